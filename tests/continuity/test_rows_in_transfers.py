"""C1 and vertex rows in transfers: kept wherever they can be, and released or reported where not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import models
import patchtransfer as pt
import real
import targets
from patchtransfer import examples
from patchtransfer.continuity.interfaces import ControlRows, chord_ratios, control_rows
from patchtransfer.continuity.null_space import row_space
from patchtransfer.continuity.rows import C1Rows, ContinuityRows
from patchtransfer.geometry.basis import collocation_matrix, knot_spans
from patchtransfer.interior import solver as interior
from patchtransfer.interior import under_rows as constrained
from patchtransfer.interior.optimizer import SplineOptimizer
from patchtransfer.interior.under_rows import best_under_rows
from patchtransfer.pipeline import inside
from strategies import deformations, layouts


def kinks(r: ControlRows, points: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Angles between D_R and -D_L in degrees."""
    left, right, _ = r.derivatives(
        points, collocation_matrix(r.knots, r.degree, t), collocation_matrix(r.knots, r.degree, t, 1)
    )
    area = np.abs(left[:, 0] * right[:, 1] - left[:, 1] * right[:, 0])
    return np.degrees(np.arctan2(area, -(left * right).sum(axis=1)))


def active_spans_are_smooth(result: pt.TransferResult, rows: ContinuityRows) -> int:
    """Kinks vanish on every knot span whose C1 rows are all active; returns the number of these spans."""
    x, found = result.multipatch.topology.coordinates, 0
    slaves = {(int(i), int(s)) for i, s in zip(rows.interface, rows.slave, strict=True) if s >= 0}
    for index, r in enumerate(control_rows(result.multipatch.topology)):
        kept = np.array([(index, int(s)) in slaves for s in r.curve])
        for low, high in zip(r.breaks[:-1], r.breaks[1:], strict=True):
            first = int(np.searchsorted(r.knots, low, side="right")) - r.degree - 1
            if kept[first : first + r.degree + 1].all():
                found += 1
                t = np.linspace(low, high, 7)[1:-1]
                assert kinks(r, x, t).max() < 1e-6
    return found


def keeps_its_rows(mp: pt.MultiPatch, target: pt.Boundary, landmarks: np.ndarray, **options) -> pt.TransferResult:
    before = pt.transfer(mp, target, landmarks, "c0", on_failure="return", **options)
    result = pt.transfer(mp, target, landmarks, on_failure="return", **options)
    assert result.certificate.injective or not before.certificate.injective
    if before.certificate.injective:
        assert result.rows is not None
        assert result.rows.residual <= 1e-10
        assert result.continuity.c0_gap == 0
        assert result.quality.scaled_jacobian.mean >= before.quality.scaled_jacobian.mean - 0.02
    return result


@pytest.mark.parametrize("name", models.ALL)
def test_transfers_keep_the_rows(name):
    mp = models.ALL[name]()
    target, landmarks = targets.deformed(mp, targets.bend(mp, 40), seed=len(name))
    result = keeps_its_rows(mp, target, landmarks)
    assert result.certificate.status == "certified"
    assert result.rows.without == ()
    assert result.rows.contradictory == ()
    t = mp.topology
    ends = {(i, at) for i, at in result.rows.released}
    control = control_rows(t)
    x = result.multipatch.topology.coordinates
    spokes = [
        s
        for around in t.spokes.values()
        for s in around
        if (s.interface, tuple(x[control[s.interface].curve[-1 if s.at_end else 0]])) in ends
    ]
    rows = C1Rows(t, control)(t.coordinates, spokes)
    assert len(rows) == result.rows.active
    assert active_spans_are_smooth(result, rows) >= (len(mp.interfaces) if name == "grid p2" else 0)


@given(data=st.data(), degree=st.integers(2, 3))
@settings(max_examples=12, deadline=None)
def test_rows_never_cost_the_certificate(data, degree):
    mp = data.draw(layouts(jitter=0.15)).multipatch(degree, 2)
    assume(pt.certify(mp).injective)
    target, landmarks = targets.deformed(mp, data.draw(deformations(mp)))
    try:
        keeps_its_rows(mp, target, landmarks)
    except pt.InfeasibleTargetError:
        assume(False)


def test_paper_method_keeps_rows_too():
    mp = models.o_grid(3, 3)
    target, landmarks = targets.deformed(mp, targets.bend(mp, 30))
    result = keeps_its_rows(mp, target, landmarks, method="paper")
    assert result.rows.active == len(C1Rows(mp.topology, control_rows(mp.topology))(mp.topology.coordinates))
    assert any(entry.startswith("under") for entry in result.log)


