"""Outlines as polygons, the quads in their corners, and the meshes between."""

from __future__ import annotations

import numpy as np
import pytest

import patchtransfer as pt
from outlines import smooth_loop
from patchtransfer.sources.auto_layout.mesh import corner_valences, generate_mesh
from patchtransfer.sources.auto_layout.reasons import NoLayoutError
from patchtransfer.sources.auto_layout.sampling import sample_outline
from shapes import polygon

SQUARE = np.array([(0.0, 0.0), (3.0, 0.0), (3.0, 3.0), (0.0, 3.0)])


def circle(radius, centre=(0.0, 0.0)):
    angle = 2 * np.pi * np.arange(24) / 24
    return smooth_loop(np.array(centre) + radius * np.column_stack([np.cos(angle), np.sin(angle)]))


def regular(n, turn=0.0):
    angle = turn + 2 * np.pi * np.arange(n) / n
    return pt.Boundary([polygon(np.column_stack([np.cos(angle), np.sin(angle)]))])


def reversed_loop(curves):
    return [pt.BSplineCurve(1 - c.knots[::-1], c.degree, c.control_points[::-1]) for c in reversed(curves)]


def signed_area(x):
    y = np.roll(x, -1, axis=0)
    return 0.5 * (x[:, 0] * y[:, 1] - x[:, 1] * y[:, 0]).sum()


def test_nodes_lie_on_the_curves_with_the_domain_on_their_left():
    for outer in (polygon(SQUARE), polygon(SQUARE[::-1])):
        for hole in (circle(0.5, (1.5, 1.5)), reversed_loop(circle(0.5, (1.5, 1.5)))):
            outline = sample_outline(pt.Boundary([hole, outer]))
            for k, nodes in enumerate(outline.loop_nodes()):
                assert np.array_equal(outline.points[nodes], outline.outlines[k].point(outline.s[nodes]))
                assert np.array_equal(outline.next[nodes], np.roll(nodes, -1))
            assert [np.sign(signed_area(outline.points[n])) for n in outline.loop_nodes()] == [-1, 1]


def test_nodes_do_not_depend_on_the_sense_of_a_loop():
    forth = sample_outline(pt.Boundary([polygon(SQUARE), circle(0.5, (1.5, 1.5))]))
    back = sample_outline(pt.Boundary([polygon(SQUARE[::-1]), reversed_loop(circle(0.5, (1.5, 1.5)))]))
    for a, b in zip(forth.loop_nodes(), back.loop_nodes(), strict=True):
        p, q = forth.points[a], back.points[b]
        distance = np.linalg.norm(p[:, None] - q[None], axis=2)
        assert distance.min(axis=1).max() < 1e-6
        assert np.array_equal(np.isnan(forth.corner_angle[a]), np.isnan(back.corner_angle[b][distance.argmin(axis=1)]))


def test_steps_are_short_enough_everywhere():
    # A square whose corners are rounded by arcs much smaller than a step.
    r = 1e-3
    arc = r * np.array([(0.0, 0.0), (0.5, 0.0), (1.0, 0.5), (1.0, 1.0)])
    turn = np.array([(0.0, -1.0), (1.0, 0.0)])
    curves = []
    for k in range(4):
        rotate = np.linalg.matrix_power(turn, k)
        start, end = (0.5 * np.array([-1, -1]) + [r, 0]) @ rotate.T, (0.5 * np.array([1, -1]) + [-r, 0]) @ rotate.T
        curves.append(pt.BSplineCurve([0, 0, 1, 1], 1, [start, end]))
        curves.append(pt.BSplineCurve([0] * 4 + [1] * 4, 3, end + arc @ rotate.T))
    outline = sample_outline(pt.Boundary([curves]))
    assert np.isnan(outline.corner_angle).all()
    edges = outline.points[outline.next] - outline.points
    assert np.linalg.norm(edges, axis=1).max() <= outline.step * (1 + 1e-9)
    before, after = edges, edges[outline.next]
    turns = np.arctan2(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0], (before * after).sum(axis=1))
    # Tangents turn by 8 degrees; chords by more where a straight side becomes an arc.
    assert abs(turns).max() < np.radians(12)


