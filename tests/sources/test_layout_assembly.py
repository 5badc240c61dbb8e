"""Layouts from integer arc lengths: places of their vertices, what must not be, and when two are the same."""

from __future__ import annotations

import dataclasses
import pickle

import numpy as np
import pytest

from patchtransfer.sources.auto_layout.assembly import AbstractLayout, assemble, check_layout
from patchtransfer.sources.auto_layout.layout_key import layout_key
from patchtransfer.sources.auto_layout.reasons import NoLayoutError
from t_meshes import rectangles

L_SHAPE = [(0, 0, 1, 1), (1, 0, 2, 1), (0, 1, 1, 2)]
RING = [(0, 0, 1, 1), (1, 0, 2, 1), (2, 0, 3, 1), (0, 1, 1, 2), (2, 1, 3, 2), (0, 2, 1, 3), (1, 2, 2, 3), (2, 2, 3, 3)]


def one(t_mesh):
    return np.ones(len(t_mesh.arc_nodes), dtype=int)


def test_vertices_are_where_the_outline_and_the_map_put_them():
    t_mesh, outline = rectangles([(0, 0, 1, 1)], xs=[0, 3], ys=[0, 2])
    layout = assemble(t_mesh, outline, np.where(t_mesh.arc_size == 3, 3, 2))
    lattice = sorted((float(x), float(y)) for x in range(4) for y in range(3))
    assert sorted(map(tuple, np.round(layout.points, 9) + 0.0)) == lattice
    assert layout.corner.sum() == 4
    on_outline = outline.outlines[0].point(layout.boundary_s)
    np.testing.assert_array_equal(layout.points[layout.boundary_vertices], on_outline)
    a, b, c, d = np.moveaxis(layout.points[layout.quads], 1, 0)
    diagonals = c - a, d - b
    np.testing.assert_allclose(diagonals[0][:, 0] * diagonals[1][:, 1] - diagonals[0][:, 1] * diagonals[1][:, 0], 2.0)


def test_arcs_are_divided_by_length_in_the_map():
    t_mesh, outline = rectangles([(0, 0, 1, 1)])
    bottom = int(np.flatnonzero((t_mesh.node_point[t_mesh.arc_nodes][:, :, 1] == 0).all(axis=1))[0])
    top = int(np.flatnonzero((t_mesh.node_point[t_mesh.arc_nodes][:, :, 1] == 1).all(axis=1))[0])
    # Half of the map's length of the lower side is at a quarter of it.
    lines, places, interval = list(t_mesh.arc_points), list(t_mesh.arc_places), t_mesh.arc_interval * 2
    start, end = lines[bottom]
    lines[bottom], places[bottom] = np.array([start, 0.75 * start + 0.25 * end, end]), np.array([0.0, 0.5, 1.0])
    for arc in set(range(4)) - {bottom}:
        start, end = lines[arc]
        lines[arc], places[arc] = np.array([start, (start + end) / 2, end]), np.array([0.0, 0.5, 1.0])
    t_mesh = dataclasses.replace(t_mesh, arc_points=tuple(lines), arc_places=tuple(places), arc_interval=interval)
    corner = outline.points
    middle = (corner + np.roll(corner, -1, axis=0)) / 2
    points = np.stack([corner, middle], axis=1).reshape(-1, 2)
    quarter = int(np.flatnonzero((points == [0.5, 0.0]).all(axis=1))[0])
    points[quarter] = [0.25, 0.0]
    s = np.stack([outline.s, outline.s + 0.5], axis=1).ravel()
    s[quarter] -= 0.25
    finer = dataclasses.replace(
        outline,
        points=points,
        s=s,
        loop=np.zeros(8, dtype=int),
        next=np.roll(np.arange(8), -1),
        corner_angle=np.stack([outline.corner_angle, np.full(4, np.nan)], axis=1).ravel(),
    )
    t_mesh = dataclasses.replace(t_mesh, node_vertex=2 * t_mesh.node_vertex)
    lengths = np.where(np.isin(np.arange(4), [bottom, top]), 2, 1)
    layout = assemble(t_mesh, finer, lengths)
    inner = {tuple(p) for p in np.round(layout.points, 9)} - {(x, y) for x in (0.0, 1.0) for y in (0.0, 1.0)}
    assert inner == {(0.25, 0.0), (0.5, 1.0)}


def test_holes_and_their_order():
    t_mesh, outline = rectangles(RING)
    layout = assemble(t_mesh, outline, one(t_mesh))
    assert np.bincount(layout.boundary_loop).tolist() == [12, 4]
    assert layout.valence.sum() == 4 * len(layout.quads) == 32
    assert not layout.quads.flags.writeable


def test_collapsed_faces_become_lines():
    boxes = [(0, 1, 1, 2), (1, 1, 2, 2), (2, 1, 4, 2), (0, 2, 1, 3), (2, 0, 4, 1)]
    t_mesh, outline = rectangles(boxes, xs=[0, 1, 1.5, 2, 3])
    x = t_mesh.node_point[t_mesh.arc_nodes][:, :, 0]
    layout = assemble(t_mesh, outline, np.where((x.min(axis=1) == 1) & (x.max(axis=1) == 1.5), 0, 1))
    assert len(layout.quads) == 4
    # The corner wins over the point that lies across.
    assert sorted(map(tuple, np.round(layout.points[layout.boundary_vertices[layout.corner]], 9))) == sorted(
        map(tuple, outline.points[~np.isnan(outline.corner_angle)])
    )


