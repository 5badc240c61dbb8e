"""Compare with a NumPy/SciPy optimiser and with G+Smo, in one process: ``python transfer_yeti.py [MODEL.xml]``.

The target is the model's own boundary, bent; without a model the bundled wrench is bent. Absolute times depend on the
machine; what counts are the ratios. G+Smo takes part where ``pip install pygismo`` works: `gsBarrierPatch2` on the
same target boundary, started from the same harmonic map, once with free interfaces (the same problem) and once patch by
patch (easier: interfaces stay as they are). Its wheel ignores its options and runs the PDE method.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import scipy.sparse as sp
from scipy.interpolate import BSpline
from scipy.sparse.linalg import splu

import patchtransfer as pt
from patchtransfer import examples
from patchtransfer.geometry.basis import knot_spans
from patchtransfer.interior.optimizer import AREA_WEIGHT, SplineOptimizer


def bend(points: np.ndarray, box: tuple[np.ndarray, np.ndarray], angle: float) -> np.ndarray:
    """Bend the plane so that the longer side of the box becomes an arc of the given angle."""
    low, size = box[0], box[1] - box[0]
    along = int(np.argmax(size))
    s, t = points[:, along] - low[along], points[:, 1 - along] - low[1 - along] - size[1 - along] / 2
    radius = size[along] / angle
    bent = np.column_stack([(radius - t) * np.sin(s / radius), radius - (radius - t) * np.cos(s / radius)])
    # An exchange of the axes would mirror.
    return bent if along == 0 else bent * [1, -1]


def bent_boundary(source: pt.MultiPatch, angle: float) -> tuple[pt.Boundary, np.ndarray]:
    points = source.topology.coordinates
    box = (points.min(axis=0), points.max(axis=0))
    loops = [
        [pt.BSplineCurve(c.knots, c.degree, bend(c.control_points, box, angle)) for c in loop]
        for loop in source.boundary().loops
    ]
    starts = [curve.start for loop in source.boundary().loops for curve in loop]
    images = [curve.start for loop in loops for curve in loop]
    return pt.Boundary(loops), np.column_stack([starts, images])


def median_time(work: Callable[[], object], repeat: int) -> float:
    work()
    times = []
    for _ in range(repeat):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return statistics.median(times)


class SciPyOptimizer:
    """The same Newton iteration in NumPy and SciPy: vectorised over all nodes, SuperLU for the systems."""

    def __init__(self, source: pt.MultiPatch) -> None:
        topology = source.topology
        self.free = np.asarray(topology.interior_points)
        along, across, weights = [], [], []
        for patch, points in zip(source.patches, topology.points, strict=True):
            (wu, bu, su), (wv, bv, sv) = (self._nodes(k, p) for k, p in zip(patch.knots, patch.degrees, strict=True))
            gather = sp.csr_array(
                (np.ones(points.size), (np.arange(points.size), points.ravel())),
                (points.size, topology.n_points),
            )
            du, dv = sp.kron(su, bv) @ gather, sp.kron(bu, sv) @ gather
            x = topology.coordinates
            ju, jv = du @ x, dv @ x
            det = ju[:, 0] * jv[:, 1] - ju[:, 1] * jv[:, 0]
            # Rows of the inverse of the reference Jacobian, applied to the parametric derivatives.
            along.append(sp.diags_array(jv[:, 1] / det) @ du - sp.diags_array(ju[:, 1] / det) @ dv)
            across.append(sp.diags_array(ju[:, 0] / det) @ dv - sp.diags_array(jv[:, 0] / det) @ du)
            weights.append(np.outer(wu, wv).ravel() * np.abs(det))
        d = [sp.csr_array(sp.vstack(blocks)) for blocks in (along, across)]
        self.weight = np.concatenate(weights) / sum(w.sum() for w in weights)
        self.full = d
        inner = [block[:, self.free] for block in d]
        # Entries of A in the order x by 1, x by 2, y by 1, y by 2 from the unknowns, all x before all y.
        self.jacobian = sp.csr_array(sp.block_diag([sp.vstack(inner), sp.vstack(inner)]))
        n = len(self.weight)
        block, node = np.meshgrid(np.arange(4), np.arange(n), indexing="ij")
        self._rows = np.broadcast_to((block * n + node)[:, None], (4, 4, n)).ravel()
        self._columns = np.broadcast_to((block * n + node)[None], (4, 4, n)).ravel()

    @staticmethod
    def _nodes(knots: np.ndarray, degree: int) -> tuple[np.ndarray, sp.csr_array, sp.csr_array]:
        """Weights of the Gauss–Lobatto nodes of all spans, and values and slopes of the basis there."""
        m = 2 * degree + 1
        legendre = np.polynomial.legendre.Legendre.basis(m - 1)
        x = np.concatenate([[-1.0], np.sort(legendre.deriv().roots().real), [1.0]])
        w = 2 / (m * (m - 1) * legendre(x) ** 2)
        breaks = knot_spans(knots)
        half = np.diff(breaks)[:, None] / 2
        nodes = ((breaks[:-1] + breaks[1:]) / 2)[:, None] + half * x
        values, slopes = [], []
        count = len(knots) - degree - 1
        for row, a, b in zip(nodes, breaks[:-1], breaks[1:], strict=True):
            # Both ends are seen from inside the span.
            inside = np.clip(row, np.nextafter(a, b), np.nextafter(b, a))
            values.append(BSpline.design_matrix(inside, knots, degree))
            basis = BSpline(knots, np.eye(count), degree)
            slopes.append(sp.csr_array(basis(inside, nu=1)))
        return (
            (half * w).ravel(),
            sp.csr_array(sp.vstack(values)),
            sp.csr_array(sp.vstack(slopes)),
        )

    def entries(self, x: np.ndarray) -> np.ndarray:
        return np.concatenate([(d @ x[:, c])[None] for c in (0, 1) for d in self.full])

    def energy(self, x: np.ndarray, scale: float) -> float:
        a = scale * self.entries(x)
        det = a[0] * a[3] - a[1] * a[2]
        if det.min() <= 0:
            return np.inf
        return float(self.weight @ (((a**2).sum(axis=0) + AREA_WEIGHT * (det**2 + 1)) / det))

    def scale(self, x: np.ndarray) -> float:
        a = self.entries(x)
        return float(self.weight @ (a[0] * a[3] - a[1] * a[2])) ** -0.5

    def derivatives(self, x: np.ndarray, scale: float) -> tuple[np.ndarray, sp.csc_array]:
        """Gradient and projected Hessian of the energy, all x before all y."""
        a = scale * self.entries(x)
        det = a[0] * a[3] - a[1] * a[2]
        by_det = np.stack([a[3], -a[2], -a[1], a[0]])
        norm = (a**2).sum(axis=0)
        # f = (|A|² + λ) / D + λ D.
        first = -(norm + AREA_WEIGHT) / det**2 + AREA_WEIGHT
        second = 2 * (norm + AREA_WEIGHT) / det**3
        gradient = self.weight * (2 * a / det + first * by_det)
        cross = -2 / det**2 * a[:, None] * by_det[None]
        hessian = second * by_det[:, None] * by_det[None] + cross + cross.transpose(1, 0, 2)
        hessian += 2 / det * np.eye(4)[:, :, None]
        hessian += first * np.fliplr(np.diag([1.0, -1.0, -1.0, 1.0]))[:, :, None]
        value, vector = np.linalg.eigh(hessian.transpose(2, 0, 1))
        value = np.maximum(value, 1e-9 * value[:, -1:]) * self.weight[:, None]
        blocks = np.einsum("nik,nk,njk->ijn", vector, value, vector)
        middle = sp.csr_array((blocks.ravel(), (self._rows, self._columns)))
        system = sp.csc_array(self.jacobian.T @ middle @ self.jacobian) * scale**2
        return scale * (self.jacobian.T @ gradient.ravel()), system

    def step(self, x: np.ndarray, scale: float) -> tuple[np.ndarray, float]:
        """One projected Newton step with line search from a feasible map, and its relative decrement."""
        rhs, system = self.derivatives(x, scale)
        direction = -splu(system, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).solve(rhs)
        slope, energy, length = float(rhs @ direction), self.energy(x, scale), 1.0
        while True:
            trial = x.copy()
            trial[self.free] += length * direction.reshape(2, -1).T
            if self.energy(trial, scale) < energy + 1e-4 * length * slope or length < 1e-8:
                return trial, -slope / energy
            length /= 2

    def minimise(self, x: np.ndarray, tolerance: float = 1e-8) -> tuple[np.ndarray, int]:
        scale = self.scale(x)
        for count in range(1, 200):
            moved, decrement = self.step(x, scale)
            if decrement < tolerance:
                return x, count
            x = moved
        return x, count


def gismo(model: pt.MultiPatch, patch_by_patch: bool, repeat: int) -> tuple[float, pt.MultiPatch] | None:
    """Time of `gsBarrierPatch2` and its result in the model's own orientation; None where it is not installed."""
    try:
        import pygismo
    except ImportError:
        return None
    patches = pygismo.core.gsMultiPatch()
    for patch, sign in zip(model.patches, model.topology.orientation, strict=True):
        # Every patch right-handed, or the result is folded.
        knots_u, points = patch.knots[0], patch.control_points
        if sign < 0:
            knots_u, points = knots_u[0] + knots_u[-1] - knots_u[::-1], points[::-1]
        basis = pygismo.nurbs.gsTensorBSplineBasis2(
            *(
                pygismo.nurbs.gsKnotVector(k.tolist(), p)
                for k, p in zip((knots_u, patch.knots[1]), patch.degrees, strict=True)
            )
        )
        coefficients = np.asfortranarray(points.transpose(1, 0, 2).reshape(-1, 2))
        patches.addPatch(pygismo.nurbs.gsTensorBSpline2(basis, coefficients))
    patches.computeTopology(1e-6 * model.diameter, False, False)

    def compute() -> object:
        method = pygismo.modelling.gsBarrierPatch2(patches, patch_by_patch)
        method.compute()
        return method.result()

    with _silent():
        seconds = median_time(compute, repeat)
        found = compute()
    points = []
    for k, (patch, sign) in enumerate(zip(model.patches, model.topology.orientation, strict=True)):
        grid = np.asarray(found.patch(k).coefs()).reshape(*patch.shape[::-1], 2).transpose(1, 0, 2)
        points.append(grid[::-1] if sign < 0 else grid)
    return seconds, model.with_control_points(points)


