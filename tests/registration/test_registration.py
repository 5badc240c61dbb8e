"""Registration: what is known to correspond is found to correspond; what cannot correspond is refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import models
import targets
from patchtransfer import Boundary, BSplineCurve, InfeasibleTargetError, InputError
from patchtransfer.geometry.outline import Outline
from patchtransfer.registration.register import register
from shapes import SQUARE, circle, loop, polygon

quick = settings(max_examples=10, deadline=None)


def worst(registration, f) -> float:
    """Largest error of the joints against the true images."""
    return max(float(np.linalg.norm(b - f(a[None])[0])) for a, b in registration.joints)


@pytest.mark.parametrize("name", models.ALL)
def test_landmarks_at_all_joints_are_met(name):
    mp = models.ALL[name]()
    f = targets.bend(mp, 35)
    target, landmarks = targets.deformed(mp, f, seed=3)
    order = np.random.default_rng(5).permutation(len(landmarks))
    registration = register(mp.boundary().loops, target, landmarks[order])
    assert worst(registration, f) < 1e-7 * target.diameter
    assert registration.confidence == 1
    for r in registration.loops:
        assert (np.diff(r.anchors, axis=0) > 0).all()
        np.testing.assert_allclose(r.anchors[-1] - r.anchors[0], [r.source.length, r.target.length], rtol=1e-12)
        s = np.linspace(0, r.source.length, 200)
        assert (np.diff(r.to_target(s)) > 0).all()
        # Domain on the left: as the source's loops run.
        assert np.sign(r.source.area) == np.sign(r.target.area)


@quick
@given(
    name=st.sampled_from(["l-shape p2", "grid p3", "star of valence 5, p3"]),
    angle=st.floats(-40, 40),
    scale=st.floats(0.01, 100),
    shift=st.tuples(st.floats(-50, 50), st.floats(-50, 50)),
    seed=st.integers(0, 1000),
    reverse=st.booleans(),
)
def test_rigid_motions_are_found_without_landmarks(name, angle, scale, shift, seed, reverse):
    """A regular pentagon has symmetries of 72 degrees; below 36 degrees the smallest rotation is the true one."""
    mp = models.ALL[name]()
    if name.startswith("star"):
        angle *= 0.75
    f = targets.similarity(angle, scale, shift)
    target, _ = targets.deformed(mp, f, seed=seed, reverse=reverse)
    registration = register(mp.boundary().loops, target)
    assert worst(registration, f) < 1e-3 * target.diameter


def test_an_asymmetric_shape_is_found_at_any_angle():
    mp = models.l_shape()
    for angle in range(0, 360, 45):
        f = targets.similarity(angle, 2.0)
        target, _ = targets.deformed(mp, f, seed=angle)
        registration = register(mp.boundary().loops, target)
        assert worst(registration, f) < 1e-3 * target.diameter
        assert registration.confidence > 0.3
        assert registration.warnings == ()


@pytest.mark.parametrize("deformation", ["bend", "bump"])
@pytest.mark.parametrize("name", ["l-shape p2", "grid p2"])
def test_corners_find_each_other_without_landmarks(name, deformation):
    """As many corners, turning the same way in the same order: they correspond, though arc lengths changed."""
    mp = models.ALL[name]()
    f = targets.bend(mp, 40) if deformation == "bend" else targets.bump(mp, (0.9, 0.3), (0.1, 0.05), 0.3)
    target, _ = targets.deformed(mp, f)
    registration = register(mp.boundary().loops, target)
    (r,) = registration.loops
    turn_s, turn_t = r.source.turn(r.source.joints[:-1]), r.target.turn(r.joints[:-1])
    corner = abs(turn_s) > np.radians(20)
    np.testing.assert_allclose(turn_t[corner], turn_s[corner], atol=np.radians(30))
    images = np.array([b for _, b in registration.joints])[corner]
    truth = f(np.array([a for a, _ in registration.joints]))[corner]
    assert np.linalg.norm(images - truth, axis=1).max() < 1e-3 * target.diameter


def test_holes_are_paired_by_position_and_by_landmarks():
    mp = models.plate_with_hole()
    f = targets.similarity(10, 1.5, (3, 1))
    target, landmarks = targets.deformed(mp, f)
    source = mp.boundary().loops
    for rows in (landmarks[:8], landmarks[8:], landmarks):
        registration = register(source, target, rows)
        assert worst(registration, f) < (1e-6 if len(rows) == 16 else 0.08) * target.diameter
    # Two holes side by side, the target's in the other order.
    outer = polygon([[0, 0], [4, 0], [4, 2], [0, 2]])
    c = circle().reversed()
    holes = [[BSplineCurve(c.knots, 2, 0.3 * c.control_points + [x, 1], c.weights)] for x in (1, 3)]
    registration = register([outer, *holes], Boundary([holes[1], outer, holes[0]]))
    for r in registration.loops:
        np.testing.assert_allclose(r.source.polygon(8).mean(axis=0), r.target.polygon(8).mean(axis=0), atol=1e-6)
    # A landmark overrules the position.
    swap = register([outer, *holes], Boundary([holes[1], outer, holes[0]]), [[1.3, 1, 3.3, 1]])
    assert swap.loops[1].target.polygon(8).mean(axis=0)[0] == pytest.approx(3)
    assert swap.loops[2].target.polygon(8).mean(axis=0)[0] == pytest.approx(1)


def test_symmetric_outlines_take_the_smallest_rotation_and_say_so():
    registration = register([polygon(SQUARE)], loop(np.roll(SQUARE, 2, axis=0) * 2.0))
    for a, b in registration.joints:
        np.testing.assert_allclose(b, 2 * a, atol=1e-9)
    assert registration.margin < 0.05
    assert "ambiguous" in registration.warnings[0]


def test_one_landmark_is_a_start():
    source = polygon(SQUARE)
    registration = register([source], loop(SQUARE), [[0, 0, 1, 1]])
    for a, b in registration.joints:
        np.testing.assert_allclose(b, 1 - a, atol=1e-9)


def test_arc_lengths_between_landmarks_keep_their_fractions():
    """With all joints as landmarks arc length alone decides between them."""
    source = polygon(SQUARE)
    ring = Boundary([[circle(2.0)]])
    at = np.radians([10, 120, 150, 300])
    rows = np.column_stack([SQUARE, 2 * np.cos(at), 2 * np.sin(at)])
    (r,) = register([source], ring, rows).loops
    s = np.array([0.0, 1, 2, 3, 4])
    t = 2 * np.radians([10, 120, 150, 300, 370])
    for i in range(4):
        for fraction in (0.0, 0.3, 0.8):
            image = r.to_target(s[i] + fraction * (s[i + 1] - s[i]))
            expected = (t[i] + fraction * (t[i + 1] - t[i])) % r.target.length
            assert float(image % r.target.length) == pytest.approx(expected, abs=1e-3)


def test_marked_curves_follow_the_paper():
    """Paper §3.2: a landmark inside a curve is not interpolated; the curve's ends come from its neighbours."""
    source = polygon([[0, 0], [2, 0], [2, 1], [0, 1]])
    ring = Boundary([[circle(1.0)]])
    angle = np.radians([0, 50, 180, 270])
    # The second landmark is inside the first curve, the others at joints 1, 2, 3 -- so curve 0 is marked.
    points = [[0.5, 0], [2, 0], [2, 1], [0, 1]]
    rows = np.column_stack([points, np.cos(angle), np.sin(angle)])
    (split,) = register([source], ring, rows).loops
    (marked,) = register([source], ring, rows, marked_curves=True).loops
    np.testing.assert_allclose(split.target.point(split.to_target(0.5)), [1, 0], atol=1e-9)
    # Curve 3 (from joint 3 to joint 0) is unmarked: its end is where the landmarks put it, two thirds on the way.
    length = 2 * np.pi
    start = np.radians(270) + (1 / 1.5) * np.radians(90)
    assert float(marked.to_target(0.0) % length) == pytest.approx(start, abs=1e-3)
    for s, a in ((2.0, angle[1]), (3.0, angle[2]), (5.0, angle[3])):
        for r in (split, marked):
            assert float(r.to_target(s) % length) == pytest.approx(a, abs=1e-3)
    # Within the marked curve arc length alone decides; its landmark is dropped.
    end = angle[1] + length
    assert float(marked.to_target(0.5)) % length == pytest.approx((start + 0.25 * (end - start)) % length, abs=1e-3)
    assert float(split.to_target(0.5)) % length == pytest.approx(0, abs=1e-3)