@real.needed
def test_rows_on_a_folded_map_follow_the_source():
    """The paper's method may fold; its rows hold all the same, with the frames of the source."""
    mp = real.model("turtle")
    target, landmarks = targets.deformed(mp, targets.articulation(mp, 45, at=0.65, blend=0.4))
    result = pt.transfer(mp, target, landmarks, "c1", "paper", on_failure="return")
    assert not result.certificate.injective
    assert any("with the source's frames" in entry for entry in result.log)
    assert result.rows.residual <= 1e-10


def test_degree_one_has_no_rows_and_says_so():
    mp = models.grid(2, 2, 1, 2)
    result = pt.transfer(mp, mp.boundary())
    assert result.rows.active == 0
    assert result.rows.without == (0, 1, 2, 3)
    assert any("4 of 4 interfaces are C0 only" in w and "patch 0" in w for w in result.warnings)


def test_second_rows_without_freedom_are_combined():
    """Even valence, Bezier, degree 2: s_2 lies on the boundary and the twists alone satisfy all rows but one."""
    mp = models.star(6, 2, 1)
    target, landmarks = targets.deformed(mp, targets.bend(mp, 30))
    result = keeps_its_rows(mp, target, landmarks)
    assert result.rows.contradictory == ()
    assert result.rows.without == ()
    assert sorted(result.rows.space.rows.order) == [0] * 6 + [1] * 5


def test_rows_that_are_not_kept_are_named():
    mp = models.star(6, 2, 1)
    rows = replace(pt.transfer(mp, mp.boundary()).rows, contradictory=((0, 3), (2, 3)))
    assert any("2 continuity rows are not kept" in w for w in rows.warnings(mp))
    assert rows.to_dict()["contradictory"] == [{"interface": 0, "vertex": 3}, {"interface": 2, "vertex": 3}]


def test_rows_that_the_boundary_contradicts_are_dropped():
    mp = models.grid(2, 1, 2, 2)
    t = mp.topology
    rows = C1Rows(t, control_rows(t))(t.coordinates)
    a, b = t.boundary_points[:2]
    matrix = rows.matrix.tolil()
    matrix[0] = 0
    matrix[0, [a, b]] = [1.0, -1.0]
    broken = ContinuityRows(
        matrix.tocsr(), np.array([-1, *rows.slave[1:]]), rows.interface, rows.vertex, rows.order, rows.left_out, ()
    )
    space = row_space(broken, t.interior_points, t.coordinates)
    assert space.contradictory == ((0, -1),)
    assert len(space.rows) == len(rows) - 1
    assert space.residual(space.project(t.coordinates)) < 1e-12


def test_impossible_rows_are_taken_back_and_reported():
    """Rows that fold the map: the certified map without them comes back, and all interfaces are named."""
    mp = models.grid(2, 1, 2, 3)
    t, control = mp.topology, control_rows(mp.topology)
    true = C1Rows(t, control)(t.coordinates)

    def crossed(released, without):
        rows = C1Rows(t, control)(t.coordinates, released, without)
        if not without:
            # s = 3 L - 2 R lies beyond L.
            for k, slave in enumerate(rows.slave):
                span = slice(*rows.matrix.indptr[k : k + 2])
                rows.matrix.data[span][rows.matrix.indices[span] != slave] = [3.0, -2.0]
        return rows

    points, certificate, log, active = best_under_rows(
        t,
        [crossed],
        lambda null_space=None, **options: SplineOptimizer(t, null_space=null_space, **options),
        t.coordinates,
        lambda x: pt.certify(mp.with_shared_points(x)),
    )
    assert len(true) > 0
    assert certificate.injective
    assert active.without == (0,)
    assert active.active == 0
    assert any("lose theirs" in entry for entry in log)
    assert active.warnings(mp)[0].startswith("1 of 1 interfaces are C0 only")
    np.testing.assert_allclose(points[t.boundary_points], t.coordinates[t.boundary_points])


@real.needed
@pytest.mark.parametrize(("name", "before", "after"), [("yeti", 23.0, 11.5), ("turtle", 28.0, 21.0)])
def test_kinks_of_real_models_fall(name, before, after):
    mp = real.model(name)
    target, landmarks = targets.deformed(mp, targets.bend(mp, 60))
    assert pt.transfer(mp, target, landmarks, "c0").continuity.kink_deg.mean > before
    result = keeps_its_rows(mp, target, landmarks)
    assert result.continuity.kink_deg.mean < after
    assert len(knot_spans(mp.patches[0].knots[0])) <= 3


