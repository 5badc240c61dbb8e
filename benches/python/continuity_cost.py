"""What continuity rows cost: ``python continuity_cost.py [MODEL.xml]``, CPU time of transfers with c0, c1 and g1.

The target is the model's own boundary, bent; without a model the bundled wrench is bent. Knot spans are split until
there are about the wanted number of unknown points, in either spline space. What counts are the ratios: times are
taken in turns, and on one thread (set OMP_NUM_THREADS and OPENBLAS_NUM_THREADS to 1).
"""

from __future__ import annotations

import argparse
import statistics
import time

import numpy as np
from transfer_yeti import bent_boundary

import patchtransfer as pt
from patchtransfer import examples


def near(source: pt.MultiPatch, points: int, smoothness: int | None) -> pt.MultiPatch:
    """The source with its spans split so that the number of unknown points comes closest to `points`."""
    finer, found = source, []
    for parts in range(1, 100):
        finer = source.split_spans(parts)
        finer = finer if smoothness is None else finer.reduce_continuity(smoothness)
        found.append(finer)
        if len(finer.topology.interior_points) >= points:
            break
    return min(found, key=lambda mp: abs(len(mp.topology.interior_points) - points))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model", nargs="?", help="multi-patch (G+Smo XML); default the bundled wrench")
    parser.add_argument("--points", type=int, default=2000, help="unknown points, about (default 2000)")
    parser.add_argument("--angle", type=float, default=40.0, help="bend in degrees (default 40)")
    parser.add_argument("--repeat", type=int, default=7, help="repetitions of which the median counts (default 7)")
    options = parser.parse_args()
    source = pt.read(options.model) if options.model else examples.load("wrench")[0]
    source = source.elevate(1) if min(min(p.degrees) for p in source.patches) < 3 else source
    target, landmarks = bent_boundary(source, np.radians(options.angle))
    for name, smoothness in (("as it is", None), ("inner knots C1", 1)):
        model = near(source, options.points, smoothness)
        print(f"{model}, {name}: {len(model.topology.interior_points)} unknown points")
        kinds = ("c0", "c1") if smoothness is None else ("c0", "c1", "g1")
        plans = {kind: pt.TransferPlan(model, kind) for kind in kinds}
        results = {kind: plan.transfer(target, landmarks) for kind, plan in plans.items()}
        times: dict[str, list[float]] = {kind: [] for kind in kinds}
        for _ in range(options.repeat):
            for kind, plan in plans.items():
                begin = time.process_time()
                plan.transfer(target, landmarks)
                times[kind].append(time.process_time() - begin)
        base = statistics.median(times["c0"])
        for kind in kinds:
            seconds = statistics.median(times[kind])
            print(f"  {kind}: {1e3 * seconds:8.1f} ms   ratio {seconds / base:.2f}   {results[kind]}")


if __name__ == "__main__":
    main()
