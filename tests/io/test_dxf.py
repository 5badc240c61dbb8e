"""DXF: every kind of entity is exact, and what is left out is told."""

from __future__ import annotations

import math
import warnings
from io import BytesIO, StringIO

import numpy as np
import pytest

from patchtransfer import InputError
from patchtransfer.geometry.outline import Outline
from patchtransfer.io import dxf
from patchtransfer.io.options import BoundaryOptions

ezdxf = pytest.importorskip("ezdxf")

RECTANGLE = [(0, 0), (4, 0), (4, 3), (0, 3)]


def drawing(version="R2010"):
    document = ezdxf.new(version)
    return document, document.modelspace()


def data_of(document, binary=False):
    if binary:
        stream = BytesIO()
        document.write(stream, fmt="bin")
        return stream.getvalue()
    stream = StringIO()
    document.write(stream)
    return stream.getvalue().encode(document.output_encoding)


def read(document, layers=None, **options):
    return dxf.read_boundary(data_of(document, **options), BoundaryOptions(layers=layers))


def radii(curves, center):
    t = np.linspace(0, 1, 201)
    return np.concatenate(
        [np.linalg.norm(c(c.domain[0] + (c.domain[1] - c.domain[0]) * t) - center, axis=1) for c in curves]
    )


@pytest.mark.parametrize("version", ["R12", "R2000", "R2018"])
@pytest.mark.parametrize("binary", [False, True])
def test_lines_and_arcs_of_any_order_and_sense_become_one_loop(version, binary):
    document, space = drawing(version)
    # A stadium: two straight sides and two half circles.
    space.add_line((0, 1), (3, 1))
    space.add_arc((0, 0), 1, 90, 270)
    space.add_line((3, -1), (0, -1))
    space.add_arc((3, 0), 1, 270, 90)
    (loop,) = read(document, binary=binary).loops
    assert len(loop) == 4
    assert abs(Outline(loop).length - (6 + 2 * math.pi)) < 1e-6
    arcs = [c for c in loop if c.degree == 2]
    assert np.abs(radii([arcs[0]], [3, 0]) - 1).max() < 2e-15
    assert np.abs(radii([arcs[1]], [0, 0]) - 1).max() < 1e-15


def test_circle_and_ellipse_are_exact_and_holes_are_loops():
    document, space = drawing()
    space.add_circle((1, 2), 5)
    space.add_ellipse((1, 2), major_axis=(2, 1), ratio=0.5)
    circle, ellipse = read(document).loops
    assert np.abs(radii(circle, [1, 2]) - 5).max() < 1e-14
    t = np.linspace(0, 4, 101)
    major, minor = np.array([2, 1]) / 5, np.array([-0.5, 1]) / 1.25
    unit = np.column_stack([(ellipse[0](t) - [1, 2]) @ a for a in (major, minor)])
    assert np.abs(np.hypot(*unit.T) - 1).max() < 1e-15
    assert Outline(circle).corners[0].size == 0


def test_half_an_ellipse_ends_where_its_parameters_say():
    document, space = drawing()
    space.add_ellipse((0, 0), major_axis=(3, 0), ratio=0.5, start_param=math.pi, end_param=2 * math.pi)
    space.add_line((3, 0), (-3, 0))
    (loop,) = read(document).loops
    assert np.isclose(min(c.control_points[:, 1].min() for c in loop), -1.5)
    assert math.isclose(abs(Outline(loop).area), math.pi * 3 * 1.5 / 2, rel_tol=1e-2)


@pytest.mark.parametrize("kind", ["lwpolyline", "polyline"])
def test_bulges_are_arcs_of_the_side_that_they_say(kind):
    document, space = drawing("R12" if kind == "polyline" else "R2010")
    points = [(0, 0, 0), (2, 0, 1), (2, 2, 0), (0, 2, -0.5)]
    if kind == "polyline":
        space.add_polyline2d(points, format="xyb", close=True)
    else:
        space.add_lwpolyline(points, format="xyb", close=True)
    (loop,) = read(document).loops
    assert [c.degree for c in loop] == [1, 2, 1, 2]
    # A bulge of 1 is a half circle to the right of the side that goes up.
    assert np.allclose(loop[1](1.0), [3, 1])
    assert np.abs(radii([loop[1]], [2, 1]) - 1).max() < 1e-15
    # One of -0.5 goes in by a quarter of the chord: the sagitta is |bulge| times half of it.
    assert np.allclose(loop[3](sum(loop[3].domain) / 2), [0.5, 1])