def test_lengths_that_make_no_layout():
    t_mesh, outline = rectangles(L_SHAPE)
    with pytest.raises(NoLayoutError, match="all faces are collapsed"):
        assemble(t_mesh, outline, 0 * one(t_mesh))
    x = t_mesh.node_point[t_mesh.arc_nodes][:, :, 0]
    # The left column, with both towers' corners merged.
    with pytest.raises(NoLayoutError) as error:
        assemble(t_mesh, outline, np.where(x.max(axis=1) > x.min(axis=1), np.where(x.max(axis=1) > 1, 1, 0), 1))
    assert error.value.stage == "assembly"


def abstract(quads, boundary, count):
    quads = np.array(quads)
    loops = np.concatenate([np.full(len(loop), k) for k, loop in enumerate(boundary)])
    vertices = np.array([v for loop in boundary for v in loop])
    return AbstractLayout(
        quads=quads,
        boundary_vertices=vertices,
        boundary_loop=loops,
        boundary_s=np.arange(len(vertices), dtype=float),
        corner=np.zeros(len(vertices), dtype=bool),
        points=np.column_stack([np.arange(count), np.arange(count) ** 2]).astype(float),
        valence=np.bincount(quads.ravel(), minlength=count),
    )


TWO = [[0, 1, 4, 5], [1, 2, 3, 4]]


def test_a_valid_layout_passes():
    check_layout(abstract(TWO, [[0, 1, 2, 3, 4, 5]], 6), 1)


@pytest.mark.parametrize(
    ("quads", "boundary", "count", "match"),
    [
        ([[0, 1, 1, 2]], [[0, 1, 2]], 3, "quad 0 .* has a repeated vertex"),
        ([*TWO, [0, 1, 6, 7]], [[0, 1, 2, 3, 4, 5]], 8, r"edge \(0, 1\) belongs to 2 quads"),
        (TWO, [[0, 1, 2, 3, 4, 5]], 7, "vertex 6 has 0 quads"),
        (TWO, [[0, 2, 3, 4, 5]], 6, "vertex 1 has 2 quads"),
        ([[0, 1, 2, 3], [2, 1, 0, 4]], [[0, 1, 2, 3, 4]], 5, "quads 0 and 1 share 3 vertices"),
        ([[0, 1, 2, 3], [2, 4, 5, 6]], [[0, 1, 2, 4, 5, 6, 3]], 7, "the boundary of the quads touches itself"),
        (TWO, [[0, 1, 2, 3, 5, 4]], 6, "vertex 3 of loop 0 is followed by 4, not by 5"),
        (TWO, [[0, 1, 2, 3, 4, 5]], 6, "Euler number is 1, not 0"),
    ],
)
def test_what_is_no_layout(quads, boundary, count, match):
    loops = 2 if "Euler" in match else 1
    with pytest.raises(NoLayoutError, match=match):
        check_layout(abstract(quads, boundary, count), loops)


def test_errors_survive_other_processes():
    error = pickle.loads(pickle.dumps(NoLayoutError("assembly", "no quads")))
    assert (str(error), error.stage, error.reason) == ("assembly: no quads", "assembly", "no quads")


def renumbered(layout, seed):
    """The same layout with other numbers of vertices and quads, other first vertices, and loops in another order."""
    rng = np.random.default_rng(seed)
    new = rng.permutation(len(layout.points))
    quads = np.array([np.roll(new[quad], rng.integers(4)) for quad in layout.quads[rng.permutation(len(layout.quads))]])
    order = rng.permutation(len(layout.boundary_vertices))
    return AbstractLayout(
        quads=quads,
        boundary_vertices=new[layout.boundary_vertices][order],
        boundary_loop=(1 - layout.boundary_loop)[order],
        boundary_s=layout.boundary_s[order] + 0.5,
        corner=layout.corner[order],
        points=layout.points[np.argsort(new)],
        valence=layout.valence[np.argsort(new)],
    )


def test_keys_of_layouts():
    t_mesh, outline = rectangles(RING, xs=[0, 1, 2.5, 3], ys=[0, 1, 2, 4])
    layout = assemble(t_mesh, outline, one(t_mesh))
    for seed in range(5):
        assert layout_key(renumbered(layout, seed)) == layout_key(layout)
    moved = dataclasses.replace(layout, points=layout.points[:, ::-1] @ np.diag([-2.0, 2.0]))
    assert layout_key(moved) != layout_key(layout)
    assert layout_key(moved, places=False) == layout_key(layout, places=False)
    x = t_mesh.node_point[t_mesh.arc_nodes][:, :, 0]
    finer = assemble(t_mesh, outline, np.where(x.max(axis=1) == 1, np.where(x.min(axis=1) == 0, 2, 1), 1))
    assert len(finer.quads) == 11
    assert layout_key(finer, places=False) != layout_key(layout, places=False)
