"""Stages of a transfer at growing sizes, and how far the solver is from the machine's limits: ``python stages.py``.

The model (yeti of `PATCHTRANSFER_MODELS`, else the bundled wrench, or a file) is bent, refined uniformly again and
again, and transferred in a plan with landmarks at all joints, `continuity="c0"`, on one thread. With ``-o FILE`` the
tables become a page of the documentation.

Physical limit: a Newton step factorizes one matrix, that of both components or, of large models, that of one in single
precision. Its multiplications and additions are counted on SuperLU's factor of the same matrix (the sum of squared
column lengths, as for Cholesky), and done at the rate of a dense matrix product. What is stored of the nodes crosses
the memory twice, for the gradient and for the Hessian, and the Hessian's entries once each way, at the rate of a copy.
"""

from __future__ import annotations

import argparse
import platform
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from optimizer_scaling import model_of
from scipy.sparse import csc_array
from scipy.sparse.linalg import SuperLU, splu
from threadpoolctl import threadpool_limits
from transfer_yeti import SciPyOptimizer, bent_boundary, median_time

import patchtransfer as pt
from patchtransfer import _core
from patchtransfer.interior.optimizer import SplineOptimizer

STAGES = ("registration", "feasibility", "fitting", "optimisation", "certificate", "quality")
#: Largest number of unknown points at which SuperLU is still run; beyond, operations grow as for nested dissection.
LARGEST = 30_000
GROWTH = 1.5
#: Unknown points from which the core factorizes one component's matrix, in single precision: twice the rate.
ITERATE_FROM = 5_000
#: Bytes that are stored of a node: the inverse of the reference Jacobian, and a weight.
NODE = 40


class Size(NamedTuple):
    """Seconds at one size; the last three are None where SuperLU would take too long."""

    unknown: int
    stages: dict[str, float]
    whole: float
    solve: float
    steps: int
    nodes: float
    superlu: float | None
    operations: float | None
    entries: int | None


def measure(model: pt.MultiPatch, angle: float) -> Size:
    target, landmarks = bent_boundary(model, angle)
    n = len(model.topology.interior_points)
    repeat = 21 if n < 1_000 else 5 if n < 10_000 else 3
    plan = pt.TransferPlan(model, "c0")
    timings: list[dict[str, float]] = []
    whole = median_time(lambda: timings.append(plan.transfer(target, landmarks).timings), repeat)
    stages = {s: float(np.median([t.get(s, 0.0) for t in timings[1:]])) for s in STAGES}
    optimizer = SplineOptimizer(model.topology)
    fitted = plan.transfer(target, landmarks).multipatch.topology.coordinates
    start = optimizer.harmonic(fitted)
    found = optimizer.minimise(start)
    solve = median_time(lambda: optimizer.minimise(optimizer.harmonic(fitted)), repeat)
    superlu = operations = entries = None
    if n <= LARGEST:
        reference = SciPyOptimizer(model)
        matrix = csc_array(reference.derivatives(found.points, reference.scale(found.points))[1])
        options = {"SymmetricMode": True}
        begin = time.perf_counter()
        factor = splu(matrix, permc_spec="MMD_AT_PLUS_A", options=options)
        superlu = time.perf_counter() - begin
        operations, entries = multiplications(factor), matrix.nnz
        if n >= ITERATE_FROM:
            one = csc_array(matrix[:n, :n])
            operations = multiplications(splu(one, permc_spec="MMD_AT_PLUS_A", options=options)) / 2
    nodes = optimizer.step_cost
    return Size(n, stages, whole, solve, len(found.history), nodes, superlu, operations, entries)


def multiplications(factor: SuperLU) -> float:
    """Of a Cholesky factorization with the same pattern, additions included."""
    return float((np.diff(factor.L.indptr).astype(float) ** 2).sum())


def step_limits(size: Size, largest: Size, product: float, copy: float) -> tuple[float, float]:
    """Seconds of a Newton step that arithmetic and memory ask for at least."""
    known = size if size.operations is not None else largest
    assert known.operations is not None
    assert known.entries is not None
    ratio = size.unknown / known.unknown
    # The upper half is stored: written by assembly, read by the factorization; a value and half an index.
    memory = known.entries * ratio / 2 * 2 * 12 + 2 * NODE * size.nodes
    return known.operations * ratio**GROWTH / product, memory / copy


def product_rate(n: int = 1500) -> float:
    """Multiplications and additions a second of a dense matrix product on one thread."""
    a = np.random.default_rng(0).random((n, n))
    return 2 * n**3 / median_time(lambda: a @ a, 5)


def copy_rate(n: int = 2**25) -> float:
    """Bytes a second that a copy reads and writes."""
    # Zeros would be one page, read again and again.
    a = np.ones(n)
    b = np.empty_like(a)
    return 16 * n / median_time(lambda: np.copyto(b, a), 5)


def processor() -> str:
    """Name of the processor, where the system tells it."""
    info = Path("/proc/cpuinfo")
    names = (
        [x.split(":", 1)[1].strip() for x in info.read_text().splitlines() if x.startswith("model name")]
        if info.exists()
        else []
    )
    return names[0] if names else platform.processor() or platform.machine()


