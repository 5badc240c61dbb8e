"""The optimiser against a dense NumPy version of its energy, and what must not depend on anything."""

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from numpy.polynomial.legendre import Legendre
from scipy.optimize import minimize
from scipy.sparse import csc_array, eye_array
from scipy.spatial import cKDTree

import models
import targets
from patchtransfer import MultiPatch, Patch, certify
from patchtransfer.errors import InputError
from patchtransfer.geometry.basis import collocation_matrix
from patchtransfer.interior.optimizer import AREA_WEIGHT, SplineOptimizer, degenerate_corners, optimize_with_ladder
from shapes import mirrored

NAMES = ["grid p2", "plate with hole p2", "o-grid p3", "star of valence 5, p3", "l-shape p3"]


def lobatto(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Extrema of the Legendre polynomial and the ends."""
    p = Legendre.basis(n - 1)
    x = np.concatenate([[-1.0], np.sort(p.deriv().roots().real), [1.0]])
    return x, 2 / (n * (n - 1) * p(x) ** 2)


@dataclass
class Dense:
    """All nodes of a multi-patch at once: parametric derivatives are matrices that act on the shared points."""

    du: np.ndarray
    dv: np.ndarray
    inverse: np.ndarray
    weights: np.ndarray
    free: np.ndarray

    @classmethod
    def of(cls, mp: MultiPatch, nodes_per_degree: int = 2) -> "Dense":
        t, rows_u, rows_v, weights = mp.topology, [], [], []
        for patch, numbers in zip(mp.patches, t.points, strict=True):
            along = []
            for knots, degree in zip(patch.knots, patch.degrees, strict=True):
                x, w = lobatto(nodes_per_degree * degree + 1)
                breaks = np.unique(knots)
                half = np.diff(breaks)[:, None] / 2
                nodes = (breaks[:-1, None] + half * (1 + x)).ravel()
                # The knots are simple and the degree at least 2, so derivatives agree on both sides of a knot.
                values, slopes = (collocation_matrix(knots, degree, nodes, k) for k in (0, 1))
                along.append((values, slopes, (half * w).ravel()))
            (a, da, wa), (b, db, wb) = along
            spread = np.zeros((numbers.size, t.n_points))
            spread[np.arange(numbers.size), numbers.ravel()] = 1
            rows_u.append(np.kron(da, b) @ spread)
            rows_v.append(np.kron(a, db) @ spread)
            weights.append(np.kron(wa, wb))
        du, dv = np.concatenate(rows_u), np.concatenate(rows_v)
        x = t.coordinates
        reference = np.stack([du @ x, dv @ x], axis=-1)
        w = np.concatenate(weights) * np.abs(np.linalg.det(reference))
        return cls(du, dv, np.linalg.inv(reference), w / w.sum(), t.interior_points)

    def jacobians(self, x):
        """A = J(x) J_reference⁻¹; complex for the complex-step derivative."""
        return np.stack([self.du @ x, self.dv @ x], axis=-1) @ self.inverse

    def scale(self, x) -> float:
        return float(self.weights @ np.linalg.det(self.jacobians(x)))

    def energy(self, x, area_weight: float = AREA_WEIGHT, eps: float = 1e-9, scale: float | None = None):
        a = self.jacobians(x) / np.sqrt(self.scale(x) if scale is None else scale)
        det = a[:, 0, 0] * a[:, 1, 1] - a[:, 0, 1] * a[:, 1, 0]
        root = np.sqrt(eps**2 + det**2)
        chi = np.where(det.real > 0, det + root, eps**2 / np.where(det.real > 0, 1, root - det)) / 2
        return self.weights @ (((a * a).sum(axis=(1, 2)) + area_weight * (det**2 + 1)) / chi)

    def gradient(self, x, area_weight: float = AREA_WEIGHT) -> np.ndarray:
        """For fold-free maps (ε = 0), for the free points."""
        scale = np.sqrt(self.scale(x))
        a = self.jacobians(x) / scale
        det = np.linalg.det(a)
        numerator = (a * a).sum(axis=(1, 2)) + area_weight * (det**2 + 1)
        by_det = 2 * area_weight - numerator / det**2
        cofactor = det[:, None, None] * np.linalg.inv(a).swapaxes(1, 2)
        by_a = 2 * a / det[:, None, None] + by_det[:, None, None] * cofactor
        by_j = np.einsum("n,nij,nkj->nik", self.weights / scale, by_a, self.inverse)
        return (self.du.T @ by_j[:, :, 0] + self.dv.T @ by_j[:, :, 1])[self.free]

    def stiffness(self) -> np.ndarray:
        """∫ ∇φ_i · ∇φ_j on the reference."""
        g = np.einsum("nkd,nki->ndi", self.inverse, np.stack([self.du, self.dv], axis=1))
        return np.einsum("n,ndi,ndj->ij", self.weights, g, g)


def problem(name: str, degrees: float = 50.0) -> tuple[MultiPatch, np.ndarray]:
    """A model and its shared points with a bent boundary and the source's interior."""
    mp = models.ALL[name]()
    t = mp.topology
    x = t.coordinates.copy()
    x[t.boundary_points] = targets.bend(mp, degrees)(x[t.boundary_points])
    return mp, x


@pytest.mark.parametrize("name", NAMES)
def test_energy_and_determinants_agree_with_numpy(name):
    mp, x = problem(name)
    dense, optimizer = Dense.of(mp), SplineOptimizer(mp.topology)
    start = optimizer.harmonic(x)
    for weight in (0.3, 1.0):
        found = optimizer.minimise(start, weight)
        assert found.stop == "converged"
        assert found.energy == pytest.approx(dense.energy(found.points, weight), rel=1e-12)
        assert found.history[0, 0] == pytest.approx(dense.energy(start, weight, found.history[0, 2]), rel=1e-11)
    a = np.linalg.det(dense.jacobians(start))
    assert optimizer.minimum_determinant(start) == pytest.approx(a.min() / (dense.weights @ a), rel=1e-11)
    assert np.array_equal(found.points[mp.topology.boundary_points], x[mp.topology.boundary_points])


@pytest.mark.parametrize("name", ["grid p2", "o-grid p3"])
def test_more_nodes_and_other_references_agree_with_numpy(name):
    mp, x = problem(name)
    optimizer = SplineOptimizer(mp.topology, nodes_per_degree=4)
    found = optimizer.minimise(optimizer.harmonic(x))
    assert found.energy == pytest.approx(Dense.of(mp, 4).energy(found.points), rel=1e-12)
    t = mp.topology
    other = mp.with_control_points([(t.coordinates * [2.0, 0.7])[p] for p in t.points])
    stretched = SplineOptimizer(t, other.patches)
    found = stretched.minimise(stretched.harmonic(x))
    assert found.energy == pytest.approx(Dense.of(other).energy(found.points), rel=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_the_result_is_a_minimum(name):
    """Another minimiser finds nothing lower than the tolerance of the decrement allows."""
    mp, x = problem(name)
    dense, optimizer = Dense.of(mp), SplineOptimizer(mp.topology)
    start = optimizer.harmonic(x)
    found = optimizer.minimise(start)
    assert found.stop == "converged"
    assert found.history[-1, 3] < 1e-8
    assert (np.diff(found.history[:, 0]) <= 0).all()
    scale, free = dense.scale(x), dense.free

    def placed(z):
        y = found.points.copy()
        y[free] = z.reshape(-1, 2)
        return y

    # The gradient used below is that of the energy: complex step in a random direction.
    direction = np.zeros(x.shape)
    direction[free] = np.random.default_rng(1).normal(size=(len(free), 2))
    step = dense.energy(found.points + 1e-30j * direction, scale=scale).imag / 1e-30
    gradient = dense.gradient(found.points)
    assert (gradient * direction[free]).sum() == pytest.approx(step, abs=1e-12)
    assert np.abs(gradient).max() < 1e-3
    other = minimize(
        lambda z: dense.energy(placed(z)),
        found.points[free].ravel(),
        jac=lambda z: dense.gradient(placed(z)).ravel(),
        method="L-BFGS-B",
        options={"maxiter": 60, "ftol": 1e-15, "gtol": 1e-10},
    )
    assert found.energy * (1 - 2e-8) < other.fun <= found.energy * (1 + 1e-13)


@pytest.mark.parametrize("name", models.ALL)
def test_harmonic_maps(name):
    """Identity on the source; linear precision; Galerkin orthogonality against a dense solve."""
    mp, x = problem(name)
    t, optimizer = mp.topology, SplineOptimizer(mp.topology)
    lost = t.coordinates.copy()
    lost[t.interior_points] = 0
    np.testing.assert_allclose(optimizer.harmonic(lost), t.coordinates, atol=1e-12 * mp.diameter)
    matrix = np.array([[1.3, 0.4], [-0.2, 0.8]])
    affine = t.coordinates @ matrix + [5, -3]
    lost[t.boundary_points] = affine[t.boundary_points]
    np.testing.assert_allclose(optimizer.harmonic(lost), affine, atol=1e-12 * mp.diameter)
    if name in NAMES:
        k, f, b = Dense.of(mp).stiffness(), t.interior_points, t.boundary_points
        expected = np.linalg.solve(k[np.ix_(f, f)], -k[np.ix_(f, b)] @ x[b])
        np.testing.assert_allclose(optimizer.harmonic(x)[f], expected, atol=1e-11 * mp.diameter)


@pytest.mark.parametrize("name", NAMES)
def test_similarities_give_the_image_of_the_source(name):
    """All A are one rotation there: the energy has its least value 2 + 2 λ."""
    mp = models.ALL[name]()
    t, optimizer = mp.topology, SplineOptimizer(mp.topology)
    for angle, scale in ((0, 1), (130, 0.01), (-40, 300)):
        image = targets.similarity(angle, scale, (4, -7))(t.coordinates)
        start = t.coordinates * scale
        start[t.boundary_points] = image[t.boundary_points]
        found = optimizer.minimise(optimizer.harmonic(start))
        np.testing.assert_allclose(found.points, image, atol=1e-11 * scale * mp.diameter)
        assert found.energy == pytest.approx(2 + 2 * AREA_WEIGHT, rel=1e-12)
        assert found.min_determinant == pytest.approx(1, rel=1e-10)


@pytest.mark.parametrize("name", ["grid p2", "o-grid p3"])
def test_results_follow_similarities_of_the_target(name):
    mp, x = problem(name)
    optimizer = SplineOptimizer(mp.topology)
    move = targets.similarity(77, 3.0, (1, 2))
    a = optimizer.minimise(optimizer.harmonic(x))
    b = optimizer.minimise(optimizer.harmonic(move(x)))
    np.testing.assert_allclose(b.points, move(a.points), atol=1e-9 * mp.diameter)
    assert b.energy == pytest.approx(a.energy, rel=1e-10)


@pytest.mark.parametrize("name", NAMES)
def test_handedness_of_patches_does_not_matter(name):
    """The model's patches are turned at random; the same model with all of them as built gives the same map."""
    mp, x = problem(name)
    plain = MultiPatch(
        [
            Patch(p.knots, p.degrees, p.control_points) if s > 0 else mirrored(p)
            for p, s in zip(mp.patches, mp.topology.orientation, strict=True)
        ]
    )
    a = SplineOptimizer(mp.topology).minimise(SplineOptimizer(mp.topology).harmonic(x))
    t = plain.topology
    y = t.coordinates.copy()
    y[t.boundary_points] = targets.bend(mp, 50.0)(y[t.boundary_points])
    b = SplineOptimizer(t).minimise(SplineOptimizer(t).harmonic(y))
    # The energy is flat at its minimum, so it agrees better than the points.
    assert b.energy == pytest.approx(a.energy, rel=1e-10)
    assert cKDTree(a.points).query(b.points)[0].max() < 1e-5 * mp.diameter


# --- null spaces ----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["grid p2", "o-grid p3"])
def test_identity_null_space_changes_nothing(name):
    mp, x = problem(name)
    n = len(mp.topology.interior_points)
    plain = SplineOptimizer(mp.topology)
    with_identity = SplineOptimizer(mp.topology, null_space=csc_array(eye_array(n)))
    np.testing.assert_allclose(with_identity.harmonic(x), plain.harmonic(x), atol=1e-12 * mp.diameter)
    a, b = plain.minimise(plain.harmonic(x)), with_identity.minimise(with_identity.harmonic(x))
    np.testing.assert_allclose(b.points, a.points, atol=1e-12 * mp.diameter)


def random_basis(n: int, seed: int) -> csc_array:
    """A sparse orthogonal matrix: random rotations of random pairs."""
    rng = np.random.default_rng(seed)
    z = np.eye(n)
    for _ in range(2 * n):
        i, j = rng.choice(n, 2, replace=False)
        c, s = np.cos(a := rng.uniform(0, 6)), np.sin(a)
        z[:, [i, j]] = z[:, [i, j]] @ np.array([[c, -s], [s, c]])
    z = z[:, rng.permutation(n)]
    np.testing.assert_allclose(z.T @ z, np.eye(n), atol=1e-12)
    return csc_array(z)


@pytest.mark.parametrize("name", ["grid p2", "star of valence 5, p3"])
def test_other_coordinates_give_the_same_map(name):
    mp, x = problem(name)
    plain = SplineOptimizer(mp.topology)
    turned = SplineOptimizer(mp.topology, null_space=random_basis(len(mp.topology.interior_points), 4))
    np.testing.assert_allclose(turned.harmonic(x), plain.harmonic(x), atol=1e-11 * mp.diameter)
    # Newton's method does not see the coordinates.
    a, b = plain.minimise(plain.harmonic(x)), turned.minimise(turned.harmonic(x))
    assert len(a.history) == len(b.history)
    np.testing.assert_allclose(b.points, a.points, atol=1e-10 * mp.diameter)


@pytest.mark.parametrize("name", ["grid p2", "o-grid p3"])
def test_tied_points_stay_tied_and_the_rest_is_minimal(name):
    """Points i and j move together, k is the mean of the two: as by elimination."""
    mp, x = problem(name, 25)
    t, dense = mp.topology, Dense.of(mp)
    free = t.interior_points
    n = len(free)
    i, j, k = n // 3, n // 2, n - 2
    z = np.eye(n)
    z[j], z[k] = z[i], 0.5 * z[i] + 0.5 * z[0]
    z = np.delete(z, [j, k], axis=1)
    optimizer = SplineOptimizer(t, null_space=csc_array(z))
    harmonic = optimizer.harmonic(x)
    stiffness = dense.stiffness()
    kff = z.T @ stiffness[np.ix_(free, free)] @ z
    move = np.linalg.solve(kff, -z.T @ (stiffness @ x)[free])
    np.testing.assert_allclose(harmonic[free], x[free] + z @ move, atol=1e-11 * mp.diameter)
    found = optimizer.minimise(harmonic)
    for points in (harmonic, found.points):
        shift = (points - x)[free]
        np.testing.assert_allclose(shift[j], shift[i], atol=1e-13 * mp.diameter)
        np.testing.assert_allclose(shift[k], (shift[i] + shift[0]) / 2, atol=1e-13 * mp.diameter)
    gradient = dense.gradient(found.points)
    # The ties bite: without them the energy would still fall.
    assert np.abs(z.T @ gradient).max() < 0.1 * np.abs(gradient).max()
    assert found.energy > SplineOptimizer(t).minimise(harmonic).energy * (1 + 1e-7)


# --- folds, interruption, threads -----------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_folded_starts_are_untangled(name):
    mp, x = problem(name)
    t, optimizer = mp.topology, SplineOptimizer(mp.topology)
    best = optimizer.minimise(optimizer.harmonic(x))
    rng = np.random.default_rng(8)
    for size in (0.1, 0.5):
        start = best.points.copy()
        start[t.interior_points] += size * rng.normal(size=(len(t.interior_points), 2))
        assert optimizer.minimum_determinant(start) < 0
        found = optimizer.minimise(start)
        assert found.min_determinant > 0
        assert certify(mp.with_control_points([found.points[p] for p in t.points])).injective
        assert found.energy == pytest.approx(best.energy, rel=1e-6)
    # Once free of folds, it stays so.
    positive = found.history[:, 1] > 0
    assert (np.diff(positive.astype(int)) >= 0).all()


def test_interior_turned_inside_out_is_untangled():
    mp, x = problem("grid p2")
    t = mp.topology
    x[t.interior_points] = x.mean(axis=0) - 1.5 * (x[t.interior_points] - x.mean(axis=0))
    found = SplineOptimizer(t).minimise(x)
    assert found.min_determinant > 0


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_exceptions_of_the_callback_come_through(error):
    mp, x = problem("o-grid p3")
    optimizer = SplineOptimizer(mp.topology)
    calls = []

    def progress(step, energy, determinant):
        calls.append((step, energy, determinant))
        if step == 2:
            raise error("enough")

    with pytest.raises(error, match="enough"):
        optimizer.minimise(optimizer.harmonic(x), progress=progress)
    assert [c[0] for c in calls] == [1, 2]
    # It can be used again, and tells every step.
    calls.clear()
    found = optimizer.minimise(optimizer.harmonic(x), progress=lambda *a: calls.append(a))
    np.testing.assert_array_equal(np.array(calls)[:, 1:], found.history[:, :2])
    again = SplineOptimizer(mp.topology)
    assert np.array_equal(again.minimise(again.harmonic(x)).points, found.points)


def test_the_step_limit_is_kept():
    mp, x = problem("o-grid p3")
    optimizer = SplineOptimizer(mp.topology)
    found = optimizer.minimise(optimizer.harmonic(x), max_steps=2)
    assert (len(found.history), found.stop) == (2, "step limit")


SCRIPT = """
import sys, hashlib
import numpy as np
sys.path.insert(0, sys.argv[1])
from patchtransfer import _core
import models, targets
from patchtransfer.interior.optimizer import SplineOptimizer
_core.set_threads(int(sys.argv[2]))
for mp in (models.o_grid(3, 4), models.plate_with_hole(2, 5)):
    t = mp.topology
    x = t.coordinates.copy()
    x[t.boundary_points] = targets.bend(mp, 50)(x[t.boundary_points])
    o = SplineOptimizer(t)
    out = o.minimise(o.harmonic(x))
    print(hashlib.sha256(out.points.tobytes() + out.history.tobytes()).hexdigest(), out.energy.hex())
"""


def test_results_do_not_depend_on_the_number_of_threads():
    here = str(Path(__file__).parents[1] / "support")
    output = [
        subprocess.run(
            [sys.executable, "-c", SCRIPT, here, str(n)], capture_output=True, text=True, check=True, env=os.environ
        ).stdout
        for n in (1, 2)
    ]
    assert output[0].count("\n") == 2
    assert output[0] == output[1]


# --- corners and the ladder -----------------------------------------------------------------------


def flat_corner() -> MultiPatch:
    """One patch with a corner of 180 degrees."""
    return models.build([models.bilinear((0, 0), (2, 0), (1, 1), (0, 2))], 2, 2, None)


def test_degenerate_corners_are_found_and_left_out():
    mp = flat_corner()
    assert degenerate_corners(mp.patches) == [(0, 3)]
    assert degenerate_corners(models.o_grid().patches) == []
    # Singular at a node: refused unless the corner is left out.
    with pytest.raises(InputError, match=r"patch 0 is singular at \(u, v\) = \(1, 1\)"):
        SplineOptimizer(mp.topology)
    optimizer = SplineOptimizer(mp.topology, excluded_corners=[(0, 3)])
    x = mp.topology.coordinates
    found = optimizer.minimise(optimizer.harmonic(x))
    np.testing.assert_allclose(found.points, x, atol=1e-10)


def test_extra_nodes_raise_the_determinant_there():
    mp, x = problem("grid p2")
    plain = SplineOptimizer(mp.topology)
    start = plain.harmonic(x)
    node = (1, 0.123, 0.456)
    more = SplineOptimizer(mp.topology, extra_nodes=[node] * 40)

    def distortion(points):
        t, (k, u, v) = mp.topology, node
        source, image = mp.patches[k], mp.patches[k].with_control_points(points[t.points[k]])
        j = [np.stack([p.grid([u], [v], 1, 0)[0, 0], p.grid([u], [v], 0, 1)[0, 0]], axis=-1) for p in (source, image)]
        a = j[1] @ np.linalg.inv(j[0])
        return (a * a).sum() / np.linalg.det(a)

    assert distortion(more.minimise(start).points) < distortion(plain.minimise(start).points) - 1e-6


def climbed(mp: MultiPatch, x: np.ndarray, **options):
    """What the ladder makes of shared points with a new boundary."""
    t = mp.topology
    return optimize_with_ladder(
        lambda **options: SplineOptimizer(t, **options),
        x,
        lambda points: certify(mp.with_control_points([points[p] for p in t.points])),
        source=t.coordinates,
        boundary=t.boundary_points,
        **options,
    )


def test_the_ladder_stops_at_the_first_proof_and_tells_what_it_did():
    mp, x = problem("o-grid p3")
    steps = []
    found, certificate, log = climbed(mp, x, progress=lambda *a: steps.append(a))
    assert certificate.status == "certified"
    assert len(log) == 1
    assert log[0].startswith("optimise: ")
    assert len(steps) == len(found.history)
    assert {s[0] for s in steps} == {"optimise"}


def test_the_ladder_climbs_every_rung_without_proof():
    """A boundary that crosses itself has no fold-free map; the best one found comes back."""
    mp, x = problem("grid p2", 20)
    t = mp.topology
    corner = t.loops[0][0].points(t.points[t.loops[0][0].patch])[0]
    x[corner] = x.mean(axis=0) + 1.5 * (x.mean(axis=0) - x[corner])
    found, certificate, log = climbed(mp, x)
    assert certificate.status == "folded"
    assert found.min_determinant < 0
    assert [entry.split(":")[0] for entry in log] == ["optimise", "twice the nodes", "area weight 1", "continuation"]
