"""The core's elimination of rows against another one: same rank, same dropped rows, same span, same nearest map."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import models
import patchtransfer as pt
import real
from elimination import eliminate, same_span
from patchtransfer import _core, examples
from patchtransfer.continuity.g1 import g1_rows
from patchtransfer.continuity.interfaces import control_rows
from patchtransfer.continuity.null_space import RowSpace, nearest, row_space
from patchtransfer.continuity.rows import C1Rows, ContinuityRows
from patchtransfer.errors import InputError
from patchtransfer.numeric.compressed import Compressed, summed
from strategies import layouts


def agrees(rows: ContinuityRows, interior: np.ndarray, points: np.ndarray) -> RowSpace:
    """The core's elimination, after it is compared with the other one."""
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    space, other = row_space(rows, interior, points), eliminate(rows, interior, points)
    kept = np.setdiff1d(np.arange(len(rows)), other.dropped)
    assert (space.rows.matrix != rows.matrix[kept]).nnz == 0
    named = {(int(rows.interface[i]), int(rows.vertex[i])) for i in other.dropped}
    whole = (rows.slave < 0).all()
    assert set(space.contradictory) == ({(i, -1) for i, _ in named} if whole else named)
    assert space.redundant == other.redundant
    z = space.basis.toarray()
    assert same_span(z, other.basis) < 1e-9
    dense = space.rows.matrix.toarray()[:, interior]
    assert np.abs(dense @ z).max(initial=0.0) < 1e-12 * max(1.0, np.abs(z).max(initial=0.0))
    there = space.project(points)
    np.testing.assert_allclose(there, other.nearest, atol=1e-10 * size)
    assert space.residual(there) < 1e-11 * size
    fixed = np.setdiff1d(np.arange(len(points)), interior)
    np.testing.assert_array_equal(there[fixed], points[fixed])
    # The particular solution takes nothing from the points that may move.
    assert space.particular[:, interior].nnz == 0
    on_rows = np.array(points)
    on_rows[interior] = space.particular @ points
    assert space.residual(on_rows) < 1e-10 * size * max(1.0, np.abs(space.particular.data).max(initial=0.0))
    return space


def rows_of(mp: pt.MultiPatch, kind: str) -> ContinuityRows:
    t = mp.topology
    control = control_rows(t)
    if kind == "c1":
        return C1Rows(t, control)(t.coordinates)
    target = mp.boundary()
    joints = np.array([[*c.start, *c.start] for loop in target.loops for c in loop])
    smooth = pt.transfer(mp, target, joints, "c1", on_failure="return").multipatch.topology.coordinates
    return g1_rows(t, control, smooth)


@pytest.mark.parametrize("name", models.ALL)
def test_c1_rows_of_the_models(name):
    mp = models.ALL[name]()
    agrees(rows_of(mp, "c1"), mp.topology.interior_points, mp.topology.coordinates)


@pytest.mark.parametrize("name", models.SPACES)
def test_g1_rows_of_the_models(name):
    mp = models.SPACES[name]()
    rows = rows_of(mp, "g1")
    agrees(rows, mp.topology.interior_points, mp.topology.coordinates)


@pytest.mark.parametrize("kind", ["c1", "g1"])
@pytest.mark.parametrize("name", models.EXAMPLES)
def test_rows_of_the_examples(name, kind):
    mp = examples.load(name)[0]
    mp = mp if kind == "c1" else models.with_freedom(mp)
    space = agrees(rows_of(mp, kind), mp.topology.interior_points, mp.topology.coordinates)
    assert space.basis.shape[1] > 0


@real.needed
@pytest.mark.parametrize("name", ["yeti", "turtle", "disc"])
def test_rows_of_real_models(name):
    mp = real.model(name)
    agrees(rows_of(mp, "c1"), mp.topology.interior_points, mp.topology.coordinates)


@given(layout=layouts(), degree=st.integers(2, 3), spans=st.integers(1, 3), seed=st.integers(0, 10**6), data=st.data())
@settings(max_examples=40, deadline=None)
def test_random_layouts_with_some_interfaces_left_out(layout, degree, spans, seed, data):
    mp = models.jiggled(layout.multipatch(degree, spans), seed, 0.003)
    assume(len(mp.interfaces) > 0)
    t = mp.topology
    without = data.draw(st.sets(st.integers(0, len(mp.interfaces) - 1), max_size=2))
    rows = C1Rows(t, control_rows(t))(t.coordinates, (), without)
    agrees(rows, t.interior_points, t.coordinates)


