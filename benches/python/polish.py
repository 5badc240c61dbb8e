"""What polishes are worth, on targets of their own: ``python benches/python/polish.py -n 200 -o FILE.md``.

Targets are those of ``robustness.py`` with other numbers. Each is transferred as it is and with both goals; numbers are
proved, and for the dilatation beside the lower bound that every map with this boundary has.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from rich.progress import track

import patchtransfer as pt

sys.path.insert(0, str(Path(__file__).parent))
import robustness

from patchtransfer.measure.similarity import similarity

#: Numbers of cases from here on are not those that the method was made with.
FIRST = 5000
GOALS = (None, "scaled_jacobian", "dilatation")
#: A dilatation so close to its bound counts as the least one.
AT_BOUND = 1.01


@dataclass(frozen=True)
class Outcome:
    """One case, one goal."""

    case: int
    source: str
    family: str
    continuity: str
    goal: str | None
    status: str
    power: int
    minimum: float
    mean: float
    dilatation: float
    bound: float
    seconds: float


def run(case: int, continuity: str, goal: str | None) -> Outcome:
    """One case."""
    names, families = robustness.source_names(), robustness.FAMILIES
    name, family = names[case % len(names)], families[case // len(names) % len(families)]
    _, target, landmarks = robustness.feasible_target(case, name, family)
    plan = pt.TransferPlan(robustness.source_named(name), continuity)
    start = time.process_time()
    result = plan.transfer(target, landmarks, on_failure="return", polish=goal)
    seconds = time.process_time() - start
    proved, metrics = result.quality.proved, result.quality.scaled_jacobian
    found = similarity(result._source, result.multipatch)
    return Outcome(
        case,
        name,
        family,
        continuity,
        goal,
        result.certificate.status,
        1 if result.polish is None else result.polish.power,
        metrics.min if proved is None else proved.min_scaled_jacobian.lower,
        metrics.mean,
        found.dilatation.upper,
        math.exp(found.least.best),
        seconds,
    )


def report(outcomes: Sequence[Outcome]) -> str:
    """Markdown."""
    lines = ["| | polish | minimum SJ: quartile, median | mean SJ | dilatation: median | at bound | worse | time |"]
    lines.append("|---|---|---|---|---|---|---|---|")
    for continuity in dict.fromkeys(o.continuity for o in outcomes):
        plain = {o.case: o for o in outcomes if (o.continuity, o.goal) == (continuity, None)}
        kept = {k for k, o in plain.items() if o.status == "certified"}
        for goal in GOALS:
            of = [o for o in outcomes if (o.continuity, o.goal) == (continuity, goal) and o.case in kept]
            quartile, median = np.quantile([o.minimum for o in of], [0.25, 0.5])
            at_bound = np.mean([o.dilatation <= AT_BOUND * o.bound for o in of])
            worse = [
                o.case
                for o in of
                if o.status != "certified"
                or (goal == "scaled_jacobian" and o.minimum < plain[o.case].minimum)
                or (goal == "dilatation" and o.dilatation > plain[o.case].dilatation)
            ]
            ratio = np.median([o.seconds / plain[o.case].seconds for o in of])
            mean, largest = np.mean([o.mean for o in of]), np.median([o.dilatation for o in of])
            lines.append(
                f"| {continuity}, {len(of)} | {goal} | {quartile:.3f}, {median:.3f} | {mean:.3f} | {largest:.3f} "
                f"| {at_bound:.0%} | {len(worse)} {worse[:5]} | {ratio:.2f} |"
            )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-n", type=int, default=200, help="targets for each continuity")
    parser.add_argument("--continuity", nargs="+", default=["c0", "c1"])
    parser.add_argument("-o", "--output", help="Markdown file; a JSON file of all cases is put beside it")
    options = parser.parse_args()
    jobs = [(FIRST + k, c, goal) for c in options.continuity for k in range(options.n) for goal in GOALS]
    outcomes = [run(*job) for job in track(jobs, disable=not sys.stderr.isatty())]
    text = report(outcomes)
    print(text)
    if options.output:
        Path(options.output).write_text(text + "\n")
        Path(options.output).with_suffix(".json").write_text(json.dumps([asdict(o) for o in outcomes], indent=1))


if __name__ == "__main__":
    main()
