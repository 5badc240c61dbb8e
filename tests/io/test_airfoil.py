"""Airfoils: one loop, smooth around the leading edge, in either order of points."""

from __future__ import annotations

import numpy as np
import pytest

import patchtransfer as pt
from patchtransfer import InputError
from patchtransfer.geometry.outline import Outline
from patchtransfer.io import airfoil
from patchtransfer.io.options import BoundaryOptions

#: Coefficients of the thickness of a four-digit section; the last one closes the trailing edge.
OPEN = [0.2969, -0.1260, -0.3516, 0.2843, -0.1015]
CLOSED = [0.2969, -0.1260, -0.3516, 0.2843, -0.1036]


def thickness(x, coefficients, t=0.12):
    return 5 * t * sum(a * x**p for a, p in zip(coefficients, (0.5, 1, 2, 3, 4), strict=True))


def sides(coefficients, n=40):
    """Upper and lower side from the leading edge on, denser there."""
    x = (1 - np.cos(np.linspace(0, np.pi, n))) / 2
    camber = 0.06 * x * (1 - x)
    y = thickness(x, coefficients)
    return np.column_stack([x, camber + y]), np.column_stack([x, camber - y])


def text(rows):
    return "\n".join(f" {x:.6f}  {y:.6f}" for x, y in rows)


def selig(coefficients, name="A section, 12 %"):
    upper, lower = sides(coefficients)
    return f"{name}\n{text(upper[::-1])}\n{text(lower[1:])}\n".encode()


def lednicer(coefficients):
    upper, lower = sides(coefficients)
    return f"A section, 12 %\n  {len(upper)}.  {len(lower)}.\n\n{text(upper)}\n\n{text(lower)}\n".encode()


@pytest.mark.parametrize("write", [selig, lednicer])
def test_a_blunt_section_has_two_corners_and_a_straight_side(write):
    boundary = airfoil.read_boundary(write(OPEN))
    (loop,) = boundary.loops
    assert [c.degree for c in loop] == [3, 1]
    places, _ = Outline(loop).corners
    assert np.allclose(sorted(Outline(loop).point(places)[:, 1]), [-0.00126, 0.00126])
    assert boundary.notes == ("airfoil 'A section, 12 %'", "trailing edge closed by a straight side of length 0.00252")


@pytest.mark.parametrize("write", [selig, lednicer])
def test_a_closed_section_has_one_corner(write):
    boundary = airfoil.read_boundary(write(CLOSED))
    (loop,) = boundary.loops
    assert len(loop) == 1
    assert len(Outline(loop).corners[0]) == 1
    assert boundary.notes == ("airfoil 'A section, 12 %'",)


def test_both_orders_are_the_same_loop():
    assert airfoil.read_boundary(selig(OPEN)) == airfoil.read_boundary(lednicer(OPEN))


def test_the_cubic_follows_the_formula_between_the_points():
    (loop,) = airfoil.read_boundary(selig(OPEN)).loops
    fine = np.concatenate(sides(OPEN, 2000))
    assert Outline(loop).nearest(fine)[1].max() < 2e-5


def test_rounding_of_the_trailing_edge_is_no_side():
    data = selig(CLOSED).replace(b" 1.000000  0.000000", b" 1.000000  0.000020", 1)
    boundary = airfoil.read_boundary(data)
    assert [len(loop) for loop in boundary.loops] == [1]
    assert boundary.notes[1] == "trailing edge closed: its ends were 2e-05 apart"
    kept = airfoil.read_boundary(data, BoundaryOptions(clean=False))
    assert [len(loop) for loop in kept.loops] == [2]


def test_a_chord_of_100_is_not_taken_for_numbers_of_points():
    lines = selig(OPEN).decode().splitlines()
    scaled = [lines[0], *("100 2" if k == 0 else line for k, line in enumerate(lines[1:]))]
    rows = [tuple(100 * float(v) for v in line.split()) for line in lines[2:]]
    data = "\n".join([*scaled[:2], *(f"{x:.4f} {y:.4f}" for x, y in rows)]).encode()
    (loop,) = airfoil.read_boundary(data).loops
    assert np.allclose(loop[0].start, [100, 2])


def test_polygons_on_request_and_repeated_points_told():
    data = selig(OPEN).decode().splitlines()
    data.insert(9, data[8])
    boundary = airfoil.read_boundary("\n".join(data).encode(), BoundaryOptions(smooth=False))
    assert {c.degree for c in boundary.loops[0]} == {1}
    assert len(boundary.loops[0]) == len(data) - 2
    assert "1 repeated points left out" in boundary.notes


def test_files_are_known_by_their_content(tmp_path):
    for name, data in (("a.dat", selig(OPEN)), ("a.txt", selig(OPEN)), ("b.dat", lednicer(OPEN))):
        (tmp_path / name).write_bytes(data)
        assert len(pt.read_boundary(tmp_path / name).loops[0]) == 2
    # A header of CSV, comments and other formats are no names.
    for start in ("x,y", "# points", "<xml>", "0.5 0.5"):
        assert not airfoil.looks_like_airfoil(selig(OPEN, start))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: s.replace("0.500", "0.5O0"), r"line \d+: expected two numbers"),
        (lambda s: s + " 999.0 999.0\n 1 0\n", r"several outlines"),
        (lambda s: s + " 1e200 0\n", r"above 1e\+100"),
        (lambda s: "\n".join(s.splitlines()[:1] + s.splitlines()[20:60]), r"starts at x = .* trailing edge is at"),
        (lambda s: "\n".join(s.splitlines()[:4]), r"3 points; a section needs at least 5"),
    ],
)
def test_messages(change, message):
    upper, lower = sides(OPEN, 41)
    data = f"name\n{text(upper[::-1])}\n{text(lower[1:])}\n"
    with pytest.raises(InputError, match=message):
        airfoil.read_boundary(change(data).encode())


def test_numbers_of_points_that_do_not_add_up():
    data = lednicer(OPEN).replace(b"  40.  40.", b"  40.  41.")
    with pytest.raises(InputError, match="announces 40 and 41 points, but 80 follow"):
        airfoil.read_boundary(data)


@pytest.mark.parametrize(
    "data",
    [b"", b"\n \n", b"SECTION", b"1 0", b"2 2\n0 0\n2 3\n0 0\n2 3\n", b"a b\n1 0.05\n0 1e16\n0 -3\n0.5 -3\n1 -1\n"],
)
def test_nothing_is_no_section(data):
    with pytest.raises(InputError, match=r"holds no points|a section needs at least"):
        airfoil.read_boundary(data)
