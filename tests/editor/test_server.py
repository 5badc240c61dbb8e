"""The studio as a process of its own: its address, who is let in, what browsers see, how it ends."""

from __future__ import annotations

import http.client
import json
import os
import random
import re
import signal
import subprocess
import sys
from contextlib import contextmanager

import pytest

import patchtransfer as pt
from patchtransfer import examples

pytest.importorskip("uvicorn")
pytest.importorskip("starlette")
client = pytest.importorskip("websockets.sync.client")
OTHER = ["/file/../../etc/passwd", "/file/%2e%2e%2fetc%2fpasswd", "/file/x.xml", "/etc/passwd"]
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals")


@contextmanager
def started(*arguments, **options):
    # A shell's background jobs, and what they start, ignore Ctrl-C.
    heed = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    code = f"{heed}; from patchtransfer.cli import main; main()"
    command = [sys.executable, "-c", code, "studio", *map(str, arguments), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options) as process:
        try:
            yield process, process.stdout.readline().strip()
        finally:
            process.kill()


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("studio")
    source, target, landmarks = examples.load("star")
    pt.write(source, folder / "source.xml")
    pt.write(target, folder / "target.xml")
    pt.write_landmarks(landmarks, folder / "landmarks.csv")
    return folder


@pytest.fixture(scope="module")
def studio(files):
    given = files / "source.xml", files / "target.xml", "--landmarks", files / "landmarks.csv"
    with started(*given, "--port", "0") as (_, address):
        yield re.fullmatch(r"http://127\.0\.0\.1:(\d+)/\?token=([\w-]{32,})", address).groups()


def ask(port, path, **headers):
    connection = http.client.HTTPConnection("127.0.0.1", int(port), timeout=30)
    connection.putrequest("GET", path, skip_host="Host" in headers)
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.endheaders()
    answer = connection.getresponse()
    return answer.status, answer.read(), dict(answer.getheaders())


def connected(port, token, origin=None, **options):
    origin = f"http://127.0.0.1:{port}" if origin is None else origin
    return client.connect(f"ws://127.0.0.1:{port}/live?token={token}", origin=origin, **options)


def test_the_page_is_there_for_whoever_has_the_token(studio):
    port, token = studio
    status, body, headers = ask(port, f"/?token={token}")
    assert status == 200
    assert b"picture-target" in body
    assert headers["referrer-policy"] == "no-referrer"
    assert "server" not in headers


@pytest.mark.parametrize(
    ("path", "headers"),
    [
        ("/", {}),
        ("/?token=", {}),
        ("/?token=wrong", {}),
        ("/?token=TOKEN&token=TOKEN", {}),
        ("/?token=TOKEN", {"Host": "evil.example"}),
        ("/?token=TOKEN", {"Host": "127.0.0.1:1"}),
        ("/?token=TOKEN", {"Host": "localhost.evil.example:PORT"}),
        ("/?token=TOKEN", {"Origin": "http://evil.example"}),
        ("/?token=TOKEN", {"Origin": "null"}),
        ("/file/result.xml", {}),
        ("/file/result.xml?token=%F0%9F%98%80", {}),
    ],
)
def test_others_are_refused(studio, path, headers):
    port, token = studio
    filled = {name: value.replace("PORT", port) for name, value in headers.items()}
    status, body, _ = ask(port, path.replace("TOKEN", token), **filled)
    assert (status, body) == (403, b"refused")


@pytest.mark.parametrize(
    "path", ["/file/../../etc/passwd", "/file/%2e%2e%2fetc%2fpasswd", "/file/x.xml", "/etc/passwd"]
)
def test_there_are_no_other_files(studio, path):
    port, token = studio
    status, body, _ = ask(port, f"{path}?token={token}")
    assert status == 404
    assert b"root" not in body


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "https://127.0.0.1:PORT"])
def test_sockets_of_other_pages_are_refused(studio, origin):
    port, token = studio
    with pytest.raises(Exception, match="403"):
        connected(port, token, origin.replace("PORT", port)).__enter__()
    with pytest.raises(Exception, match="403"):
        connected(port, "wrong").__enter__()


def test_what_is_saved_is_what_is_shown(studio, tmp_path):
    port, token = studio
    for name in ("target.xml", "result.xml", "landmarks.csv", "report.json", "report.html"):
        status, body, headers = ask(port, f"/file/{name}?token={token}")
        assert status == 200, name
        assert headers["content-disposition"] == f'attachment; filename="{name}"'
        (tmp_path / name).write_bytes(body)
    source, target, landmarks = examples.load("star")
    assert pt.read_boundary(tmp_path / "target.xml") == target
    assert pt.read(tmp_path / "result.xml") == pt.transfer(source, target, landmarks).multipatch
    assert json.loads((tmp_path / "report.json").read_text())["certificate"]["injective"]


