"""Symmetries of outlines and of layouts."""

from __future__ import annotations

import numpy as np
import pytest

import domains
from outlines import smooth_loop
from patchtransfer import Boundary, QuadLayout
from patchtransfer.geometry.outline import Outline
from patchtransfer.sources.auto_layout.symmetry import Isometry, layout_symmetry, outline_symmetries, symmetrised
from shapes import SQUARE, loop, polygon

RECTANGLE = loop(SQUARE * [2, 1])
#: The square's nine vertices, row by row, and its quarters.
PLACES = np.array([(x, y) for y in (0.0, 0.5, 1.0) for x in (0.0, 0.5, 1.0)])
QUARTERS = np.array([[0, 1, 4, 3], [1, 2, 5, 4], [3, 4, 7, 6], [4, 5, 8, 7]])
RIM = np.array([0, 1, 2, 3, 5, 6, 7, 8])
LEFT_RIGHT = Isometry(np.diag([-1.0, 1.0]), np.array([0.5, 0.5]))
QUARTER_TURN = Isometry(domains.rotation(90), np.array([0.5, 0.5]))


def symmetries(boundary):
    return outline_symmetries([Outline(curves) for curves in boundary.loops])


@pytest.mark.parametrize(
    ("boundary", "mirrors", "turns"),
    [
        (loop(SQUARE), 4, 3),
        (RECTANGLE, 2, 1),
        (domains.L, 1, 0),
        (domains.T, 1, 0),
        (domains.SKEW_L, 0, 0),
        (domains.pentagon(), 5, 4),
        (domains.plate(), 4, 3),
        (domains.plate((0.2, 0.0)), 1, 0),
        (domains.plate((0.2, 0.1)), 0, 0),
        (domains.disk(radii=(1.7, 1.0)), 2, 1),
        (loop([(0, 0), (2, 0), (3, 1), (1, 1)]), 0, 1),
        # Of infinitely many, those of a square.
        (domains.disk(), 4, 3),
    ],
    ids=[
        *("square", "rectangle", "L", "T", "skew", "pentagon", "plate", "shifted", "askew", "ellipse", "parallelogram"),
        "disk",
    ],
)
@pytest.mark.parametrize("turned", [0, 37])
def test_symmetries_of_outlines(boundary, mirrors, turns, turned):
    moved = domains.mapped(boundary, 10 * domains.rotation(turned), (3.0, -40.0))
    found = symmetries(moved)
    assert sum(isometry.mirrors for isometry in found) == mirrors
    assert len(found) - mirrors == turns
    loops = [Outline(curves) for curves in moved.loops]
    for isometry in found:
        assert np.allclose(isometry.matrix @ isometry.matrix.T, np.eye(2), atol=1e-14)
        assert np.linalg.det(isometry.matrix) == pytest.approx(-1 if isometry.mirrors else 1)
        # Samples of curves are 1e-8 off them.
        for outline in loops:
            images = isometry(outline.polygon(200))
            assert np.min([other.nearest(images)[1] for other in loops], axis=0).max() < 1e-7 * moved.diameter


@pytest.mark.parametrize("degrees", [0, 10, 37])
def test_axes_are_exact(degrees):
    """Corners go to corners to rounding, or patches made symmetric would miss them."""
    boundary = domains.mapped(domains.T, domains.rotation(degrees))
    corners = np.array([curve.start for curve in boundary.loops[0]])
    (mirror,) = symmetries(boundary)
    distance = np.linalg.norm(mirror(corners)[:, None] - corners[None], axis=2)
    assert distance.min(axis=1).max() < 1e-13


def test_nearly_symmetric_outlines_count_as_symmetric():
    """One thousandth, as in a drawing by hand; not a hundredth."""
    assert len(symmetries(loop([(0, 0), (1, 0), (1, 1.001), (0, 1)]))) == 7
    assert symmetries(loop([(0, 0), (1, 0), (1, 1.03), (0.01, 0.98)])) == []


def test_equal_holes_may_be_exchanged():
    angle = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    hole = smooth_loop(0.2 * np.column_stack([np.cos(angle), np.sin(angle)]))
    holes = [domains.mapped(Boundary([hole]), np.eye(2), (x, 0.0)).loops[0] for x in (-1.0, 1.0)]
    boundary = Boundary([polygon((2 * SQUARE - 1) * [2, 1]), *holes])
    assert len(symmetries(boundary)) == 3


def test_an_isometry_maps_points_of_any_shape():
    assert QUARTER_TURN(np.array([1.0, 0.5])) == pytest.approx([0.5, 1.0])
    assert QUARTER_TURN(np.zeros((2, 3, 2))).shape == (2, 3, 2)
    assert LEFT_RIGHT.mirrors
    assert not QUARTER_TURN.mirrors


def test_images_of_vertices():
    image = layout_symmetry(QUARTERS, RIM, PLACES[RIM], LEFT_RIGHT, np.sqrt(2))
    assert image.tolist() == [2, 1, 0, 5, 4, 3, 8, 7, 6]
    image = layout_symmetry(QUARTERS, RIM, PLACES[RIM], QUARTER_TURN, np.sqrt(2))
    assert image.tolist() == [2, 5, 8, 1, 4, 7, 0, 3, 6]


def test_layouts_without_the_symmetry():
    # Halves: turned, their cut would lie across.
    places, halves, rim = PLACES[[0, 1, 2, 6, 7, 8]], np.array([[0, 1, 4, 3], [1, 2, 5, 4]]), np.arange(6)
    assert layout_symmetry(halves, rim, places, LEFT_RIGHT, np.sqrt(2)).tolist() == [2, 1, 0, 5, 4, 3]
    assert layout_symmetry(halves, rim, places, QUARTER_TURN, np.sqrt(2)) is None
    # A cut that is not in the middle.
    moved = places.copy()
    moved[[1, 4], 0] = 0.6
    assert layout_symmetry(halves, rim, moved, LEFT_RIGHT, np.sqrt(2)) is None


def test_the_mean_of_images():
    """Quarters of a square with a control point astray become symmetric; symmetric ones stay."""
    mp = QuadLayout(PLACES, QUARTERS).multipatch(2, 2)
    group = []
    for turns in (1, 2, 3):
        turn = Isometry(domains.rotation(90 * turns), QUARTER_TURN.centre)
        group.append((turn, layout_symmetry(QUARTERS, RIM, PLACES[RIM], turn, np.sqrt(2))))
    same = symmetrised(mp, QUARTERS, group)
    nets = [patch.control_points.copy() for patch in mp.patches]
    for net, patch in zip(nets, same.patches, strict=True):
        assert np.allclose(net, patch.control_points, rtol=0, atol=1e-15)
    nets[0][1, 1] += [0.04, 0.02]
    result = symmetrised(mp.with_control_points(nets), QUARTERS, group)
    assert np.allclose(result.patches[0].control_points[1, 1] - mp.patches[0].control_points[1, 1], [0.01, 0.005])
    points = np.concatenate([patch.control_points.reshape(-1, 2) for patch in result.patches])
    for turn, _ in group:
        assert np.linalg.norm(turn(points)[:, None] - points[None], axis=2).min(axis=1).max() < 1e-15
