"""How long a drag in the studio takes from the mouse to the picture, in a real browser, on the bundled examples.

200 moves of each example in a window of 1280 x 900: a control point of the target is grabbed with a reach of a tenth of
the loop, moved in 20 steps by up to 4 % of the diameter and dropped, and so are inner layout vertices, by a third of
the way to the next one. Clocked in the page: from the mouse's event, by its own time stamp, to the first frame after
the answer to it was drawn. Nothing is moved before the frame of the last move is there, as with a screen that one
looks at. A table for docs/guide/studio.md.

    python benches/python/studio_browser.py [EXAMPLE ...]

It needs Chromium on the path, playwright and the extra "studio".
"""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from playwright.sync_api import Page, sync_playwright

import patchtransfer as pt
from patchtransfer import examples

DRAGS, STEPS, WAY, ROOM = 10, 20, 0.04, 1 / 3
#: From an event to the frame after it was answered: the last one that counts is that of the move itself.
CLOCK = """
window.moves = []; window.open_move = null;
document.addEventListener("pointermove", (event) => { if (event.buttons) window.open_move = event.timeStamp; }, true);
const there = document.getElementById("time");
new MutationObserver(() => {
  const since = window.open_move;
  if (since === null) return;
  window.open_move = null;
  // A frame is drawn after its callbacks; a message that is sent in one is handled after that.
  requestAnimationFrame(() => { const done = new MessageChannel();
    done.port1.onmessage = () => window.moves.push(performance.now() - since); done.port2.postMessage(0); });
}).observe(there, { childList: true, characterData: true, subtree: true });
"""


def drag(page: Page, kind: str, rng: np.random.Generator) -> None:
    """One drag of a random mark, each step after the picture of the last, then undone."""
    marks = page.locator(f"#picture-target .{kind}")
    box = marks.nth(int(rng.integers(marks.count()))).bounding_box()
    picture = page.locator("#picture-target .target-outline").bounding_box()
    assert box is not None
    assert picture is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    angle = rng.uniform(0, 2 * np.pi)
    size = float(np.hypot(picture["width"], picture["height"]))
    way = WAY * size
    if kind == "vertex":
        others = [m for m in (mark.bounding_box() for mark in marks.all()) if m is not None]
        far = [np.hypot(m["x"] - box["x"], m["y"] - box["y"]) for m in others]
        way = min([way, *(ROOM * d for d in far if d > 0)])
    page.mouse.move(x, y)
    page.mouse.down()
    for k in range(1, STEPS + 1):
        before = page.evaluate("window.moves.length")
        # A click that goes nowhere moves no vertex: the first step is longer than that.
        part = max(way * k / STEPS, 4.0) if kind == "vertex" else way * k / STEPS
        page.mouse.move(x + part * float(np.cos(angle)), y + part * float(np.sin(angle)))
        page.wait_for_function("n => window.moves.length > n", arg=before, timeout=10_000)
    page.mouse.up()
    page.locator("#undo:enabled").wait_for()
    page.get_by_role("button", name="undo").click()
    page.locator("#undo:disabled").wait_for()


def measured(page: Page, kind: str) -> str:
    """Median and worst of the moves of one kind of mark."""
    if not page.locator(f"#picture-target .{kind}").count():
        return "–"
    rng = np.random.default_rng(1)
    page.evaluate("window.moves = []")
    for _ in range(DRAGS):
        drag(page, kind, rng)
    times = np.array(page.evaluate("window.moves"))
    return f"{np.median(times):.0f}, {times.max():.0f} ({100 * (times <= 60).mean():.0f} %)"


def main() -> None:
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    print("| example | control points: median, worst (within 60 ms) | layout vertices |")
    print("|---|---|---|")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        for name in sys.argv[1:] or examples.EXAMPLES:
            source, target, landmarks = examples.load(name)
            files = [Path(folder) / f"{name}-{what}" for what in ("source.xml", "target.xml", "landmarks.csv")]
            pt.write(source, files[0])
            pt.write(target, files[1])
            pt.write_landmarks(landmarks, files[2])
            command = [sys.executable, "-m", "patchtransfer.cli", "studio", *files[:2], "--landmarks", files[2]]
            with subprocess.Popen([*command, "--no-browser"], stdout=subprocess.PIPE, text=True) as server:
                assert server.stdout is not None
                page = browser.new_page(viewport={"width": 1280, "height": 900})
                page.goto(server.stdout.readline().strip())
                page.locator("#verdict.good").wait_for()
                page.evaluate(CLOCK)
                # Landmarks lie on joints: they would be taken instead.
                page.add_style_tag(content=".pairs { pointer-events: none; }")
                print(f"| {name} | {measured(page, 'handle')} | {measured(page, 'vertex')} |", flush=True)
                page.close()
                server.send_signal(signal.SIGINT)
        browser.close()


if __name__ == "__main__":
    main()
