"""Results are the same to the bit for any number of threads, and no stage wakes the threads of BLAS."""

import ast
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import patchtransfer
from patchtransfer import examples

#: Threads of BLAS and of the core.
COUNTS = ((1, 1), (2, 4), (4, 2))
#: NumPy's functions that call BLAS; `einsum` does if it is to choose the order.
BLAS = {"convolve", "correlate", "dot", "inner", "matmul", "tensordot", "vdot"}


@pytest.fixture(scope="module")
def found():
    """What `bits.py` prints for every pair of counts."""
    out = {}
    for blas, core in COUNTS:
        counts = {"OPENBLAS_NUM_THREADS": str(blas), "RAYON_NUM_THREADS": str(core)}
        run = subprocess.run(
            [sys.executable, str(Path(__file__).parents[1] / "support" / "bits.py")],
            env={**os.environ, **counts},
            capture_output=True,
            text=True,
            check=False,
        )
        assert run.returncode == 0, run.stderr
        out[blas, core] = json.loads(run.stdout)
    return out


def test_all_stages_give_the_same_bits(found):
    first = found[COUNTS[0]]["bits"]
    assert {f"{name}, {how}" for name in examples.EXAMPLES for how in ("landmarks", "no landmarks")} < first.keys()
    for counts in COUNTS[1:]:
        bits = found[counts]["bits"]
        assert bits.keys() == first.keys()
        assert [name for name in first if bits[name] != first[name]] == [], counts


def test_no_stage_wakes_blas(found):
    seen = [run for run in found.values() if run["threads"] and run["seen"]]
    if not seen:
        pytest.skip("BLAS has no threads here, or none that can be watched")
    assert [run["woken"] for run in seen] == [0] * len(seen)


def test_the_package_leaves_no_matrix_to_blas():
    """But norms: of short vectors, or along an axis, which BLAS has no part in."""
    folder, bad = Path(patchtransfer.__file__).parent, []
    for path in sorted(folder.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            at = f"{path.relative_to(folder)}:{getattr(node, 'lineno', 0)}"
            match node:
                case ast.Attribute(value=ast.Attribute(attr="linalg"), attr=name) if name != "norm":
                    bad.append(f"{at}: linalg.{name}")
                case ast.Attribute(value=ast.Name(id="np"), attr=name) if name in BLAS:
                    bad.append(f"{at}: {name}")
                case ast.Call(func=ast.Attribute(attr="einsum"), keywords=[_, *_]):
                    bad.append(f"{at}: einsum with options")
                case ast.ImportFrom(module="scipy.linalg" | "scipy.sparse.linalg" | "numpy.linalg"):
                    bad.append(f"{at}: {node.module}")
    assert bad == [], "use patchtransfer.numeric.dense and patchtransfer.numeric.definite"