def test_marked_curves_split_where_no_neighbour_is_unmarked():
    source = polygon(SQUARE)
    middles = [[0.5, 0], [1, 0.5], [0.5, 1], [0, 0.5]]
    rows = np.column_stack([middles, np.roll(middles, 1, axis=0)])
    (r,) = register([source], loop(SQUARE), rows, marked_curves=True).loops
    np.testing.assert_allclose(r.target.point(r.to_target(0.5)), [0, 0.5], atol=1e-9)


def test_numbers_of_loops_must_agree():
    plate, sheet = models.plate_with_hole().boundary(), models.grid().boundary()
    with pytest.raises(InfeasibleTargetError, match=r"source has 1 holes and the target 0.*same topology"):
        register(plate.loops, sheet)
    with pytest.raises(InfeasibleTargetError, match=r"source has 0 holes and the target 1"):
        register(sheet.loops, plate)


def test_source_loops_with_the_domain_on_their_right_are_refused():
    """Their target is turned over, and with it every point but two."""
    outer, hole = polygon(SQUARE * 4 - 1.5), polygon(SQUARE)
    target = Boundary([outer, hole])
    with pytest.raises(InputError, match=r"source boundary: loop 1 has the domain on its right"):
        register([outer, hole], target)
    with pytest.raises(InputError, match=r"source boundary: loop 0 has the domain on its right"):
        register([[c.reversed() for c in outer[::-1]]], Boundary([outer]))
    assert len(register([outer, [c.reversed() for c in hole[::-1]]], target).loops) == 2


M = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([[0, 0, 0, 0], [0.5, 0.4, 1, 1]], r"row 2: \(0.5, 0.4\) is 0.4 off the source boundary.*1%"),
        ([[0, 0, 0.5, 0.3]], r"row 1: \(0.5, 0.3\) is 0.3 off the target boundary"),
        (np.hstack([M, M[[0, 2, 1, 3]]]), r"rows \d and \d cross"),
        (np.hstack([M, M[::-1]]), r"rows 1, 2, 3, 4 run backwards.*mirror"),
        ([[0, 0, 0, 0], [1, 1, 1, 1], [0, 0, 1, 0]], "rows 1 and 3 are the same point of the source"),
        ([[0, 0, 0, 0], [1, 1, 1, 1], [1, 0, 0, 0]], "rows 1 and 3 are the same point of the target"),
        ([[0, 0, 0]], r"shape \(r, 4\).*\(1, 3\)"),
        ([[0, 0, 0, np.nan]], "landmarks.*NaN"),
        ([["a", 0, 0, 0]], "landmarks.*numbers"),
    ],
)
def test_bad_landmarks_are_refused_by_row(rows, message):
    with pytest.raises(InputError, match=message) as caught:
        register([polygon(SQUARE)], loop(SQUARE), rows)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("start", range(4))
def test_the_first_landmark_may_be_the_duplicate(start):
    """Whatever the rows' order, a point given twice is found, also across the loop's own start."""
    source = polygon(np.roll(SQUARE, start, axis=0))
    for others in ([], [[1, 1, 1, 1]]):
        rows = [[0, 0, 0, 0], [0.5, 0, 0, 1e-13], *others]
        with pytest.raises(InputError, match="rows 1 and 2 are the same point of the target"):
            register([source], loop(SQUARE), rows)
        rows = [[0, 0, 0, 0], [0, 1e-13, 0.5, 0], *others]
        with pytest.raises(InputError, match="rows 1 and 2 are the same point of the source"):
            register([source], loop(SQUARE), rows)


def test_landmarks_pair_a_loop_with_one_loop():
    mp = models.plate_with_hole()
    target, landmarks = targets.deformed(mp, targets.similarity(0, 1))
    crossed = landmarks.copy()
    crossed[[0, 8], 2:] = landmarks[[8, 0], 2:]
    with pytest.raises(InputError, match=r"row \d+ pairs source loop \d with target loop \d"):
        register(mp.boundary().loops, target, crossed)


def test_no_rows_are_no_landmarks():
    source = [polygon(SQUARE)]
    for rows in (None, [], np.empty((0, 4))):
        assert register(source, loop(SQUARE), rows).confidence < 1


def test_orientation_and_start_of_the_target_do_not_matter():
    mp = models.l_shape()
    f = targets.bend(mp, 20)
    target, landmarks = targets.deformed(mp, f)
    expected = np.array([b for _, b in register(mp.boundary().loops, target, landmarks).joints])
    (curves,) = target.loops
    for turn in range(len(curves)):
        for reverse in (False, True):
            rolled = [*curves[turn:], *curves[:turn]]
            other = Boundary([[c.reversed() for c in rolled[::-1]] if reverse else rolled])
            found = np.array([b for _, b in register(mp.boundary().loops, other, landmarks).joints])
            np.testing.assert_allclose(found, expected, atol=1e-8)


def test_outlines_are_those_given():
    mp = models.l_shape()
    target, landmarks = targets.deformed(mp, targets.bend(mp, 20))
    (r,) = register(mp.boundary().loops, target, landmarks).loops
    assert r.source.curves == mp.boundary().loops[0]
    assert Outline(target.loops[0]).length == pytest.approx(r.target.length, rel=1e-12)


FLAT = [[0.0, 0], [1, 0], [2, 0], [1, 0]]


@pytest.mark.parametrize(
    ("loops", "message"),
    [
        ([np.repeat(SQUARE, [1, 2, 1, 1], axis=0)], r"loop 0, curve 1 at \(1, 0\) has no length"),
        ([SQUARE, np.zeros((3, 2)) + 0.5], r"loop 1, curve 0 at \(0.5, 0.5\) has no length"),
        ([SQUARE, SQUARE], "loops 0 and 1 lie on each other"),
        ([SQUARE, SQUARE[::-1]], "loops 0 and 1 lie on each other"),
        ([SQUARE, 0.2 + 0.2 * np.array(FLAT)], "loop 1 encloses no area"),
    ],
)
def test_target_loops_that_bound_nothing_are_refused(loops, message):
    source = [polygon(SQUARE)] if len(loops) == 1 else models.plate_with_hole().boundary().loops
    with pytest.raises(InputError, match=message):
        register(source, Boundary([polygon(corners) for corners in loops]))
