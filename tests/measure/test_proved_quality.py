"""Proved bounds of the quality: samples lie between them, closed forms, exact fractions, invariances."""

import json
import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import models
import patchtransfer as pt
import real
from commands import run
from patchtransfer.measure.quality import sample
from shapes import LINE, bicubic, identity, mirrored, quad

ROUNDING = 1e-12


def of(patch: pt.Patch, **more) -> pt.ProvedQuality:
    return pt.quality(pt.MultiPatch([patch], []), proved=True, **more).proved


def holds(bounds: pt.Bounds, value: float, rel: float = ROUNDING) -> bool:
    return bounds.lower <= value * (1 + rel) and value <= bounds.upper * (1 + rel)


@given(
    seed=st.integers(0, 10**6),
    size=st.floats(0, 0.12),
    weights=st.booleans(),
    width=st.sampled_from([0.1, 1e-3, 1e-7]),
)
def test_dense_samples_are_between_the_bounds(seed, size, weights, width):
    mp = pt.MultiPatch([bicubic(seed, size, weights)], [])
    proved, dense = pt.quality(mp, proved=True, width=width).proved, pt.quality(mp, 60)
    jacobian, condition = proved.min_scaled_jacobian, proved.max_condition_number
    assert jacobian.lower <= dense.scaled_jacobian.min + ROUNDING
    assert condition.upper >= dense.condition_number.max * (1 - ROUNDING)
    if jacobian.upper < 0:
        assert jacobian.lower == -1
        assert condition.lower == math.inf
    elif jacobian.lower > 0:
        assert jacobian.upper - jacobian.lower <= width * jacobian.upper
        assert condition.upper - condition.lower <= width * condition.upper * (1 + ROUNDING)
    # What is taken is taken: a finite difference of the map says so, too.
    _, u, v = jacobian.at
    assert scaled_jacobian_at(mp.patches[0], u, v) == pytest.approx(jacobian.upper, abs=1e-9)


def scaled_jacobian_at(patch: pt.Patch, u: float, v: float) -> float:
    """By the derivatives that the patch evaluates; at the inner knots of these patches they are continuous."""
    x, y = (patch.grid([u], [v], a, 1 - a)[0, 0] for a in (1, 0))
    return (x[0] * y[1] - x[1] * y[0]) / (np.hypot(*x) * np.hypot(*y))


def test_samples_overstate_what_is_proved():
    mp = pt.MultiPatch([bicubic(182, 0.1)], [])
    found = pt.quality(mp, proved=True)
    dense = pt.quality(mp, 1000).scaled_jacobian.min
    assert found.scaled_jacobian.min > 1.2 * found.proved.min_scaled_jacobian.upper
    assert found.proved.min_scaled_jacobian.lower <= dense <= 1.001 * found.proved.min_scaled_jacobian.upper


@pytest.mark.parametrize("angle", [0.02, 0.7, math.pi / 2, 2.5])
def test_a_parallelogram_has_the_sine_of_its_angle_at_once(angle):
    c, s = math.cos(angle), math.sin(angle)
    proved = of(quad([0, 0], [2, 0], [2 + c, s], [c, s]))
    for bounds, value in ((proved.min_scaled_jacobian, s), (proved.max_condition_number, 2.5 / s)):
        assert holds(bounds, value)
        assert bounds.upper - bounds.lower < 1e-13 * value / s
    assert proved.cells == 0


@given(points=st.lists(st.tuples(st.integers(-2, 2), st.integers(-2, 2)), min_size=9, max_size=9))
@settings(max_examples=60)
def test_agrees_with_fractions_on_integer_patches(points):
    """A second route without rounding: det J and B_u·B_v as products of Bernstein forms in fractions, at a grid."""
    control = (np.array(points, float).reshape(3, 3, 2) + 6 * np.stack(np.mgrid[:3, :3], axis=2)).round()
    knots = [0.0] * 3 + [1.0] * 3
    proved = of(pt.Patch((knots, knots), (2, 2), control), width=1e-6)
    worst, largest = Fraction(2), Fraction(0)
    for i in range(9):
        for j in range(9):
            x, y = tangents(control, Fraction(i, 8), Fraction(j, 8))
            det = x[0] * y[1] - x[1] * y[0]
            e, g = x[0] ** 2 + x[1] ** 2, y[0] ** 2 + y[1] ** 2
            if e * g > 0:
                # The sign of det J times its square over EG is monotone in the scaled Jacobian.
                worst = min(worst, (1 if det > 0 else -1) * det * det / (e * g))
            if det > 0:
                largest = max(largest, (e + g) / det)
    low, high = proved.min_scaled_jacobian.lower, proved.max_condition_number.upper
    assert (1 if low > 0 else -1) * Fraction(low) ** 2 <= worst
    assert high == math.inf or Fraction(high) >= largest
    if proved.min_scaled_jacobian.lower > 0:
        _, u, v = proved.min_scaled_jacobian.at
        x, y = tangents(control, Fraction(u), Fraction(v))
        det, lengths = x[0] * y[1] - x[1] * y[0], (x[0] ** 2 + x[1] ** 2) * (y[0] ** 2 + y[1] ** 2)
        assert Fraction(proved.min_scaled_jacobian.upper) ** 2 >= det * det / lengths


