"""CSV: outlines with and without corners, landmarks, bad lines."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

import models
import patchtransfer as pt
from patchtransfer import InputError
from patchtransfer.io import points
from patchtransfer.io.interpolation import interpolate_outline


def circle(n: int, radius: float = 1.0, start: float = 0.0) -> np.ndarray:
    t = start + 2 * np.pi * np.arange(n) / n
    return radius * np.column_stack([np.cos(t), np.sin(t)])


def polygon(corners, per_edge: int) -> np.ndarray:
    """A polygon with `per_edge` points on every edge, its start corner included."""
    corners = np.asarray(corners, float)
    t = np.arange(per_edge)[:, None] / per_edge
    return np.concatenate([a + t * (b - a) for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)])


def sampled(loop, count: int = 400) -> np.ndarray:
    return np.concatenate([c(np.linspace(*c.domain, count)) for c in loop])


def distance(points, loop) -> float:
    """Largest distance of points from a loop, refined where the samples are nearest."""
    worst = 0.0
    for point in points:
        best = np.inf
        for c in loop:
            t = np.linspace(*c.domain, 20 * len(c.control_points) + 1)
            for _ in range(8):
                i = int(np.argmin(np.linalg.norm(c(t) - point, axis=1)))
                t = np.linspace(t[max(i - 1, 0)], t[min(i + 1, len(t) - 1)], 41)
            best = min(best, float(np.linalg.norm(c(t) - point, axis=1).min()))
        worst = max(worst, best)
    return worst


def joints(loop) -> set:
    return {tuple(np.round(c.start, 9).tolist()) for c in loop}


@pytest.mark.parametrize("per_edge", [1, 2, 7, 100])
@pytest.mark.parametrize("sides", [3, 4, 5, 8, 11])
def test_a_polygon_keeps_all_corners_and_straight_edges(sides, per_edge):
    corners = circle(sides, 2.0)
    loop = interpolate_outline(polygon(corners, per_edge))
    assert joints(loop) == {tuple(c) for c in np.round(corners, 9).tolist()}
    assert all(c.degree == 1 for c in loop)


@pytest.mark.parametrize("n", [20, 24, 60, 500, 5000])
def test_a_sampled_circle_has_no_corner(n):
    loop = interpolate_outline(circle(n))
    assert len(loop) == 1
    radii = np.linalg.norm(sampled(loop, 2000), axis=1)
    # Cubic interpolation is of fourth order in the step.
    assert np.abs(radii - 1).max() < 0.1 * (2 * np.pi / n) ** 4 + 1e-14
    (c,) = loop
    a, b = c(np.array(c.domain), 1)
    assert np.abs(a - b).max() < 1e-9


@pytest.mark.parametrize("fine", [3, 10, 40])
def test_a_finely_sampled_half_disc_has_two_corners(fine):
    t = np.linspace(0, np.pi, 12 * fine + 1)
    arc = np.column_stack([np.cos(t), np.sin(t)])
    base = np.column_stack([np.linspace(-1, 1, 8 * fine)[1:-1], np.zeros(8 * fine - 2)])
    loop = interpolate_outline(np.concatenate([arc, base]))
    assert joints(loop) == {(1.0, 0.0), (-1.0, 0.0)}
    assert sorted(c.degree for c in loop) == [1, 3]


def test_a_corner_cut_over_several_points_is_one_corner():
    square = polygon([(0, 0), (1, 0), (1, 1), (0, 1)], 300)
    # An arc of half the window's length as radius, sampled like the rest, replaces the corner at the origin.
    t = np.pi / 2 * np.linspace(0, 1, 5)
    cut = 0.01 * (1 - np.column_stack([np.cos(t), np.sin(t)]))
    kept = square[(np.abs(square) > 0.0101).any(axis=1)]
    loop = interpolate_outline(np.concatenate([cut, kept]))
    assert len(loop) == 4
    assert any(np.linalg.norm(c.start) <= 0.005 for c in loop)


def test_tiny_edges_of_contour_tracers_are_no_joints():
    t = 2 * np.pi * np.sort(np.concatenate([np.arange(200), np.arange(0, 200, 7) + 0.01])) / 200
    assert len(interpolate_outline(np.column_stack([2 * np.cos(t), np.sin(t)]))) == 1


def test_ripples_below_the_window_are_no_corners():
    points = circle(2000)
    points *= 1 + 5e-4 * (-1.0) ** np.arange(2000)[:, None]
    assert len(interpolate_outline(points)) == 1


def test_straight_edges_between_sampled_arcs_stay_straight():
    fillets = []
    for k, (x, y) in enumerate([(9, 4), (1, 4), (1, 1), (9, 1)]):
        t = (k + np.linspace(0, 1, 7)) * np.pi / 2
        fillets.append(np.column_stack([x + np.cos(t), y + np.sin(t)]))
    loop = interpolate_outline(np.concatenate(fillets))
    edge_lengths = sorted(np.linalg.norm(c.end - c.start) for c in loop if c.degree == 1)
    assert np.allclose(edge_lengths, [3, 3, 8, 8])
    for c, following in zip(loop, loop[1:] + loop[:1], strict=True):
        out, into = c(c.domain[1], 1), following(following.domain[0], 1)
        cross = (out[0] * into[1] - out[1] * into[0]) / (np.linalg.norm(out) * np.linalg.norm(into))
        assert abs(cross) < 1e-9
    points = sampled(loop)
    assert points.min() > -1e-3
    assert np.all(points.max(axis=0) < [10.001, 5.001])


@settings(max_examples=40, deadline=None)
@given(
    st.integers(3, 40).flatmap(
        lambda n: st.tuples(
            st.lists(st.floats(0.3, 1.0), min_size=n, max_size=n),
            st.lists(st.floats(0.1, 1.0), min_size=n, max_size=n),
        )
    ),
    st.floats(1e-3, 1e3),
)
def test_every_point_is_hit_and_the_loop_is_closed_to_the_bit(polar, scale):
    radius, step = map(np.array, polar)
    t = 2 * np.pi * np.cumsum(step) / step.sum()
    points = scale * radius[:, None] * np.column_stack([np.cos(t), np.sin(t)])
    loop = interpolate_outline(points)
    for c, following in zip(loop, loop[1:] + loop[:1], strict=True):
        assert np.array_equal(c.end, following.start)
    on_knots = np.concatenate([c(np.unique(c.knots)) for c in loop])
    straight = [c for c in loop if c.degree == 1]
    far = cKDTree(on_knots).query(points)[0] > 1e-9 * scale
    assert distance(points[far], straight) < 1e-9 * scale if far.any() else True


def test_blocks_comments_and_headers(tmp_path):
    path = tmp_path / "outline.csv"
    path.write_text("\ufeff# a blank line ends a block\nx, y\n0,0\n4,0\n\n4,4\n")
    with pytest.raises(InputError, match="fewer than 3"):
        pt.read_boundary(path)
    path.write_text("# a square with a hole\nx, y\n0,0\n4,0\n# inside\n4,4\n0,4\n0,0\n\n\n1 1\n2 1 # comment\n2 2\n\n")
    outer, hole = pt.read_boundary(path).loops
    assert [c.start.tolist() for c in outer] == [[0, 0], [4, 0], [4, 4], [0, 4]]
    assert [c.start.tolist() for c in hole] == [[1, 1], [2, 1], [2, 2]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0,0\n1,0\n1,0\n0,1\n", "line 3: repeats"),
        ("0,0\n1,0\n0,1\n0,0\n0,0\n", "line 4: repeats"),
        ("0,0\n1,0\n", "starts at line 1 has fewer than 3"),
        ("0,0\n1,0\n0,0\n1,0\n0,0", "fewer than 3 distinct"),
        ("0,0\n1,0\n1\n", "line 3: expected x,y, got 1"),
        ("0,0\n1,0\n1,b\n", "line 3: .*'1, b'"),
        ("0,0\n1,0\n1,nan\n", "line 3: NaN"),
        ("0,0\n1,0\n1,1e300\n", "line 3: .*1e150"),
        ("x,y\n# nothing\n", "no points"),
        ("0,0\n1,0\nx,y\n1,1\n", "line 3"),
        ("0;0\n1;0\n", "line 1"),
        (b"0,0\n\xff,1\n", "not UTF-8"),
        ("\n \n", "empty"),
    ],
)
def test_bad_outlines_name_the_line(tmp_path, text, message):
    path = tmp_path / "outline.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(InputError, match=message) as caught:
        pt.read_boundary(path, clean=False)
    assert str(caught.value).startswith(f"{path}: ")


def test_landmarks_are_found_by_column_name(tmp_path):
    path = tmp_path / "landmarks.csv"
    path.write_text("# pairs\nname,ys,xs,xt,yt\nnose,2,1,3,4\n\ntail,6,5,7,8e-1 # far\n")
    assert pt.read_landmarks(path).tolist() == [[1, 2, 3, 4], [5, 6, 7, 0.8]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1,2,3,4\n", "line 1: the header"),
        ("xs,ys,xt\n1,2,3\n", "yt is missing"),
        ("xs,ys,xt,yt,yt\n1,2,3,4,5\n", "yt is missing or repeated"),
        ("xs,ys,xt,yt\n1,2,3\n", "line 2: 3 entries"),
        ("xs,ys,xt,yt\n1,2,3,a\n", "line 2: expected four numbers"),
        ("xs,ys,xt,yt\n1,2,3,inf\n", "line 2: NaN"),
        ("xs,ys,xt,yt\n", "no landmarks"),
        ("", "empty"),
    ],
)
def test_bad_landmarks_name_the_line(tmp_path, text, message):
    path = tmp_path / "landmarks.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        pt.read_landmarks(path)
    assert str(caught.value).startswith(f"{path}: ")


@given(st.lists(st.tuples(*[st.floats(-1e100, 1e100)] * 4), min_size=1, max_size=6), st.booleans())
def test_landmarks_come_back_to_the_bit(tmp_path_factory, rows, named):
    path = tmp_path_factory.mktemp("landmarks") / "l.csv"
    names = [f"ear {k}" for k in range(len(rows))] if named else None
    pt.write_landmarks(rows, path, names)
    np.testing.assert_array_equal(pt.read_landmarks(path), np.array(rows))
    assert points.read_named_landmarks(path.read_bytes())[1] == (names or [""] * len(rows))


@pytest.mark.parametrize("name", ["a,b", "a#b", " a", "a\nb", "a  b"])
def test_names_that_would_be_read_as_something_else_are_refused(tmp_path, name):
    with pytest.raises(InputError, match=r"l\.csv: a landmark's name cannot be"):
        pt.write_landmarks([[0, 0, 1, 1]], tmp_path / "l.csv", [name])
    with pytest.raises(InputError, match="2 names for 1 landmarks"):
        pt.write_landmarks([[0, 0, 1, 1]], tmp_path / "l.csv", [name, name])
    assert not (tmp_path / "l.csv").exists()


def test_landmarks_are_pairs_of_points_too():
    mp = models.grid(2, 2, 2, 2, None)
    target = mp.boundary()
    rows = [((0, 0), (0, 0)), ((1, 0), (1, 0))]
    corners = mp.topology.coordinates[[v.point for v in mp.vertices if v.valence == 1]]
    pairs = [(corner, corner) for corner in corners]
    flat = np.array(pairs).reshape(-1, 4)
    a, b = pt.transfer(mp, target, pairs), pt.transfer(mp, target, flat)
    assert a.multipatch == b.multipatch
    np.testing.assert_array_equal(a.registration.landmarks, b.registration.landmarks)
    with pytest.raises(InputError, match="pairs"):
        pt.transfer(mp, target, np.zeros((len(rows), 3)))
