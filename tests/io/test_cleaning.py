"""Outlines cleaned: slivers, gaps and specks go, features stay, whatever the place, size and turn of the drawing."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import patchtransfer as pt
from patchtransfer import Boundary, BSplineCurve
from patchtransfer.io.cleaning import cleaned, mended
from patchtransfer.io.loops import TOLERANCE, chain, diameter


def line(a, b) -> BSplineCurve:
    return BSplineCurve([0.0, 0.0, 1.0, 1.0], 1, [a, b])


def polygon(points) -> list[BSplineCurve]:
    return [line(a, b) for a, b in zip(points, np.roll(points, -1, axis=0), strict=True)]


def moved(points, angle: float, scale: float, shift) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return scale * (np.asarray(points, float) @ np.array([[c, s], [-s, c]]) + shift)


#: Corners of an outline whose diameter is about 1.
HOUSE = np.array([(0, 0), (0.8, 0), (0.8, 0.4), (0.4, 0.6), (0, 0.4)])


def with_sliver(at: int, size: float, angle: float) -> np.ndarray:
    """The house with corner `at` doubled."""
    extra = HOUSE[at] + size * np.array([np.cos(angle), np.sin(angle)])
    return np.insert(HOUSE, at + 1, extra, axis=0)


placing = st.tuples(st.floats(0, 6), st.floats(1e-6, 1e6), st.tuples(st.floats(-9, 9), st.floats(-9, 9)))


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 4), st.floats(1e-8, 3e-4), st.floats(0, 6), placing)
@example(3, 9.379992792894518e-05, 0.46875, (0.0, 1.0, (0.0, 0.0)))
def test_a_sliver_anywhere_is_absorbed_and_told(at, size, angle, place):
    points = moved(with_sliver(at, size, angle), *place)
    notes: list[str] = []
    (loop,) = cleaned([polygon(points)], notes)
    assert len(loop) == 5
    (note,) = notes
    # One that runs back along the next edge is a spike as well, of which all is cut off, not half.
    spike = "spike" in note
    assert spike or "sliver" in note
    wanted = moved(HOUSE, *place)
    error = np.linalg.norm(np.array([c.start for c in loop])[:, None] - wanted[None], axis=2).min(axis=1)
    assert error.max() <= (1.01 if spike else 0.51) * size * place[1]
    again: list[str] = []
    assert cleaned([loop], again) == [loop]
    assert again == []


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 4), st.floats(0.0, 1.0), st.floats(1e-4, 9e-3), st.floats(0, 6), st.integers(1, 3), placing)
def test_a_spike_anywhere_is_cut_off_and_told(edge, along, size, angle, pieces, place):
    """Out and back by other points, at a corner or along an edge (angle 0: forth and back on it)."""
    a, b = HOUSE[edge], HOUSE[(edge + 1) % 5]
    foot = a + (0.2 + 0.6 * along) * (b - a)
    forth = np.arctan2(*(b - a)[::-1]) + angle * (angle > 0.1)
    tip = foot + size * np.array([np.cos(forth), np.sin(forth)])
    out, home = np.linspace(0, 1, pieces + 1)[:, None], np.linspace(1, 0, 3)[:, None]
    spiked = [HOUSE[: edge + 1], foot + out * (tip - foot), (foot + home * (tip - foot))[1:], HOUSE[edge + 1 :]]
    points = moved(np.concatenate(spiked), *place)
    notes: list[str] = []
    (loop,) = cleaned([polygon(points)], notes)
    assert len(loop) == 6
    assert all("spike" in note for note in notes)
    assert notes
    np.testing.assert_allclose(
        np.sort([c.start @ [1, 0.37] for c in loop]),
        np.sort(np.append(moved(HOUSE, *place), moved([foot], *place), axis=0) @ [1, 0.37]),
        atol=2e-6 * place[1],
    )
    assert all((c.end == d.start).all() for c, d in zip(loop, [*loop[1:], loop[0]], strict=True))


def test_cusps_thin_wedges_and_cracks_are_no_spikes():
    airfoil = BSplineCurve([0, 0, 0, 1, 1, 1], 2, [(0.9, 0.02), (0.95, 0.001), (1, 0)])
    rest = [line((1, 0), (0.9, -0.02)), line((0.9, -0.02), (0, 0)), line((0, 0), (0.9, 0.02))]
    crack = polygon([(0, 0), (0.5, 0), (0.5, 0.3), (0.5, 0), (1, 0), (1, 1), (0, 1)])
    for loop in ([airfoil, *rest], crack):
        notes: list[str] = []
        assert cleaned([loop], notes) == [loop]
        assert notes == []


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 4), st.floats(1e-3, 1e-2), st.integers(1, 6), placing)
def test_chamfers_and_fillets_from_a_thousandth_on_stay(at, size, pieces, place):
    before, corner, after = HOUSE[at - 1], HOUSE[at], HOUSE[(at + 1) % 5]
    u, v = ((p - corner) / np.linalg.norm(p - corner) for p in (before, after))
    t = np.linspace(0, 1, pieces + 1)[:, None]
    # A chamfer of one piece, a parabola of several, each shorter than what could be a slip.
    cut = corner + size * ((1 - t) ** 2 * u + t**2 * v)
    points = moved(np.concatenate([HOUSE[:at], cut, HOUSE[at + 1 :]]), *place)
    notes: list[str] = []
    loop = polygon(points)
    assert cleaned([loop], notes) == [loop]
    assert notes == []


@settings(max_examples=30, deadline=None)
@given(st.floats(1e-6, 4e-4), placing)
def test_the_ends_of_slots_and_blunt_edges_stay(width, place):
    slot = np.array([(0, 0), (0.3, -0.04), (1, 0), (1, width), (0.3, 0.04 + width), (0, width)])
    loop = polygon(moved(slot, *place))
    notes: list[str] = []
    assert cleaned([loop], notes) == [loop]
    assert notes == []


def test_dense_points_are_no_slivers():
    t = 2 * np.pi * np.arange(20000) / 20000
    loop = polygon(np.column_stack([np.cos(t), np.sin(t)]))
    assert cleaned([loop], []) == [loop]


def test_a_curve_keeps_its_tangent_at_an_absorbed_sliver():
    arc = BSplineCurve([0, 0, 0, 0, 1, 1, 1, 1], 3, [(0, 0), (1e-4, 1e-4), (0.5, 1), (1, 0)])
    notes: list[str] = []
    (loop,) = cleaned([[arc, line((1, 0), (0, -1e-4)), line((0, -1e-4), (0, 0))]], notes)
    assert len(loop) == 2
    tangent = loop[0](np.array([0.0]), 1)[0]
    assert np.arctan2(tangent[1], tangent[0]) == pytest.approx(np.pi / 4, abs=1e-9)


def test_specks_are_dropped_and_holes_of_a_thousandth_are_not():
    speck, hole = 0.3 + 1e-4 * HOUSE, 0.2 + 1e-3 * HOUSE / 0.8
    notes: list[str] = []
    assert len(cleaned([polygon(HOUSE), polygon(speck), polygon(hole)], notes)) == 2
    assert "loop 1, a speck" in notes[0]


@settings(max_examples=40, deadline=None)
@given(st.floats(1e-8, 1e-4), st.floats(0, 6), st.permutations(range(5)), placing)
def test_noise_of_printing_at_the_ends_of_pieces_is_closed(gap, angle, order, place):
    corners = np.repeat(HOUSE, 2, axis=0)
    corners[1::2] += gap * np.array([np.cos(angle), np.sin(angle)])
    ends = moved(corners, *place)
    pieces = [line(ends[2 * i + 1], ends[(2 * i + 2) % 10]) for i in order]
    notes: list[str] = []
    names, joined = mended([f"edge {i}" for i in order], pieces, notes)
    (loop,) = chain(names, joined, TOLERANCE * diameter(joined))
    assert len(loop) == 5
    assert len(notes) == (5 if gap > 3e-6 else len(notes))
    starts = np.array([c.start for c in loop])
    away = np.linalg.norm(starts[:, None] - moved(HOUSE, *place)[None], axis=2).min(axis=1)
    assert away.max() <= (gap + 1e-6) * place[1]


def test_a_gap_with_two_candidates_is_left_open():
    pieces = [line((0, 0), (1, 0)), line((1, 1e-4), (1, 1)), line((1 + 1e-4, 0), (2, 1))]
    notes: list[str] = []
    assert mended(["a", "b", "c"], pieces, notes)[1] == pieces
    assert notes == []


def test_curves_without_length_are_left_out():
    notes: list[str] = []
    names, kept = mended(["a", "dot"], [line((0, 0), (1, 0)), line((1, 0), (1, 0))], notes)
    assert (names, len(kept)) == (["a"], 1)
    assert notes == ["dot has no length and is left out"]


def test_a_transfer_puts_the_corner_of_a_sliver_where_it_belongs(tmp_path):
    source = pt.from_layout(
        [(0, 0), (0.8, 0), (0.8, 0.4), (0, 0.4)], [(0, 1, 2, 3)], Boundary([polygon(HOUSE[[0, 1, 2, 4]])])
    ).multipatch
    corners = HOUSE[[0, 1, 2, 4]] * [1.2, 1]
    path = tmp_path / "target.csv"
    for extra in ([], [corners[0] + [1.6e-4, -1e-4]]):
        np.savetxt(path, [*corners, *extra], delimiter=",")
        target = pt.read_boundary(path)
        points = pt.transfer(source, target).multipatch.patches[0].control_points
        found = points[[0, -1, -1, 0], [0, 0, -1, -1]]
        assert np.linalg.norm(found[:, None] - corners[None], axis=2).min(axis=0).max() <= 1e-3 * target.diameter
    assert "sliver" in target.notes[0]
    assert len(pt.read_boundary(path, clean=False).loops[0]) == 5
