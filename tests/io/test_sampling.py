"""Points: polygons and samples of smooth curves told apart, all or nothing, and `Boundary.from_points`."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import patchtransfer as pt
from patchtransfer import Boundary, InputError


def circle(n: int) -> np.ndarray:
    t = 2 * np.pi * np.arange(n) / n
    return np.column_stack([np.cos(t), np.sin(t)])


def subdivided(corners, k: int) -> np.ndarray:
    t = np.arange(k)[:, None] / k
    return np.concatenate([a + t * (b - a) for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)])


def coast(n: int, seed: int) -> np.ndarray:
    """An outline as maps have it: midpoints moved again and again."""
    rng = np.random.default_rng(seed)
    points = circle(6)
    while len(points) < n:
        following = np.roll(points, -1, axis=0)
        edge = following - points
        moved = (points + following) / 2 + rng.normal(0, 0.2, (len(points), 1)) * edge[:, ::-1] * [-1, 1]
        points = np.stack([points, moved], axis=1).reshape(-1, 2)
    return points[np.sort(rng.choice(len(points), n, replace=False))]


def blob(n: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    t = 2 * np.pi * np.arange(n) / n
    r = 1 + sum(0.2 / j * rng.uniform(-1, 1) * np.cos(j * t + rng.uniform(0, 7)) for j in range(2, 5))
    return np.column_stack([r * np.cos(t), r * np.sin(t)])


def straight(boundary: Boundary) -> bool:
    return all(c.degree == 1 for loop in boundary.loops for c in loop)


@pytest.mark.parametrize("digits", [3, 9, 12, 17])
@pytest.mark.parametrize("n", [*range(3, 18), 19, 24, 36, 40])
def test_regular_polygons_are_read_whole_whatever_the_digits(n, digits):
    boundary = Boundary.from_points(np.round(circle(n), digits))
    assert len(boundary.loops[0]) == (n if n < 18 else 1)
    assert straight(boundary) == (n < 18)
    (note,) = boundary.notes
    assert ("polygon" in note.split(";")[0]) == (n < 18)


@pytest.mark.parametrize("k", [2, 7, 30])
@pytest.mark.parametrize("n", [5, 12, 16])
def test_points_on_the_edges_do_not_round_a_polygon(n, k):
    assert len(Boundary.from_points(subdivided(circle(n), k)).loops[0]) == n


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("n", [30, 36, 60, 300])
def test_coasts_are_polygons(n, seed):
    assert len(Boundary.from_points(coast(n, seed)).loops[0]) == n


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("n", [50, 100, 300, 3000])
def test_sampled_blobs_are_smooth(n, seed):
    (loop,) = Boundary.from_points(np.round(blob(n, seed), 6)).loops
    assert len(loop) == 1


@pytest.mark.parametrize(("ratio", "n"), [(1.5, 24), (2, 28), (3, 40), (5, 64)])
def test_tips_of_ellipses_are_no_corners(ratio, n):
    assert len(Boundary.from_points(circle(n) * [ratio, 1]).loops[0]) == 1


@pytest.mark.parametrize("n", [40, 80, 200])
def test_the_trailing_edge_is_an_airfoils_only_corner(n):
    x = (1 - np.cos(np.pi * np.arange(n) / (n - 1))) / 2
    y = 0.6 * (0.2969 * np.sqrt(x) - 0.126 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1036 * x**4)
    section = np.concatenate([np.column_stack([x, y])[::-1], np.column_stack([x, -y])[1:-1]])
    (loop,) = Boundary.from_points(section).loops
    assert len(loop) == 1
    assert loop[0].start.tolist() == pytest.approx([1, 0], abs=1e-12)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 1000), st.sampled_from([12, 16, 24, 60]), st.floats(0, 6), st.floats(1e-3, 1e3), st.booleans())
def test_the_reading_does_not_depend_on_place_size_turn_and_start(seed, n, angle, scale, rough):
    points = coast(n, seed) if rough else blob(n, seed)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    other = np.roll(scale * points @ turn + 1, seed % n, axis=0)[::-1]
    counts = [len(Boundary.from_points(p).loops[0]) for p in (points, other)]
    assert counts[0] == counts[1]


def test_the_switch_decides():
    assert len(Boundary.from_points(circle(12), smooth=True).loops[0]) == 1
    assert len(Boundary.from_points(circle(60), smooth=False).loops[0]) == 60
    assert Boundary.from_points(circle(60), smooth=False).notes == ()
    # Half a disc has its two corners all the same.
    half = np.concatenate([circle(48)[:25], [(-0.5, 0), (0, 0), (0.5, 0)]])
    assert len(Boundary.from_points(half, smooth=True).loops[0]) == 2
    assert len(Boundary.from_points(half, smooth=True, corner_angle=120).loops[0]) == 1


def test_points_and_files_are_read_alike(tmp_path):
    path = tmp_path / "rings.csv"
    rings = [3 * circle(40), circle(12)]
    path.write_text("\n\n".join("\n".join(f"{x!r},{y!r}" for x, y in ring.tolist()) for ring in rings))
    assert pt.read_boundary(path) == Boundary.from_points(rings)
    assert pt.read_boundary(path, smooth=True) == Boundary.from_points(rings, smooth=True)
    assert pt.read_boundary(path, smooth=False) == Boundary.from_points([r.tolist() for r in rings], smooth=False)


def test_repeated_points_are_left_out_with_a_note():
    points = np.insert(circle(8), 3, circle(8)[2], axis=0)
    boundary = Boundary.from_points(np.vstack([points, points[:1]]))
    assert len(boundary.loops[0]) == 8
    assert "repeated points: loop 0, point 3" in boundary.notes[0]
    with pytest.raises(InputError, match="loop 0, point 3: repeats"):
        Boundary.from_points(points, clean=False)


@pytest.mark.parametrize(
    ("loops", "message"),
    [
        ([], "shape|no loops"),
        ([[(0, 0), (1, 0), (0, 1)], []], r"loop 1 has the shape"),
        (np.zeros((4, 3)), r"loop 0 has the shape \(4, 3\)"),
        ([[(0, 0), (1, 0), (0, np.nan)]], "loop 0, point 2: NaN"),
        ([[(0, 0), (1, 0)]], "fewer than 3"),
        (1e140 * circle(40), "above 1e.100"),
        ([[("a", 0), (1, 0), (1, 1)]], "not an array of numbers"),
    ],
)
def test_bad_points_are_refused_by_loop_and_point(loops, message):
    with pytest.raises(InputError, match=message):
        Boundary.from_points(loops)


def test_bad_corner_angles_are_refused():
    with pytest.raises(InputError, match="corner_angle"):
        Boundary.from_points(circle(5), corner_angle=0)


def test_corners_beside_corners_are_corners_also_beside_an_arc():
    t = np.pi * (np.arange(61) / 60 - 0.5)
    arc = [12, 4] + 4 * np.column_stack([np.cos(t), np.sin(t)])
    plate = np.vstack([arc, [(3, 8), (0, 5), (0, 0)]])
    (loop,) = Boundary.from_points(plate).loops
    starts = {tuple(c.start.tolist()) for c in loop}
    assert {(3.0, 8.0), (0.0, 5.0), (0.0, 0.0)} <= starts
    assert sorted(c.degree for c in loop) == [1, 1, 1, 1, 3]
