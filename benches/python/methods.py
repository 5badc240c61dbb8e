"""The certified and the published method on all samples and deformations: ``python methods.py [OUT.md]``.

Writes docs/methods.md. The published method runs with either first map, and under C1 rows with weighted rows and with
the paper's literal ones. Processor times; each on a prepared plan, so that both methods have their source's work done.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

import patchtransfer as pt
from patchtransfer import MultiPatch, PaperOptions, TransferPlan, TransferResult, examples

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "support"))
import targets  # noqa: E402  (deformations with known correspondence)

DEFORMATIONS: dict[str, Callable[[MultiPatch], targets.Deformation]] = {
    "bend 30°": lambda mp: targets.bend(mp, 30),
    "bend 60°": lambda mp: targets.bend(mp, 60),
    "bend 90°": lambda mp: targets.bend(mp, 90),
    "articulation 30°": lambda mp: targets.articulation(mp, 30, blend=0.4),
    "swirl 60°": lambda mp: targets.swirl(mp, (0.5, 0.5), 60, 0.5),
    "bump": lambda mp: targets.bump(mp, (0.2, 0.5), (0.15, 0.05), 0.25),
    "stretch 4:1": lambda mp: targets.stretch(2, 0),
    "stretch 8:1": lambda mp: targets.stretch(8**0.5, 0),
    "stretch 8:1, oblique": lambda mp: targets.stretch(8**0.5, 30),
    "stretch 16:1": lambda mp: targets.stretch(4, 0),
}


class Variant(NamedTuple):
    """A way to transfer: its name, continuity, and options of the published method, None for the certified one."""

    name: str
    continuity: str
    options: PaperOptions | None


LETTER = PaperOptions(
    freeze_interfaces=True, literal_rows=True, snap_corners=False, boundary_weight=1.0, boundary_samples="uniform"
)
VARIANTS = (
    Variant("certified", "c0", None),
    Variant("paper, reversible", "c0", PaperOptions()),
    Variant("paper, Dirichlet", "c0", PaperOptions("dirichlet")),
    Variant("certified", "c1", None),
    Variant("paper, reversible, weighted rows", "c1", PaperOptions()),
    Variant("paper, Dirichlet, weighted rows", "c1", PaperOptions("dirichlet")),
    Variant("paper, reversible, literal rows", "c1", PaperOptions(literal_rows=True)),
    Variant("paper, Dirichlet, literal rows", "c1", PaperOptions("dirichlet", literal_rows=True)),
    Variant("paper, to the letter", "c1", LETTER),
)
#: Of every target: the C1 variants but the last.
IN_FULL = range(3, 8)

HEADER = """# The two methods side by side

Written by `python benches/python/methods.py`. Every sample goes to its own target and to deformations of its own
boundary, by `method="certified"` and by `method="paper"` with its options (`PaperOptions`): first map reversible
harmonic or one Dirichlet solve; C1 rows weighted by knot spans, degrees and speeds, or literally 2 s - p - q = 0.
"To the letter" is `{letter}`.

Certified: by the same proof for all. Flip-free: the last mesh has no flipped faces, which need not give an injective
spline. C0 left: interfaces that lost their rows, of all those of certified results, since no certified map keeps them.
Scaled Jacobian: medians of smallest and mean value where all variants are certified. Time: processor time of the whole
transfer on a prepared plan, median and largest.

"""
SUMMARY = ("method", "joined", "certified", "flip-free", "C0 left", "min", "mean", "median", "largest")
FOOT = """
The two first maps end in the same minimum: they differ in time alone. Literal rows prescribe the ratio of speeds that
weighted ones take from the map without rows; the mean hardly feels it. To the letter most of the time is the
alternation with a soft boundary, which β draws outwards for a hundred iterations.

## Every target, joined C1

Smallest / mean scaled Jacobian and time; flips: of the first map without rows, in the last pass under weighted rows at
its beginning → at its end (local-global steps).

