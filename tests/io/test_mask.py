"""Masks and images: the outline within half a pixel, corners where there are some."""

from __future__ import annotations

import math
import warnings
from io import BytesIO

import numpy as np
import pytest

import patchtransfer as pt
from patchtransfer import Boundary, InputError
from patchtransfer.geometry.outline import Outline
from patchtransfer.io import mask as reader
from patchtransfer.io.options import BoundaryOptions

pytest.importorskip("skimage")
Image = pytest.importorskip("PIL.Image")

SIZE = 160
#: Centres of pixels, y upright.
X, Y = np.meshgrid(np.arange(SIZE) + 0.5, SIZE - np.arange(SIZE) - 0.5)


def disc(x, y, radius):
    return np.hypot(X - x, Y - y) < radius


def turned_rectangle(x, y, angle, half_length, half_width):
    u = (X - x) * math.cos(angle) + (Y - y) * math.sin(angle)
    v = (Y - y) * math.cos(angle) - (X - x) * math.sin(angle)
    return (abs(u) < half_length) & (abs(v) < half_width)


def area(boundary):
    outer, *holes = (abs(Outline(loop).area) for loop in boundary.loops)
    return outer - sum(holes)


def perimeter(boundary):
    return sum(Outline(loop).length for loop in boundary.loops)


def image(array, kind="PNG", **options):
    stream = BytesIO()
    Image.fromarray(array).save(stream, kind, **options)
    return stream.getvalue()


def test_an_upright_rectangle_is_exact():
    mask = np.zeros((40, 60), bool)
    mask[5:30, 10:50] = True
    (loop,) = Boundary.from_mask(mask).loops
    points = np.array(sorted(c.start.tolist() for c in loop))
    assert np.allclose(points, [[10, 10], [10, 35], [50, 10], [50, 35]])
    assert math.isclose(abs(Outline(loop).area), mask.sum())


@pytest.mark.parametrize("radius", [6, 11.3, 25, 60.7])
@pytest.mark.parametrize("shift", [0, 0.31, 0.77])
def test_discs_are_smooth_and_within_half_a_pixel(radius, shift):
    mask = disc(80 + shift, 80 - shift / 2, radius)
    boundary = Boundary.from_mask(mask)
    (loop,) = boundary.loops
    assert len(loop) == 1
    assert len(Outline(loop).corners[0]) == 0
    away = np.linalg.norm(Outline(loop).polygon(400) - [80 + shift, 80 - shift / 2], axis=1) - radius
    assert np.abs(away).max() < 0.5
    assert abs(area(boundary) - mask.sum()) < 0.2 * perimeter(boundary)


@pytest.mark.parametrize("angle", np.linspace(0.03, 1.5, 7))
@pytest.mark.parametrize("half_width", [5, 12, 40])
def test_rectangles_of_any_angle_have_their_four_corners(angle, half_width):
    mask = turned_rectangle(80.2, 79.6, angle, 60, half_width)
    boundary = Boundary.from_mask(mask)
    (loop,) = boundary.loops
    assert len(loop) == 4
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    corners = np.abs((np.array([c.start for c in loop]) - [80.2, 79.6]) @ turn)
    assert np.abs(corners - [60, half_width]).max() < 1
    assert abs(area(boundary) - mask.sum()) < 0.25 * perimeter(boundary)


def test_corners_between_lines_and_arcs_and_holes():
    mask = disc(80, 60, 55) & (Y > 60) & ~disc(80, 85, 12)
    half, hole = Boundary.from_mask(mask).loops
    assert sorted(c.degree for c in half) == [1, 3]
    assert len(Outline(half).corners[0]) == 2
    assert len(Outline(hole).corners[0]) == 0
    assert np.allclose(Outline(hole).polygon(100).mean(axis=0), [80, 85], atol=0.2)


def test_grey_levels_tell_more_than_half_a_pixel():
    distance = np.hypot(X - 80.4, Y - 79.8)
    grey = np.clip(50.3 - distance + 0.5, 0, 1) * 255
    (loop,) = Boundary.from_mask(grey).loops
    away = np.linalg.norm(Outline(loop).polygon(400) - [80.4, 79.8], axis=1) - 50.3
    assert np.abs(away).max() < 0.5
    finer = Boundary.from_mask(grey, tolerance=0.05).loops[0]
    away = np.linalg.norm(Outline(finer).polygon(400) - [80.4, 79.8], axis=1) - 50.3
    assert np.abs(away).max() < 0.1


def test_a_switch_for_polygons_and_one_for_smooth_outlines():
    mask = turned_rectangle(80, 80, 0.4, 60, 30)
    assert {c.degree for c in Boundary.from_mask(mask, smooth=False).loops[0]} == {1}
    (loop,) = Boundary.from_mask(mask, smooth=True).loops
    assert len(loop) == 1
    assert len(Outline(loop).corners[0]) == 0
    # No right angle turns by more than 100 degrees.
    assert len(Boundary.from_mask(mask, corner_angle=100).loops[0]) == 1


