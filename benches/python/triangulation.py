"""Constrained Delaunay triangulation beside Triangle (option ``p``): ``python triangulation.py [POINTS ...]``.

Needs the package ``triangle``. Both get the same points and boundary edges as arrays and return arrays of triangles
without the exterior; both copy their arguments in and their results out within the time. Beyond the triangulation
Triangle's time holds the output of vertices, segments and their markers; ours the checks of the input (coinciding
points, crossing or touching polygons, points outside) and triangles in lexicographic order. Triangle's conversion of a
dictionary's keys is left out: its compiled function is called directly.

CPU time of one thread, medians of runs that alternate; what counts is the ratio. `mesh` is the background mesh of the
bundled wrench, refined uniformly to about that size.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np

from patchtransfer import _core, examples

Case = tuple[np.ndarray, list[np.ndarray]]


def grid(n: int, shift: float = 0.0) -> Case:
    """Square grid, its interior points moved by up to `shift` of its spacing."""
    m = round(n**0.5)
    t = np.arange(m) / (m - 1)
    points = np.stack(np.meshgrid(t, t, indexing="ij"), -1)
    inside = points[1:-1, 1:-1]
    inside += np.random.default_rng(0).uniform(-shift, shift, inside.shape) / (m - 1)
    at = np.arange(m * m).reshape(m, m)
    rim = np.concatenate([at[:-1, 0], at[-1, :-1], at[:0:-1, -1], at[0, :0:-1]])
    return points.reshape(-1, 2), [rim]


def random(n: int) -> Case:
    """Random points of a square with as many points a side as a grid has."""
    m = round(n**0.5)
    t, zero = np.arange(m) / m, np.zeros(m)
    sides = np.concatenate([np.c_[t, zero], np.c_[zero + 1, t], np.c_[1 - t, zero + 1], np.c_[zero, 1 - t]])
    inside = np.random.default_rng(1).uniform(0.5 / m, 1 - 0.5 / m, (n - 4 * m, 2))
    return np.concatenate([sides, inside]), [np.arange(4 * m)]


def star(n: int) -> Case:
    """Random points of a star-shaped domain that is not convex."""
    random = np.random.default_rng(2)
    m = 4 * round(n**0.5)
    t = np.concatenate([2 * np.pi * np.arange(m) / m, random.uniform(0, 2 * np.pi, n - m)])
    part = np.concatenate([np.ones(m), np.sqrt(random.uniform(0, 0.98, n - m))])
    radius = part * (1 + 0.3 * np.sin(5 * t) + 0.1 * np.sin(13 * t))
    return np.stack([radius * np.cos(t), radius * np.sin(t)], 1), [np.arange(m)]


def mesh(n: int) -> Case:
    """What `background_mesh.source_mesh` triangulates."""
    model = examples.load("wrench")[0]
    while 2 * len(model.topology.coordinates) < n:
        model = model.split_spans(2)
    topology = model.topology
    loops = [
        np.concatenate([side.points(topology.points[side.patch])[:-1] for side in loop]) for loop in topology.loops
    ]
    return topology.coordinates, [loop.astype(np.int64) for loop in loops]


CASES: dict[str, Callable[[int], Case]] = {
    "grid": grid,
    "grid, shifted": lambda n: grid(n, 0.3),
    "random": random,
    "star": star,
    "mesh": mesh,
}


def area(points: np.ndarray, triangles: np.ndarray) -> float:
    d, e = (points[triangles[:, k]] - points[triangles[:, 0]] for k in (1, 2))
    return float(abs(d[:, 0] * e[:, 1] - d[:, 1] * e[:, 0]).sum()) / 2


def compare(points: np.ndarray, loops: list[np.ndarray], repeat: int) -> tuple[float, float]:
    """Median seconds of Triangle and ours."""
    import triangle.core

    edges = np.concatenate([np.stack([loop, np.roll(loop, -1)], 1) for loop in loops]).astype(np.int32)
    domain = {"pointlist": points, "segmentlist": edges}
    if len(loops) > 1:
        # The mean of its corners lies in the only hole here, that of the wrench.
        domain["holelist"] = np.stack([points[loop].mean(0) for loop in loops[1:]])
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(repeat):
        begin = time.process_time()
        theirs, _ = triangle.core.triang(domain, "pQz")
        times[0].append(time.process_time() - begin)
        begin = time.process_time()
        _, ours = _core.triangulate(points, loops)
        times[1].append(time.process_time() - begin)
    if len(ours) != len(theirs["trianglelist"]) or not np.isclose(
        area(points, ours), area(points, theirs["trianglelist"])
    ):
        raise RuntimeError("the triangulations differ")
    return float(np.median(times[0])), float(np.median(times[1]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("points", type=float, nargs="*", default=[1e4, 1e5, 5e5], help="default 1e4 1e5 5e5")
    sizes = [int(size) for size in parser.parse_args().points]
    print("| points | case | Triangle, ms | patchtransfer, ms | ratio |\n|---:|---|---:|---:|---:|")
    for size in sizes:
        for name, case in CASES.items():
            points, loops = case(size)
            theirs, ours = compare(points, loops, 21 if size < 200_000 else 5)
            print(
                f"| {len(points):,} | {name} | {1e3 * theirs:.1f} | {1e3 * ours:.1f} | {ours / theirs:.2f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
