"""Local–global steps of the mesh method beside libigl's ARAP: ``python local_global.py [VERTICES ...]``.

Needs ``pip install libigl``. Both alternate a projection of every face's Jacobian (ours to bounded conformal
distortion, ARAP's to a rotation) with a solve by a factorization made once; both do so on the same mesh, from the same
folded map, with the same vertices fixed. Wall times, medians of runs that alternate; ours with one thread and with the
core's own, libigl's as it comes. What counts is the ratio.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

import igl
import numpy as np
from plan_map import seconds
from triangulation import grid

from patchtransfer import _core
from patchtransfer.mesh.background_mesh import TriangleMesh
from patchtransfer.mesh.harmonic import mesh_solver

#: Steps in a run, and the bound of the conformal distortion; with it no run is free of flips, which would end it.
STEPS, BOUND = 5, 1.2


def compare(n: int, repeat: int) -> tuple[int, list[float]]:
    """Vertices; seconds of libigl and ours: preparation, then a step, ours with one thread and with all."""
    points, (rim,) = grid(n, 0.3)
    mesh = TriangleMesh(*_core.triangulate(points, [rim]), (rim,))
    rim = np.sort(rim)
    start = points * [1, 0] + points * [0, 1] * (1 + 4 * np.sin(9 * points[:, :1]))
    bounds = np.full(len(mesh.triangles), BOUND)
    arap, solvers = igl.ARAPData(), []
    times = [
        seconds(lambda: igl.arap_precomputation(points, mesh.triangles, 2, rim.astype(np.int32), arap)),
        seconds(lambda: solvers.append(mesh_solver(mesh, rim, None))),
    ]
    arap.max_iter = STEPS

    def ours() -> None:
        _, flips, _ = solvers[0].iterate(start, bounds, STEPS, 0.0)
        if len(flips) != STEPS + 1:
            raise RuntimeError(f"{len(flips) - 1} steps instead of {STEPS}")

    works: list[tuple[int, Callable[[], object]]] = [
        (0, lambda: igl.arap_solve(start[rim], arap, start)),
        (1, ours),
        (0, ours),
    ]
    steps: list[list[float]] = [[] for _ in works]
    for _ in range(repeat):
        for (threads, work), found in zip(works, steps, strict=True):
            _core.set_threads(threads)
            found.append(seconds(work) / STEPS)
    return len(points), times + [float(np.median(found)) for found in steps]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("vertices", type=float, nargs="*", default=[1e4, 1e5, 5e5], help="default 1e4 1e5 5e5")
    columns = "vertices | libigl prepares, ms | ours | libigl's step, ms | ours, one thread | ours | ours / libigl"
    print(f"| {columns} |\n|{'---:|' * 7}")
    for size in parser.parse_args().vertices:
        n, found = compare(int(size), 21 if size < 200_000 else 5)
        times = " | ".join(f"{1e3 * s:.1f}" for s in found)
        print(f"| {n:,} | {times} | {found[3] / found[2]:.2f} |", flush=True)


if __name__ == "__main__":
    main()
