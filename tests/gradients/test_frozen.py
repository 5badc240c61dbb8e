"""Maps as functions of their boundary: derivatives against differences, adjoints, symmetries, what must not matter."""

import pickle
from itertools import pairwise

import numpy as np
import pytest

import models
import patchtransfer as pt
import targets
from patchtransfer import InfeasibleTargetError, InputError, TransferError, examples
from patchtransfer.geometry.outline import Outline
from patchtransfer.gradients import Filled


def motions(points: np.ndarray) -> np.ndarray:
    """Smooth, and no affine map: of size 1 on the whole."""
    size = np.hypot(*np.ptp(points, axis=0))
    x, y = (2 * (points - points.mean(axis=0)) / size).T
    return np.column_stack([np.sin(3 * y) + 0.3 * x * y, np.cos(2.5 * x) - 0.4 * y**2])


def check(frozen, filled, d, step):
    """Adjoint identity to rounding, central differences to the issue's 1e-8."""
    rng = np.random.default_rng(3)
    w, rough = rng.normal(size=filled.points.shape), rng.normal(size=d.shape)
    forward = filled.jvp(rough) * w
    assert abs(forward.sum() - (rough * filled.vjp(w)).sum()) <= 1e-12 * np.abs(forward).sum()
    boundary = filled.points[frozen.boundary_points]
    moved = filled.jvp(d)
    assert np.array_equal(moved[frozen.boundary_points], d)

    def central(h):
        return (frozen.fill(boundary + h * d).points - frozen.fill(boundary - h * d).points) / (2 * h)

    # Of fourth order: what is left is rounding.
    difference = (4 * central(step) - central(2 * step)) / 3
    assert np.abs(difference - moved).max() <= 1e-8 * np.abs(moved).max()


@pytest.mark.parametrize("continuity", ["c0", "c1"])
@pytest.mark.parametrize("name", examples.EXAMPLES)
def test_derivatives_on_all_examples(name, continuity):
    source, target, landmarks = examples.load(name)
    result = pt.transfer(source, target, landmarks, continuity, refine="never", on_failure="return")
    frozen = result.freeze()
    filled = frozen.fill(frozen.boundary)
    size = np.hypot(*np.ptp(frozen.boundary, axis=0))
    assert filled.certificate.injective
    assert filled.gradient_norm < 1e-11
    np.testing.assert_allclose(filled.points, result.multipatch.topology.coordinates, atol=1e-5 * size)
    check(frozen, filled, motions(frozen.boundary), 1e-5 * size)


def test_derivatives_under_exact_rows():
    mp = models.grid(2, 2, 3, 2).reduce_continuity(1)
    points = targets.bend(mp, 40)(mp.topology.coordinates)
    frozen = pt.TransferPlan(mp, "g1").freeze(points)
    filled = frozen.fill(points[frozen.boundary_points])
    check(frozen, filled, motions(frozen.boundary), 2e-5)
    # The frozen gluing ties the interfaces' tangents at the boundary to its legs: it does not carry far.
    moved = frozen.fill(frozen.boundary + 0.002 * motions(frozen.boundary))
    assert moved.certificate.injective
    # The boundary is not smooth across the joints, but the gluing is exact.
    assert pt.check_continuity(moved.multipatch).as_g1_residual < 1e-10


def straight_corner() -> pt.MultiPatch:
    """Two squares side by side; the right one's corner (1, 1) is its own."""
    left = models.bilinear((-1, 0), (0, 0), (0, 1), (-1, 1))
    right = models.bilinear((0, 0), (1, 0), (1, 1), (0, 1))
    return models.build([left, right], 3, 2, None)


