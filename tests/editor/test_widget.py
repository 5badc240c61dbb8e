"""The studio in a notebook: traits from Python, a notebook that runs, and the cell's script in a browser."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

import patchtransfer as pt
import shapes
from patchtransfer import InputError, examples

pytest.importorskip("anywidget")


def opened(landmarks=None):
    source, target, _ = examples.load("star")
    return pt.studio(source, target, landmarks)


def moved(target, shift):
    curves = [
        [pt.BSplineCurve(c.knots, c.degree, c.control_points + shift, c.weights) for c in loop] for loop in target.loops
    ]
    return pt.Boundary(curves)


def one_arm_on():
    """The tips of the star's six arms, each taken to the next: the map turns."""
    tips = examples.load("star")[2][:6]
    return np.hstack([tips[:, :2], np.roll(tips[:, 2:], -1, axis=0)])


class Listener:
    """What a widget says to its cells."""

    def __init__(self, widget):
        self.said = []
        widget.send = self.said.append
        self._widget = widget

    def tell(self, content):
        """What comes back for a message of a cell."""
        self.said.clear()
        self._widget._handle_custom_msg(content, [])
        return list(self.said)


def test_landmarks_set_from_python_change_the_result():
    source, target, _ = examples.load("star")
    widget = opened()
    before = widget.result
    assert before.multipatch == pt.transfer(source, target).multipatch
    heard, said = [], Listener(widget).said
    widget.observe(lambda change: heard.append(change.name), ["landmarks", "result"])
    widget.landmarks = one_arm_on()
    assert widget.result.multipatch == pt.transfer(source, target, one_arm_on()).multipatch
    assert widget.result.multipatch != before.multipatch
    assert sorted(heard) == ["landmarks", "result"]
    assert [len(state["landmarks"]) for state in said] == [len(one_arm_on())]
    assert said[0]["undo"]
    widget.landmarks = ()
    assert widget.result.multipatch == before.multipatch


def test_pairs_of_points_are_landmarks_as_well():
    widget = opened()
    widget.landmarks = one_arm_on().reshape(-1, 2, 2)
    np.testing.assert_array_equal(widget.landmarks, one_arm_on())


def test_a_target_set_from_python_is_seen_whole():
    source, target, _ = examples.load("star")
    widget = opened()
    said = Listener(widget).said
    far = moved(target, [40.0, -7.0])
    widget.target = far
    assert widget.result.multipatch == pt.transfer(source, far).multipatch
    (state,) = said
    width, height = map(int, state["frame"]["view_box"].split()[2:])
    places = np.array(state["handles"])[:, 3:]
    assert (places > 0).all()
    assert (places < [width, height]).all()
    # And so is the first one, when that is undone in a cell.
    (state,) = Listener(widget).tell({"do": "undo"})
    assert (np.array(state["handles"])[:, 3:] > 0).all()
    assert widget.target == target


def test_target_and_landmarks_are_set_together():
    source, target, landmarks = examples.load("star")
    widget = opened(landmarks)
    shift = [3.0, 1.0]
    with widget.hold_trait_notifications():
        widget.target = moved(target, shift)
        widget.landmarks = landmarks + np.array([0, 0, *shift])
    assert widget.error == ""
    again = pt.transfer(source, widget.target, widget.landmarks)
    assert widget.result.multipatch == again.multipatch


def test_what_is_wrong_is_said():
    widget = opened()
    widget.landmarks = one_arm_on() + 100
    assert widget.result is None
    assert "landmark" in widget.error
    with pytest.raises(InputError, match="shape"):
        widget.landmarks = [[1.0, 2.0, 3.0]]
    with pytest.raises(InputError, match=r"NaN|finite"):
        widget.landmarks = [[1.0, 2.0, 3.0, np.nan]]
    widget.landmarks = None
    assert widget.error == ""
    with pytest.raises(Exception, match=r"result.* trait is read-only"):
        widget.result = None


def test_traits_wait_while_a_point_is_held():
    widget = opened()
    cell = Listener(widget)
    before, result = widget.target, widget.result
    (state,) = cell.tell({"do": "open"})
    assert state["done"] == "open"
    assert state["source"]
    loop, curve, point, *_ = state["handles"][3]
    x, y = (before.loops[loop][curve].control_points[point] + 0.02 * before.diameter).tolist()
    cell.tell({"do": "grab", "loop": loop, "curve": curve, "point": point, "reach": 0.1})
    (state,) = cell.tell({"do": "drag", "x": x, "y": y})
    assert state["live"]
    assert widget.target == before
    assert widget.result is result
    (state,) = cell.tell({"do": "drop"})
    np.testing.assert_allclose(widget.target.loops[loop][curve].control_points[point], [x, y])
    assert widget.result.multipatch == pt.transfer(examples.load("star")[0], widget.target).multipatch
    # What is set while another is held counts, and undoing leads to what there was before it was grabbed.
    dropped = widget.target
    cell.tell({"do": "grab", "loop": loop, "curve": curve, "point": point})
    cell.tell({"do": "drag", "x": x + 0.1, "y": y})
    widget.target = before
    assert "no point is held" in cell.tell({"do": "drag", "x": x, "y": y})[0]["refused"]
    cell.tell({"do": "undo"})
    assert widget.target == dropped