@contextmanager
def _silent() -> Iterator[None]:
    """Keep what C++ writes on standard output out of the table."""
    sys.stdout.flush()
    kept = os.dup(1)
    with open(os.devnull, "wb") as nothing:
        os.dup2(nothing.fileno(), 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model", nargs="?", help="multi-patch (G+Smo XML); default the bundled wrench")
    parser.add_argument("--angle", type=float, default=40.0, help="bend in degrees (default 40)")
    parser.add_argument("--repeat", type=int, default=20, help="repetitions of which the median counts (default 20)")
    options = parser.parse_args()
    source = pt.read(options.model) if options.model else examples.load("wrench")[0]
    target, landmarks = bent_boundary(source, np.radians(options.angle))
    print(f"{source}\nbent by {options.angle:g}°, {len(source.topology.interior_points)} unknown points\n")

    result = pt.transfer(source, target, landmarks, continuity="c0")
    whole = median_time(lambda: pt.transfer(source, target, landmarks, continuity="c0"), options.repeat)
    plan = pt.TransferPlan(source, continuity="c0")
    planned = median_time(lambda: plan.transfer(target, landmarks), options.repeat)

    # The fitted boundary is the common problem of all optimisers; the harmonic map is their common start.
    topology = source.topology
    start = topology.coordinates.copy()
    for points, patch in zip(topology.points, result.multipatch.patches, strict=True):
        start[points] = patch.control_points
    optimizer = SplineOptimizer(topology)
    start = optimizer.harmonic(start)
    if optimizer.minimum_determinant(start) <= 0:
        raise SystemExit("the harmonic start is folded at this bend, and the reference starts feasible; bend less")
    ours = optimizer.minimise(start)
    steps = len(ours.history)
    rust = median_time(lambda: optimizer.minimise(start), options.repeat)
    reference = SciPyOptimizer(source)
    found, reference_steps = reference.minimise(start)
    scipy = median_time(lambda: reference.minimise(start), max(3, options.repeat // 5))
    apart = float(np.abs(found - ours.points).max()) / source.diameter
    if apart > 1e-4:
        raise SystemExit(f"the two optimisers disagree by {apart:.1e} of the diameter: no comparison")

    rows = [
        ("transfer(), all stages", whole, 1.0, f"{result.certificate.status}, {_quality(result.multipatch)}"),
        ("TransferPlan.transfer()", planned, whole / planned, "source-only work kept"),
        ("optimiser", rust, 1.0, f"{steps} Newton steps of {1e3 * rust / steps:.2f} ms"),
        (
            "optimiser in NumPy and SciPy",
            scipy,
            scipy / rust,
            f"{reference_steps} steps of {1e3 * scipy / reference_steps:.2f} ms, a step "
            f"{scipy / reference_steps / (rust / steps):.1f} times as long; same minimum to {apart:.0e}",
        ),
    ]
    initial = source.with_control_points([start[p] for p in topology.points])
    for name, patch_by_patch in (("all patches", False), ("patch by patch", True)):
        peer = gismo(initial, patch_by_patch, max(3, options.repeat // 5))
        if peer is not None:
            rows.append((f"gsBarrierPatch2, {name}", peer[0], peer[0] / rust, _quality(peer[1])))
    print(f"{'':30} {'median':>10}   ratio")
    for name, seconds, ratio, note in rows:
        print(f"{name:30} {1e3 * seconds:7.2f} ms  {ratio:6.2f}   {note}")
    print("\nRatios: the plan's is transfer() over it; all others are over the optimiser.")
    if len(rows) == 4:
        print("G+Smo is missing: pip install pygismo")


def _quality(model: pt.MultiPatch) -> str:
    metrics = pt.quality(model)
    folded = f", {metrics.nonpositive} of {metrics.n_samples} samples folded" if metrics.nonpositive else ""
    return f"scaled Jacobian min {metrics.scaled_jacobian.min:.3f} mean {metrics.scaled_jacobian.mean:.3f}{folded}"


if __name__ == "__main__":
    main()
