"""Many targets through one plan: ``python plan_map.py [-n 100] [--model FILE] [--refinements K] [--rounds 7]``.

Compares a cold `transfer()` for every target, of a source as read from a file, with one plan for all: one target after
the other on one core, then with the core's own threads, with an executor of two threads, and of two processes. What
counts are the ratios, taken within a round, their medians and ranges over the rounds; the last four are to one plan on
one core and need two idle ones. The very last, two processes with half the targets each that exchange nothing, is what
the machine allows at best.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial
from multiprocessing import get_context
from multiprocessing.connection import Connection
from statistics import median

import numpy as np
from transfer_yeti import bent_boundary

import patchtransfer as pt
from patchtransfer import _core, examples

Given = list[tuple[pt.Boundary, np.ndarray]]


def seconds(work: Callable[[], object]) -> float:
    begin = time.perf_counter()
    work()
    return time.perf_counter() - begin


def half(orders: Connection, source: pt.MultiPatch, continuity: str, given: Given) -> None:
    """A process of its own: the targets as often as it is told to."""
    _core.set_threads(1)
    plan = pt.TransferPlan(source, continuity)
    list(plan.map(given))
    orders.send(True)
    while orders.recv():
        list(plan.map(given))
        orders.send(True)


def both(halves: list[Connection]) -> None:
    for orders in halves:
        orders.send(True)
    for orders in halves:
        orders.recv()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-n", type=int, default=100)
    parser.add_argument("--model", help="multi-patch file; default the bundled wrench")
    parser.add_argument("--refinements", type=int, default=0, help="halve all knot spans so often (default 0)")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--continuity", default="c0")
    options = parser.parse_args()
    source = pt.read(options.model) if options.model else examples.load("wrench")[0]
    for _ in range(options.refinements):
        source = source.split_spans(2)
    given = [bent_boundary(source, angle) for angle in np.linspace(0.2, 1.2, options.n)]
    plan = pt.TransferPlan(source, options.continuity)
    context = get_context("spawn")
    halves = []
    for k in (0, 1):
        here, there = context.Pipe()
        context.Process(target=half, args=(there, source, options.continuity, given[k::2])).start()
        here.recv()
        halves.append(here)
    print(f"{options.n} targets, {source}, medians of {options.rounds} rounds")
    with ThreadPoolExecutor(2) as threads, ProcessPoolExecutor(2, mp_context=context) as processes:
        # What a source keeps for later transfers is the plan's work too, so cold transfers get fresh ones.
        works: dict[str, Callable[[list[pt.MultiPatch]], object]] = {
            "cold transfer(), one core": lambda fresh: [
                pt.transfer(s, *g, options.continuity) for s, g in zip(fresh, given, strict=True)
            ],
            "one plan, one core": lambda _: list(plan.map(given)),
            "one plan, the core's threads": lambda _: list(plan.map(given)),
            "two threads": lambda _: list(plan.map(given, threads)),
            "two processes": lambda _: list(plan.map(given, processes)),
            "two that exchange nothing": lambda _: both(halves),
        }
        times: dict[str, list[float]] = {name: [] for name in works}
        for _ in range(options.rounds + 1):
            fresh = [pt.MultiPatch(source.patches, source.interfaces) for _ in given]
            for place, (name, work) in enumerate(works.items()):
                _core.set_threads(1 if place < 2 else 0)
                times[name].append(seconds(partial(work, fresh)) / options.n)
    for orders in halves:
        orders.send(False)
    # The first round warms up.
    cold, alone, *others = [(name, found[1:]) for name, found in times.items()]
    print(f"{cold[0]:28}{1e3 * median(cold[1]):8.1f} ms each")
    shares = [a / c for a, c in zip(alone[1], cold[1], strict=True)]
    print(f"{alone[0]:28}{1e3 * median(alone[1]):8.1f} ms each, {median(shares):.0%} of cold", end="")
    print(f" ({min(shares):.0%} to {max(shares):.0%})")
    for name, found in others:
        gains = [a / b for a, b in zip(alone[1], found, strict=True)]
        print(f"{name:28}{1e3 * median(found):8.1f} ms each, {median(gains):.2f} times faster", end="")
        print(f" ({min(gains):.2f} to {max(gains):.2f})")


if __name__ == "__main__":
    main()