@pytest.mark.parametrize("message", ["open", None, 3, [], {"do": "explode"}, {"do": "drag", "x": float("nan"), "y": 0}])
def test_messages_that_are_not_understood_change_nothing(message):
    widget = opened()
    before = widget.target
    (state,) = Listener(widget).tell(message)
    assert state["refused"]
    assert state["ok"]
    assert widget.target is before


def test_an_outline_alone_is_parameterized():
    outline = shapes.loop([[0, 0], [3, 0], [3.4, 1], [0, 1.2]])
    widget = pt.studio(outline)
    assert widget.target == outline
    assert widget.result.certificate.injective


def test_without_anywidget_the_command_is_named():
    code = (
        "import sys; sys.modules['anywidget'] = None; import patchtransfer as pt\n"
        "try: pt.studio(*pt.examples.load('star')[:2])\n"
        "except pt.InputError as error: print(error)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "pip install 'patchtransfer[notebook]'" in done.stdout


def test_the_function_stays_a_function_when_its_room_is_loaded():
    code = "import patchtransfer as pt, patchtransfer.editor.server; print(pt.studio.__name__, pt.studio.__name__)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["studio", "studio"]


def test_a_notebook_runs():
    nbclient = pytest.importorskip("nbclient")
    nbformat = pytest.importorskip("nbformat")
    pytest.importorskip("ipykernel")
    cells = [
        "import patchtransfer as pt\nsource, target, landmarks = pt.examples.load('star')",
        "w = pt.studio(source, target)\nw",
        "before = w.result\nw.landmarks = [(landmarks[k, :2], landmarks[(k + 1) % 6, 2:]) for k in range(6)]",
        "print(w.result.certificate.status, w.target == target, len(w.landmarks), w.error == '')\n"
        "print(w.result.multipatch == before.multipatch)",
    ]
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell) for cell in cells])
    nbclient.NotebookClient(notebook, timeout=120, kernel_name="python3").execute()
    (shown,) = notebook.cells[1].outputs
    assert "application/vnd.jupyter.widget-view+json" in shown.data
    (state,) = [
        entry["state"]
        for entry in notebook.metadata.widgets["application/vnd.jupyter.widget-state+json"]["state"].values()
        if entry["model_module"] == "anywidget"
    ]
    assert "export default" in state["_esm"]
    assert notebook.cells[3].outputs[0].text == "certified True 6 True\nFalse\n"


#: A page with cells of one model, which hands on what it is told and what comes back, as a notebook does.
PAGE = """<!doctype html><body style="margin: 0"><script type="module">
const hearers = new Set();
window.model = {
  on: (name, hear) => hearers.add(hear),
  off: (name, hear) => hearers.delete(hear),
  send: async (message) => (await window.tell(message)).forEach(window.hear),
};
window.hear = (state) => hearers.forEach((hear) => hear(state, []));
window.hearers = hearers;
const code = new Blob([await window.code()], { type: "text/javascript" });
const { default: widget } = await import(URL.createObjectURL(code));
window.cell = () => {
  const el = document.body.appendChild(document.createElement("div"));
  window.end = widget.render({ model: window.model, el });
};
window.cell();
</script></body>"""


