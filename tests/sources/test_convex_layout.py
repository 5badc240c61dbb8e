"""The layout of last resort: it exists for every valid outline, and its patches are certified."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, event, given, settings
from hypothesis import strategies as st

import patchtransfer as pt
from outlines import blobs, cell_unions, outlines, smooth_loop, star_polygons
from patchtransfer.geometry.outline import Outline
from patchtransfer.proof.feasibility import check_loops
from patchtransfer.sources.auto_layout.coarse_polygon import coarse_polygon
from patchtransfer.sources.auto_layout.convex import convex_layout
from patchtransfer.sources.auto_layout.convex_pieces import convex_pieces, quads_needed
from patchtransfer.sources.auto_layout.reasons import NoLayoutError
from patchtransfer.sources.auto_layout.with_places import with_places
from shapes import polygon


def loops_of(boundary: pt.Boundary) -> list[Outline]:
    return [Outline(loop) for loop in boundary.loops]


def certified(boundary: pt.Boundary) -> pt.TransferResult:
    own = loops_of(boundary)
    layout = with_places(convex_layout(own), own)
    return pt.from_layout(layout.vertices, layout.quads, boundary, 3, 3, assignment=layout.assignment)


def valid(boundary: pt.Boundary) -> bool:
    try:
        return not check_loops(boundary.loops, "outline")
    except pt.InfeasibleTargetError:
        return False


def area_of(boundary: pt.Boundary) -> float:
    areas = sorted((abs(outline.area) for outline in loops_of(boundary)), reverse=True)
    return areas[0] - sum(areas[1:])


def moved(boundary: pt.Boundary, linear: np.ndarray) -> pt.Boundary:
    return pt.Boundary(
        [
            [pt.BSplineCurve(c.knots, c.degree, c.control_points @ linear.T, c.weights) for c in loop]
            for loop in boundary.loops
        ]
    )


@settings(max_examples=40)
@given(outlines)
def test_every_outline_has_a_certified_layout(boundary):
    assume(valid(boundary))
    result = certified(boundary)
    event(f"{len(boundary.loops)} loops, {len(result.multipatch) // 10 * 10}s of patches")
    assert result.certificate.status == "certified"
    own = sum(
        abs(o.area) * (1 if k == 0 else -1) for k, o in enumerate(map(Outline, result.multipatch.boundary().loops))
    )
    assert own == pytest.approx(area_of(boundary), rel=5e-3)


@settings(max_examples=60)
@given(outlines)
def test_layouts_are_what_they_say(boundary):
    """A disk with holes, corners on vertices, enough quads at every boundary vertex, arc lengths in order."""
    assume(valid(boundary))
    own = loops_of(boundary)
    layout = convex_layout(own)
    graph = with_places(layout, own).graph
    assert len(graph.loops) == len(own)
    assert sorted(graph.boundary_vertices) == layout.boundary_vertices.tolist()
    np.testing.assert_array_equal(graph.valence, layout.valence)
    assert not np.isnan(layout.points).any()
    on = {v: k for k, v in enumerate(layout.boundary_vertices.tolist())}
    for k, outline in enumerate(own):
        mine = layout.boundary_loop == k
        s, corner = layout.boundary_s[mine], layout.corner[mine]
        np.testing.assert_allclose(layout.points[layout.boundary_vertices[mine]], outline.point(s), atol=1e-9)
        np.testing.assert_allclose(np.sort(s[corner]), np.sort(outline.corners[0]), atol=1e-9 * outline.length)
        outer = abs(outline.area) == max(abs(o.area) for o in own)
        turn = outline.turn(s) * (1 if (outline.area > 0) == outer else -1)
        angle = np.where(corner, np.pi - turn, np.pi)
        assert (layout.valence[layout.boundary_vertices[mine]] >= quads_needed(angle)).all()
    for loop in graph.loops:
        s = layout.boundary_s[[on[v] for v in loop]]
        length = own[layout.boundary_loop[on[loop[0]]]].length
        turns = np.mod(np.diff(s, append=s[0]), length).sum() / length
        assert round(turns) in (1, len(loop) - 1)


def generic(kind: str) -> pt.Boundary:
    """Outlines without symmetries: of four points on a circle either diagonal is Delaunay."""
    if kind == "blob":
        return blob()
    random = np.random.default_rng(int(kind))
    n = 7 + int(kind)
    angle = 2 * np.pi * (np.arange(n) + random.uniform(-0.3, 0.3, n)) / n
    radius = random.uniform(0.4, 1.2, n)
    points = radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    hole = 0.15 * np.array([[1.0, 0.1], [-0.2, -1.1], [-0.9, 0.7]])
    return pt.Boundary([polygon(points), polygon(hole)])


@pytest.mark.parametrize("kind", ["blob", "0", "1", "2", "3"])
def test_layouts_follow_the_outline(kind):
    """The same valences for the same shape elsewhere, of another size, mirrored, or described otherwise."""
    boundary = generic(kind)
    cosine, sine = np.cos(np.radians(37)), np.sin(np.radians(37))
    maps = [np.array([[cosine, -sine], [sine, cosine]]), np.eye(2) * 1e-3, np.eye(2) * 1e3, np.diag([-1.0, 1.0])]
    others = [moved(boundary, linear) for linear in maps]
    others.append(pt.Boundary([[c.reversed() for c in reversed(loop)] for loop in boundary.loops]))
    others.append(pt.Boundary(boundary.loops[::-1]))
    others.append(pt.Boundary([loop[1:] + loop[:1] for loop in boundary.loops]))
    wanted = convex_layout(loops_of(boundary))
    for other in others:
        found = convex_layout(loops_of(other))
        assert sorted(found.valence.tolist()) == sorted(wanted.valence.tolist())
        assert len(found.quads) == len(wanted.quads)


def test_the_same_layout_twice_to_the_bit():
    boundary = blob()
    a, b = (convex_layout(loops_of(boundary)) for _ in range(2))
    for name in ("quads", "points", "boundary_vertices", "boundary_loop", "boundary_s", "corner", "valence"):
        assert getattr(a, name).tobytes() == getattr(b, name).tobytes()
        assert not getattr(a, name).flags.writeable


def blob() -> pt.Boundary:
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    radius = 1 + 0.25 * np.cos(3 * angle + 0.3) + 0.12 * np.sin(2 * angle)
    return pt.Boundary([smooth_loop(radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))])


def disk(radius=1.0, n=32) -> list[pt.BSplineCurve]:
    angle = np.linspace(0, 2 * np.pi, n, endpoint=False)
    return smooth_loop(radius * np.column_stack([np.cos(angle), np.sin(angle)]))


@pytest.mark.parametrize(
    ("loops", "patches", "mean"),
    [
        ([polygon([(0, 0), (3, 0), (3, 1), (0, 1)])], 1, 1.0),
        ([polygon([(0, 0), (2, 0), (0.7, 1.5)])], 3, 0.96),
        ([disk()], 5, 0.99),
        ([disk(), disk(0.4)], 4, 0.98),
    ],
)
def test_simple_domains_have_simple_layouts(loops, patches, mean):
    result = certified(pt.Boundary(loops))
    assert len(result.multipatch) == patches
    assert result.quality.scaled_jacobian.mean >= mean - 1e-9


def test_a_thin_ring_has_more_nodes_until_chords_pass_the_hole():
    polygons = coarse_polygon(loops_of(pt.Boundary([disk(), disk(0.9)])))
    assert len(polygons.points) > 8
    pieces = convex_pieces(polygons)
    assert sum(len(cycle) == 4 for cycle in pieces.cycles) == len(pieces.cycles)
    assert certified(pt.Boundary([disk(), disk(0.98)])).certificate.status == "certified"


def test_the_tip_of_a_leaf_is_filled_by_one_patch():
    """Its five degrees bound the scaled Jacobian; nothing else is as bad."""
    lower = np.array([[0, 0], [0.5, -0.02], [1, -0.6]])
    sides = [pt.BSplineCurve([0, 0, 0, 1, 1, 1], 2, x) for x in (lower, (lower * [1, -1])[::-1])]
    end = pt.BSplineCurve([0, 0, 1, 1], 1, [[1, -0.6], [1, 0.6]])
    result = certified(pt.Boundary([[sides[0], end, sides[1]]]))
    assert result.certificate.status == "certified"
    assert result.corner_bound == pytest.approx(np.sin(2 * np.arctan(0.04)), abs=2e-3)
    assert result.quality.scaled_jacobian.min > 0.9 * result.corner_bound


@pytest.mark.parametrize("width", [0.5, 0.05, 0.001])
def test_the_end_of_a_slit_gets_three_patches(width):
    """Nearly 360 degrees: two patches would have straight angles."""
    points = [(0, 0), (1 - width / 2, 0), (1.01, 1), (1 + width / 2, 0), (2.1, 0), (2, 2), (-0.1, 2.2)]
    own = loops_of(pt.Boundary([polygon(points)]))
    layout = convex_layout(own)
    tip = layout.boundary_vertices[np.linalg.norm(layout.points[layout.boundary_vertices] - points[2], axis=1).argmin()]
    assert layout.valence[tip] >= 3
    assert certified(pt.Boundary([polygon(points)])).certificate.status == "certified"


def test_outlines_that_touch_are_refused():
    touching = polygon([(0, 0), (2, 0), (2, 2), (1, 0), (0, 2)])
    with pytest.raises(NoLayoutError, match=r"coarse polygon: near .* may touch itself") as raised:
        convex_layout(loops_of(pt.Boundary([touching])))
    assert raised.value.stage == "coarse polygon"


@settings(max_examples=30)
@given(st.one_of(star_polygons(), cell_unions(), blobs()))
def test_pieces_tile_the_polygon(boundary):
    assume(valid(boundary))
    polygons = coarse_polygon(loops_of(boundary))
    pieces = convex_pieces(polygons)

    def area(points: np.ndarray) -> float:
        x, y = points.T
        return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2

    whole = sum(area(polygons.points[nodes]) for nodes in polygons.polygons)
    assert sum(area(pieces.points[cycle]) for cycle in pieces.cycles) == pytest.approx(whole)
    assert set(np.concatenate(pieces.cycles)) == set(range(len(pieces.points)))