def test_the_second_route_of_ezdxf_gives_the_same_points():
    from ezdxf.path import make_path

    document, space = drawing()
    entity = space.add_lwpolyline([(0, 0, 0.3), (5, 1, -0.7), (4, 6, 2.0)], format="xyb", close=True)
    (loop,) = read(document).loops
    flat = np.array([(v.x, v.y) for v in make_path(entity).flattening(1e-4)])
    assert Outline(loop).nearest(flat)[1].max() < 1e-3


def test_rational_and_periodic_splines_are_kept():
    document, space = drawing()
    # A full circle as NURBS of degree 2 ...
    w = math.sqrt(0.5)
    corners = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0)]
    spline = space.add_rational_spline(corners, [1, w, 1, w, 1, w, 1, w, 1], degree=2)
    spline.knots = [0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4]
    # ... and a closed one whose knots are not clamped.
    square = [(9, 9, 0), (-9, 9, 0), (-9, -9, 0), (9, -9, 0)]
    space.add_spline().set_closed(square, degree=3)
    circle, round_one = read(document).loops
    assert np.abs(radii(circle, [0, 0]) - 1).max() < 1e-15
    assert np.array_equal(round_one[0].start, round_one[0].end)
    assert Outline(round_one).corners[0].size == 0
    middle = np.mean([Outline(round_one).polygon(64)], axis=1)
    assert np.abs(middle).max() < 1e-9


def test_a_spline_of_fit_points_passes_through_them():
    document, space = drawing()
    through = [(0, 0), (1, 2), (3, 3), (5, 1)]
    space.add_spline([(x, y, 0) for x, y in through])
    space.add_line((5, 1), (0, 0))
    (loop,) = read(document).loops
    assert Outline(loop).nearest(np.array(through, float))[1].max() < 1e-9


def test_extrusion_downwards_mirrors():
    document, space = drawing()
    down = {"extrusion": (0, 0, -1)}
    space.add_lwpolyline([(-4, 0), (-1, 0), (-1, 2), (-4, 2)], close=True, dxfattribs=down)
    space.add_circle((-2, 1), 0.5, dxfattribs=down)
    outer, hole = read(document).loops
    assert np.concatenate([c.control_points for c in outer])[:, 0].min() == 1
    assert np.allclose(Outline(hole).polygon(32).mean(axis=0), [2, 1])


def test_blocks_are_expanded_with_all_transforms_around_them():
    document, space = drawing()
    inner = document.blocks.new("INNER", base_point=(1, 1))
    inner.add_circle((1, 1), 0.5)
    inner.add_text("a name")
    outer = document.blocks.new("OUTER")
    outer.add_lwpolyline(RECTANGLE, close=True)
    outer.add_blockref("INNER", (2, 1.5), dxfattribs={"xscale": 2, "yscale": 1})
    space.add_blockref("OUTER", (10, 20), dxfattribs={"rotation": 90})
    boundary = read(document)
    rectangle, ellipse = boundary.loops
    assert np.allclose(rectangle[0].end, [10, 24])
    samples = Outline(ellipse).polygon(400)
    # A circle of radius 0.5, twice as wide, turned upright.
    assert np.allclose(np.ptp(samples, axis=0), [1, 2], atol=1e-3)
    assert np.allclose(samples.mean(axis=0), [8.5, 22], atol=1e-3)
    assert boundary.notes == ("left out, for they draw no outline: 1 TEXT on layer '0'",)


def test_a_grid_of_references_is_laid_out():
    document, space = drawing()
    document.blocks.new("HOLE").add_circle((0, 0), 0.25)
    space.add_lwpolyline(RECTANGLE, close=True)
    grid = {"row_count": 2, "column_count": 3, "row_spacing": 1, "column_spacing": 1}
    space.add_blockref("HOLE", (1, 1), dxfattribs=grid)
    assert len(read(document).loops) == 7


def layered():
    document, space = drawing()
    for name in ("Outline", "Holes", "Frame"):
        document.layers.add(name)
    space.add_lwpolyline(RECTANGLE, close=True, dxfattribs={"layer": "Outline"})
    space.add_circle((1, 1), 0.5, dxfattribs={"layer": "Holes"})
    space.add_lwpolyline([(-9, -9), (9, -9), (9, 9)], close=True, dxfattribs={"layer": "Frame"})
    space.add_text("title", dxfattribs={"layer": "Frame"})
    space.add_hatch(dxfattribs={"layer": "Outline"})
    return document