def test_ten_thousand_random_messages(studio):
    """Refused or obeyed, every one is answered, and the studio goes on."""
    port, token = studio
    rng = random.Random(7)
    words = ["do", "grab", "drag", "x", "y", "loop", "curve", "point", "landmark", "on", "source", "{", "[", '"', ":"]
    with connected(port, token) as socket:
        state = json.loads(socket.recv())
        assert state["source"]
        for k in range(10_000):
            kind = rng.randrange(4)
            if kind == 0:
                text = "".join(chr(rng.randrange(1, 0x2FF)) for _ in range(rng.randrange(40)))
            elif kind == 1:
                text = rng.randbytes(rng.randrange(40))
            elif kind == 2:
                text = json.dumps({rng.choice(words): rng.choice(words) for _ in range(rng.randrange(6))})
            else:
                text = json.dumps({"do": rng.choice(["grab", "drag", "remove"]), "x": rng.random(), "loop": -1})
            socket.send(text)
            if k % 100 == 99:
                for _ in range(100):
                    assert "refused" in json.loads(socket.recv())
        socket.send('{"do": "refresh"}')
        assert json.loads(socket.recv())["status"] == "certified"


def test_a_message_that_is_too_large_ends_its_connection_only(studio):
    port, token = studio
    with connected(port, token) as socket:
        socket.recv()
        socket.send("x" * 100_000)
        with pytest.raises(client.ConnectionClosed if hasattr(client, "ConnectionClosed") else Exception):
            socket.recv()
    assert ask(port, f"/?token={token}")[0] == 200


def test_it_ends_on_ctrl_c_with_a_page_open(files):
    with started(files / "source.xml") as (process, address):
        port, token = re.fullmatch(r"http://127\.0\.0\.1:(\d+)/\?token=(.+)", address).groups()
        with connected(port, token) as socket:
            socket.recv()
            process.send_signal(signal.SIGINT)
            process.wait(timeout=30)
        assert process.returncode == 0
        assert process.stderr.read() == ""


def test_nothing_is_written_where_nobody_said(files, tmp_path):
    home = tmp_path / "home"
    home.mkdir()
    places = {"HOME": str(home), "TMPDIR": str(home), "XDG_CACHE_HOME": str(home), "PYTHONDONTWRITEBYTECODE": "1"}
    before = {path: path.stat().st_mtime_ns for path in files.rglob("*")}
    with started(files / "source.xml", files / "target.xml", cwd=home, env={**os.environ, **places}) as (_, address):
        port, token = re.fullmatch(r"http://127\.0\.0\.1:(\d+)/\?token=(.+)", address).groups()
        with connected(port, token) as socket:
            socket.recv()
            steps = [{"do": "grab", "loop": 0, "curve": 0, "point": 0}, {"do": "drag", "x": 0.1, "y": 0.9}]
            for message in (*steps, {"do": "drop"}, {"do": "undo"}, {"do": "../../x", "file": "/tmp/x"}):
                socket.send(json.dumps(message))
                socket.recv()
        for name in ("target.xml", "result.xml", "report.html", "report.json", "../x"):
            ask(port, f"/file/{name}?token={token}")
        assert list(home.iterdir()) == []
    assert {path: path.stat().st_mtime_ns for path in files.rglob("*")} == before


def test_a_port_that_is_taken_is_an_error(files, studio):
    port, _ = studio
    with started(files / "source.xml", "--port", port) as (process, address):
        assert address == ""
        assert process.wait(timeout=60) == 2
        assert re.fullmatch(rf"error: port {port} cannot be used [^\n]*--port 0\n", process.stderr.read())


