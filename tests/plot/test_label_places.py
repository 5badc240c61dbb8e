"""Labels and legends stand where they hide nothing."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import patchtransfer as pt
from patchtransfer import plot
from patchtransfer.plot.labels import around, placed

KNOTS = [0, 0, 1, 1]


def strip(n: int, width: float = 1.0) -> pt.MultiPatch:
    """Squares in a row, each of them narrower than the one before."""
    edges = np.concatenate([[0.0], np.cumsum(width ** np.arange(n))])
    return pt.MultiPatch(
        [pt.Patch((KNOTS,) * 2, (1, 1), [[[a, 0], [a, 1]], [[b, 0], [b, 1]]]) for a, b in pairwise(edges)]
    )


def boxes(figure, texts):
    """Extents in the picture, laid out."""
    figure.draw_without_rendering()
    return [text.get_window_extent() for text in texts]


@settings(deadline=None, max_examples=40)
@given(st.lists(st.tuples(st.floats(0, 60), st.floats(0, 60)), min_size=1, max_size=8, unique=True))
def test_labels_do_not_cover_each_other(points):
    """Up to eight points within a square of five labels' width: there is room around it."""
    points = np.array(points)
    places = [around(point, point - 30) for point in points]
    sizes = np.full((len(points), 2), [12.0, 8.0])
    chosen = placed(places, sizes, points, np.empty((0, 2)))
    at = np.array([place.at[k] for place, k in zip(places, chosen, strict=True)])
    apart = np.abs(at[:, None] - at)
    for i in range(len(at)):
        for j in range(i):
            assert (apart[i, j] >= sizes[0] - 1e-9).any()


def test_a_lone_label_stands_where_it_should():
    point = np.array([[3.0, 4.0]])
    place = around(point[0], np.array([0.0, 1.0]))
    (k,) = placed([place], np.array([[8.0, 8.0]]), point, np.empty((0, 2)))
    np.testing.assert_allclose(place.at[k] - point[0], [0, 9], atol=1e-12)


def test_patches_are_numbered_inside():
    mp = strip(5, 0.8)
    ax = plot.multipatch(mp, ids=True).axes[0]
    assert [text.get_text() for text in ax.texts] == list("01234")
    for k, text in enumerate(ax.texts):
        x, y = text.get_position()
        assert mp.locate([[x, y]])[0].tolist() == [k]
    assert not plot.multipatch(mp).axes[0].texts


def test_numbers_of_close_joints_do_not_overprint():
    """Joints of a thin bar's end are closer than their numbers are wide."""
    outline = [[0, 0], [10, 0], [10, 0.15], [5, 0.15], [4.9, 0.15], [4.8, 0.15], [0, 0.15]]
    boundary = pt.Boundary.from_points([outline])
    joints = [[*p, *p] for p in outline]
    figure = plot.registration(boundary, boundary, joints)
    for ax in figure.axes:
        middles = [ax.transData.transform(text.xy) + np.array(text.xyann) * figure.dpi / 72 for text in ax.texts]
        apart = np.abs(np.array(middles)[:, None] - middles) * 72 / figure.dpi
        assert len(middles) == 7
        # Digits are about 5 by 7 points.
        assert all((apart[i, j] > [4, 6]).any() for i in range(7) for j in range(i))


def star() -> pt.MultiPatch:
    at = np.pi / 3 * np.arange(7)
    ring = np.array([np.cos(at), np.sin(at)]).T
    return pt.MultiPatch(
        [pt.Patch((KNOTS,) * 2, (1, 1), [[[0, 0], ring[k + 2]], [ring[k], ring[k + 1]]]) for k in (0, 2, 4)]
    )


@pytest.mark.parametrize("stretch", [(1, 1), (8, 1), (1, 8)])
def test_legends_are_inside_the_frame_and_hide_nothing(stretch):
    mp = star()
    mp = mp.with_control_points([p.control_points * stretch for p in mp.patches])
    figure = plot.multipatch(mp)
    ax = figure.axes[0]
    (box,) = boxes(figure, [ax.get_legend()])
    frame = figure.bbox
    assert frame.x0 <= box.x0
    assert box.x1 <= frame.x1
    assert frame.y0 <= box.y0
    assert box.y1 <= frame.y1
    t = np.linspace(0, 1, 20)
    inside = np.concatenate([patch.grid(t, t).reshape(-1, 2) for patch in mp.patches])
    x, y = ax.transData.transform(inside).T
    (handle,) = (h.get_window_extent() for h in ax.get_legend().get_texts())
    assert not ((x > handle.x0) & (x < handle.x1) & (y > handle.y0) & (y < handle.y1)).any()


def test_a_transfer_keeps_its_panels_alike_with_a_legend():
    mp = star()
    figure = plot.transfer(mp, mp.boundary(), mp, caption="a caption", color="dilatation")
    (legend,) = figure.legends
    caption = figure._supxlabel
    box, under = boxes(figure, [legend, caption])
    assert not box.overlaps(under)
    assert figure.bbox.y0 <= box.y0
    assert len({ax.get_ylim() for ax in figure.axes[:3]}) == 1
