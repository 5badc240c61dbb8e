"""Paths of pictures against the curves that they draw."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from svg.path import parse_path

import models
import patchtransfer as pt
from patchtransfer.web import figure, joint_labels, picture


def bezier(pieces, t):
    """Points of cubic Béziers (n, 4, 2) at the parameters t, (n, len(t), 2)."""
    basis = np.stack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3], axis=1)
    return np.einsum("tk,nkj->ntj", basis, pieces)


@settings(max_examples=15, deadline=None)
@given(st.integers(1, 3), st.integers(1, 4), st.integers(0, 5))
def test_lines_of_cubics_are_exact(degree, spans, seed):
    patch = models.grid(1, 1, degree, spans, seed).patches[0]
    lines = picture.iso_lines(picture.sampled(pt.MultiPatch([patch], [])))
    # Every piece is a polynomial of degree 3 on its part of a line, whose ends and middle are enough to find it.
    t = np.linspace(0, 1, 7)
    at = bezier(lines.pieces, t)
    _, u, v = pt.MultiPatch([patch], []).locate(at.reshape(-1, 2), tolerance=1e-9)
    u, v = u.reshape(-1, 7), v.reshape(-1, 7)
    along_u, along_v = np.ptp(u, axis=1), np.ptp(v, axis=1)
    assert (np.minimum(along_u, along_v) < 1e-7).all()
    # At equal steps of the parameter, which a line drawn through points only would not have.
    running = np.where((along_u > along_v)[:, None], u, v)
    steps = np.diff(running, axis=1)
    np.testing.assert_allclose(steps, np.broadcast_to(steps[:, :1], steps.shape), atol=1e-6)


def test_arcs_and_high_degrees_are_drawn_within_a_unit():
    """What is no cubic is interpolated, piece by piece, as near as the picture can show."""
    half = np.sqrt(0.5)
    arc = pt.BSplineCurve([0, 0, 0, 1, 1, 1], 2, [[1, 0], [1, 1], [0, 1]], [1, half, 1])
    pieces = picture.curve_lines([arc]).pieces
    at = bezier(pieces, np.linspace(0, 1, 50)).reshape(-1, 2)
    frame = picture.frame(at)
    assert np.abs(np.hypot(*at.T) - 1).max() * frame.scale < 0.2
    quintic = models.interpolated(lambda u, v: np.stack([u + 0.05 * np.sin(3 * v), v + 0.05 * np.sin(3 * u)], -1), 5, 1)
    lines = picture.iso_lines(picture.sampled(pt.MultiPatch([quintic], [])))
    _, u, v = pt.MultiPatch([quintic], []).locate(
        bezier(lines.pieces, np.linspace(0, 1, 5)).reshape(-1, 2), tolerance=1e-3
    )
    across = np.minimum(np.ptp(u.reshape(-1, 5), axis=1), np.ptp(v.reshape(-1, 5), axis=1))
    assert across.max() < 1e-4


@given(st.integers(0, 20))
@settings(max_examples=10, deadline=None)
def test_path_data_says_what_the_pieces_are(seed):
    mp = models.grid(2, 1, 3, 2, seed)
    drawn = picture.sampled(mp)
    lines = picture.iso_lines(drawn)
    frame = picture.frame(np.concatenate([p.reshape(-1, 2) for p, _ in drawn.grids]))
    parts = [s for s in parse_path(picture.path(lines, frame)) if type(s).__name__ == "CubicBezier"]
    said = np.array([[s.start, s.control1, s.control2, s.end] for s in parts])
    drawn_units = frame(lines.pieces)
    np.testing.assert_array_equal(said.real, drawn_units[..., 0])
    np.testing.assert_array_equal(said.imag, drawn_units[..., 1])
    # Class by class the same pieces, each once.
    by_class = picture.by_class(lines, frame)
    count = sum(data.count("c") for _, data in by_class)
    assert count == len(lines.pieces)
    assert [kind for kind, _ in by_class] == sorted({*picture.class_of(lines.values).tolist()}, reverse=True)


def test_a_frame_keeps_proportions_and_turns_y():
    frame = picture.frame(np.array([[1.0, 2.0], [3.0, 3.0]]))
    corners = frame(np.array([[1.0, 3.0], [3.0, 2.0]]))
    np.testing.assert_array_equal(corners, [[1000, 1000], [39000, 20000]])
    assert frame.view_box == "0 0 40000 21000"


def test_classes_end_where_they_say():
    values = np.array([-1, 0, 1e-9, 0.2, 0.21, 0.9, 0.95, 0.951, 1.0])
    np.testing.assert_array_equal(picture.class_of(values), [0, 0, 1, 1, 2, 6, 7, 8, 8])


def test_a_loop_is_closed_without_a_chord():
    """Closing is for the last piece of a loop; a chord would be a line that is not there."""
    mp = models.grid(2, 2, 2, 1, None)
    frame = picture.frame(mp.topology.coordinates)
    segments = [type(s).__name__ for s in parse_path(picture.loops(mp.boundary(), frame))]
    assert segments.count("Move") == 1
    closing = parse_path(picture.loops(mp.boundary(), frame))[-1]
    assert abs(closing.start - closing.end) <= 1


def test_neighbours_have_different_colours():
    mp = models.grid(4, 4, 1, 1, None)
    colours = [colour for colour, _ in figure.model_figure(mp, "a", "a")[0].patches]
    assert all(colours[f.patch_a] != colours[f.patch_b] for f in mp.interfaces)


def test_the_worst_places_are_where_they_say():
    mp = models.grid(2, 2, 3, 2, 3)
    _, places = figure.model_figure(mp, "a", "a", worst=True)
    assert places == sorted(places, key=lambda place: place.value)
    for place in places:
        np.testing.assert_allclose(mp.patches[place.patch](place.u, place.v), place.point, atol=1e-12)
    assert places[0].value == pytest.approx(pt.quality(mp, samples=19).scaled_jacobian.min, abs=0.05)


@pytest.mark.parametrize("name", pt.examples.EXAMPLES)
def test_numbers_of_joints_are_whole_and_apart(name):
    """Beside their joints, inside the picture, and none on another; they were printed on each other and cut off."""
    result = pt.transfer(*pt.examples.load(name))
    joints = np.array([np.concatenate(joint) for joint in result.registration.joints])
    target = pt.Boundary([loop.target.curves for loop in result.registration.loops])
    own = figure.model_figure(result._source, "source", "source", joints=joints[:, :2])[0]
    other = figure.boundary_figure(target, "target", "target", joints[:, 2:])
    for drawn, points in ((own, joints[:, :2]), (other, joints[:, 2:])):
        assert [mark.text for mark in drawn.joints] == [str(k) for k in range(len(joints))]
        at = np.array([(mark.x, mark.y) for mark in drawn.joints])
        # Digits of a font of 1000 units are 640 wide and 900 high.
        half = np.array([(320 * len(mark.text), 450) for mark in drawn.joints])
        low, high = at - half, at + half
        assert (low >= 0).all()
        assert (high <= [float(size) for size in drawn.view_box.split()[2:]]).all()
        over = (low[:, None] < high) & (high[:, None] > low)
        assert over.all(axis=2).sum() == len(joints)
        in_frame = picture.frame(
            np.concatenate([picture.curve_lines(loop).pieces.reshape(-1, 2) for loop in target.loops])
        )
        if drawn is other:
            assert np.hypot(*(at - in_frame(points)).T).max() <= 2800


def test_numbers_are_outside_of_outlines_and_inside_of_holes():
    """Of a square frame, at points of its sides' lower quarters: where there is room on both sides."""
    square = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], float)
    loops = [square, square[::-1] / 2]
    frame = pt.Boundary([pt.Boundary.from_points(loop).loops[0] for loop in loops])
    points = np.concatenate([0.75 * loop + 0.25 * np.roll(loop, -1, axis=0) for loop in loops])
    # A wide frame around: there is no room at the edge of the picture.
    in_frame = picture.frame(3 * square)
    outlines = [picture.curve_lines(loop).pieces[:, :3].reshape(-1, 2) for loop in frame.loops]
    middles = in_frame.inverse(joint_labels.beside(points, outlines, np.empty((0, 2)), in_frame))
    size = np.abs(middles).max(axis=1)
    assert (size[:4] > 1.02).all()
    assert (size[4:] < 0.48).all()
    assert np.hypot(*(middles - points).T).max() < 0.3