def test_specks_go_with_a_note_and_regions_are_refused_with_their_sizes():
    mask = disc(80, 80, 40)
    mask[2:4, 2:5] = True
    mask[80, 80] = False
    boundary = Boundary.from_mask(mask)
    assert len(boundary.loops) == 1
    assert boundary.notes[0] == "1 specks of up to 6 pixels left out"
    assert boundary.notes[1] == "1 pinholes of up to 1 pixels filled"
    mask[0:10, 0:10] = True
    with pytest.raises(InputError, match=rf"2 regions, of {disc(80, 80, 40).sum() - 1}, 100 pixels; keep one"):
        Boundary.from_mask(mask)
    # Regions that touch at corners of pixels only are two.
    corners = np.zeros((20, 20), bool)
    corners[:10, :10] = corners[10:, 10:] = True
    with pytest.raises(InputError, match="2 regions, of 100, 100 pixels"):
        Boundary.from_mask(corners)


def test_a_region_may_touch_the_rim():
    boundary = Boundary.from_mask(np.ones((20, 30)))
    assert math.isclose(area(boundary), 600)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (np.zeros((5, 5)), "nothing is inside"),
        (np.zeros(5), r"two axes, rows and columns, got shape \(5,\)"),
        (np.full((5, 5), np.nan), "NaN"),
        (np.array([["a"]]), "not an array of numbers"),
        (np.zeros((5, 0)), "two axes"),
        (np.broadcast_to(np.zeros(1), (5000, 5000)), "25000000 pixels"),
    ],
)
def test_masks_without_an_outline(given, message):
    with pytest.raises(InputError, match=message):
        Boundary.from_mask(given)


@pytest.mark.parametrize("options", [{"tolerance": 0}, {"tolerance": math.nan}, {"corner_angle": 0}])
def test_options_are_checked(options):
    with pytest.raises(InputError, match=next(iter(options))):
        Boundary.from_mask(np.ones((9, 9)), **options)


@pytest.mark.parametrize("kind", ["PNG", "TIFF", "BMP"])
def test_images_dark_on_bright_or_bright_on_dark(kind, tmp_path):
    mask = turned_rectangle(80, 80, 0.4, 60, 30)
    bright = image((mask * 255).astype(np.uint8), kind)
    dark = image(np.where(mask, 20, 240).astype(np.uint8), kind)
    path = tmp_path / f"a.{kind.lower()}"
    path.write_bytes(bright)
    boundary = pt.read_boundary(path)
    assert boundary == Boundary.from_mask(mask)
    assert "inside is what is bright" in boundary.notes[0]
    other = reader.read_boundary(dark)
    assert "inside is what is dark" in other.notes[0]
    assert area(other) == pytest.approx(area(boundary))


def test_colour_transparency_and_depth_of_images():
    mask = disc(80, 80, 50)
    colour = np.where(mask[..., None], [200, 30, 30], [255, 255, 255]).astype(np.uint8)
    expected = Boundary.from_mask(mask)
    assert area(reader.read_boundary(image(colour))) == pytest.approx(area(expected))
    alpha = np.dstack([np.zeros((SIZE, SIZE, 3), np.uint8), (mask * 255).astype(np.uint8)])
    opaque = reader.read_boundary(image(alpha))
    assert opaque == expected
    assert opaque.notes[0] == "inside is what is opaque"
    assert reader.read_boundary(image((mask * 60000).astype(np.uint16))) == expected
    assert reader.read_boundary(image(mask)) == expected


def test_of_several_pages_the_first_is_read_with_a_note():
    pages = [Image.fromarray((disc(80, 80, r) * 255).astype(np.uint8)) for r in (40, 20)]
    stream = BytesIO()
    pages[0].save(stream, "TIFF", save_all=True, append_images=pages[1:])
    boundary = reader.read_boundary(stream.getvalue())
    assert boundary.notes[0] == "first of 2 pages of the image"
    assert boundary == Boundary.from_mask(disc(80, 80, 40))


def test_large_and_damaged_images_are_refused_in_one_line():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for rows, message in ((4_000, "20000000 pixels, at most 16000000"), (40_000, "more than 16000000 pixels")):
            with pytest.raises(InputError, match=message):
                reader.read_boundary(image(np.zeros((rows, 5_000), bool)))
        data = image((disc(80, 80, 50) * 255).astype(np.uint8))
        random = np.random.default_rng(0)
        for _ in range(100):
            mangled = bytearray(data)
            for at in random.integers(8, len(data), 3):
                mangled[at] = random.integers(256)
            try:
                reader.read_boundary(bytes(mangled[: random.integers(20, len(data) + 1)]), BoundaryOptions())
            except InputError as error:
                told = str(error)
                if "\n" in told:
                    raise AssertionError(told) from None


def test_noise_ends_soon():
    noise = np.random.default_rng(0).random((700, 700)) < 0.6
    with pytest.raises(InputError, match=r"regions, of|outlines, at most"):
        Boundary.from_mask(noise)