@pytest.mark.parametrize("continuity", ["c0", "c1"])
def test_derivatives_with_an_excluded_corner(continuity):
    """Corner (1, 1) is on the line of its neighbours, and stays so while the boundary moves."""
    plan = pt.TransferPlan(straight_corner(), continuity)
    t = plan.source.topology
    x, y = t.coordinates.T
    # The upper right corner is cut off: (1, 1) goes to the middle of the cut.
    cut = t.coordinates.copy()
    top, side = np.isclose(y, 1) & (x > -1e-9), np.isclose(x, 1) & (y > -1e-9)
    cut[top] = np.column_stack([0.5 * x[top], 1 - 0.5 * x[top]])
    cut[side] = np.column_stack([1 - 0.5 * y[side], 0.5 * y[side]])
    frozen = plan.freeze(cut)
    patch = next(k for k, p in enumerate(t.points) if np.isin(np.flatnonzero(top & side), p).all())
    filled = frozen.fill(frozen.boundary)
    assert filled.certificate.status == "degenerate"
    assert frozen._problem._excluded == [(patch, 3)]
    still = np.abs(frozen.boundary.sum(axis=1) - 1) < 1e-9
    d = motions(frozen.boundary)
    d[still] = frozen.boundary[still] @ np.array([[0.2, -0.3], [0.5, 0.1]])
    check(frozen, filled, d, 1e-5)


@pytest.mark.parametrize("continuity", ["c0", "c1"])
def test_similarities_take_maps_along(continuity):
    """X(s R b + t) = s R X(b) + t, so derivatives along similarities are known to the last digits."""
    mp = models.o_grid()
    frozen = pt.TransferPlan(mp, continuity).freeze(targets.bend(mp, 30)(mp.topology.coordinates))
    b = frozen.boundary
    filled = frozen.fill(b)
    for linear in (np.eye(2), np.array([[0.0, 1.0], [-1.0, 0.0]])):
        np.testing.assert_allclose(filled.jvp(b @ linear), filled.points @ linear, atol=1e-11)
    np.testing.assert_allclose(filled.jvp(np.ones_like(b)), 1.0, atol=1e-11)
    turn = 1.7 * np.array([[0.6, 0.8], [-0.8, 0.6]])
    np.testing.assert_allclose(frozen.fill(b @ turn + 3).points, filled.points @ turn + 3, atol=1e-11)


@pytest.mark.parametrize("continuity", ["c0", "c1"])
def test_far_from_the_origin_it_is_the_derivative_of_the_model_at_the_origin(continuity):
    mp = models.o_grid()
    away = 1e6 * mp.diameter * np.array([0.8, -0.6])
    near = pt.TransferPlan(mp, continuity).freeze()
    far_model = mp.with_shared_points(mp.topology.coordinates + away)
    far = pt.TransferPlan(far_model, continuity).freeze()
    d = motions(near.boundary)
    here, there = near.fill(near.boundary), far.fill(near.boundary + away)
    assert there.certificate.injective
    assert np.array_equal(there.points[far.boundary_points], near.boundary + away)
    expected = here.jvp(d)
    np.testing.assert_allclose(there.jvp(d), expected, atol=1e-8 * np.abs(expected).max())
    w = np.random.default_rng(1).normal(size=here.points.shape)
    expected = here.vjp(w)
    np.testing.assert_allclose(there.vjp(w), expected, atol=1e-8 * np.abs(expected).max())


@pytest.fixture(scope="module")
def star():
    source, target, landmarks = examples.load("star")
    result = pt.transfer(source, target, landmarks)
    return result, target, result.freeze()


def test_filling_is_a_function_of_its_argument(star):
    """To the bit, whatever was filled in between, and so are derivatives of maps filled before."""
    _, _, frozen = star
    moved = frozen.boundary + 0.02 * motions(frozen.boundary)
    first = frozen.fill(frozen.boundary)
    w = motions(first.points)
    derivative, motion = first.vjp(w), first.jvp(moved)
    other = frozen.fill(moved)
    assert not np.array_equal(other.vjp(w), derivative)
    assert np.array_equal(first.vjp(w), derivative)
    assert np.array_equal(first.jvp(moved), motion)
    # Where optimizers are made anew.
    again = pickle.loads(pickle.dumps(frozen)).fill(frozen.boundary)
    assert np.array_equal(again.points, first.points)
    assert np.array_equal(again.vjp(w), derivative)
    # The start is another, so the rounding is.
    warm = frozen.fill(moved, near=other)
    np.testing.assert_allclose(warm.points, other.points, atol=1e-13 * np.abs(other.points).max())
    assert warm.energy == pytest.approx(other.energy, rel=1e-14)


