"""Where registration without landmarks spends its time: ``python benches/python/registration_stages.py [names]``.

For each bundled example: CPU milliseconds of the whole (the best of several runs in a plan, on one thread), and of its
stages as a profiler sees them, which adds its own time to Python's share.
"""

from __future__ import annotations

import cProfile
import pstats
import sys
import time
from collections.abc import Callable

import patchtransfer as pt
from patchtransfer import _core
from patchtransfer.geometry.outline import Outline
from patchtransfer.registration.register import register
from patchtransfer.registration.sampled_boundary import BoundaryShape

NAMES = ("wrench", "rabbit", "human", "frame", "two-hole-plate", "star")
RUNS = 7
#: Functions whose time, with what they call, makes a stage.
STAGES = {
    "samples": "sample",
    "scans": "<method 'scan' of 'builtins.Matching' objects>",
    "solves": "<method 'solve' of 'builtins.Matching' objects>",
    "profiles": "_profiles",
    "slides": "<method 'slide' of 'builtins.Sliding' objects>",
    "their set-up": "sliding",
}


def cpu(work: Callable[[], object]) -> float:
    """Least milliseconds of several runs."""
    spent = []
    for _ in range(RUNS):
        begin = time.process_time()
        work()
        spent.append(time.process_time() - begin)
    return 1e3 * min(spent)


def profile(work: Callable[[], object]) -> dict[str, float]:
    """Milliseconds of every function by name, with what it calls."""
    profiler = cProfile.Profile(time.process_time)
    profiler.runcall(work)
    found: dict[str, float] = {}
    for (_, _, name), (_, _, _, total, _) in pstats.Stats(profiler).stats.items():  # type: ignore[attr-defined]
        found[name] = found.get(name, 0.0) + 1e3 * total
    return found


def main(names: list[str]) -> None:
    """Print the table."""
    _core.set_threads(1)
    print(f"| example | whole | {' | '.join(STAGES)} | the rest |\n|---{'|---' * (len(STAGES) + 2)}|")
    for name in names:
        source, target, _ = pt.examples.load(name)
        outlines = [Outline(loop) for loop in source.boundary().loops]
        shape = BoundaryShape.sample(outlines)

        def work(
            outlines: list[Outline] = outlines, target: pt.Boundary = target, shape: BoundaryShape = shape
        ) -> None:
            register(outlines, target, sampled=lambda: shape)

        whole, times = cpu(work), profile(work)
        parts = [times.get(function, 0.0) for function in STAGES.values()]
        rest = times["register"] - sum(parts)
        print(f"| {name} | {whole:.0f} | {' | '.join(f'{part:.1f}' for part in parts)} | {rest:.1f} |")


if __name__ == "__main__":
    main(sys.argv[1:] or list(NAMES))
