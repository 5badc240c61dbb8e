"""Points found in models beside evaluating them: ``python location.py [POINTS]``.

Random points of every bundled example, all patches mixed, and of a grid of 30 bent patches: `Patch.__call__` makes
them, patch by patch, and `MultiPatch.locate` finds them again. CPU seconds of all threads, medians of three: halved,
the time on two idle cores. What counts is the ratio, and that the largest residual stays below 1e-12 of the diameter.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np

from patchtransfer import MultiPatch, Patch, examples

RUNS = 3


def seconds(work: Callable[[], object]) -> float:
    """Median over the runs."""
    spent = []
    for _ in range(RUNS):
        start = time.process_time()
        work()
        spent.append(time.process_time() - start)
    return float(np.median(spent))


def bent_grid(columns: int = 6, rows: int = 5) -> MultiPatch:
    """Bicubic unit squares with three spans a direction, bent."""
    square = Patch(([0, 0, 1, 1], [0, 0, 1, 1]), (1, 1), [[[0, 0], [0, 1]], [[1, 0], [1, 1]]]).elevate(2).split_spans(3)

    def cell(a: int, b: int) -> Patch:
        x, y = np.moveaxis(square.control_points + np.array([a, b]), -1, 0)
        return square.with_control_points(np.stack([x + 0.3 * np.sin(1.3 * y), y + 0.3 * np.cos(1.1 * x)], axis=-1))

    return MultiPatch([cell(a, b) for a in range(columns) for b in range(rows)])


def points(mp: MultiPatch, patch: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """The points at parameters of mixed patches."""
    x = np.empty((len(patch), 2))
    for k, p in enumerate(mp.patches):
        own = patch == k
        x[own] = p(u[own], v[own])
    return x


def measure(name: str, mp: MultiPatch, n: int) -> None:
    """Print a model's line."""
    rng = np.random.default_rng(0)
    patch, u, v = rng.integers(0, len(mp.patches), n), np.empty(n), np.empty(n)
    for k, p in enumerate(mp.patches):
        own = patch == k
        u[own], v[own] = (rng.uniform(*limits, own.sum()) for limits in p.domain)
    x = points(mp, patch, u, v)
    residual = np.linalg.norm(points(mp, *mp.locate(x)) - x, axis=1).max() / mp.diameter
    evaluate, locate = seconds(lambda: points(mp, patch, u, v)), seconds(lambda: mp.locate(x))
    ratio = locate / evaluate
    print(f"{name:20}{len(mp.patches):8}{evaluate:14.3f}{locate:12.3f}{ratio:8.1f}{residual:10.1e}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("points", nargs="?", type=int, default=1_000_000)
    n = parser.parse_args().points
    models = {"30 bent squares": bent_grid()} | {name: examples.load(name)[0] for name in examples.EXAMPLES}
    print(f"{'model':20}{'patches':>8}{'evaluate [s]':>14}{'locate [s]':>12}{'ratio':>8}{'residual':>10}")
    for name, mp in models.items():
        measure(name, mp, n)


if __name__ == "__main__":
    main()