def test_several_directions_share_a_factorization(star):
    filled = star[2].fill(star[2].boundary)
    rng = np.random.default_rng(0)
    w, d = rng.normal(size=(3, *filled.points.shape)), rng.normal(size=(2, *star[2].boundary.shape))
    # Sums are in another order.
    np.testing.assert_allclose(filled.vjp(w), [filled.vjp(one) for one in w], atol=1e-12)
    np.testing.assert_allclose(filled.jvp(d), [filled.jvp(one) for one in d], atol=1e-12)
    assert filled.vjp(w[:0]).shape == (0, *star[2].boundary.shape)


def test_boundaries_without_a_map_let_a_line_search_step_back(star):
    result, _, frozen = star
    before = frozen.fill(frozen.boundary).points
    outer = result.multipatch.topology.loops[0]
    crossed = frozen.boundary.copy()
    # A point pulled across the whole model.
    number = np.searchsorted(
        frozen.boundary_points, outer[0].points(result.multipatch.topology.points[outer[0].patch])[1]
    )
    crossed[number] += 3 * (frozen.boundary.mean(axis=0) - crossed[number])
    for bad in (crossed, frozen.boundary * [1, -1], 0 * frozen.boundary):
        try:
            filled = frozen.fill(bad)
        except InfeasibleTargetError:
            continue
        assert not filled.certificate.injective
    assert np.array_equal(frozen.fill(frozen.boundary).points, before)


def test_a_map_with_folds_has_no_derivative(star):
    """As `fill` gives where it finds no other, but nothing is wrong with the boundary."""
    good = star[2].fill(star[2].boundary)
    folded = Filled(good._problem, np.array(good.points), good.points, None, 1.0, good.energy, np.inf)
    for derivative, given in ((folded.vjp, good.points), (folded.jvp, star[2].boundary)):
        with pytest.raises(TransferError, match="no derivative"):
            derivative(given)


def test_input_errors(star):
    result, _, frozen = star
    with pytest.raises(InputError, match="fill: expected finite boundary points"):
        frozen.fill(frozen.points)
    with pytest.raises(InputError, match="fill: expected finite boundary points"):
        frozen.fill(np.nan * frozen.boundary)
    filled = frozen.fill(frozen.boundary)
    with pytest.raises(InputError, match="vjp: derivatives by all points"):
        filled.vjp(frozen.boundary)
    with pytest.raises(InputError, match="jvp: motions of the boundary"):
        filled.jvp(filled.points)
    arrived = pickle.loads(pickle.dumps(result))
    assert arrived.rows.active == result.rows.active
    with pytest.raises(InputError, match=r"another process.*plan\.freeze"):
        arrived.freeze()
    with pytest.raises(InputError, match="freeze: expected finite points"):
        pt.TransferPlan(models.o_grid()).freeze(frozen.boundary)


def test_a_map_that_is_not_certified_is_not_frozen():
    mp = models.grid()
    points = mp.topology.coordinates.copy()
    points[:, 0] = np.abs(points[:, 0] - 1)
    with pytest.raises(TransferError):
        pt.TransferPlan(mp).freeze(points)


def test_frozen_rows_hold_on_the_way(star):
    """The map stays C1 in the sense of its rows wherever the boundary goes."""
    result, _, frozen = star
    space = result.rows.space
    for size in (0.01, 0.03):
        filled = frozen.fill(frozen.boundary + size * motions(frozen.boundary))
        assert filled.certificate.injective
        assert space.residual(filled.points) < 1e-12 * np.hypot(*np.ptp(frozen.boundary, axis=0))