"""


class Case(NamedTuple):
    """What one variant made of one target."""

    result: TransferResult
    seconds: float

    @property
    def flip_free(self) -> bool:
        history = self.result.paper_history
        return history is None or min(history.flips) == 0

    @property
    def quality(self) -> tuple[float, float]:
        metrics = self.result.quality.scaled_jacobian
        return metrics.min, metrics.mean

    def cell(self) -> str:
        status = self.result.certificate.status
        least, mean = self.quality
        said = "" if status == "certified" else f"{status}, "
        return f"{said}{least:.3f} / {mean:.3f}, {1e3 * self.seconds:.0f} ms"


def run(plan: TransferPlan, given: tuple[object, ...], options: PaperOptions | None) -> Case:
    """Result and processor time."""
    method = "certified" if options is None else "paper"
    begin = time.process_time()
    result = plan.transfer(
        *given,  # type: ignore[arg-type]
        method=method,
        paper_options=options,
        refine="never",
        fixed_correspondence=True,
        on_failure="return",
    )
    return Case(result, time.process_time() - begin)


def flips(case: Case) -> str:
    """First map, then the last pass from its beginning to its end."""
    history = case.result.paper_history
    if history is None or not history.flips:
        return "–"
    first = (history.earlier or (history,))[0].flips[0]
    return f"{first}, {history.flips[0]} → {min(history.flips)} ({len(history.flips) - 1})"


def line(cells: list[str]) -> str:
    """A line of a table."""
    return f"| {' | '.join(cells)} |\n"


def summary(rows: list[list[Case]], interfaces: list[int]) -> str:
    """One line a variant."""
    text = line(list(SUMMARY)) + f"|---|---|{'---:|' * (len(SUMMARY) - 2)}\n"
    sound = [[case.result.certificate.injective for case in row] for row in rows]
    everywhere = [row for row, good in zip(rows, sound, strict=True) if all(good)]
    for i, variant in enumerate(VARIANTS):
        cases, good = [row[i] for row in rows], [found[i] for found in sound]
        left = "–"
        if variant.continuity == "c1":
            ends = [(c.result.rows, n) for c, n, yes in zip(cases, interfaces, good, strict=True) if yes]
            lost = sum(n if active is None else len(active.without) for active, n in ends)
            left = f"{lost} of {sum(n for _, n in ends)}"
        quality = np.median([row[i].quality for row in everywhere], axis=0)
        seconds = np.array([case.seconds for case in cases])
        cells = [variant.name, variant.continuity.upper(), f"{sum(good)} of {len(rows)}"]
        cells += ["–" if variant.options is None else str(sum(case.flip_free for case in cases)), left]
        cells += [f"{q:.3f}" for q in quality]
        text += line([*cells, f"{1e3 * np.median(seconds):.0f} ms", f"{1e3 * seconds.max():.0f} ms"])
    return text + f"\nAll variants are certified on {len(everywhere)} of {len(rows)} targets.\n"


def main(output: Path) -> None:
    """Run everything and write the tables."""
    rows: list[list[Case]] = []
    interfaces: list[int] = []
    columns = ["sample", "target", "flips", *(VARIANTS[i].name.removeprefix("paper, ") for i in IN_FULL)]
    table, refused = line(columns) + f"|---|---|---|{'---:|' * len(IN_FULL)}\n", []
    for name in examples.EXAMPLES:
        source, target, landmarks = examples.load(name)
        plans = {continuity: TransferPlan(source, continuity) for continuity in ("c0", "c1")}
        for plan in plans.values():
            plan.transfer(target, landmarks, on_failure="return")
        cases = [("own target", lambda t=target, marks=landmarks: (t, marks))]
        for kind, make in DEFORMATIONS.items():
            cases.append((kind, lambda f=make, mp=source: targets.deformed(mp, f(mp))))
        for kind, case in cases:
            try:
                row = [run(plans[variant.continuity], case(), variant.options) for variant in VARIANTS]
            except pt.TransferError as error:
                refused.append(f"- {name}, {kind}: {error}\n")
                continue
            rows.append(row)
            interfaces.append(len(source.interfaces))
            cells = [name, kind, flips(row[IN_FULL[1]]), *(row[i].cell() for i in IN_FULL)]
            table += line(cells)
            print(line(cells), end="", flush=True)
    text = HEADER.format(letter=repr(LETTER)) + summary(rows, interfaces) + FOOT + table
    if refused:
        text += "\nRefused as targets, by both methods:\n\n" + "".join(refused)
    output.write_text(text)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("output", type=Path, nargs="?", default=ROOT / "docs" / "methods.md", metavar="OUT.md")
    main(parser.parse_args().output)
