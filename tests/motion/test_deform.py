import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import models
import patchtransfer as pt
import targets
from patchtransfer import Deformer, InfeasibleTargetError, InputError, NotCertifiedError, deform, examples
from patchtransfer.geometry.outline import Outline


def outline(mp, loop=0):
    return Outline(mp.boundary().loops[loop])


def at(mp, fraction, loop=0):
    o = outline(mp, loop)
    return o.point(fraction * o.length)


def handle(mp, fraction, drag, loop=0):
    p = at(mp, fraction, loop)
    return [*p, *(p + np.asarray(drag))]


def distance(mp, point):
    return min(float(outline(mp, k).nearest(np.atleast_2d(point))[1][0]) for k in range(len(mp.boundary().loops)))


@pytest.fixture(scope="module")
def wrench():
    return Deformer(examples.load("wrench")[0])


def test_handles_are_met_and_the_rest_stays(wrench):
    mp = wrench.multipatch
    length = outline(mp).length
    rows = [handle(mp, 0.3, (2.0, 3.0)), handle(mp, 0.7, (-3.0, 1.0))]
    result = wrench.deform(rows, radius=0.08 * length)
    assert result.certificate.status == "certified"
    assert pt.certify(result.multipatch).injective
    new = result.multipatch
    for row in rows:
        assert distance(new, row[2:]) < 1e-9 * length
    # To the bit farther along the loop than the radius (and the reach of a control point), as all other loops.
    for k, (before, after) in enumerate(zip(mp.boundary().loops, new.boundary().loops, strict=True)):
        for a, b in zip(before, after, strict=True):
            s = outline(mp, k).nearest(a.control_points)[0] / outline(mp, k).length
            away = np.minimum.reduce([np.abs((s - f + 0.5) % 1 - 0.5) for f in (0.3, 0.7)])
            if k > 0 or away.min() > 0.1:
                np.testing.assert_array_equal(a.control_points, b.control_points)
    topology = mp.topology
    still = np.setdiff1d(topology.boundary_points, result.moved)
    assert len(still) > 0
    assert set(result.moved) & set(topology.boundary_points.tolist())


@settings(max_examples=12, deadline=None)
@given(
    st.sampled_from(["o-grid p3", "plate with hole p3", "annulus p3", "l-shape p2"]),
    st.lists(st.floats(0, 0.999), min_size=1, max_size=3, unique_by=lambda x: round(5 * x)),
    st.integers(0, 10**6),
)
def test_random_drags_are_certified_and_exact(name, fractions, seed):
    mp = models.ALL[name]()
    rng = np.random.default_rng(seed)
    gaps = np.diff(sorted([*fractions, fractions[0] + 1 if len(fractions) == 1 else min(fractions) + 1]))
    if len(fractions) > 1 and gaps.min() < 0.1:
        return
    rows = [handle(mp, f, 0.04 * rng.normal(size=2)) for f in fractions]
    result = deform(mp, rows)
    assert result.certificate.injective
    for row in rows:
        assert distance(result.multipatch, row[2:]) < 1e-8


def test_a_fixed_handle_holds(wrench):
    mp = wrench.multipatch
    length = outline(mp).length
    pull = handle(mp, 0.3, (0.0, 4.0))
    held = handle(mp, 0.34, (0.0, 0.0))
    free = wrench.deform([pull], radius=0.1 * length).multipatch
    fixed = wrench.deform([pull, held], radius=0.1 * length).multipatch
    assert distance(free, held[2:]) > 0.1
    assert distance(fixed, held[2:]) < 1e-9 * length
    assert distance(fixed, pull[2:]) < 1e-9 * length


def test_smooth_joints_stay_smooth():
    """No kink is added where two sides meet smoothly, however the handle pulls at the joint or beside it."""
    mp = models.annulus(4, 3, 2)
    deformer = Deformer(mp)
    before = outline(mp)
    turns = np.abs(before.turn(before.joints[:-1]))
    assert turns.max() < np.radians(2)
    for fraction in (0.0, 0.05, 0.24, 0.5):
        new = outline(deformer.deform([handle(mp, fraction, (0.15, 0.2))]).multipatch)
        np.testing.assert_allclose(np.abs(new.turn(new.joints[:-1])), turns, atol=0.01)


def test_repeated_calls_start_from_the_original(wrench):
    rows = [handle(wrench.multipatch, 0.3, (1.0, 2.0))]
    first = wrench.deform(rows).multipatch
    wrench.deform([handle(wrench.multipatch, 0.6, (-1.0, 0.0))])
    assert wrench.deform(rows).multipatch == first
    assert deform(wrench.multipatch, rows).multipatch == first
    # Nothing to do: the boundary stays.
    same = wrench.deform(np.empty((0, 4)))
    assert not set(same.moved)
    assert same.multipatch.boundary() == wrench.multipatch.boundary()


def test_holes_have_handles():
    mp = models.plate_with_hole(3, 2)
    result = deform(mp, [handle(mp, 0.4, (0.05, -0.04), loop=1)])
    assert result.certificate.status == "certified"
    outer = mp.boundary().loops[0]
    assert all(
        np.array_equal(a.control_points, b.control_points)
        for a, b in zip(outer, result.multipatch.boundary().loops[0], strict=True)
    )


