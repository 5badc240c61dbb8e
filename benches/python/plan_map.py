"""Many targets through one plan: ``python plan_map.py [-n 100] [--model FILE] [--refinements K]``.

Compares a cold `transfer()` for every target, of a source as read from a file, with one plan for all: one target after
the other on one core, then with the core's own threads, with an executor of two threads, and of two processes. What
counts are the ratios; the last three are to one plan on one core and need two idle ones.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context

import numpy as np
from transfer_yeti import bent_boundary

import patchtransfer as pt
from patchtransfer import _core, examples
from patchtransfer.refinement import refine_uniformly


def seconds(work: Callable[[], object]) -> float:
    begin = time.perf_counter()
    work()
    return time.perf_counter() - begin


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-n", type=int, default=100)
    parser.add_argument("--model", help="multi-patch file; default the bundled wrench")
    parser.add_argument("--refinements", type=int, default=0, help="halve all knot spans so often (default 0)")
    parser.add_argument("--continuity", default="c0")
    options = parser.parse_args()
    source = pt.read(options.model) if options.model else examples.load("wrench")[0]
    for _ in range(options.refinements):
        source = refine_uniformly(source)
    given = [bent_boundary(source, angle) for angle in np.linspace(0.2, 1.2, options.n)]
    plan = pt.TransferPlan(source, options.continuity)
    plan.transfer(*given[0])
    # What a source keeps for later transfers is the plan's work too.
    fresh = [pt.MultiPatch(source.patches, source.interfaces) for _ in given]
    print(f"{options.n} targets, {source}")

    def row(what: str, work: Callable[[], object], than: float | None = None) -> float:
        each = seconds(work) / options.n
        print(f"{what:28}{1e3 * each:8.1f} ms each" + (f", {than / each:.2f} times faster" if than else ""))
        return each

    _core.set_threads(1)
    cold = row(
        "cold transfer(), one core",
        lambda: [pt.transfer(s, *g, options.continuity) for s, g in zip(fresh, given, strict=True)],
    )
    alone = row("one plan, one core", lambda: list(plan.map(given)))
    print(f"{'':28}{alone / cold:8.0%} of cold")
    _core.set_threads(0)
    row("one plan, the core's threads", lambda: list(plan.map(given)), alone)
    with ThreadPoolExecutor(2) as pool:
        row("two threads", lambda: list(plan.map(given, pool)), alone)
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        list(plan.map(given, pool))
        row("two processes", lambda: list(plan.map(given, pool)), alone)


if __name__ == "__main__":
    main()
