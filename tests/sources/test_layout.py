"""Quad layouts: what is refused, and parameterizations built from them."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner

import models
import patchtransfer as pt
import real
from patchtransfer.cli import main
from patchtransfer.geometry.rectangles import rectangles
from shapes import circle, loop

# Three quads around an interior vertex: a hexagon.
HEXAGON = np.array([[0, 0], *[[np.cos(a), np.sin(a)] for a in np.arange(6) * np.pi / 3]])
THREE = [[0, 1, 2, 3], [0, 3, 4, 5], [0, 5, 6, 1]]


def test_a_disc_of_three_patches():
    """Every patch fills a third; by symmetry the centre stays, and the smooth boundary allows 180 degrees only."""
    result = pt.from_layout(HEXAGON, THREE, pt.Boundary([[circle()]]), degree=3, spans=3)
    assert result.certificate.injective
    assert result.boundary_error < 1e-4
    assert [v.valence for v in result.multipatch.vertices if v.extraordinary] == [3]
    centre = result.multipatch.patches[0](0.0, 0.0)
    np.testing.assert_allclose(centre, 0, atol=1e-3)


@pytest.mark.parametrize("degree", [1, 2, 4])
def test_patches_are_the_quads_in_order(degree):
    vertices, quads = [[0, 0], [2, 0], [2, 1], [0, 1], [1, 0], [1, 1]], [[0, 4, 5, 3], [4, 1, 2, 5]]
    result = pt.from_layout(vertices, quads, loop([[0, 0], [2, 0], [2, 1], [0, 1]]), degree, spans=2)
    assert [p.degrees for p in result.multipatch.patches] == [(degree, degree)] * 2
    for patch, quad in zip(result.multipatch.patches, quads, strict=True):
        np.testing.assert_allclose(patch(0, 0), vertices[quad[0]], atol=1e-9)
        np.testing.assert_allclose(patch(1, 1), vertices[quad[2]], atol=1e-9)
    assert result.quality.scaled_jacobian.min == pytest.approx(1, abs=1e-9)


def test_rectangles_have_the_patches_mean_sides_and_orientation():
    for mp in (models.plate_with_hole(2, 2), models.o_grid(3, 2)):
        for patch, rectangle in zip(mp.patches, rectangles(mp), strict=True):
            (u0, u1), (v0, v1) = ((k[0], k[-1]) for k in patch.knots)
            corners = np.array([rectangle(u, v) for u, v in ((u0, v0), (u1, v0), (u1, v1), (u0, v1))])
            sides = np.roll(corners, -1, axis=0) - corners
            assert abs(sides[0] @ sides[1]) < 1e-12
            c = patch.control_points
            assert np.linalg.norm(sides[0]) == pytest.approx(
                np.linalg.norm(np.diff(c, axis=0), axis=2).sum(axis=0).mean()
            )
            # Same knots, and linear in the parameters.
            middle = rectangle((u0 + u1) / 2, (v0 + v1) / 2)
            np.testing.assert_allclose(middle, corners.mean(axis=0), atol=1e-12)


@pytest.mark.parametrize("name", ["plate with hole p2", "o-grid p3", "l-shape p2"])
def test_the_layout_of_a_model_gives_a_model_of_its_quality(name):
    mp = models.ALL[name]()
    vertices, quads = layout_of(mp)
    (degree, _), spans = mp.patches[0].degrees, len(np.unique(mp.patches[0].knots[0])) - 1
    result = pt.from_layout(vertices, quads, mp.boundary(), degree, max(spans, 2))
    assert result.certificate.injective
    assert result.quality.scaled_jacobian.mean > pt.quality(mp).scaled_jacobian.mean - 0.03


def layout_of(mp):
    """Patch corners of a model as a layout, counter-clockwise."""
    numbers, vertices, quads = {}, [], []
    for points, sign in zip(mp.topology.points, mp.topology.orientation, strict=True):
        corners = [points[0, 0], points[-1, 0], points[-1, -1], points[0, -1]][:: int(sign)]
        for c in map(int, corners):
            if c not in numbers:
                numbers[c] = len(vertices)
                vertices.append(mp.topology.coordinates[c])
        quads.append([numbers[int(c)] for c in corners])
    return vertices, quads


@real.needed
@pytest.mark.parametrize(("name", "degree", "spans"), [("yeti", 2, 2), ("turtle", 3, 2)])
def test_outlines_of_real_models(name, degree, spans):
    """With the model's own corners as layout: certified, and no worse than the original on the mean."""
    mp = real.model(name)
    result = pt.from_layout(*layout_of(mp), mp.boundary(), degree, spans)
    assert result.certificate.status == "certified"
    assert result.quality.scaled_jacobian.mean >= pt.quality(mp).scaled_jacobian.mean - 0.03