def test_structure_is_kept(wrench):
    mp = wrench.multipatch
    new = wrench.deform([handle(mp, 0.1, (1.0, 0.0))]).multipatch
    assert new.interfaces == mp.interfaces
    assert new.ids == mp.ids
    for a, b in zip(mp.patches, new.patches, strict=True):
        assert a.degrees == b.degrees
        assert all(np.array_equal(x, y) for x, y in zip(a.knots, b.knots, strict=True))


def test_impossible_drags():
    mp = models.plate_with_hole(3, 2)
    with pytest.raises(InfeasibleTargetError):
        deform(mp, [handle(mp, 0.4, (5.0, 0.0), loop=1)])  # the hole leaves the plate
    deformer = Deformer(models.grid(1, 1, 3, 1, None))
    # One span a side cannot follow this inside without folding, or the boundary crosses itself.
    with pytest.raises((InfeasibleTargetError, NotCertifiedError)):
        deformer.deform([handle(deformer.multipatch, 0.125, (0.0, 0.97))], radius=0.4)


def test_refill_takes_any_boundary_on_the_same_sides():
    mp = models.o_grid(3, 2)
    plan = pt.TransferPlan(mp)
    points = mp.topology.coordinates.copy()
    boundary = mp.topology.boundary_points
    points[boundary] = targets.bend(mp, 40)(points[boundary])
    points[mp.topology.interior_points] = 7.0  # does not matter
    found = plan.refill(points)
    assert found.certificate.injective
    np.testing.assert_array_equal(found.multipatch.topology.coordinates[boundary], points[boundary])
    again = plan.refill(found.multipatch.topology.coordinates).multipatch
    np.testing.assert_allclose(
        again.topology.coordinates, found.multipatch.topology.coordinates, atol=1e-6 * mp.diameter
    )
    with pytest.raises(InputError, match="refill"):
        plan.refill(points[1:])
    with pytest.raises(InputError, match="refill"):
        plan.refill(points * np.nan)
    points[boundary] = np.random.default_rng(0).permutation(points[boundary])
    with pytest.raises(InfeasibleTargetError, match="boundary"):
        plan.refill(points)


def test_bad_input(wrench):
    mp = wrench.multipatch
    row = handle(mp, 0.3, (1.0, 0.0))
    for bad, message in (
        ([row[:3]], "rows"),
        ([[*row[:3], np.nan]], "finite"),
        ([[1e5, 1e5, 0, 0]], "handle 0 at .* away from the boundary"),
        ([row, row], "cannot be moved independently"),
    ):
        with pytest.raises(InputError, match=message):
            wrench.deform(bad)
    with pytest.raises(InputError, match="radius"):
        wrench.deform([row], radius=-1.0)
    with pytest.raises(InputError, match="on_failure"):
        wrench.deform([row], on_failure="ignore")


@pytest.fixture(scope="module")
def held():
    return Deformer(examples.load("wrench")[0], frozen=True)


@settings(max_examples=10, deadline=None)
@given(st.floats(0, 1), st.floats(0, 2 * np.pi), st.floats(0.5, 4))
def test_drags_under_held_rows_have_the_same_boundary_and_are_as_good(wrench, held, fraction, angle, size):
    rows = [handle(wrench.multipatch, fraction, (size * np.cos(angle), size * np.sin(angle)))]
    try:
        free = wrench.deform(rows)
    except (InfeasibleTargetError, NotCertifiedError) as error:
        with pytest.raises(type(error)):
            held.deform(rows)
        return
    result = held.deform(rows)
    assert pt.certify(result.multipatch).injective
    on = result.multipatch.topology.boundary_points
    np.testing.assert_array_equal(result.multipatch.topology.coordinates[on], free.multipatch.topology.coordinates[on])
    means = [pt.quality(r.multipatch).scaled_jacobian.mean for r in (result, free)]
    assert means[0] > means[1] - 0.005
    assert result.log[0].startswith("under the model's own rows")


def test_under_held_rows_nearby_handles_give_nearby_maps(held):
    """Rows that follow the boundary jump; frozen, a drag of a millionth moves points by about as much."""
    base = np.array([handle(held.multipatch, 0.3, (2.0, 3.0))])
    step = 1e-6 * held.multipatch.diameter
    points = [held.deform(base + np.array([0, 0, d, 0])).multipatch.topology.coordinates for d in (-step, 0.0, step)]
    first, second = points[1] - points[0], points[2] - points[1]
    assert 0.5 * step < np.abs(first).max() < 5 * step
    np.testing.assert_allclose(first, second, atol=1e-3 * step)


def test_where_held_rows_find_no_map_others_are_tried(held, monkeypatch):
    def none(*_args, **_options):
        raise InfeasibleTargetError("fill: none")

    monkeypatch.setattr(held, "_frozen", type("None", (), {"fill": none, "boundary_points": np.array([0])})())
    result = held.deform([handle(held.multipatch, 0.3, (2.0, 3.0))])
    assert result.certificate.injective
    assert "no map without folds" in result.log[0]
    assert len(result.log) > 1
