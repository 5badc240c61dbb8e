"""SVG: what is drawn is read, what is not is named: hidden, clipped, unused, on other layers; pieces and fillings."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from patchtransfer import Boundary, InputError
from patchtransfer.io import svg
from patchtransfer.io.options import BoundaryOptions

SQUARE = '<path id="square" d="M0 0h8v8h-8z"/>'
HEAD = 'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink"'


def picture(content: str, layers=None, clean=True, root="") -> Boundary:
    head = f'{HEAD} xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"'
    return svg.read_boundary(f"<svg {head} {root}>{content}</svg>".encode(), BoundaryOptions(clean, layers=layers))


def areas(boundary: Boundary) -> list[float]:
    return [abs(area(loop)) for loop in boundary.loops]


def area(loop) -> float:
    x, y = np.concatenate([c(np.linspace(*c.domain, 400))[:-1] for c in loop]).T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


@pytest.mark.parametrize(
    "hidden",
    [
        '<g style="display:none">{}</g>',
        '<g display="none"><g display="inline">{}</g></g>',
        '<g visibility="hidden">{}</g>',
        '<g style="opacity: 0">{}</g>',
        '<g fill="none">{}</g>',
        '<g fill="none" stroke="#000" stroke-width="0">{}</g>',
        '<g fill-opacity="0">{}</g>',
        '<style>/* x { } */ .off, .no {{ display : none !important }}</style><g class="a off">{}</g>',
        '<style>g.off{{visibility:hidden}} #seen{{visibility:visible}}</style><g class="off">{}</g>',
        '<style>#away{{fill:transparent}}</style><g id="away" fill="red">{}</g>',
        '<g inkscape:groupmode="layer" inkscape:label="old" style="fill:red;display:none">{}</g>',
        "<defs>{}</defs>",
        '<symbol id="s">{}</symbol>',
        '<clipPath id="c">{}</clipPath>',
        '<mask id="c">{}</mask>',
        '<clipPath id="c"><circle r="2"/></clipPath><g clip-path="url(#c)">{}</g>',
        '<g mask="url(#nothing)">{}</g>',
        '<g fill="none" stroke="#000">{}</g>',
    ],
)
def test_what_is_not_seen_is_left_out_and_named(hidden):
    frame = '<rect id="frame" x="-5" y="-5" width="40" height="40"/>'
    boundary = picture(hidden.replace("{{", "{").replace("}}", "}").replace("{}", frame) + SQUARE)
    assert areas(boundary) == pytest.approx([64])
    assert any("left out" in note for note in boundary.notes)


def test_what_is_seen_is_kept_without_a_word():
    for around in (
        '<g style="fill:#123">{}</g>',
        '<g visibility="hidden"><g visibility="visible">{}</g></g>',
        '<clipPath id="c"><path d="M-1-1h99v99h-99z"/></clipPath><g clip-path="url(#c)">{}</g>',
        '<g transform="scale(.5)"><clipPath id="c"><rect width="16" height="16"/></clipPath>'
        '<g clip-path="url(#c)" transform="scale(2)">{}</g></g>',
        '<g opacity=".01" stroke="none">{}</g>',
        '<style>.off{display:none}</style><g class="offset">{}</g>',
    ):
        boundary = picture(around.replace("{}", SQUARE))
        assert areas(boundary) == pytest.approx([64]), around
        assert boundary.notes == ()


def test_nothing_that_is_seen_is_an_error_that_says_what_there_was():
    with pytest.raises(InputError, match=r"no closed path.*hidden: <path> square.*1 <text>"):
        picture(f'<g display="none">{SQUARE}</g><text>only words</text>')


def test_text_images_rules_and_stroked_decoration_are_named():
    boundary = picture(
        "<style>svg > path {fill:none} @media print { .a {display:none} }</style>" + SQUARE + "<text>a</text><text/>"
        '<image href="x.png"/><path id="eye" fill="none" stroke="red" d="M2 2h1v1z"/><line id="hair" x2="3" y2="1"/>'
    )
    assert areas(boundary) == pytest.approx([64])
    told = "\n".join(boundary.notes)
    for word in ("2 <text>, 1 <image>", "svg > path", "@media print", "<path> eye", "<line> hair"):
        assert word in told


def test_what_is_only_stroked_is_the_outline_if_nothing_is_filled():
    boundary = picture('<path d="M0 0h8v8h-8z"/><circle cx="4" cy="4" r="1"/>', root='fill="none" stroke="black"')
    assert areas(boundary) == pytest.approx([64, np.pi], rel=1e-4)
    assert boundary.notes == ()


def test_use_and_symbols_are_drawn_where_they_are_placed():
    boundary = picture(
        '<defs><g id="two"><rect width="1" height="1"/><rect x="3" width="1" height="1"/></g></defs>'
        '<symbol id="unit" viewBox="0 0 2 2"><rect width="2" height="2"/></symbol>'
        '<use xlink:href="#two" x="10" transform="scale(2)"/><use href="#unit" x="50" y="1" width="8" height="4"/>'
        '<svg x="70" y="0" width="6" height="6" viewBox="0 0 3 3"><rect width="3" height="3"/></svg>'
    )
    assert areas(boundary) == pytest.approx([4, 4, 16, 36])
    corners = [min(map(tuple, [c.start.tolist() for c in loop])) for loop in boundary.loops]
    assert corners == [(20, -2), (26, -2), (52, -5), (70, -6)]
    assert boundary.notes == ()


def test_use_that_multiplies_is_bounded():
    levels = "".join(f'<g id="g{k + 1}">' + f'<use href="#g{k}"/>' * 10 + "</g>" for k in range(9))
    with pytest.raises(InputError, match="<use> repeats"):
        picture(f'<defs><g id="g0"/>{levels}</defs><use href="#g9"/>')


def test_layers_are_chosen_by_label_or_id():
    content = (
        '<g inkscape:label="Walls" id="layer1"><rect width="9" height="9"/></g><g id="holes">'
        '<circle cx="3" cy="3" r="1"/></g><g inkscape:label="Old" style="display:none"><rect width="2" height="1"/></g>'
    )
    assert areas(picture(content, layers=("walls",))) == pytest.approx([81])
    assert areas(picture(content, layers=("layer1", "holes"))) == pytest.approx([81, np.pi], rel=1e-4)
    assert areas(picture(content, layers=("Old",))) == pytest.approx([2])
    with pytest.raises(InputError, match=r"no layer 'roof'; there are .*Walls"):
        picture(content, layers=("Walls", "Roof"))


def test_a_filling_closes_what_has_no_z():
    boundary = picture('<path id="tub" d="M0 0 L10 0 L10 10 L0 10"/><path d="M2 2 h1 v1 z m1 3 h2 v2"/>')
    assert areas(boundary) == pytest.approx([100, 0.5, 2])
    assert "closed <path> tub by a line of 10" in boundary.notes[0]
    first = boundary.loops[0]
    assert [c.start.tolist() for c in first] == [[0, 0], [10, 0], [10, -10], [0, -10]]


@settings(max_examples=40, deadline=None)
@given(st.permutations(range(6)), st.lists(st.booleans(), min_size=6, max_size=6), st.booleans())
def test_pieces_in_any_order_and_sense_are_joined(order, turned, stroked):
    corners = [(0, 0), (9, 0), (9, 5), (6, 7), (2, 7), (0, 4)]
    edges = list(itertools.pairwise([*corners, corners[0]]))
    paths = ""
    for i in order:
        a, b = edges[i][::-1] if turned[i] else edges[i]
        bulge = (a[0] + b[0]) / 2, (a[1] + b[1]) / 2
        paths += f'<path d="M{a[0]} {a[1]} Q{bulge[0]} {bulge[1]} {b[0]} {b[1]}"/>'
    boundary = picture(f'<g fill="none" stroke="red">{paths}</g>' if stroked else paths)
    assert [len(loop) for loop in boundary.loops] == [6]
    assert areas(boundary)[0] == pytest.approx(57.0)
    assert "joined 6 pieces" in boundary.notes[0]


def test_pieces_of_filled_arcs_and_lines_are_one_outline():
    boundary = picture(
        '<path d="M0 0 A2 2 0 0 1 4 0"/><line x1="4" x2="4" y2="3"/><path d="M4 3H0"/><path d="M0 3V0"/>'
    )
    assert areas(boundary) == pytest.approx([12 + 2 * np.pi], rel=1e-4)


def test_small_gaps_between_pieces_are_closed_unless_told_not_to():
    content = '<path d="M0 0 L10 0"/><path d="M10 10 L10 0.001"/><path d="M10 10 L0 10"/><path d="M0 10 L0 0"/>'
    boundary = picture(content)
    assert "closed a gap of 0.001" in "\n".join(boundary.notes)
    assert any(np.array_equal(c.start, [10, -0.0005]) for c in boundary.loops[0])
    with pytest.raises(InputError, match=r"open.*0.001 away"):
        picture(content, clean=False)


def test_units_are_those_of_the_standard():
    assert areas(picture('<rect width="1in" height="25.4mm"/>')) == pytest.approx([96 * 96])


def test_segments_that_vanish_beside_a_wild_point_are_named():
    boundary = picture('<path d="M0 0 L1 0 L1 1 L2e13 5 L0 9 Z"/>')
    assert "left out" in boundary.notes[0]


def test_a_line_that_touches_filled_pieces_does_not_keep_them_from_closing():
    boundary = picture('<path d="M0 0 Q5 -5 9 0"/><path d="M9 0 Q5 5 0 0"/><path id="hair" d="M9 0 h4"/>')
    assert [len(loop) for loop in boundary.loops] == [2]
    assert any("<path> hair" in note for note in boundary.notes)
