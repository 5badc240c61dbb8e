"""How long a moved point of the studio takes to become a picture, on the bundled examples; without the browser.

200 moves of each example: a control point is grabbed with a reach of a tenth of the loop, moved in 20 steps by up to
4 % of the diameter, and dropped. A table for docs/guide/studio.md.

    python benches/python/studio.py
"""

from __future__ import annotations

import json
import time

import numpy as np

from patchtransfer import examples
from patchtransfer.editor.session import Session
from patchtransfer.editor.view import View

DRAGS, STEPS, REACH, WAY = 10, 20, 0.1, 0.04


def drag(session: Session, view: View, rng: np.random.Generator) -> list[tuple[float, float]]:
    """Milliseconds of the map and of its picture, move by move."""
    at = session.handles[rng.integers(len(session.handles))]
    start = session.edited.target.loops[at.loop][at.curve].control_points[at.point].copy()
    angle = rng.uniform(0, 2 * np.pi)
    way = WAY * session.edited.target.diameter * np.array([np.cos(angle), np.sin(angle)])
    session.grab(at, REACH)
    out = []
    for k in range(1, STEPS + 1):
        x, y = (start + way * k / STEPS).tolist()
        begin = time.perf_counter()
        session.drag((x, y))
        mapped = time.perf_counter()
        json.dumps(view.state())
        out.append((1e3 * (mapped - begin), 1e3 * (time.perf_counter() - mapped)))
    session.drop()
    session.undo()
    return out


def main() -> None:
    print("| example | map: median, worst | picture: median, worst | together: median, worst |")
    print("|---|---|---|---|")
    for name in examples.EXAMPLES:
        session = Session(*examples.load(name))
        view, rng = View(session), np.random.default_rng(1)
        times = np.array([move for _ in range(DRAGS) for move in drag(session, view, rng)])
        columns = [*times.T, times.sum(axis=1)]
        print(f"| {name} | " + " | ".join(f"{np.median(t):.0f}, {t.max():.0f}" for t in columns) + " |", flush=True)


if __name__ == "__main__":
    main()