def tangents(control, u: Fraction, v: Fraction) -> list[list[Fraction]]:
    """B_u and B_v of a biquadratic Bézier patch, exactly."""

    def basis(t):
        return [(1 - t) ** 2, 2 * t * (1 - t), t**2], [2 * t - 2, 2 - 4 * t, 2 * t]

    (a, da), (b, db) = basis(u), basis(v)
    exact = [[[Fraction(float(x)) for x in point] for point in row] for row in control]
    return [
        [sum(f[i] * g[j] * exact[i][j][c] for i in range(3) for j in range(3)) for c in (0, 1)]
        for f, g in ((da, b), (a, db))
    ]


def test_a_straight_corner_is_zero_and_can_be_left_out():
    straight = quad([0, 0], [1, 0], [0.5, 0.5], [0, 1])
    proved = of(straight)
    assert (proved.min_scaled_jacobian.lower, proved.min_scaled_jacobian.upper) == (0, 0)
    assert (proved.max_condition_number.lower, proved.max_condition_number.upper) == (math.inf, math.inf)
    assert proved.min_scaled_jacobian.at == (0, 1, 1)
    assert proved.cells < 100
    for samples in (3, 4, 10):
        found = pt.quality(pt.MultiPatch([straight], []), samples, [(0, 3)], proved=True)
        proved = found.proved
        # The nearest samples are on the cut, where this patch is worst.
        assert holds(proved.min_scaled_jacobian, found.scaled_jacobian.min)
        assert holds(proved.max_condition_number, found.condition_number.max)


@pytest.mark.parametrize("corners", [(0,), (1,), (0, 1), (0, 2), (1, 2), (0, 1, 2, 3)])
def test_squares_at_corners_are_left_out_and_nothing_else(corners):
    mp = pt.MultiPatch([quad([0, 0], [3, 0.5], [5, 5], [1, 2])], [])
    whole = pt.quality(mp, 4, proved=True).proved
    left = pt.quality(mp, 4, [(0, c) for c in corners], proved=True)
    assert left.proved.min_scaled_jacobian.lower >= whole.min_scaled_jacobian.lower - ROUNDING
    points = [(u, v) for u in np.linspace(0, 1, 31) for v in np.linspace(0, 1, 31)]
    apart = [(u, v) for u, v in points if not any(inside(c, u, v, 1 / 3) for c in corners)]
    values = [scaled_jacobian_at(mp.patches[0], u, v) for u, v in apart]
    assert holds(left.proved.min_scaled_jacobian, min(values), 1e-3)