class TestInABrowser:
    @pytest.fixture
    def widget(self):
        return opened()

    @pytest.fixture
    def told(self):
        return []

    @pytest.fixture
    def page(self, browser, widget, told, tmp_path):
        """A cell that shows the widget, offline; what it tells is kept."""
        context = browser.new_context(offline=True, viewport={"width": 1000, "height": 900})
        page, complaints, listener = context.new_page(), [], Listener(widget)

        def tell(message):
            told.append(message)
            return listener.tell(message)

        page.expose_function("tell", tell)
        page.expose_function("code", lambda: widget._esm)
        page.on("console", lambda message: complaints.append(message.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        (tmp_path / "cell.html").write_text(PAGE)
        page.goto((tmp_path / "cell.html").as_uri())
        page.locator("#verdict.good").wait_for()
        yield page
        context.close()
        assert complaints == []

    def middle(self, mark):
        box = mark.bounding_box()
        return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def handle(self, page, number=3):
        return self.middle(page.locator("#picture-target .handle").nth(number))

    def drag(self, page, by):
        x, y = self.handle(page)
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x + by[0], y + by[1], steps=5)
        page.mouse.up()

    def test_a_point_is_dragged_and_the_traits_follow(self, page, widget, told):
        before = widget.target
        x, y = self.handle(page)
        self.drag(page, (12, -8))
        page.locator("#words", has_text="proved").wait_for()
        page.locator("#undo:enabled").wait_for()
        assert [message["do"] for message in told][:3] == ["open", "grab", "drag"]
        assert told[-1] == {"do": "drop"}
        assert self.handle(page) == pytest.approx((x + 12, y - 8), abs=2)
        last = told[-2]
        loop, curve, point = (told[1][key] for key in ("loop", "curve", "point"))
        held = widget.target.loops[loop][curve].control_points[point]
        np.testing.assert_allclose(held, [last["x"], last["y"]])
        assert widget.target != before
        assert widget.result.certificate.injective

    def test_keys_are_heard_in_the_cell_only(self, page, widget):
        before = widget.target
        self.drag(page, (10, 5))
        page.locator("#undo:enabled").wait_for()
        page.evaluate("document.activeElement.blur()")
        page.keyboard.press("Control+z")
        assert widget.target != before
        page.locator("#words").click()
        page.keyboard.press("Control+z")
        page.locator("#undo:disabled").wait_for()
        assert widget.target == before

    def test_a_landmark_is_added_by_hand(self, page, widget):
        page.get_by_role("button", name="add landmark").click()
        for name in ("source", "target"):
            box = page.locator(f"#picture-{name}").bounding_box()
            page.mouse.click(box["x"] + 0.9 * box["width"], box["y"] + 0.45 * box["height"])
        page.locator('#picture-target path.pair[data-landmark="0"]').wait_for(state="attached")
        assert len(widget.landmarks) == 1
        assert len(widget.result.registration.landmarks) >= 1

    def test_what_python_sets_is_drawn(self, page, widget, told):
        data = page.locator("#picture-target .iso path").first.get_attribute("d")
        said = []
        widget.send = said.append
        widget.landmarks = one_arm_on()
        page.evaluate("state => window.hear(state)", said[0])
        assert page.locator("#picture-target path.pair").count() == 6
        assert page.locator("#picture-target .iso path").first.get_attribute("d") != data
        assert [message["do"] for message in told] == ["open"]

    def test_cells_of_one_widget_show_the_same_until_they_end(self, page):
        page.evaluate("window.cell()")
        cells = page.locator("body > div")
        assert cells.count() == 2
        cells.nth(1).locator("#verdict.good").wait_for()
        self.drag_in(page, cells.nth(0))
        for k in (0, 1):
            cells.nth(k).locator("#undo:enabled").wait_for()
        outlines = [cells.nth(k).locator(".target-outline").get_attribute("d") for k in (0, 1)]
        assert outlines[0] == outlines[1]
        # Switches are of a cell.
        cells.nth(0).get_by_label("iso-lines").uncheck()
        assert cells.nth(0).locator("#picture-target .iso:visible").count() == 0
        assert cells.nth(1).locator("#picture-target .iso:visible").count() > 0
        page.evaluate("window.end()")
        assert page.evaluate("window.hearers.size") == 1

    def drag_in(self, page, cell):
        x, y = self.middle(cell.locator("#picture-target .handle").nth(3))
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x + 9, y + 9, steps=3)
        page.mouse.up()

    def test_styles_stay_in_the_cell(self, page):
        page.evaluate("document.body.insertAdjacentHTML('beforeend', '<p class=label>a</p><h1 class=stale>b</h1>')")
        assert page.evaluate("getComputedStyle(document.querySelector('.stale')).opacity") == "1"
        assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgba(0, 0, 0, 0)"

    @pytest.mark.parametrize(("scheme", "ground"), [("light", "rgb(255, 255, 255)"), ("dark", "rgb(21, 24, 28)")])
    def test_it_fits_a_narrow_cell(self, page, scheme, ground):
        page.emulate_media(color_scheme=scheme)
        page.set_viewport_size({"width": 390, "height": 844})
        assert page.evaluate("document.documentElement.scrollWidth") == 390
        assert page.locator("#picture-target").bounding_box()["width"] > 300
        cell = page.locator(".widget").evaluate("cell => getComputedStyle(cell).backgroundColor")
        assert cell == ground