@pytest.mark.parametrize("name", ["star", "wrench", "two-hole-plate"])
def test_the_outline_moves_the_boundary(name):
    source, target, landmarks = examples.load(name)
    frozen = pt.transfer(source, target, landmarks).freeze()
    outline = frozen.outline(target)
    given = outline.control_points
    assert np.array_equal(outline(given), frozen.boundary)
    # Translations exactly, other similarities but for the distance that the fit left.
    shift = np.array([3.0, -4.0])
    np.testing.assert_allclose(outline(given + shift), frozen.boundary + shift, atol=1e-11 * np.abs(given).max())
    size = np.hypot(*np.ptp(given, axis=0))
    centre = given.mean(axis=0)
    for linear in (1.1 * np.eye(2), np.array([[1, 0.1], [-0.1, 1.0]])):
        moved = outline(centre + (given - centre) @ linear)
        np.testing.assert_allclose(moved, centre + (frozen.boundary - centre) @ linear, atol=2e-2 * size)
        curves = [c.with_control_points(centre + (c.control_points - centre) @ linear) for c in loops(target)]
        ends = np.cumsum([0, *(len(loop) for loop in target.loops)])
        image = pt.Boundary([curves[a:b] for a, b in pairwise(ends)])
        assert distance(frozen, moved, image) < distance(frozen, frozen.boundary, target) + 1e-3 * size
    w = np.random.default_rng(2).normal(size=frozen.boundary.shape)
    d = np.random.default_rng(3).normal(size=given.shape)
    assert (outline.transpose(w) * d).sum() == pytest.approx((w * (outline.matrix @ d)).sum(), rel=1e-12)
    with pytest.raises(InputError, match="away from every loop"):
        frozen.outline(pt.Boundary([[c.with_control_points(c.control_points + size) for c in target.loops[0]]]))


def loops(target: pt.Boundary) -> list[pt.BSplineCurve]:
    return [curve for loop in target.loops for curve in loop]


def distance(frozen, boundary, target: pt.Boundary) -> float:
    """Of the curves of boundary points to a target."""
    points = frozen.points.copy()
    points[frozen.boundary_points] = boundary
    model = frozen.source.with_shared_points(points)
    outlines = [Outline(loop) for loop in target.loops]
    at = [
        np.concatenate([s.curve(model.patches)(np.linspace(*s.curve(model.patches).domain, 50)) for s in loop])
        for loop in frozen.source.topology.loops
    ]
    return max(min(float(o.nearest(x)[1].max()) for o in outlines) for x in at)


def test_smooth_joints_stay_smooth_under_the_outline():
    mp = models.annulus()
    result = pt.transfer(mp, targets.deformed(mp, targets.stretch(1.2, 30))[0])
    frozen = result.freeze()
    target = pt.Boundary(result.multipatch.boundary().loops)
    outline = frozen.outline(target)
    given = outline.control_points
    filled = frozen.fill(outline(given + 0.05 * motions(given)))
    # The target's own curves would kink: joints and legs move each for themselves there.
    outlines = [Outline(loop) for loop in filled.multipatch.boundary().loops]
    assert max(np.abs(o.turn(o.joints[:-1])).max() for o in outlines) < 1e-7


def test_steps_in_the_inner_product(star):
    _, _, frozen = star
    inner, d = frozen.inner_product, motions(frozen.boundary)
    w = np.random.default_rng(5).normal(size=d.shape)
    step = inner.gradient(w)
    assert inner(step, d) == pytest.approx((w * d).sum(), rel=1e-10)
    assert inner(d, d) > 0
    # A constant motion has no slope: its square is the length of the boundary.
    length = sum(Outline(loop).length for loop in frozen.fill(frozen.boundary).multipatch.boundary().loops)
    ones = np.column_stack([np.ones(len(d)), np.zeros(len(d))])
    assert inner(ones, ones) == pytest.approx(length, rel=1e-3)


