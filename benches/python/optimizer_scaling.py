"""Optimiser at growing sizes, beside one factorization of the same Hessian: ``python optimizer_scaling.py``.

The model (yeti of `PATCHTRANSFER_MODELS`, else the bundled wrench, or a file) is bent, refined uniformly again and
again, and solved at every size in a process of its own, so that the peak memory is that of the size. The yardstick is
SciPy's SuperLU on the Newton matrix of the same map, in the same process; CHOLMOD takes part where `scikit-sparse` or
`cvxopt` is, G+Smo where `pygismo` is. `GB` is what the optimiser adds to the process. Times are CPU time, by default on
one thread: on a shared machine they vary less than what the clock says, but ratios are what counts.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.sparse import csc_array, csc_matrix
from scipy.sparse.linalg import splu
from transfer_yeti import SciPyOptimizer, bend, gismo

import patchtransfer as pt
from patchtransfer import _core, examples
from patchtransfer.interior.optimizer import SplineOptimizer

#: Largest number of unknown points at which a peer is still run.
LIMITS = {"SuperLU": 40_000, "CHOLMOD": 40_000, "G+Smo": 2_000}


def model_of(name: str | None, refinements: int) -> pt.MultiPatch:
    folder = os.environ.get("PATCHTRANSFER_MODELS")
    if name is None and folder:
        name = str(Path(folder) / "yeti.xml")
    model = pt.read(name) if name else examples.load("wrench")[0]
    for _ in range(refinements):
        model = model.split_spans(2)
    return model


def seconds(work: Callable[[], object], repeat: int) -> float:
    """Least CPU time of some runs."""
    times = []
    for _ in range(repeat):
        begin = time.process_time()
        work()
        times.append(time.process_time() - begin)
    return min(times)


def peak_gigabytes() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20


def measure(model: pt.MultiPatch, angle: float, threads: int) -> dict[str, float | str]:
    """Times of the stages at one size."""
    _core.set_threads(threads)
    topology = model.topology
    points = topology.coordinates
    n = len(topology.interior_points)
    repeat = 5 if n < 1_000 else 2 if n < 10_000 else 1
    x = points.copy()
    on = topology.boundary_points
    x[on] = bend(points, (points.min(axis=0), points.max(axis=0)), np.radians(angle))[on]
    before = peak_gigabytes()
    row: dict[str, float | str] = {"unknown": n, "setup": seconds(lambda: SplineOptimizer(topology), repeat)}
    optimizer = SplineOptimizer(topology)
    # The Laplacian is factorized once per optimizer: the first call counts.
    row["harmonic"] = seconds(lambda: optimizer.harmonic(x), 1)
    start = optimizer.harmonic(x)
    found = optimizer.minimise(start)
    row["minimise"] = seconds(lambda: optimizer.minimise(start), repeat)
    row["GB"] = peak_gigabytes() - before
    row |= {
        "steps": len(found.history),
        "stop": found.stop,
        "energy": found.energy,
        "start det": optimizer.minimum_determinant(start),
        "least det": found.min_determinant,
    }
    return row | peers(model, found.points, start)


def peers(model: pt.MultiPatch, points: np.ndarray, start: np.ndarray) -> dict[str, float]:
    """One factorization of the Newton matrix at `points` by SuperLU and CHOLMOD; G+Smo's optimiser from `start`."""
    out: dict[str, float] = {}
    n = len(model.topology.interior_points)
    if n <= max(LIMITS["SuperLU"], LIMITS["CHOLMOD"]):
        reference = SciPyOptimizer(model)
        matrix = csc_array(reference.derivatives(points, reference.scale(points))[1])
        if n <= LIMITS["SuperLU"]:
            options = {"SymmetricMode": True}
            out["SuperLU"] = seconds(lambda: splu(matrix, permc_spec="MMD_AT_PLUS_A", options=options), 1)
        if (factorize := cholmod(matrix)) is not None:
            out["CHOLMOD"] = seconds(factorize, 1)
    if n <= LIMITS["G+Smo"]:
        initial = model.with_control_points([start[p] for p in model.topology.points])
        if (peer := gismo(initial, False, 1)) is not None:
            out["G+Smo"] = peer[0]
    return out


def cholmod(matrix: csc_array) -> Callable[[], object] | None:
    """One analysis and factorization by CHOLMOD, from scikit-sparse or else cvxopt; None where both are missing."""
    try:
        from sksparse.cholmod import cholesky

        # Compressed columns are what it takes; anything else would be converted inside the time.
        symmetric = csc_matrix(matrix)
        return lambda: cholesky(symmetric)
    except ImportError:
        pass
    try:
        import cvxopt
        from cvxopt import cholmod as solver
    except ImportError:
        return None
    coo = matrix.tocoo()
    lower = coo.row >= coo.col
    a = cvxopt.spmatrix(coo.data[lower], coo.row[lower].tolist(), coo.col[lower].tolist(), matrix.shape)

    def factorize() -> object:
        factor = solver.symbolic(a)
        solver.numeric(a, factor)
        return factor

    return factorize


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model", nargs="?", help="multi-patch (G+Smo XML)")
    parser.add_argument("--angle", type=float, default=100.0, help="bend in degrees (default 100)")
    parser.add_argument("--refinements", type=int, default=4, help="largest number of refinements (default 4)")
    parser.add_argument("--threads", type=int, default=1, help="threads of the core (default 1)")
    parser.add_argument("--one", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one is not None:
        print(json.dumps(measure(model_of(options.model, options.one), options.angle, options.threads)))
        return
    columns = ("unknown", "setup", "harmonic", "minimise", "steps", "SuperLU", "CHOLMOD", "G+Smo", "GB")
    print("".join(f"{c:>10}" for c in (*columns, "solve/LU", "exponent")))
    previous: dict[str, float] | None = None
    for k in range(options.refinements + 1):
        done = subprocess.run([sys.executable, *sys.argv, "--one", str(k)], capture_output=True, text=True)
        if done.returncode:
            raise SystemExit(done.stderr)
        row = json.loads(done.stdout.splitlines()[-1])
        cells = [f"{row[c]:10.4g}" if c in row else f"{'-':>10}" for c in columns]
        whole = row["harmonic"] + row["minimise"]
        cells.append(f"{whole / row['SuperLU']:10.2f}" if "SuperLU" in row else f"{'-':>10}")
        if previous:
            before = previous["harmonic"] + previous["minimise"]
            cells.append(f"{np.log(whole / before) / np.log(row['unknown'] / previous['unknown']):10.2f}")
        print(
            "".join(cells),
            f"  {row['stop']}, energy {row['energy']:.10g}, least det {row['least det']:.3g}",
            flush=True,
        )
        previous = row


if __name__ == "__main__":
    main()
