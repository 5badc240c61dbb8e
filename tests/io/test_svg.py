"""SVG: exact segments, arcs, transforms of groups, shapes, refusals."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from patchtransfer import Boundary, InputError
from patchtransfer.io import svg


def picture(content: str) -> Boundary:
    return svg.read_boundary(f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9">{content}</svg>'.encode())


def samples(boundary: Boundary) -> np.ndarray:
    return np.concatenate([c(np.linspace(*c.domain, 500)) for loop in boundary.loops for c in loop])


def area(loop) -> float:
    points = np.concatenate([c(np.linspace(*c.domain, 800))[:-1] for c in loop])
    x, y = points.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def test_lines_and_beziers_are_exact_and_upright():
    (loop,) = picture('<path d="M1,2 L5,2 Q6,4 5,6 C4,7 2,7 1,6 Z"/>').loops
    assert [c.degree for c in loop] == [1, 2, 3, 1]
    assert loop[1].control_points.tolist() == [[5, -2], [6, -4], [5, -6]]
    assert loop[2].control_points.tolist() == [[5, -6], [4, -7], [2, -7], [1, -6]]
    assert loop[3].end.tolist() == [1, -2]
    # Down on the screen is down in the plane.
    assert loop[0].start[1] > loop[3].start[1]


def test_every_closed_subpath_is_a_loop():
    boundary = picture('<path d="M0 0h9v9h-9z m2 2h2v2h-2z"/><g><path d="M6 6 l2 0 l0 2 z"/></g>')
    assert [len(loop) for loop in boundary.loops] == [4, 4, 3]
    assert boundary.loops[1][0].start.tolist() == [2, -2]


@settings(max_examples=60, deadline=None)
@given(
    st.floats(0.5, 20),
    st.floats(0.5, 20),
    st.floats(-180, 180),
    st.floats(-3, 3),
    st.floats(-3, 3),
    st.floats(0.2, 3),
    st.floats(-60, 60),
)
def test_arcs_lie_on_their_ellipse_whatever_the_transforms(rx, ry, turn, dx, dy, scale, skew):
    boundary = picture(
        f'<g transform="translate({dx},{dy}) scale({scale},1.5)"><g transform="skewX({skew})">'
        f'<ellipse id="e" transform="rotate({turn})" cx="1" cy="-2" rx="{rx}" ry="{ry}"/></g></g>'
    )
    r = np.radians
    rotation = np.array([[np.cos(r(turn)), -np.sin(r(turn))], [np.sin(r(turn)), np.cos(r(turn))]])
    matrix = np.diag([scale, 1.5]) @ np.array([[1, np.tan(r(skew))], [0, 1]]) @ rotation
    points = samples(boundary) * [1, -1] - [dx, dy]
    unit = (np.linalg.solve(matrix, points.T).T - [1, -2]) / [rx, ry]
    assert np.abs(np.linalg.norm(unit, axis=1) - 1).max() < 1e-8
    assert abs(area(boundary.loops[0])) == pytest.approx(np.pi * rx * ry * scale * 1.5, rel=1e-5)


@pytest.mark.parametrize("flags", ["0 0", "0 1", "1 0", "1 1"])
def test_path_arcs_are_smooth_circles(flags):
    (loop,) = picture(f'<path d="M2 0 A2 2 0 {flags} 0 2 Z"/>').loops
    arc, line = loop
    assert (arc.degree, line.degree) == (3, 1)
    center = {"0 0": (2, -2), "0 1": (0, 0), "1 0": (0, 0), "1 1": (2, -2)}[flags]
    assert np.abs(np.linalg.norm(arc(np.linspace(0, 1, 999)) - center, axis=1) - 2).max() < 2e-8
    inner = np.unique(arc.knots)[1:-1]
    left, right = arc(inner - 1e-9, 1), arc(inner + 1e-9, 1)
    assert np.abs(left - right).max() < 1e-6


def test_shapes():
    boundary = picture(
        '<rect x="1" y="2" width="3" height="4"/><circle cx="9" cy="9" r="2"/><polygon points="0,0 1,0 0,1"/>'
        '<rect x="20" width="4" height="2" rx="1"/>'
        '<defs><path d="M0 0 L1 1"/></defs><text>hello</text><metadata><x xmlns="y"/></metadata>'
    )
    areas = [abs(area(loop)) for loop in boundary.loops]
    assert areas == pytest.approx([12, 4 * np.pi, 0.5, 4 + np.pi], rel=1e-5)


def test_consecutive_ends_are_equal_to_the_bit():
    (loop,) = picture('<path transform="rotate(33.3)" d="m.1 .7 l.1 .2 l.3 .1 c.1 .1 -.2 .2 .1 -1.3 z"/>').loops
    for c, following in zip(loop, loop[1:] + loop[:1], strict=True):
        assert np.array_equal(c.end, following.start)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (
            '<path id="coast" fill="none" stroke="#000" d="M0 0 L1 0 L1 1"/>',
            "<path> coast is open.*stroked.*1.41 apart",
        ),
        ('<path d="M5 5 h1"/>', "number 1 is open"),
        ('<g fill="none" stroke="red"><polyline points="0,0 1,0 1,1"/></g>', "<polyline> number 1 is open"),
        ('<path d="M0 0 h9"/><path d="M9 0 v9"/><path d="M9 9 h-8"/><path d="M0 9 v-9"/>', "number 3.* is 1 away"),
        ('<path d="M0 0 q5 -2 9 0"/><path d="M9 0 q2 5 0 9"/><path d="M9 9 q-5 2 -9 -1"/>', "open at .*close the gap"),
        ('<path d="M0 0 h1 v1 z, x 5"/>', "'x' is no part of a path"),
        ('<path id="p" d="M0 0 L1 fish"/>', "<path> p: cannot read its geometry"),
        ('<circle id="c"/>', "<circle> c: cannot read its geometry"),
        ('<rect width="30%" height="2"/>', "<rect> number 1: cannot read its geometry .*absolute unit"),
        ('<rect width="3" height="2em"/>', "<rect> number 1: cannot read its geometry .*absolute unit"),
        ('<path d="M0 0 h1e999 v1 z"/>', "<path> number 1"),
        ('<g id="g" transform="wobble(3)"><path d="M0 0 h1 v1 z"/></g>', "<g> g: cannot read its transform"),
        ('<path style="transform: rotate(3deg)" d="M0 0 h1 v1 z"/>', "transform in a style"),
        ('<g id="a"><rect width="1" height="1"/><use id="u" href="#a"/></g>', "<use> u: refers to itself"),
        ('<symbol id="a" viewBox="0 0 x 1"/><use id="u" href="#a"/>', "<use> u: .*viewBox"),
        ("<text>only words</text>", "no closed path"),
        ('<path d=""/>', "no closed path"),
    ],
)
def test_bad_pictures_name_the_element(content, message):
    with pytest.raises(InputError, match=message):
        picture(content)


def test_document_types_are_refused():
    bomb = b'<!DOCTYPE svg [<!ENTITY a "M0 0 h1 v1 z">]><svg><path d="&a;"/></svg>'
    with pytest.raises(InputError, match="DOCTYPE"):
        svg.read_boundary(bomb)
