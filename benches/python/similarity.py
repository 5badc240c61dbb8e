"""Theorems and proved bounds checked on results of random targets: ``python benches/python/similarity.py``.

Targets are feasible ones of ``robustness.py``, transferred with landmarks (C0 and C1) and without (C0). Proved bounds
are held against 100 x 100 samples a knot span, lower bounds against the dilatation of the result, what a dilatation
guarantees against the proved quality. A violation is printed with its case, and the exit status is 1.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.progress import track

import patchtransfer as pt

sys.path.insert(0, str(Path(__file__).parent))
import robustness

#: Samples a knot span and direction that bounds are held against.
DENSE = 100
#: Rounding of samples, relative.
ROUNDING = 1e-12


@dataclass(frozen=True)
class Row:
    """One certified map: what samples overstate, cells, bounds of the dilatation, and milliseconds."""

    overstated: float
    understated: float
    cells: int
    least: float
    most: float
    corners_lose: bool
    transfer: float
    whole: float
    without_energies: float


def violations(source: pt.MultiPatch, result: pt.TransferResult) -> list[str]:
    """What does not hold of a result."""
    proved, dense = result.quality.proved, pt.quality(result.multipatch, DENSE)
    jacobian, condition = proved.min_scaled_jacobian, proved.max_condition_number
    found, before = result.dilatation, pt.quality(source, proved=True).proved
    exclude = result.certificate.status == "degenerate"
    checks = {
        "samples below the scaled Jacobian": exclude or jacobian.lower <= dense.scaled_jacobian.min + ROUNDING,
        "samples above the condition number": exclude or condition.upper >= dense.condition_number.max * (1 - ROUNDING),
        "width of the scaled Jacobian": jacobian.upper - jacobian.lower <= 1e-3 * jacobian.upper + ROUNDING,
        "lower bounds": found.least.best <= found.log_dilatation.upper,
        "quantile": found.q95 <= found.log_dilatation.upper + ROUNDING,
        "guaranteed scaled Jacobian": found.guaranteed_scaled_jacobian(max(before.min_scaled_jacobian.lower, 0))
        <= jacobian.upper + ROUNDING,
        "guaranteed condition number": found.guaranteed_condition_number(before.max_condition_number.upper)
        >= condition.lower * (1 - ROUNDING),
    }
    return [name for name, holds in checks.items() if not holds]


def row(result: pt.TransferResult, seconds: float) -> Row:
    """Numbers of a certified result."""
    begin = time.process_time()
    found = pt.similarity(result._source, result.multipatch)
    middle = time.process_time()
    pt.similarity(result._source, result.multipatch, energy=False)
    end = time.process_time()
    quality, proved, least = result.quality, result.quality.proved, found.least
    return Row(
        quality.scaled_jacobian.min / proved.min_scaled_jacobian.upper - 1,
        proved.max_condition_number.lower / quality.condition_number.max - 1,
        proved.cells,
        least.best,
        found.log_dilatation.upper,
        (least.energy or 0) > least.corners,
        seconds,
        1e3 * (middle - begin),
        1e3 * (end - middle),
    )


def report(rows: list[Row]) -> str:
    """The figures in words."""
    table = np.array([list(vars(r).values()) for r in rows], float)
    over, under, cells, least, most, lose, seconds, whole, without = table.T
    ratio = least / most
    return "\n".join(
        [
            f"{len(rows)} certified maps",
            f"samples overstate the smallest scaled Jacobian by > 0.1 % on {(over > 1e-3).mean():.0%}, by > 1 % on "
            f"{(over > 1e-2).mean():.1%}, at most by {over.max():.0%}",
            f"samples understate the largest condition number by > 1 % on {(under > 1e-2).mean():.1%}",
            f"cells beyond the pieces: median {np.median(cells):.0f}, at most {cells.max():.0f}",
            f"largest log D: median {np.median(most):.2f}; lower over upper bound: median {np.median(ratio):.2f}, "
            f"within 1 % on {(ratio > 0.99).mean():.0%}; energies above corners on {lose.mean():.0%}",
            f"processor time: transfer {np.median(seconds):.3f} s, similarity {np.median(whole):.0f} ms, without "
            f"energies {np.median(without):.1f} ms (medians)",
        ]
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-n", type=int, default=324, help="cases, from 0")
    parser.add_argument("--step", type=int, default=4, help="every so manieth")
    options = parser.parse_args()
    rows, bad = [], 0
    for case in track(range(0, options.n, options.step), "targets"):
        names = robustness.source_names()
        name = names[case % len(names)]
        family = robustness.FAMILIES[case // len(names) % len(robustness.FAMILIES)]
        _, target, landmarks = robustness.feasible_target(case, name, family)
        source = robustness.source_named(name)
        for continuity, points in (("c0", landmarks), ("c1", landmarks), ("c0", None)):
            begin = time.process_time()
            try:
                result = pt.transfer(source, target, points, continuity=continuity, on_failure="return")
            except pt.TransferError as error:
                print(f"case {case}: {error}")
                continue
            seconds = time.process_time() - begin
            if not result.certificate.injective:
                continue
            for text in violations(source, result):
                bad += 1
                print(f"case {case}, {continuity}{'' if points is None else ', landmarks'}: {text}")
            if result.certificate.status == "certified":
                rows.append(row(result, seconds))
    print(report(rows))
    print(f"{bad} violations")
    sys.exit(bad > 0)


if __name__ == "__main__":
    main()
