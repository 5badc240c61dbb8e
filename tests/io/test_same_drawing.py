"""One shape of lines and arcs with a hole, drawn in every format: the boundaries agree within their own resolution."""

from __future__ import annotations

import math
from io import BytesIO, StringIO

import numpy as np
import pytest

import patchtransfer as pt
from patchtransfer.geometry.outline import Outline, hausdorff

ezdxf = pytest.importorskip("ezdxf")
shapely = pytest.importorskip("shapely")
Image = pytest.importorskip("PIL.Image")
pytest.importorskip("skimage")

# A plate with a round end at the right, a corner cut off at the upper left and a hole.
WIDTH, HEIGHT, CUT = 120.0, 80.0, 30.0
HOLE, RADIUS = (70.0, 45.0), 18.0
AREA = WIDTH * HEIGHT - CUT**2 / 2 + math.pi * (HEIGHT / 2) ** 2 / 2 - math.pi * RADIUS**2
#: Segments of a quarter of a circle where only points can be written, and how far its chords are inside.
QUARTER = 64
SAGITTA = HEIGHT / 2 * (1 - math.cos(math.pi / 4 / QUARTER))
#: Room around the plate in the image, in pixels.
ROOM = 10


def dxf():
    document = ezdxf.new()
    space = document.modelspace()
    space.add_line((0, 0), (WIDTH, 0))
    space.add_arc((WIDTH, HEIGHT / 2), HEIGHT / 2, 270, 90)
    space.add_lwpolyline([(0, 0), (0, HEIGHT - CUT), (CUT, HEIGHT), (WIDTH, HEIGHT)])
    space.add_circle(HOLE, RADIUS)
    stream = StringIO()
    document.write(stream)
    return stream.getvalue().encode()


def svg():
    outer = f"M0 0 H{WIDTH} A{HEIGHT / 2} {HEIGHT / 2} 0 0 0 {WIDTH} {-HEIGHT} H{CUT} L0 {CUT - HEIGHT} Z"
    hole = f'<circle cx="{HOLE[0]}" cy="{-HOLE[1]}" r="{RADIUS}"/>'
    return f'<svg xmlns="http://www.w3.org/2000/svg"><path d="{outer}"/>{hole}</svg>'.encode()


def polygon():
    plate = shapely.Polygon([(0, 0), (WIDTH, 0), (WIDTH, HEIGHT), (CUT, HEIGHT), (0, HEIGHT - CUT)])
    end = shapely.Point(WIDTH, HEIGHT / 2).buffer(HEIGHT / 2, quad_segs=QUARTER)
    return plate.union(end) - shapely.Point(HOLE).buffer(RADIUS, quad_segs=QUARTER)


def png():
    rows, columns = int(HEIGHT) + 2 * ROOM, int(WIDTH + HEIGHT / 2) + 2 * ROOM
    x, y = np.meshgrid(np.arange(columns) + 0.5 - ROOM, rows - np.arange(rows) - 0.5 - ROOM)
    plate = (x > 0) & (y > 0) & (y < HEIGHT) & (x < WIDTH) & (y - x < HEIGHT - CUT)
    inside = (plate | (np.hypot(x - WIDTH, y - HEIGHT / 2) < HEIGHT / 2)) & (
        np.hypot(x - HOLE[0], y - HOLE[1]) > RADIUS
    )
    stream = BytesIO()
    Image.fromarray(np.where(inside, 0, 255).astype(np.uint8)).save(stream, "PNG")
    return stream.getvalue()


#: The formats with their resolution in units of the drawing, and where they put its corner.
FORMATS = {
    "plate.svg": (svg, 1e-6, 0),
    "plate.geojson": (lambda: shapely.to_geojson(polygon()).encode(), 2 * SAGITTA, 0),
    "plate.png": (png, 0.75, ROOM),
}


@pytest.fixture(scope="module")
def exact(tmp_path_factory):
    path = tmp_path_factory.mktemp("drawing") / "plate.dxf"
    path.write_bytes(dxf())
    return pt.read_boundary(path)


def test_the_drawing_itself_is_exact(exact):
    areas = [abs(Outline(loop).area) for loop in exact.loops]
    assert math.isclose(areas[0] - areas[1], AREA, rel_tol=2e-3)
    assert [len(loop) for loop in exact.loops] == [5, 1]


@pytest.mark.parametrize("name", FORMATS)
def test_all_formats_agree_within_their_resolution(exact, tmp_path, name):
    make, resolution, shift = FORMATS[name]
    (tmp_path / name).write_bytes(make())
    boundary = pt.read_boundary(tmp_path / name)
    assert len(boundary.loops) == 2
    for loop, same in zip(boundary.loops, exact.loops, strict=True):
        moved = [c.with_control_points(c.control_points - shift) for c in loop]
        assert hausdorff(Outline(moved), Outline(same)) < resolution
        assert len(Outline(moved).corners[0]) == len(Outline(same).corners[0])
        assert math.isclose(abs(Outline(moved).area), abs(Outline(same).area), rel_tol=5e-3)


def test_shapely_gives_what_its_file_gives(tmp_path):
    (tmp_path / "plate.json").write_text(shapely.to_geojson(polygon()))
    assert pt.Boundary.from_shapely(polygon()) == pt.read_boundary(tmp_path / "plate.json")


def test_only_formats_with_layers_can_be_asked_for_some(tmp_path):
    (tmp_path / "plate.png").write_bytes(png())
    with pytest.raises(pt.InputError, match="a PNG, TIFF or BMP file has no layers"):
        pt.read_boundary(tmp_path / "plate.png", layers=["0"])