def inside(corner: int, u: float, v: float, size: float) -> bool:
    """Whether a point is within a square at a corner, but not on its cuts."""
    return abs(u - corner % 2) < size - 1e-9 and abs(v - corner // 2) < size - 1e-9


def test_a_fold_is_proved_where_it_is_worst():
    proved = of(quad([0, 0], [1, 0], [0.3, 0.3], [0, 1]))
    assert proved.min_scaled_jacobian.lower == -1
    assert proved.min_scaled_jacobian.upper < -0.5
    assert proved.min_scaled_jacobian.at == (0, 1, 1)
    assert proved.max_condition_number.lower == math.inf
    assert "at most -0." in str(proved)
    assert "infinite, proved" in str(proved)


def test_a_side_that_is_a_point_ends_soon():
    point = pt.Patch((LINE, LINE), (1, 1), [[[0, 0], [0, 0]], [[1, 0], [0, 1]]])
    proved = of(point)
    assert proved.max_condition_number.upper == math.inf
    assert proved.min_scaled_jacobian.lower <= 0
    assert "not proved" in str(proved) or "0, proved" in str(proved)


@given(
    seed=st.integers(0, 10**6),
    angle=st.floats(0, 7),
    scale=st.sampled_from([1e-150, 1e-3, 7.0, 1e150]),
    swap=st.booleans(),
    refined=st.sampled_from(["", "elevate", "split"]),
)
def test_does_not_depend_on_how_the_map_is_written(seed, angle, scale, swap, refined):
    patch = bicubic(seed, 0.05)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    moved = patch.with_control_points(scale * (patch.control_points @ turn.T + [3.0, -2.0]))
    moved = mirrored(moved) if swap else moved
    mp = pt.MultiPatch([moved], [])
    mp = mp.elevate(1) if refined == "elevate" else mp.split_spans(2) if refined == "split" else mp
    a, b = of(patch), pt.quality(mp, proved=True).proved
    for one, other in (
        (a.min_scaled_jacobian, b.min_scaled_jacobian),
        (a.max_condition_number, b.max_condition_number),
    ):
        assert max(one.lower, other.lower) <= min(one.upper, other.upper) * (1 + 1e-9)


def test_knots_have_their_unit():
    """The condition number is in the patch's own parameters, which the core scales by powers of two."""
    points = identity((LINE, LINE), (1, 1))
    for a, b in ((1, 1), (3, 1), (0.25, 5), (1000, 1)):
        patch = pt.Patch(([0, 0, a, a], [0, 0, b, b]), (1, 1), points)
        value = (b / a) + (a / b)
        proved = of(patch)
        assert holds(proved.max_condition_number, value)
        assert proved.max_condition_number.upper <= value * (1 + 1e-12)


def test_threads_do_not_change_a_bit():
    mp = models.grid()
    found = []
    for threads in (1, 2, 3):
        pt._core.set_threads(threads)
        found.append(pt.quality(mp, proved=True, width=1e-6).proved)
    pt._core.set_threads(0)
    assert found[0] == found[1] == found[2]


def test_width_is_what_is_asked_for_and_checked():
    mp, _, _ = pt.examples.load("wrench")
    wide, narrow = (pt.quality(mp, proved=True, width=w).proved for w in (0.1, 1e-8))
    assert narrow.cells >= wide.cells
    for name in ("min_scaled_jacobian", "max_condition_number"):
        a, b = getattr(wide, name), getattr(narrow, name)
        assert a.lower <= b.lower <= b.upper <= a.upper
        assert b.upper - b.lower <= 1e-8 * b.upper
    for width in (0, 1, -1, math.nan):
        with pytest.raises(pt.InputError, match="width"):
            pt.quality(mp, proved=True, width=width)


def test_degrees_that_are_too_high_are_refused():
    knots = [0.0] * 16 + [1.0] * 16
    points = identity((knots, LINE), (15, 1))
    mp = pt.MultiPatch([pt.Patch((knots, LINE), (15, 1), points, np.linspace(1, 2, 32).reshape(16, 2))], [])
    with pytest.raises(pt.InputError, match=r"patch 0: degrees \(15, 1\) exceed 14"):
        pt.quality(mp, proved=True)
    assert pt.quality(mp).proved is None


def test_a_transfer_reports_what_is_proved():
    source, target, landmarks = pt.examples.load("wrench")
    result = pt.transfer(source, target, landmarks, continuity="c0")
    bounds = result.quality.proved.min_scaled_jacobian
    assert 0 < bounds.lower <= bounds.upper <= result.quality.scaled_jacobian.min + ROUNDING
    dense = min(float(values.min()) for _, values in sample(result.multipatch, 100))
    assert bounds.lower <= dense
    data = json.loads(json.dumps(result.to_dict()))["quality"]["proved"]
    assert data["min_scaled_jacobian"]["lower"] == bounds.lower
    assert pt.ProvedQuality.from_dict(data) == result.quality.proved


def test_command_line(tmp_path):
    source, _, _ = pt.examples.load("wrench")
    model, report = tmp_path / "model.xml", tmp_path / "report.json"
    pt.write(source, model)
    found = run("quality", model, "--proved", "--json", report)
    assert found.exit_code == 0
    assert "proved" not in found.stderr
    assert "minimum scaled Jacobian 0.7" in found.stdout
    assert "proved" in found.stdout
    assert json.loads(report.read_text())["quality"] == pt.quality(pt.read(model), proved=True).to_dict()
    assert "proved" not in run("quality", model).stdout
    assert run("quality", model, "--proved", "--width", "2").exit_code == 2
    assert "minimum scaled Jacobian 0.7" in run("check", model).stdout


@real.needed
@pytest.mark.parametrize("name", ["yeti", "turtle"])
def test_real_models(name):
    mp = real.model(name)
    found = pt.quality(mp, 40, proved=True)
    assert holds(found.proved.min_scaled_jacobian, found.scaled_jacobian.min, 1e-9)
    assert holds(found.proved.max_condition_number, found.condition_number.max, 1e-9)