@given(seed=st.integers(0, 10**6), kind=st.sampled_from(["c1", "vertex rows only"]), count=st.integers(1, 4))
@settings(max_examples=40, deadline=None)
def test_rows_that_the_boundary_contradicts(seed, kind, count):
    """Rows between boundary points alone, and pairs of rows that say different things about one point."""
    rng = np.random.default_rng(seed)
    mp = models.star(5, 3, 2)
    t, x = mp.topology, mp.topology.coordinates
    rows = C1Rows(t, control_rows(t))(x)
    if kind != "c1":
        rows = rows.select(np.flatnonzero(rows.slave < 0))
    fixed, inner = t.boundary_points, t.interior_points
    row, column, value = [], [], []
    for k in range(count):
        other = rng.choice(fixed) if k % 2 else rng.choice(inner)
        row += [k, k]
        column += [int(rng.choice(np.setdiff1d(fixed, [other]))), int(other)]
        value += [np.sqrt(0.5), -np.sqrt(0.5)]
    more = summed(np.array(row), np.array(column), np.array(value), (count, len(x)))
    old = rows.entries
    entries = Compressed(
        np.concatenate([old.indptr, old.indptr[-1] + more.indptr[1:]]),
        np.concatenate([old.indices, more.indices]),
        np.concatenate([old.data, more.data]),
        (len(rows) + count, len(x)),
    )
    none, first = np.full(count, -1), int(rows.interface.max())
    all_rows = replace(
        rows,
        entries=entries,
        slave=np.concatenate([rows.slave, none]),
        interface=np.concatenate([rows.interface, first + 1 + np.arange(count)]),
        vertex=np.concatenate([rows.vertex, none]),
        order=np.concatenate([rows.order, rng.integers(0, 3, count)]),
    )
    space = agrees(all_rows, inner, x)
    assert len(space.contradictory) >= count // 2


def test_no_rows_leave_everything_free():
    mp = models.grid(2, 2, 2, 2)
    t = mp.topology
    rows = C1Rows(t, control_rows(t))(t.coordinates, (), range(len(mp.interfaces)))
    space = agrees(rows, t.interior_points, t.coordinates)
    np.testing.assert_array_equal(space.basis.toarray(), np.eye(len(t.interior_points)))


def test_two_control_points_across_are_refused():
    """The middle patch's points across lie on both interfaces: each row needs the other's slave."""
    rows = ContinuityRows(
        summed(np.repeat([0, 1], 3), np.array([0, 1, 2, 1, 2, 3]), np.array([0.5, -1, 0.5] * 2), (2, 4)),
        *(np.array(x) for x in ([1, 2], [0, 1], [-1, -1], [0, 0])),
        0,
        (),
    )
    with pytest.raises(InputError, match=r"circle.*fewer than three control points.*elevate"):
        row_space(rows, np.array([1, 2]), np.arange(8.0).reshape(4, 2) ** 2)


@pytest.mark.parametrize("kind", ["c1", "g1"])
def test_the_number_of_threads_changes_no_bit(kind):
    mp = models.with_freedom(examples.load("human")[0])
    rows = rows_of(mp, kind)
    t, found = mp.topology, []
    try:
        for n in (1, 2, 3):
            _core.set_threads(n)
            space = row_space(rows, t.interior_points, t.coordinates)
            found.append([*space.columns[:3], space.particular.data, space.project(t.coordinates)])
    finally:
        _core.set_threads(0)
    for other in found[1:]:
        assert all(np.array_equal(a, b) for a, b in zip(found[0], other, strict=True))


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_size_and_place_of_a_model_do_not_matter(scale):
    """Rows are dropped and counted by their size against the model's."""
    mp = models.star(6, 2, 1)
    t = mp.topology
    rows = rows_of(mp, "c1")
    before = row_space(rows, t.interior_points, t.coordinates)
    moved = scale * t.coordinates + np.array([3.0, -2.0]) * scale
    after = row_space(rows, t.interior_points, moved)
    assert (after.contradictory, after.redundant) == (before.contradictory, before.redundant)
    expected = scale * before.project(t.coordinates) + np.array([3.0, -2.0]) * scale
    np.testing.assert_allclose(after.project(moved), expected, atol=1e-11 * scale * mp.diameter)


@pytest.mark.parametrize("name", ["grid p2", "plate with hole p3"])
def test_nearest_points_on_dependent_rows(name):
    """A row twice asks no more than once."""
    mp = models.jiggled(models.ALL[name](), 3)
    t, rows = mp.topology, rows_of(mp, "c1")
    chosen = np.flatnonzero(rows.slave >= 0)[:6]
    once = nearest(rows, chosen, t.interior_points, t.coordinates)
    twice = nearest(rows, np.repeat(chosen, 2), t.interior_points, t.coordinates)
    np.testing.assert_allclose(once, twice, atol=1e-9 * mp.diameter)
    assert np.abs(rows.matrix[chosen] @ once).max() < 1e-11 * mp.diameter
