"""All comparisons with other software, one after the other: ``python peers.py [-o docs/peers.md]``.

Each is a script of its own beside this one, or one of the core's benches, and runs what it compares side by side. Those
whose peer is missing are left out and named: ``pip install triangle libigl cvxopt``.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from stages import processor

HERE = Path(__file__).parent
MODELS = os.environ.get("PATCHTRANSFER_MODELS")


class Comparison(NamedTuple):
    title: str
    #: What to say of the figures.
    text: str
    command: tuple[str, ...]
    #: Modules of the peers, all needed.
    needs: tuple[str, ...] = ()


def script(name: str, *options: str) -> tuple[str, ...]:
    return (sys.executable, str(HERE / name), *options)


COMPARISONS = (
    Comparison(
        "Whole transfer and optimiser, G+Smo and NumPy",
        "`gsBarrierPatch2` (its wheel runs the PDE method) starts from the same harmonic map on the same fitted "
        "boundary, once with free interfaces (the same problem), once patch by patch (an easier one). The NumPy "
        "optimiser makes the same Newton steps with SuperLU.",
        script("transfer_yeti.py", *([str(Path(MODELS) / "yeti.xml")] if MODELS else [])),
        ("pygismo",),
    ),
    Comparison(
        "Optimiser at growing sizes, SuperLU, CHOLMOD and G+Smo",
        "Seconds of CPU, one thread. SuperLU and CHOLMOD factorize the Newton matrix once; *solve/LU* is the whole "
        "solve, harmonic map and all Newton steps, over SuperLU's one factorization. *GB* is what the optimiser adds "
        "to the process.",
        script("optimizer_scaling.py", "--refinements", "5"),
        ("pygismo",),
    ),
    Comparison(
        "Constrained Delaunay triangulation, Triangle",
        "Exterior and holes removed. On a square grid every four neighbours lie on a circle: exact predicates decide.",
        script("triangulation.py"),
        ("triangle",),
    ),
    Comparison(
        "Local–global step of the mesh method, libigl's ARAP",
        "A step projects every face and solves with a factorization made once.",
        script("local_global.py"),
        ("igl",),
    ),
    Comparison(
        "Signed-SVD projection, memcpy",
        "A million 2×2 matrices projected to bounded conformal distortion, and as many copied. The three times are the "
        "lower bound, the estimate and the upper bound of criterion.",
        ("cargo", "bench", "--locked", "-q", "-p", "patchtransfer-core", "--bench", "kernels", "--", "memcpy|ssvd"),
    ),
    Comparison(
        "Poisson's equation, nutils",
        "Same model, splines, quadrature and boundary fit.",
        script("poisson_nutils.py"),
        ("nutils",),
    ),
)


def run(command: tuple[str, ...]) -> str:
    done = subprocess.run(command, capture_output=True, text=True, cwd=HERE.parent.parent)
    if done.returncode:
        raise SystemExit(f"{' '.join(command)}\n{done.stderr}")
    lines = [line.rstrip() for line in done.stdout.splitlines()]
    # Criterion's remarks on outliers and earlier runs say nothing about the ratio.
    kept = [line for line in lines if command[0] != "cargo" or "time:" in line or line.startswith(("memcpy", "ssvd"))]
    return "\n".join(kept).strip()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, help="write a page of the documentation")
    options = parser.parse_args()
    model = "the model yeti" if MODELS else "the bundled wrench"
    parts = [
        "# Beside other software\n",
        f"Made by ``benches/python/peers.py`` on {processor()}, {os.cpu_count()} cores; where a size is not named, the "
        f"source of a transfer is {model}. Absolute times depend on the machine; what counts are the ratios.\n",
    ]
    for comparison in COMPARISONS:
        missing = [module for module in comparison.needs if find_spec(module) is None]
        if missing:
            print(f"{comparison.title}: left out, {', '.join(missing)} missing", flush=True)
            continue
        found = run(comparison.command)
        print(f"{comparison.title}\n{found}\n", flush=True)
        block = found if found.startswith("|") else f"```text\n{found}\n```"
        parts.append(f"## {comparison.title}\n\n{comparison.text}\n\n{block}\n")
    if options.output is not None:
        options.output.write_text("\n".join(parts))


if __name__ == "__main__":
    main()
