"""What continuity rows cost: ``python continuity_cost.py [MODEL.xml]``, CPU time of transfers with c0, c1 and g1.

The target is the model's own boundary, bent; without a model the bundled wrench is bent. Knot spans are split until
there are the wanted number of unknown points, in either spline space. What counts are the ratios.
"""

from __future__ import annotations

import argparse
import statistics
import time

import numpy as np
from transfer_yeti import bent_boundary

import patchtransfer as pt
from patchtransfer import examples


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model", nargs="?", help="multi-patch (G+Smo XML); default the bundled wrench")
    parser.add_argument("--points", type=int, default=2000, help="unknown points at least (default 2000)")
    parser.add_argument("--angle", type=float, default=40.0, help="bend in degrees (default 40)")
    parser.add_argument("--repeat", type=int, default=5, help="repetitions of which the median counts (default 5)")
    options = parser.parse_args()
    source = pt.read(options.model) if options.model else examples.load("wrench")[0]
    source = source.elevate(1) if min(min(p.degrees) for p in source.patches) < 3 else source
    target, landmarks = bent_boundary(source, np.radians(options.angle))
    rough = source.reduce_continuity(1)
    for name, start in (("as it is", source), ("inner knots C1", rough)):
        parts, model = 1, start
        # New knots are simple: where inner knots are to be C1, the new ones are as well.
        while len(model.topology.interior_points) < options.points:
            parts += 1
            model = source.split_spans(parts)
            model = model.reduce_continuity(1) if start is rough else model
        print(f"{model}, {name}: {len(model.topology.interior_points)} unknown points")
        base = 0.0
        for continuity in ("c0", "c1", "g1")[: 3 if start is rough else 2]:
            plan = pt.TransferPlan(model, continuity)
            result = plan.transfer(target, landmarks)
            times = []
            for _ in range(options.repeat):
                begin = time.process_time()
                plan.transfer(target, landmarks)
                times.append(time.process_time() - begin)
            seconds = statistics.median(times)
            base = base or seconds
            print(f"  {continuity}: {1e3 * seconds:8.1f} ms   ratio {seconds / base:.2f}   {result}")


if __name__ == "__main__":
    main()
