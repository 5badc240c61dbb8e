"""The ladder of the optimiser: for every rung a boundary on which all rungs before it fail.

The cases are strong deformations found by a random search (`docs/stages/optimisation.md` gives its numbers). They are
made of control points, so that neither registration nor fit has a part in them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

import models
import patchtransfer as pt
import targets
from failing import hopeless
from patchtransfer import MultiPatch
from patchtransfer.interior import optimizer as optimize
from patchtransfer.interior.optimizer import SplineOptimizer, optimize_with_ladder
from patchtransfer.progress import Budget

RUNGS = ("optimise", "nodes added where the proof failed", "twice the nodes", "area weight 1", "continuation")


def pinch(centre, degrees: float, width: float, depth: float) -> targets.Deformation:
    """Make a neck: scale across a direction by 1 - depth at the centre, less and less away from it."""
    at, angle = np.asarray(centre), np.radians(degrees)
    along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])

    def f(x: np.ndarray) -> np.ndarray:
        s, t = (x - at) @ along, (x - at) @ across
        scale = 1 - depth * np.exp(-(s**2) / (2 * width**2))
        return at + np.outer(s, along) + np.outer(t * scale, across)

    return f


def turned_hole(mp: MultiPatch, degrees: float, scale: float) -> np.ndarray:
    """Shared points with the inner loop turned and scaled; the outer one stays."""
    t, points = mp.topology, mp.topology.coordinates.copy()
    inner = np.unique(np.concatenate([side.points(t.points[side.patch]) for side in t.loops[1]]))
    points[inner] = targets.similarity(degrees, scale)(points[inner])
    return points


@dataclass(frozen=True)
class Case:
    """A source, its shared points with the new boundary, and the rung that first gives a certified map."""

    name: str
    model: Callable[[], MultiPatch]
    move: Callable[[MultiPatch], np.ndarray]
    rung: str

    def __str__(self) -> str:
        return self.name

    @classmethod
    def of(cls, name: str, model: Callable[[], MultiPatch], f: Callable, rung: str) -> Case:
        return cls(name, model, lambda mp: f(mp)(mp.topology.coordinates), rung)


CASES = [
    Case.of("bend", lambda: models.o_grid(3, 2), lambda mp: targets.bend(mp, 80), "optimise"),
    Case(
        "hole turned by 150 degrees", lambda: models.annulus(4, 2, 2), lambda mp: turned_hole(mp, 150, 0.7), "optimise"
    ),
    Case.of(
        "neck in a star",
        lambda: models.star(5, 3, 2),
        lambda mp: pinch((-0.3463052, 0.77270784), np.degrees(72.85815149078717), 0.6498128789985449, 1.2 * 0.83),
        "nodes added where the proof failed",
    ),
    Case.of(
        "thinner neck in a star",
        lambda: models.star(5, 3, 2),
        lambda mp: pinch((-0.3463052, 0.77270784), np.degrees(72.85815149078717), 0.6498128789985449, 1.2 * 0.8359375),
        "twice the nodes",
    ),
    Case.of(
        "neck in a strip of Bézier patches",
        lambda: models.strip(5, 4, 1),
        lambda mp: pinch((3.47493476, 0.25412518), np.degrees(300.9213728468286), 0.2708667463234203, 1.2 * 0.875),
        "area weight 1",
    ),
    Case.of(
        "corner pressed towards a hole",
        lambda: models.plate_with_hole(3, 2),
        lambda mp: targets.bump(mp, (0, 1), 0.477 * 1.3 * np.array([0.7, -0.5]), 0.16135800297774736 / 2),
        "continuation",
    ),
]


@pytest.mark.parametrize("case", CASES, ids=str)
def test_every_rung_is_needed_by_some_boundary(case):
    """All rungs before fail, on the numbers alone: the certificate of each of their maps is in the log."""
    mp = case.model()
    found = pt.TransferPlan(mp, "c0").refill(case.move(mp))
    log = [entry.split(":")[0] for entry in found.log]
    assert found.certificate.status == "certified"
    assert log[-1] == case.rung
    # In order, and none left out but added nodes, which need a map without folds at the nodes there are.
    passed = list(dict.fromkeys(log))
    expected = RUNGS[: RUNGS.index(case.rung) + 1]
    assert [rung for rung in passed if rung != RUNGS[1]] == [rung for rung in expected if rung != RUNGS[1]]
    assert all(not entry.endswith(" certified") for entry in found.log[:-1])
    assert found.log[-1].endswith(" certified")
    # Nothing else certifies it: the check is of the model as it is written.
    assert pt.certify(found.multipatch).status == "certified"


def test_the_harmonic_map_is_enough_for_mild_targets_only():
    for name, degrees in (("o-grid p3", 10), ("star of valence 5, p3", 10)):
        mp = models.ALL[name]()
        t, optimizer = mp.topology, SplineOptimizer(mp.topology)
        points = targets.bend(mp, degrees)(t.coordinates)
        assert pt.certify(mp.with_shared_points(optimizer.harmonic(points))).injective
    # And folds where the optimiser does not: a turned hole takes the harmonic map through itself.
    mp = models.annulus(4, 2, 2)
    optimizer = SplineOptimizer(mp.topology)
    harmonic = optimizer.harmonic(turned_hole(mp, 150, 0.7))
    assert optimizer.minimum_determinant(harmonic) < -0.1
    found = optimizer.minimise(harmonic)
    assert found.min_determinant > 0.05
    # Untangled with ε falling while folds are left, a barrier from then on.
    folded = found.history[:, 1] <= 0
    assert folded[0]
    assert (np.diff(found.history[folded, 2]) <= 0).all()
    assert found.history[folded, 2].min() > 100 * found.history[-1, 2]
    assert (found.history[~folded, 1] > 0).all()


def test_the_harmonic_start_saves_steps():
    """It is no matter of finding a map: from the source's own interior the optimiser finds the same one."""
    for name in ("grid p2", "o-grid p3", "plate with hole p3"):
        mp = models.ALL[name]()
        t, optimizer = mp.topology, SplineOptimizer(mp.topology)
        start = t.coordinates.copy()
        start[t.boundary_points] = targets.similarity(170, 0.3, (5, 0))(targets.bend(mp, 40)(start))[t.boundary_points]
        near, far = optimizer.minimise(optimizer.harmonic(start)), optimizer.minimise(start)
        assert far.energy == pytest.approx(near.energy, rel=1e-6)
        assert len(near.history) < len(far.history)


