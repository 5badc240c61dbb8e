"""Pages in a real browser, with the network cut."""

from __future__ import annotations

import pytest

import commands
import patchtransfer as pt
from patchtransfer import examples


@pytest.fixture
def opened(browser):
    """Opens a page from disk; at the end no script has complained and nothing was asked for."""
    contexts, complaints = [], []

    def open_page(path, **options):
        context = browser.new_context(offline=True, **options)
        contexts.append(context)
        page = context.new_page()
        page.on("console", lambda message: complaints.append(message.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda request: complaints.append(request.url) if "file:" not in request.url else None)
        page.goto(path.as_uri())
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert complaints == []


@pytest.fixture(scope="module")
def human(tmp_path_factory):
    path = tmp_path_factory.mktemp("pages") / "human.html"
    path.write_text(pt.transfer(*examples.load("human")).to_html(), "utf-8")
    return path


def view(page, name):
    return [float(x) for x in page.locator(f"#picture-{name}").get_attribute("viewBox").split()]


def test_pictures_are_enlarged_moved_and_shown_whole_again(opened, human):
    page = opened(human)
    whole = view(page, "result")
    page.get_by_role("button", name="enlarge the result").click()
    assert view(page, "result")[2] == pytest.approx(0.6 * whole[2], rel=1e-3)
    assert view(page, "source")[2] == pytest.approx(whole[2], abs=view(page, "source")[2])
    picture = page.locator("#picture-result")
    before = view(page, "result")
    box = picture.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 40, y)
    page.mouse.up()
    after = view(page, "result")
    assert after[0] < before[0]
    assert after[2:] == before[2:]
    picture.focus()
    page.keyboard.press("0")
    assert view(page, "result") == whole


def test_a_worst_place_is_looked_at(opened, human):
    page = opened(human)
    whole = view(page, "result")
    page.locator(".places a").first.click()
    x, y, width, height = view(page, "result")
    mark = page.locator("#worst-1")
    at = float(mark.get_attribute("data-x")), float(mark.get_attribute("data-y"))
    assert width < whole[2] / 4
    assert (x + width / 2, y + height / 2) == pytest.approx(at, abs=1)


def test_matched_points_light_up_together(opened, human):
    page = opened(human)
    page.locator('#picture-target [data-key="match-7"]').hover(force=True)
    assert page.locator('.lit[data-key="match-7"]').count() == 3


def test_layers_are_shown_on_demand(opened, human):
    page = opened(human)
    net, numbers = page.locator("#picture-result .net"), page.locator("#picture-result .numbers")
    assert not net.is_visible()
    page.get_by_label("control net").check()
    page.get_by_label("patch numbers").check()
    assert net.is_visible()
    assert numbers.is_visible()
    page.get_by_label("iso-lines").uncheck()
    assert page.locator("#picture-result .iso:visible").count() == 0


def test_the_table_of_interfaces_is_sorted_by_numbers(opened, human):
    page = opened(human)
    head = page.get_by_role("button", name="mean kink, °")
    values = lambda: [float(t) for t in page.locator(".sortable tbody td:nth-child(3)").all_text_contents()]  # noqa: E731
    head.click()
    assert values() == sorted(values())
    head.click()
    assert values() == sorted(values(), reverse=True)


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 390])
def test_pages_fit_their_window(opened, human, scheme, width):
    page = opened(human, viewport={"width": width, "height": 900}, color_scheme=scheme)
    assert page.evaluate("document.documentElement.scrollWidth") == width
    ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert ground == {"light": "rgb(255, 255, 255)", "dark": "rgb(21, 24, 28)"}[scheme]
    for name in ("source", "target", "result"):
        box = page.locator(f"#picture-{name}").bounding_box()
        assert box["width"] > 250
        assert box["height"] > 250


def test_without_scripts_everything_is_there(opened, human):
    page = opened(human, java_script_enabled=False)
    assert page.locator("svg.picture").count() == 3
    assert page.locator(".sortable tbody tr").count() > 30
    page.get_by_label("control net").check()
    assert page.locator("#picture-result .net").is_visible()
    assert page.locator(".zoom:visible").count() == 0


def test_a_page_of_thirty_patches_is_small_and_is_painted(opened, human):
    assert human.stat().st_size <= 1_500_000
    page = opened(human)
    paints = "performance.getEntriesByName('first-contentful-paint').map(paint => paint.startTime)"
    # Asked again and again from here: the page's policy forbids to wait by a script of text.
    for _ in range(400):
        if times := page.evaluate(paints):
            break
        page.wait_for_timeout(25)
    assert times


def test_a_printed_page_has_pictures_and_tables_but_no_switches(opened, human):
    page = opened(human, viewport={"width": 794, "height": 1123}, java_script_enabled=False)
    page.emulate_media(media="print")
    assert page.locator(".switches:visible").count() == 0
    assert page.locator(".zoom:visible").count() == 0
    assert page.locator("svg.picture:visible").count() == 3
    assert page.locator(".sortable tbody tr:visible").count() > 30
    assert page.evaluate("document.documentElement.scrollWidth") == 794
    printed = page.pdf(format="A4")
    assert printed.startswith(b"%PDF")


def test_the_index_of_a_batch_is_sorted_and_linked(opened, tmp_path):
    folder = commands.inputs_of_transfer(tmp_path)
    (folder / "bow.csv").write_text("0,0\n1,1\n1,0\n0,1\n")
    page = folder / "index.html"
    names = [folder / "target.xml", folder / "bow.csv"]
    commands.run("batch", folder / "source.xml", *names, "-o", folder / "out", "--html", page, "--workers", "1")
    shown = opened(page, viewport={"width": 390, "height": 800})
    assert shown.evaluate("document.documentElement.scrollWidth") == 390
    first = shown.locator(".sortable tbody tr").first
    assert "bow.csv" in first.text_content()
    shown.get_by_role("button", name="min scaled Jacobian").click()
    shown.get_by_role("button", name="min scaled Jacobian").click()
    assert "target.xml" in shown.locator(".sortable tbody tr").first.text_content()
    with shown.expect_navigation():
        shown.get_by_role("link", name="report").click()
    assert '"certificate"' in shown.content()
