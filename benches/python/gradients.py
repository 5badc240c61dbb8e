"""What a derivative costs: ``python gradients.py [MODEL]``.

For the bundled wrench and rabbit: a point with the gradient of a function of all control points (`Frozen.fill`, then
`Filled.vjp`), against `TransferPlan.refill` on the same boundary, C0 and C1; medians of interleaved runs in CPU time.
For a model refined to some 1e5 unknown points: the seconds of a `vjp` alone, once factorized.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np
from optimizer_scaling import model_of

import patchtransfer as pt
from patchtransfer import examples

REPEAT = 31
#: Size of the motions of the boundary, in diameters: steps of an optimiser.
STEP = 0.01
LARGE = 100_000


def cpu(run: Callable[[], object]) -> float:
    begin = time.process_time()
    run()
    return time.process_time() - begin


def moved(mp: pt.MultiPatch, seed: int) -> np.ndarray:
    """All points along a random smooth motion of the plane."""
    x = mp.topology.coordinates
    a, b = np.random.default_rng(seed).normal(size=(2, 2))
    scaled = 2 * (x - x.mean(axis=0)) / mp.diameter
    return x + STEP * mp.diameter * np.sin(scaled[:, ::-1] * 2 * a + b)


def compare(name: str, continuity: str) -> None:
    source, target, landmarks = examples.load(name)
    model = pt.transfer(source, target, landmarks, continuity).multipatch
    plan = pt.TransferPlan(model, continuity)
    frozen = plan.freeze()
    w = np.random.default_rng(0).normal(size=frozen.points.shape)
    times = []
    for k in range(REPEAT):
        points = moved(model, k)
        boundary = points[frozen.boundary_points]
        fill = cpu(lambda b=boundary: frozen.fill(b))
        both = cpu(lambda b=boundary: frozen.fill(b).vjp(w))
        times.append((cpu(lambda p=points: plan.refill(p)), fill, both))
    refill, fill, both = np.median(times, axis=0)
    print(
        f"{name:7s} {continuity}  refill {1e3 * refill:5.1f} ms  fill {1e3 * fill:5.1f} ms  "
        f"with vjp {1e3 * both:5.1f} ms, {both / refill:.2f} of refill"
    )


def large(model: pt.MultiPatch) -> None:
    while len(model.topology.interior_points) < LARGE:
        model = model.split_spans()
    frozen = pt.TransferPlan(model, "c0").freeze()
    filled = frozen.fill(moved(model, 0)[frozen.boundary_points])
    w = np.random.default_rng(0).normal(size=frozen.points.shape)
    filled.vjp(w)
    begin = time.perf_counter()
    seconds = cpu(lambda: filled.vjp(w))
    print(
        f"{len(model.topology.interior_points)} unknown points: gradient {filled.gradient_norm:.1e}, "
        f"vjp {time.perf_counter() - begin:.2f} s, {seconds:.2f} s of CPU"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("model", nargs="?", help="model for the large case; default yeti or the wrench")
    model = model_of(parser.parse_args().model, 0)
    for name in ("wrench", "rabbit"):
        for continuity in ("c0", "c1"):
            compare(name, continuity)
    large(model)


if __name__ == "__main__":
    main()