def test_layers_that_are_off_or_frozen_are_left_out_with_a_note():
    document = layered()
    document.layers.get("Frame").freeze()
    document.layers.get("Holes").off()
    boundary = read(document)
    assert len(boundary.loops) == 1
    assert boundary.notes[0] == "left out, for they draw no outline: 1 HATCH on layer 'Outline'"
    assert "off or frozen" in boundary.notes[1]
    assert "2 on layer 'Frame'" in boundary.notes[1]
    # What is asked for by name is read.
    assert len(read(document, layers=("Holes",)).loops) == 1


def test_layers_are_chosen_without_regard_to_case():
    boundary = read(layered(), layers=("outline", "HOLES"))
    assert len(boundary.loops) == 2
    assert "not chosen: 2 on layer 'Frame'" in boundary.notes[-1]
    with pytest.raises(InputError, match=r"no layer 'outlines'; its layers are .*'?Holes"):
        read(layered(), layers=("outlines",))


def test_open_lines_on_another_layer_lead_to_the_choice_of_layers():
    document, space = drawing()
    space.add_lwpolyline(RECTANGLE, close=True, dxfattribs={"layer": "CUT"})
    space.add_line((0, -1), (4, -1), dxfattribs={"layer": "DIM"})
    with pytest.raises(
        InputError, match=r"on layer 'DIM' is open.*outline's layer only \(--layer, layers=\): CUT, DIM"
    ):
        read(document)
    assert len(read(document, ("CUT",)).loops[0]) == 4


def test_drawings_off_the_plane_are_refused_and_shifted_planes_are_not():
    document, space = drawing()
    space.add_lwpolyline(RECTANGLE, close=True, dxfattribs={"elevation": 7})
    assert len(read(document).loops) == 1
    space.add_line((0, 0, 7), (1, 1, 9), dxfattribs={"layer": "B"})
    with pytest.raises(InputError, match=r"LINE \w+ on layer 'B' is 2 away from the plane z = 7"):
        read(document)


def test_messages_name_the_entity_and_its_layer():
    document, space = drawing()
    space.add_line((0, 0), (1, 0), dxfattribs={"layer": "A"})
    space.add_line((1, 0), (1, 1), dxfattribs={"layer": "A"})
    space.add_line((1, 1), (0, 0.1), dxfattribs={"layer": "A"})
    with pytest.raises(InputError, match=r"LINE \w+ on layer 'A' is open at \(0, 0\).*0.1 away"):
        read(document)
    document, space = drawing()
    space.add_text("nothing else")
    with pytest.raises(InputError, match=r"no lines, arcs or splines .* 1 TEXT on layer '0'"):
        read(document)


def test_blocks_that_hold_themselves_or_are_laid_out_without_end_are_refused():
    document, space = drawing()
    block = document.blocks.new("SELF")
    block.add_blockref("SELF", (1, 1))
    space.add_blockref("SELF", (0, 0))
    with pytest.raises(InputError, match="holds itself"):
        read(document)
    document, space = drawing()
    document.blocks.new("B0").add_text("empty of outline")
    for k in range(1, 9):
        block = document.blocks.new(f"B{k}")
        for x in range(20):
            block.add_blockref(f"B{k - 1}", (x, 0))
    space.add_blockref("B8", (0, 0))
    with pytest.raises(InputError, match="block references"):
        read(document)
    document, space = drawing()
    document.blocks.new("B")
    space.add_blockref("B", (0, 0), dxfattribs={"row_count": 30000, "column_count": 30000})
    with pytest.raises(InputError, match="900000000 block references"):
        read(document)
    document, space = drawing()
    space.add_blockref("MISSING", (0, 0))
    with pytest.raises(InputError, match="'MISSING' is not in the file"):
        read(document)


def test_mangled_drawings_are_read_or_refused(capfd):
    document = layered()
    document.modelspace().add_spline([(0, 0, 0), (1, 1, 0), (2, 0, 0)])
    document.modelspace().add_blockref("X", (0, 0))
    text = data_of(document)
    start = text.find(b"ENTITIES")
    random = np.random.default_rng(0)
    refused = []
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for _ in range(150):
            cut = int(random.integers(start, len(text)))
            snippet = random.choice([b"", b"1e308", b"nan", b"-7", b"\0", b"0\nLINE\n", b"999999999999"])
            mangled = text[:cut] + bytes(snippet) + text[cut + int(random.integers(0, 30)) :]
            try:
                dxf.read_boundary(mangled, BoundaryOptions())
            except InputError as error:
                refused.append(str(error))
    assert refused
    assert not any("\n" in message for message in refused)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("data", [b"", b"\n", b"0", b"0\nSECTION", b"AutoCAD Binary DXF\r\n\x1a\x00"])
def test_what_is_no_drawing_at_all_is_an_error(data):
    with pytest.raises(InputError):
        dxf.read_boundary(data)