def test_rows_follow_a_rough_map_as_well_as_the_exact_one(monkeypatch):
    """Ratios of speeds within 1 %, the same quality, and the finest space is solved under rows only."""
    mp = models.o_grid(3, 16)
    target, landmarks = targets.deformed(mp, targets.bend(mp, 50))
    plan = pt.TransferPlan(mp)
    rough = plan.transfer(target, landmarks)
    assert len(rough.log) == 2
    assert rough.log[0].startswith("rough map")
    assert rough.log[1].startswith(f"under {rough.rows.active} rows, optimise: ")
    plain = pt.transfer(mp, target, landmarks, "c0").multipatch.topology.coordinates
    control = control_rows(mp.topology)
    start = plain.copy()
    start[mp.topology.interior_points] = mp.topology.coordinates[mp.topology.interior_points]
    optimizer = SplineOptimizer(mp.topology)
    found = optimizer.minimise(optimizer.harmonic(start), tolerance=interior.ROUGH)
    assert len(found.history) == 0
    ratios = [chord_ratios(mp.topology, control, x) for x in (found.points, plain)]
    np.testing.assert_allclose(*ratios, rtol=0.01)
    monkeypatch.setattr(interior, "ROUGH", 1e-8)
    exact = plan.transfer(target, landmarks)
    assert abs(exact.quality.scaled_jacobian.mean - rough.quality.scaled_jacobian.mean) < 1e-3
    assert abs(exact.continuity.kink_deg.mean - rough.continuity.kink_deg.mean) < 0.2
    x, y = (r.multipatch.topology.coordinates for r in (exact, rough))
    assert np.abs(x - y).max() < 2e-3 * mp.diameter


def test_where_rows_fail_with_a_rough_map_the_exact_one_is_followed(monkeypatch):
    mp = models.o_grid(3, 3)
    target, landmarks = targets.deformed(mp, targets.bend(mp, 30))
    plain = pt.transfer(mp, target, landmarks, "c0").multipatch.topology.coordinates
    calls = []

    def spy(topology, choices, make, reference, *rest, rounds, **options):
        calls.append((rounds, reference))
        points, certificate, log, rows = best_under_rows(
            topology, choices, make, reference, *rest, rounds=rounds, **options
        )
        # As if an interface lost its rows with the rough map.
        return points, certificate, log, replace(rows, without=(0,) if len(calls) == 1 else ())

    monkeypatch.setattr(interior, "best_under_rows", spy)
    # On the boundary that "c0" has.
    monkeypatch.setattr(inside, "with_legs_of_chords", lambda posed, *_: posed)
    result = pt.transfer(mp, target, landmarks)
    assert [rounds for rounds, _ in calls] == [1, constrained.ROW_ROUNDS]
    assert np.array_equal(calls[1][1], plain)
    assert result.rows.without == ()
    assert [entry.split()[0] for entry in result.log] == ["rough", "under", "optimise:", "under"]


def test_rows_are_released_before_they_are_eliminated(monkeypatch):
    mp, target, landmarks = examples.load("human")
    eliminated = []

    def count(rows, *rest):
        eliminated.append(len(rows))
        return row_space(rows, *rest)

    monkeypatch.setattr(constrained, "row_space", count)
    result = pt.transfer(mp, target, landmarks)
    assert len(result.rows.released) > 0
    assert eliminated == [result.rows.active]


@pytest.mark.parametrize("name", ["grid p2", "plate with hole p3", "l-shape p3"])
def test_corners_move_as_rows_beside_them_ask(name):
    mp = models.jiggled(models.ALL[name](), 5)
    t, x = mp.topology, mp.topology.coordinates
    rows, corners = C1Rows(t, control_rows(t))(x), constrained._Corners(t)
    moved = corners.with_rows(rows, x)
    assert np.array_equal(moved[t.boundary_points], x[t.boundary_points])
    first = {
        int(r.curve[-2 if s.at_end else 1])
        for v, around in t.spokes.items()
        if v in t.boundary_points
        for s in around
        for r in (control_rows(t)[s.interface],)
    }
    here = np.isin(rows.slave, sorted(first))
    assert here.any()
    assert np.abs(rows.matrix @ x)[here].max() > 1e-3 * mp.diameter
    assert np.abs(rows.matrix @ moved)[here].max() < 1e-13 * mp.diameter
    # The nearest: moved at right angles to what the rows allow.
    free = rows.matrix[here].toarray()[:, t.interior_points]
    shift = (moved - x)[t.interior_points]
    assert np.abs(shift - np.linalg.pinv(free) @ (free @ shift)).max() < 1e-12 * mp.diameter
    assert corners.collapsed(x, x) == frozenset()