def test_corners_are_nodes_with_the_interior_angle():
    outline = sample_outline(pt.Boundary([polygon(SQUARE), polygon([(1.0, 1.0), (2.0, 1.0), (1.0, 2.0)])]))
    corner = ~np.isnan(outline.corner_angle)
    found = {tuple(p): a for p, a in zip(outline.points[corner].round(12), outline.corner_angle[corner], strict=True)}
    assert found.keys() == {(0, 0), (3, 0), (3, 3), (0, 3), (1, 1), (2, 1), (1, 2)}
    assert np.degrees([found[1, 1], found[2, 1], found[0, 0]]) == pytest.approx([270, 315, 90])


def test_corners_get_the_quads_whose_right_angles_fit_best():
    outline = sample_outline(regular(8, 0.1))
    corner = ~np.isnan(outline.corner_angle)
    # 135 degrees are as near to one right angle as to two; rounding does not decide.
    assert set(corner_valences(outline)[corner]) == {2}
    assert set(corner_valences(outline, offset=-0.2)[corner]) == {1}
    assert set(corner_valences(outline)[~corner]) == {0}
    needle = sample_outline(pt.Boundary([polygon([(0, 0), (1, 0), (1, 0.05)])]))
    assert sorted(v for v in corner_valences(needle) if v) == [1, 1, 1]


def test_single_corners_can_be_prescribed():
    boundary = pt.Boundary([polygon(SQUARE), polygon([(1.0, 1.0), (2.0, 1.0), (1.0, 2.0)])])
    outline = sample_outline(boundary)
    valence = corner_valences(outline, corner_patches={(1, 2): 5})
    changed = np.flatnonzero(valence != corner_valences(outline))
    assert outline.points[changed] == pytest.approx(np.array([(1.0, 2.0)]))
    assert valence[changed] == 5
    for key, quads, message in [
        ((2, 0), 1, "there is no loop 2"),
        ((1, 3), 1, "loop 1 has 3 corners, counted from 0; there is no corner 3"),
        ((0, 1), 0, "corner 1 of loop 0 needs at least one patch, got 0"),
    ]:
        with pytest.raises(pt.InputError, match=message):
            corner_valences(outline, corner_patches={key: quads})


def test_meshes_keep_the_outline_and_fill_the_domain():
    boundary = pt.Boundary([circle(0.5, (1.5, 1.5)), polygon(SQUARE)])
    outline = sample_outline(boundary)
    mesh = generate_mesh(outline, corner_valences(outline))
    n = len(outline.points)
    assert np.array_equal(mesh.points[:n], outline.points)
    sides = {tuple(sorted(e)) for e in zip(range(n), outline.next.tolist(), strict=True)}
    assert sides <= {tuple(e) for e in mesh.edges.tolist()}
    p = mesh.points[mesh.triangles]
    a, b = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    area = (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2
    assert (area > 0).all()
    assert area.sum() == pytest.approx(sum(signed_area(outline.points[k]) for k in outline.loop_nodes()))
    assert 3000 < len(mesh.triangles) < 6000
    for array in (mesh.points, mesh.triangles, mesh.edges, outline.points, outline.s, outline.corner_angle):
        assert not array.flags.writeable


def test_what_is_no_domain_is_named_with_its_place():
    def mesh(boundary):
        outline = sample_outline(boundary)
        return generate_mesh(outline, corner_valences(outline))

    crossing = pt.Boundary([polygon([(0, 0), (3, 0), (3, 2), (1, -1), (0, 2)])])
    with pytest.raises(NoLayoutError, match=r"mesh: the polygon edges .* cross .*node .*: loop 0, arc length") as error:
        mesh(crossing)
    assert error.value.stage == "mesh"
    with pytest.raises(NoLayoutError, match="the domain is not on the left of loop 1"):
        mesh(pt.Boundary([polygon(SQUARE), polygon(SQUARE / 2 + 5)]))
    with pytest.raises(NoLayoutError, match="sampling: the holes leave no area"):
        sample_outline(pt.Boundary([polygon(SQUARE), polygon(SQUARE * 0.9), polygon(SQUARE * 0.9)]))