class TestInABrowser:
    @pytest.fixture
    def page(self, browser, files):
        given = files / "source.xml", files / "target.xml", "--landmarks", files / "landmarks.csv"
        complaints = []
        with started(*given) as (_, address):
            page = browser.new_page(viewport={"width": 1280, "height": 900})
            page.on("console", lambda message: complaints.append(message.text))
            page.on("pageerror", lambda error: complaints.append(str(error)))
            page.on("request", lambda r: complaints.append(r.url) if "//127.0.0.1:" not in r.url else None)
            page.goto(address)
            page.locator("#verdict.good").wait_for()
            yield page
            page.close()
        assert complaints == []

    def at(self, page, mark):
        """Where a mark is in the window."""
        box = mark.bounding_box()
        return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def middle(self, page, number):
        return self.at(page, page.locator("#picture-target .handle").nth(number))

    def test_a_point_is_dragged_and_the_certificate_follows(self, page):
        x, y = self.middle(page, 3)
        before = page.locator("#picture-target .iso path").first.get_attribute("d")
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x + 12, y - 8, steps=6)
        page.locator("#words", has_text="of samples").wait_for()
        assert page.locator("#verdict").text_content() == "certified"
        page.mouse.up()
        page.locator("#words", has_text="proved").wait_for()
        assert page.locator("#picture-target .iso path").first.get_attribute("d") != before
        assert self.middle(page, 3) == pytest.approx((x + 12, y - 8), abs=2)
        page.get_by_role("button", name="undo").click()
        page.locator("#undo:disabled").wait_for()
        assert page.locator("#picture-target .iso path").first.get_attribute("d") == before

    def test_an_infeasible_drag_is_shown_and_recovers(self, page):
        x, y = self.middle(page, 0)
        box = page.locator("#picture-target").bounding_box()
        centre = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(2.4 * centre[0] - 1.4 * x, 2.4 * centre[1] - 1.4 * y, steps=8)
        page.locator("#verdict.bad").wait_for()
        page.locator("#picture-target .place").first.wait_for(state="attached")
        page.mouse.move(x, y, steps=4)
        page.locator("#verdict.good").wait_for()
        page.mouse.up()

    def test_landmarks_are_added_moved_and_removed(self, page):
        count = page.locator("#picture-source path.pair").count()
        page.get_by_role("button", name="add landmark").click()
        for name in ("source", "target"):
            box = page.locator(f"#picture-{name}").bounding_box()
            page.mouse.click(box["x"] + 0.97 * box["width"], box["y"] + 0.35 * box["height"])
        added = page.locator(f'#picture-target path.pair[data-landmark="{count}"]')
        # A line without length has no box, so that it counts as hidden; its round cap is what one sees.
        added.wait_for(state="attached")
        assert page.locator("#picture-source path.pair").count() == count + 1
        x, y = self.at(page, added)
        page.mouse.dblclick(x, y)
        added.wait_for(state="detached")

    def test_a_layout_vertex_is_dragged_freed_and_undone(self, page, tmp_path):
        """The star's centre, where six patches meet."""
        line = page.locator("#picture-target .iso path").first
        vertex = page.locator("#picture-target .vertex")
        before, (x, y) = line.get_attribute("d"), self.at(page, vertex)
        box = page.locator("#picture-target").bounding_box()
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x + 20, y + 14, steps=6)
        page.locator("#words", has_text="of samples").wait_for()
        assert page.locator("#verdict.good").text_content() == "certified"
        # Out of the shape and back.
        page.mouse.move(box["x"] + 4, box["y"] + 4, steps=6)
        page.locator("#verdict.bad").wait_for()
        page.mouse.move(x + 20, y + 14, steps=6)
        page.locator("#verdict.good").wait_for()
        page.mouse.up()
        page.locator("#words", has_text="proved").wait_for()
        assert self.at(page, vertex) == pytest.approx((x + 20, y + 14), abs=1)
        after = line.get_attribute("d")
        assert after != before
        with page.expect_download() as started_download:
            page.get_by_role("link", name="result.xml").click()
        started_download.value.save_as(tmp_path / "result.xml")
        saved = pt.read(tmp_path / "result.xml")
        free = pt.transfer(*examples.load("star")).multipatch
        inner = [v.point for v in saved.topology.vertices if v.interior]
        shift = (saved.topology.coordinates - free.topology.coordinates)[inner] / free.diameter
        assert pt.certify(saved).injective
        assert 0.01 < shift[0, 0] < 0.1
        page.mouse.dblclick(x + 20, y + 14)
        page.locator("#picture-target .vertex.moved").wait_for(state="detached")
        assert line.get_attribute("d") == before
        page.get_by_role("button", name="undo").click()
        page.locator("#picture-target .vertex.moved").wait_for(state="attached")
        assert line.get_attribute("d") == after

    def test_files_are_saved_by_the_browser(self, page, tmp_path):
        with page.expect_download() as started_download:
            page.get_by_role("link", name="result.xml").click()
        started_download.value.save_as(tmp_path / "result.xml")
        assert pt.certify(pt.read(tmp_path / "result.xml")).injective

    @pytest.mark.parametrize("scheme", ["light", "dark"])
    def test_it_fits_a_telephone(self, page, scheme):
        page.emulate_media(color_scheme=scheme)
        page.set_viewport_size({"width": 390, "height": 844})
        assert page.evaluate("document.documentElement.scrollWidth") == 390
        assert page.locator("#picture-target").bounding_box()["width"] > 300