def test_the_area_inside_a_boundary_is_exact():
    mp = models.plate_with_hole()
    frozen = pt.TransferPlan(mp, "c0").freeze()
    b = frozen.boundary

    def area(boundary):
        return frozen.area(boundary)[0]

    assert area(b) == pytest.approx(sum(Outline(loop).area for loop in mp.boundary().loops), rel=1e-3)
    d = motions(b)
    step = 1e-4
    assert (frozen.area(b)[1] * d).sum() == pytest.approx(
        (area(b + step * d) - area(b - step * d)) / (2 * step), rel=1e-9
    )
    assert area(2 * b) == pytest.approx(4 * area(b), rel=1e-14)


def test_a_frozen_circle_follows_its_outline_as_a_circle():
    source, target, landmarks = examples.load("annulus")
    frozen = pt.transfer(source, target, landmarks).freeze()
    assert abs(frozen.area(frozen.boundary)[0] - np.pi * (1.3**2 - 0.4**2)) < 1e-13
    outline = frozen.outline(target)
    motion = np.zeros_like(outline.control_points)
    motion[sum(len(curve.control_points) for curve in target.loops[0]) :] = [0.05, 0.02]
    filled = frozen.fill(outline(outline.control_points + motion))
    assert filled.certificate.status == "certified"
    for curve in filled.multipatch.boundary().loops[1]:
        x = curve(np.linspace(*curve.domain, 50)) - [0.3, 0.12]
        np.testing.assert_allclose(np.hypot(*x.T), 0.4, rtol=0, atol=1e-13)
    ones = np.ones_like(frozen.boundary)
    length = 2 * np.pi * (1.3 + 0.4)
    assert frozen.inner_product(ones, ones) == pytest.approx(2 * length, rel=1e-8)


@pytest.mark.parametrize("continuity", ["c0", "c1"])
def test_inner_points_that_are_held_stay_where_they_are_put(continuity):
    """The others have the least distortion with them there: no motion of the rest lowers the energy."""
    source, target, landmarks = examples.load("rabbit")
    frozen = pt.transfer(source, target, landmarks, continuity, refine="never").freeze()
    inner = [v.point for v in source.topology.vertices if v.interior][:3]
    held, size = frozen.pinned(inner), np.hypot(*np.ptp(frozen.boundary, axis=0))
    assert held.pins.tolist() == inner
    assert len(frozen.pins) == 0
    # Held where they come to lie by themselves they change nothing but rounding.
    np.testing.assert_allclose(held.fill(held.boundary).points, frozen.points, atol=1e-9 * size)
    places = frozen.points[inner] + 0.003 * size * np.array([[1, 0], [0, 1], [-1, 0.5]])
    filled = held.fill(held.boundary, pins=places)
    np.testing.assert_array_equal(filled.points[inner], places)
    np.testing.assert_array_equal(filled.points[held.boundary_points], held.boundary)
    assert filled.certificate.injective
    assert filled.gradient_norm < 1e-11
    assert filled.energy > frozen.fill(frozen.boundary).energy
    # Derivatives by the boundary are those with the points held.
    d = motions(held.boundary)
    assert np.abs(filled.jvp(d)[inner]).max() == 0
    h = 1e-5 * size
    ends = [held.fill(held.boundary + s * h * d, pins=places, near=filled).points for s in (1, -1)]
    moved = filled.jvp(d)
    np.testing.assert_allclose((ends[0] - ends[1]) / (2 * h), moved, atol=1e-5 * np.abs(moved).max())


def test_points_that_cannot_be_held():
    frozen = pt.transfer(*examples.load("star")).freeze()
    for points in ([int(frozen.boundary_points[0])], [10**6]):
        with pytest.raises(InputError, match="not inside"):
            frozen.pinned(points)
    inner = frozen.source.topology.interior_points
    with pytest.raises(InputError, match="named twice"):
        frozen.pinned([int(inner[0])] * 2)
    with pytest.raises(InputError, match="rows tie"):
        frozen.pinned(inner)
    with pytest.raises(InputError, match="1 held points"):
        frozen.pinned(inner[:1]).fill(frozen.boundary, pins=[[0.0, np.nan]])