def test_continuation_takes_smaller_steps_where_the_map_folds(monkeypatch):
    """A quarter of the way first; halved after a fold, doubled after a success."""
    case = CASES[-1]
    mp = case.model()
    t, end = mp.topology, case.move(mp)
    at, least = [], []

    class Watched(SplineOptimizer):
        def minimise(self, points, *args, **options):
            found = super().minimise(points, *args, **options)
            b = t.boundary_points
            way = (points[b] - t.coordinates[b]).ravel() @ (end[b] - t.coordinates[b]).ravel()
            at.append(way / ((end[b] - t.coordinates[b]) ** 2).sum())
            least.append(found.min_determinant)
            return found

    optimizer = Watched(t, nodes_per_degree=4)
    found = optimize._continue_boundary(optimizer, t.coordinates, end, t.boundary_points, lambda points: points)
    assert found is not None
    np.testing.assert_array_equal(found[t.boundary_points], end[t.boundary_points])
    rejected = [x for x, d in zip(at, least, strict=True) if d <= 0]
    taken = [x for x, d in zip(at, least, strict=True) if d > 0]
    assert rejected
    assert (np.diff(taken) > 0).all()
    assert np.diff(taken).min() < np.diff(taken).max() / 2
    # Without a path it says so.
    crossed = end.copy()
    corner = t.loops[0][0].points(t.points[t.loops[0][0].patch])[0]
    crossed[corner] = -2.0 * crossed[corner]
    assert optimize._continue_boundary(optimizer, t.coordinates, crossed, t.boundary_points, lambda x: x) is None


@pytest.mark.parametrize("work", [0.0, 1e5, 1e6, 3e6])
def test_the_ladder_keeps_to_its_budget(work):
    """Whatever is left, the first rung is climbed; after it steps are only taken as far as the budget reaches."""
    case = CASES[-1]
    mp = case.model()
    t, spent = mp.topology, []

    class Watched(SplineOptimizer):
        def minimise(self, points, *args, **options):
            found = super().minimise(points, *args, **options)
            spent.append(len(found.history) * self.step_cost)
            return found

    _, certificate, log = optimize_with_ladder(
        lambda **options: Watched(t, **options),
        case.move(mp),
        lambda points: pt.certify(mp.with_shared_points(points)),
        source=t.coordinates,
        boundary=t.boundary_points,
        budget=Budget(work),
    )
    assert not certificate.injective
    assert spent[0] > 0
    assert sum(spent[1:]) <= work
    assert (len(spent) > 1) == (work > 0)
    assert log[-1] == "stopped by the budget of Newton steps: what would be tried next seldom helps"


@pytest.mark.parametrize("continuity", ["c0", "c1"])
def test_uniform_refinement_is_needed_by_some_boundary(continuity):
    mp, target, landmarks = hopeless()
    with pytest.raises(pt.NotCertifiedError) as failure:
        pt.transfer(mp, target, landmarks, continuity, refine="never")
    assert failure.value.result.boundary_error < 1e-3
    tried = [entry.split(":")[0] for entry in failure.value.result.log]
    assert tried[-1] == "continuation"
    result = pt.transfer(mp, target, landmarks, continuity)
    assert result.certificate.status == "certified"
    # Reported, conforming, and on the same patches.
    assert any("refined uniformly: one knot in every span of every patch" in note for note in result.warnings)
    assert result.multipatch.interfaces == mp.interfaces
    assert [np.unique(k).size for p in result.multipatch.patches for k in p.knots] == [3] * 10
    assert pt.certify(pt.MultiPatch(result.multipatch.patches, mp.interfaces)).status == "certified"