def tables(sizes: list[Size], product: float, copy: float) -> str:
    """Both tables, in Markdown."""
    ms = lambda s: f"{1e3 * s:.1f}" if s < 0.1 else f"{1e3 * s:.0f}"  # noqa: E731
    largest = max((size for size in sizes if size.operations is not None), key=lambda size: size.unknown)
    limits = [step_limits(size, largest, product, copy) for size in sizes]
    lines = [
        "| unknown points | transfer | " + " | ".join(STAGES) + " | exponent | physical limit | transfer / limit |",
        "|" + "---:|" * (len(STAGES) + 5),
    ]
    for before, size, limit in zip([None, *sizes], sizes, limits, strict=False):
        growth = (
            "–"
            if before is None
            else f"{np.log(size.whole / before.whole) / np.log(size.unknown / before.unknown):.2f}"
        )
        least = size.steps * sum(limit)
        cells = [f"{size.unknown:,}", f"**{ms(size.whole)}**", *(ms(size.stages[s]) for s in STAGES), growth]
        cells += [f"{1e3 * least:.2f}", f"{size.whole / least:.0f}"]
        lines.append("| " + " | ".join(cells) + " |")
    heads = ("unknown points", "Newton steps", "solve", "SuperLU once", "solve / SuperLU", "step")
    heads += ("arithmetic bound", "memory bound", "step / bounds")
    lines += ["", "| " + " | ".join(heads) + " |", "|" + "---:|" * len(heads)]
    for size, (arithmetic, memory) in zip(sizes, limits, strict=True):
        step = size.solve / size.steps
        cells = [f"{size.unknown:,}", str(size.steps), ms(size.solve)]
        cells += ["–", "–"] if size.superlu is None else [ms(size.superlu), f"{size.solve / size.superlu:.2f}"]
        cells += [ms(step), f"{1e3 * arithmetic:.2f}", f"{1e3 * memory:.2f}", f"{step / (arithmetic + memory):.0f}"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


PAGE = """# Speed

Made by ``benches/python/stages.py --refinements {refinements}`` on {machine}, one thread:
a dense matrix product runs at {product:.0f} Gflop/s, a copy at {copy:.0f} GB/s. Milliseconds, medians. The source is
{source}, refined uniformly, its boundary bent by {angle:.0f}°, landmarks at all joints, `continuity="c0"`, one plan for
all targets.

{tables}

The first table is the whole transfer with its evidence (the continuity report is made when asked for). *Exponent*: of
the growth from the row above. *Physical limit*: both bounds of the second table for all steps; the other stages count
as nothing.

The second table is the solver alone, from the harmonic map to the optimum. *SuperLU once*: one factorization of the
Newton matrix by SciPy, in the same run. *Arithmetic bound*: what a factorization computes, at the rate of the dense
product (sparse codes reach a third of it at best on such matrices); from {iterate:,} unknown points on of one
component's matrix, in single precision, as [conjugate gradients](stages/optimisation.md) need it (above {largest:,} by
the growth of nested dissection, n^1.5). *Memory bound*: what is stored of the nodes read twice, the Hessian's entries
written and read once. *Newton steps* are those on the finest space; a large solve makes more on coarser ones, whose
time is in *step* as well. What a step does beyond the bounds is mostly the Hessian itself: {nodes} nodes a knot span,
each with a closed-form positive part, and the energies of the line search. Small models are far from any limit: there
Python and its calls are most.

`peers.py` beside it compares with [other software](peers.md), each comparison being a script of its own; others are
`registration_stages.py`, `plan_map.py` (threads, processes), `continuity_cost.py` (C1 against C0), `registration.py`
(1,000 curves), `busy_machine.py` (beside other programs) and `location.py` (points found in models, beside evaluating
them). `cargo bench -p patchtransfer-core` times the core's kernels.
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model", nargs="?", help="multi-patch (G+Smo XML)")
    parser.add_argument("--angle", type=float, default=100.0, help="bend in degrees (default 100)")
    parser.add_argument("--refinements", type=int, default=4, help="largest number of refinements (default 4)")
    parser.add_argument("-o", "--output", type=Path, help="write a page of the documentation")
    options = parser.parse_args()
    _core.set_threads(1)
    with threadpool_limits(1):
        product, copy = product_rate(), copy_rate()
        sizes = []
        for k in range(options.refinements + 1):
            model = model_of(options.model, k)
            sizes.append(measure(model, np.radians(options.angle)))
            print(f"{sizes[-1].unknown} unknown points: {1e3 * sizes[-1].whole:.1f} ms", flush=True)
    text = tables(sizes, product, copy)
    print(text)
    if options.output is not None:
        coarse = model_of(options.model, 0)
        degree = coarse.patches[0].degrees[0]
        page = PAGE.format(
            refinements=options.refinements,
            machine=processor(),
            product=product / 1e9,
            copy=copy / 1e9,
            source=f"the model {options.model or 'yeti'}" if len(coarse) == 21 else "the bundled wrench",
            angle=options.angle,
            tables=text,
            nodes=f"({2 * degree + 1})²",
            iterate=ITERATE_FROM,
            largest=LARGEST,
        )
        options.output.write_text(page)


if __name__ == "__main__":
    main()
