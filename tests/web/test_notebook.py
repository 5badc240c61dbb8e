"""Models, boundaries and results in notebooks: a picture and a table, drawn once and soon."""

import base64
import re
import time
from xml.etree import ElementTree

import numpy as np
import pytest

import patchtransfer as pt
from patchtransfer import examples

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture
def star() -> pt.MultiPatch:
    """Three squares about a vertex."""
    at = np.pi / 3 * np.arange(7)
    ring = np.array([np.cos(at), np.sin(at)]).T
    corners = [[[[0, 0], ring[k + 2]], [ring[k], ring[k + 1]]] for k in (0, 2, 4)]
    return pt.MultiPatch([pt.Patch(([0, 0, 1, 1],) * 2, (1, 1), points) for points in corners])


def picture(page: str) -> ElementTree.Element:
    data = re.search(r'src="data:image/svg\+xml;base64,([^"]+)"', page)
    assert data
    return ElementTree.fromstring(base64.b64decode(data[1]))


def cells(page: str) -> dict[str, str]:
    return dict(re.findall(r"<th[^>]*>([^<]*)</th><td[^>]*>([^<]*)</td>", page))


def test_a_table_tells_what_a_picture_is_of(star):
    facts = {"patches": "3", "degrees": "1 × 1", "control points": "7", "interfaces": "3", "holes": "0"}
    boundary, patch = star.boundary(), star.patches[0]
    for shown, wanted in (
        (star, facts | {"extraordinary vertices": "1"}),
        (boundary, {"loops": "1", "curves": "6", "degrees": "1", "control points": "12"}),
        (patch, {"degrees": "1 × 1", "control points": "2 × 2", "weights": "no"}),
    ):
        page = shown._repr_html_()
        assert f"<caption>{type(shown).__name__}</caption>" in page
        assert wanted.items() <= cells(page).items()
        drawn = picture(page)
        assert drawn.tag == f"{SVG}svg"
        assert ElementTree.tostring(drawn) == ElementTree.tostring(ElementTree.fromstring(shown._repr_svg_()))


def test_pictures_have_their_patches_and_fit_a_notebook(star):
    drawn = ElementTree.fromstring(star._repr_svg_())
    assert len([path for path in drawn.iter(f"{SVG}path") if "patch" in path.get("class", "").split()]) == 3
    width, height = (int(drawn.get(name)) for name in ("width", "height"))
    _, _, wide, high = map(float, drawn.get("viewBox").split())
    assert width <= 560
    assert height <= 420
    assert width / height == pytest.approx(wide / high, rel=0.01)


def test_patches_that_fold_are_shown_as_they_are(star):
    patch = star.patches[0]
    folded = patch.with_control_points(patch.control_points[::-1] * [1, 0])
    assert "q0" in folded._repr_svg_()


def test_pictures_are_drawn_once(star):
    assert star._repr_svg_() is star._repr_svg_()
    # Changed copies have pictures of their own.
    assert (
        star.with_control_points([2 * p.control_points * [1, 2] for p in star.patches])._repr_svg_()
        != star._repr_svg_()
    )


def test_drawing_takes_at_most_150_ms(star):
    star._repr_html_()  # which loads what draws
    model, _, _ = examples.load("human")
    begin = time.process_time()
    model._repr_html_()
    assert time.process_time() - begin < 0.15


def test_results_show_their_model_under_their_numbers():
    result = pt.transfer(*examples.load("star"))
    assert result._repr_html_().startswith("<p>TransferResult: certified")
    assert picture(result._repr_html_()).tag == f"{SVG}svg"
    assert result._repr_svg_() is result.multipatch._repr_svg_()