SQUARE = [[0, 0], [2, 0], [2, 2], [0, 2], [1, 0]]


@pytest.mark.parametrize(
    ("vertices", "quads", "message"),
    [
        (SQUARE, [[3, 2, 1, 0]], r"quad 0 \[3, 2, 1, 0\] is inverted"),
        ([[0, 0], [2, 0], [0.5, 0.5], [0, 2]], [[0, 1, 2, 3]], "quad 0 .* not convex"),
        ([*SQUARE, [1, -1], [0, -1]], [[0, 1, 2, 3], [6, 5, 4, 0]], r"vertex 4 lies inside edge \(0, 1\)"),
        (SQUARE[:4], [[0, 1, 2, 3], [0, 1, 2, 3]], "belongs to 2 quads on the same side"),
        (SQUARE, [[0, 1, 2, 9]], "use vertices 0 to 9 of 5"),
        (SQUARE, [[0, 1, 2]], r"shape \(m, 4\)"),
        ([[0, 0, 0]], [[0, 0, 0, 0]], r"shape \(n, 2\)"),
    ],
)
def test_bad_layouts_are_refused(vertices, quads, message):
    with pytest.raises(pt.InputError, match=message):
        pt.QuadLayout(vertices, quads)


def test_vertices_off_the_boundary_and_corners_inside_edges_are_refused():
    square = [[0, 0], [1, 0], [1, 1], [0, 1]]
    with pytest.raises(pt.InputError, match=r"vertex 2 at \(1, 1\) is 0.1 off the boundary"):
        pt.from_layout(square, [[0, 1, 2, 3]], loop([[0, 0], [1, 0], [1, 0.9], [0, 0.9]]))
    with pytest.raises(pt.InputError, match=r"corner at \(0.5, -0.2\) inside the layout edge \(0, 1\)"):
        pt.from_layout(square, [[0, 1, 2, 3]], loop([[0, 0], [0.5, -0.2], [1, 0], [1, 1], [0, 1]]))
    # Assigned explicitly, a far vertex is no error.
    target = loop([[0, 0], [1, 0], [1.5, 1.5], [0, 1]])
    result = pt.from_layout(square, [[0, 1, 2, 3]], target, 2, assignment={2: (1.5, 1.5)})
    np.testing.assert_allclose(result.multipatch.patches[0](1, 1), [1.5, 1.5])
    with pytest.raises(pt.InputError, match="assignment names vertex 7"):
        pt.from_layout(square, [[0, 1, 2, 3]], target, assignment={7: (0, 0)})


def test_build_command(tmp_path):
    circle_points = [[np.cos(a), np.sin(a)] for a in np.arange(72) * np.pi / 36]
    np.savetxt(tmp_path / "disc.csv", circle_points, delimiter=",", header="x,y", comments="")
    content = {"vertices": HEXAGON.tolist(), "quads": THREE, "boundary": "disc.csv", "spans": 3}
    (tmp_path / "layout.json").write_text(json.dumps(content))
    arguments = [str(tmp_path / name) for name in ("layout.json", "out.xml", "out.png")]
    done = CliRunner().invoke(main, ["build", arguments[0], "-o", arguments[1], "--plot", arguments[2]])
    assert done.exit_code == 0, done.output
    assert pt.certify(pt.read(arguments[1])).injective
    assert (tmp_path / "out.png").stat().st_size > 1000


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "malformed JSON"),
        ("[]", "a layout is an object"),
        ("{}", '"vertices" is missing'),
        ('{"vertices": [], "quads": [], "boundary": 1}', '"boundary" must be a str'),
        ('{"vertices": [], "quads": [], "boundary": "x.csv", "spans": 1.5}', '"spans" must be an integer'),
        ('{"vertices": [], "quads": [], "boundary": "x.csv", "span": 1}', 'unknown field "span"'),
        ('{"vertices": [], "quads": [], "boundary": "x.csv", "assignment": [1]}', '"assignment" must map'),
        ('{"vertices": [], "quads": [], "boundary": "x.csv"}', r"x\.csv"),
    ],
)
def test_bad_layout_files_are_refused(tmp_path, text, message):
    (tmp_path / "layout.json").write_text(text)
    done = CliRunner().invoke(main, ["build", str(tmp_path / "layout.json"), "-o", str(tmp_path / "out.xml")])
    assert done.exit_code == 2
    assert "layout.json" in done.stderr
    import re

    assert re.search(message, done.stderr), done.stderr
    assert not (tmp_path / "out.xml").exists()
