"""The paper's experiments on the bundled samples: ``python -m patchtransfer.reproduce -o DIR``.

Table 1 and Figures 8 to 12 of §4, the former beside the printed numbers. The paper's models are not published; our
samples are drawings of our own, four of them of the same subjects, so the numbers are to be compared in kind, not
digit by digit. Everything written is the same at every run, except for times, version and commit.
"""

from __future__ import annotations

import csv
import math
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import click
import numpy as np

from .. import __version__, examples
from ..errors import InputError
from ..files import finite_or_none, json_text, write_atomic
from ..geometry.boundary import Boundary
from ..geometry.multipatch import MultiPatch
from ..iga import PoissonResult, poisson
from ..measure.bounds import outwards
from ..measure.quality import Quality, Statistics, quality, sample
from ..pipeline.plan import TransferPlan
from ..pipeline.result import TransferResult
from ..plot import figures as plot
from ..plot.continuity import slope_differences
from ..plot.drawing import need_matplotlib
from . import figures
from .page import page
from .proportions import condition_number_to_scale

__all__ = ["PRINTED", "Case", "Printed", "Step", "reproduce"]

METHODS = ("paper", "certified")
#: Patches whose points move by more of the diameter than this between first and last step are articulated.
MOVED = 5e-3
#: Largest κ times smallest scaled Jacobian, over 2, from which a printed row is doubtful.
DOUBTFUL = 5.0
#: Significant digits of the written numbers.
DIGITS = 6


@dataclass(frozen=True)
class Printed:
    """A row of the paper's Table 1, as printed."""

    name: str
    sample: str
    transferred: bool
    scaled_jacobian: Statistics
    condition_number: Statistics

    @property
    def remark(self) -> str | None:
        """What the largest κ and the smallest scaled Jacobian say about each other.

        "contradictory" where κ ≥ 2 / scaled Jacobian, which holds at every point, is broken; "doubtful" where κ is
        `DOUBTFUL` times as large as it has to be, while it is hardly larger in the other rows.
        """
        ratio = self.condition_number.max * self.scaled_jacobian.min / 2
        return "contradictory" if ratio < 1 else "doubtful" if ratio > DOUBTFUL else None


def _printed(name: str, sample: str, transferred: bool, *numbers: float) -> Printed:
    return Printed(name, sample, transferred, Statistics(*numbers[:3]), Statistics(*numbers[3:]))


PRINTED = (
    _printed("Rabbit_s", "rabbit", False, 0.0013, 0.9308, 1, 2, 2.4689, 2011.8),
    _printed("Boarder_s", "frame", False, 0.0128, 0.8905, 1, 2, 2.5718, 156.667),
    _printed("Two_hole_s", "two-hole-plate", False, 2.92e-5, 0.9543, 1, 2, 4.3951, 73852),
    _printed("Human_s", "human", False, 0.0013, 0.8957, 1, 2, 2.5958, 1598.8),
    _printed("Rabbit", "rabbit", True, 0.0048, 0.9244, 1, 2, 2.4940, 439.59),
    _printed("Boarder", "frame", True, 0.0017, 0.8770, 1, 2, 2.8581, 1751.4),
    _printed("Two_hole", "two-hole-plate", True, 0.00487, 0.9590, 1, 2, 2.2722, 4113.7),
    _printed("Human", "human", True, 0.000189, 0.9083, 1, 2, 2.6942, 1030.1),
)
"""Table 1 of the paper; ``_s`` are the sources."""

FIELDS = {"rabbit": (4, 5), "frame": (3, 5), "two-hole-plate": (3, 5), "human": (4, 12)}
"""Fig. 11: degree of the field and control points per patch and direction, in the order of the paper's columns."""

FIG10, FIG12 = "rabbit", "wrench"
"""Samples of Fig. 10, whose model the paper does not name, and of Fig. 12."""


@dataclass(frozen=True, eq=False)
class Case:
    """A sample with its transfers; `seconds` per method, of a transfer on a prepared plan."""

    name: str
    source: MultiPatch
    target: Boundary
    source_quality: Quality
    results: dict[str, TransferResult]
    without_rows: TransferResult
    seconds: dict[str, float]


@dataclass(frozen=True, eq=False)
class Step:
    """A step of Fig. 12; `articulated` are the patches that move from step to step."""

    step: int
    result: TransferResult
    articulated: tuple[int, ...]
    scaled_jacobian: Statistics

    def row(self) -> dict[str, Any]:
        """Numbers for the data files: of all patches, and of the articulated ones."""
        whole, part = self.result.quality.scaled_jacobian, self.scaled_jacobian
        return {
            "step": self.step,
            "status": self.result.certificate.status,
            "sj_min": whole.min,
            "sj_mean": whole.mean,
            "articulated_sj_min": part.min,
            "articulated_sj_mean": part.mean,
            "corner_bound": self.result.corner_bound,
            "boundary_error": self.result.boundary_error,
        }


def transferred(name: str) -> Case:
    """One sample by both methods, and by "certified" without continuity rows."""
    source, target, landmarks = examples.load(name)
    plan = TransferPlan(source)
    results, seconds = {}, {}
    for method in METHODS:
        begin = time.perf_counter()
        results[method] = plan.transfer(
            target, landmarks, method=method, refine="never", fixed_correspondence=True, on_failure="return"
        )
        seconds[method] = time.perf_counter() - begin
    without = TransferPlan(source, "c0").transfer(target, landmarks, refine="never", on_failure="return")
    return Case(name, source, target, quality(source, proved=True), results, without, seconds)


def articulation(name: str) -> list[Step]:
    """Fig. 12: the sample's targets in equal steps, one plan for all."""
    found = []
    for step in range(1, examples.STEPS[name] + 1):
        source, target, landmarks = examples.load(name, step)
        found.append(
            TransferPlan(source).transfer(
                target, landmarks, refine="never", fixed_correspondence=True, on_failure="return"
            )
        )
    moving = _moving(found[0].multipatch, found[-1].multipatch)
    return [Step(k, r, moving, _scaled_jacobian(r.multipatch, moving)) for k, r in enumerate(found, 1)]


def _moving(first: MultiPatch, last: MultiPatch) -> tuple[int, ...]:
    shift = [
        np.linalg.norm(b.control_points - a.control_points, axis=2).max() / first.diameter
        for a, b in zip(first.patches, last.patches, strict=True)
    ]
    return tuple(np.flatnonzero(np.array(shift) > MOVED).tolist())


def _scaled_jacobian(mp: MultiPatch, patches: Sequence[int]) -> Statistics:
    values = np.concatenate([scaled.ravel() for _, scaled in (sample(mp)[k] for k in patches)])
    return Statistics(float(values.min()), float(values.mean()), float(values.max()))


def table1(cases: Sequence[Case]) -> list[dict[str, Any]]:
    """Rows of Table 1: what is printed, then ours, sample by sample."""
    rows = []
    for case in cases:
        printed = {p.transferred: p for p in PRINTED if p.sample == case.name}
        for after in (False, True):
            if after in printed:
                p = printed[after]
                rows.append(_row(case, p.name, after, "printed", p, remark=p.remark))
            if not after:
                to_scale = condition_number_to_scale(case.source)
                rows.append(_row(case, case.name, False, "source", case.source_quality, kappa_mean_to_scale=to_scale))
                continue
            for method, result in case.results.items():
                more = {
                    "kappa_mean_to_scale": condition_number_to_scale(result.multipatch),
                    "status": result.certificate.status,
                    "boundary_error": result.boundary_error,
                    "seconds": round(case.seconds[method], 3),
                }
                rows.append(_row(case, case.name, True, method, result.quality, **more))
    return rows


def _row(case: Case, model: str, after: bool, method: str, numbers: Printed | Quality, **more: Any) -> dict[str, Any]:
    row: dict[str, Any] = {
        "sample": case.name,
        "model": model,
        "shape": "result" if after else "source",
        "method": method,
    }
    for short, values in (("sj", numbers.scaled_jacobian), ("kappa", numbers.condition_number)):
        row |= {f"{short}_{name}": finite_or_none(getattr(values, name)) for name in ("min", "mean", "max")}
    if isinstance(numbers, Quality) and numbers.proved is not None:
        lower, upper = numbers.proved.min_scaled_jacobian.lower, numbers.proved.max_condition_number.upper
        row["sj_min_proved"] = outwards(lower, DIGITS, math.floor)
        row["kappa_max_proved"] = finite_or_none(outwards(upper, DIGITS, math.ceil))
    else:
        row |= dict.fromkeys(("sj_min_proved", "kappa_max_proved"))
    return row | dict.fromkeys(("kappa_mean_to_scale", "remark", "status", "boundary_error", "seconds")) | more


def slopes(cases: Sequence[Case]) -> list[dict[str, Any]]:
    """Fig. 10 in numbers: slope differences at control points, and kinks of iso-lines, without and with rows."""
    found = []
    for case in cases:
        for rows, result in (("without", case.without_rows), ("with", case.results["certified"])):
            angles = np.concatenate(slope_differences(result.multipatch))
            angles = angles[np.isfinite(angles)]
            kink, active = result.continuity.kink_deg, result.rows
            found.append(
                {
                    "sample": case.name,
                    "rows": rows,
                    "active": 0 if active is None else active.active,
                    "left_out": None if active is None else active.left_out,
                    "residual": None if active is None else active.residual,
                    "slope_median_deg": float(np.median(angles)),
                    "slope_mean_deg": float(angles.mean()),
                    "kink_mean_deg": kink.mean,
                    "kink_max_deg": kink.max,
                }
            )
    return found


def fields(cases: Sequence[Case]) -> dict[str, PoissonResult]:
    """Fig. 11: Poisson's equation on the results, uniform knots as in the paper."""
    by_name = {case.name: case for case in cases}
    return {
        name: poisson(by_name[name].results["certified"].multipatch, degree=degree, points=points, knots="uniform")
        for name, (degree, points) in FIELDS.items()
        if name in by_name
    }


def _field_row(name: str, result: PoissonResult) -> dict[str, Any]:
    content = result.to_dict()
    kept = ("degree", "points", "dofs", "l2_error", "h1_error", "max_error", "exact_max")
    row = {"sample": name} | {key: content[key] for key in kept}
    return row | {"points": "×".join(map(str, FIELDS[name][1:] * 2))}


def reproduce(
    folder: str | Path,
    names: Sequence[str] | None = None,
    progress: Callable[[str], None] | None = None,
) -> dict[str, Any]:
    """Measure everything and write it.

    Writes ``table1.csv``, ``figure10.csv``, ``figure11.csv``, ``figure12.csv``, all of them with version and commit in
    ``reproduction.json``, pictures ``figure8.png`` to ``figure12.png`` and the page ``reproduction.md``. Files of these
    names are replaced.

    Parameters
    ----------
    folder : path
        Made if it does not exist.
    names : sequence of str, optional
        Samples; default all of `examples.EXAMPLES` without weights, which the paper's method lacks. Figures without a
        sample are left out.
    progress : callable, optional
        Called with a line of text before every part.

    Returns
    -------
    dict
        The content of ``reproduction.json``, numbers to six digits.

    Raises
    ------
    InputError
        On an unknown sample, a folder that cannot be written to, or without matplotlib.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> folder = Path(tempfile.mkdtemp())
    >>> from patchtransfer import reproduce
    >>> content = reproduce.reproduce(folder, names=["star"])
    >>> (folder / "table1.csv").exists()
    True
    """
    samples = [name for name in examples.EXAMPLES if name not in examples.RATIONAL]
    chosen = samples if names is None else list(dict.fromkeys(names))
    unknown = [name for name in chosen if name not in samples]
    if unknown or not chosen:
        raise InputError(f"no sample {(unknown or ['(none)'])[0]!r}; there are {', '.join(samples)}")
    need_matplotlib("the figures")
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: the folder cannot be made ({error.strerror}); choose another one") from None
    say = progress or (lambda text: None)
    cases = []
    for name in chosen:
        say(f"Table 1, Figures 8 to 10: {name}")
        cases.append(transferred(name))
    say("Figure 11: Poisson's equation")
    solved = fields(cases)
    say("Figure 12: articulation in steps")
    steps = articulation(FIG12) if FIG12 in chosen else []
    data: dict[str, Any] = {
        "version": __version__,
        "commit": commit(),
        "table1": table1(cases),
        "figure10": slopes(cases),
        "figure10_drawn": _bent(cases).name,
        "figure11": [_field_row(name, result) for name, result in solved.items()],
        "figure12": [step.row() for step in steps],
        "figure12_articulated": list(steps[0].articulated) if steps else [],
    }
    data = _rounded(data)
    say("pictures and tables")
    _draw(folder, cases, solved, steps)
    for name in ("table1", "figure10", "figure11", "figure12"):
        if data[name]:
            write_atomic(folder / f"{name}.csv", _csv(data[name]))
    write_atomic(folder / "reproduction.json", json_text(data, indent=1))
    write_atomic(folder / "reproduction.md", page(data))
    return data


def _rounded(data: Any) -> Any:
    """Numbers to `DIGITS`: what rounding differently would change is not written."""
    if isinstance(data, dict):
        return {key: _rounded(value) for key, value in data.items()}
    if isinstance(data, list):
        return [_rounded(value) for value in data]
    return float(f"{data:.{DIGITS}g}") if isinstance(data, float) else data


def _draw(folder: Path, cases: list[Case], solved: dict[str, PoissonResult], steps: list[Step]) -> None:
    names = [c.name for c in cases]
    models = [(c.source, c.target, c.results["certified"].multipatch) for c in cases]
    figures.save(figures.decompositions(models, names), folder / "figure8.png")
    figures.save(figures.colour_maps([(a, b) for a, _, b in models], names), folder / "figure9.png")
    bent = _bent(cases)
    both = bent.without_rows.multipatch, bent.results["certified"].multipatch
    figures.save(plot.slope_difference(*both), folder / "figure10.png")
    if solved:
        figures.save(figures.solutions(list(solved.values()), list(solved)), folder / "figure11.png")
    if steps:
        shapes = [examples.load(FIG12)[0], *(step.result.multipatch for step in steps)]
        titles = ["source", *(f"step {s.step}" for s in steps)]
        figures.save(figures.steps(shapes, titles), folder / "figure12.png")


def _bent(cases: Sequence[Case]) -> Case:
    """The sample whose interfaces Fig. 10 draws."""
    return next((c for c in cases if c.name == FIG10), cases[0])


def _csv(rows: list[dict[str, Any]]) -> str:
    out = StringIO()
    writer = csv.DictWriter(out, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return out.getvalue()


def commit() -> str | None:
    """Commit of the checkout that this module belongs to, "-dirty" with changes; None outside of one."""
    here = Path(__file__).resolve()

    def git(*command: str) -> str:
        done = subprocess.run(["git", "-C", str(here.parent), *command], capture_output=True, text=True, check=True)
        return done.stdout.strip()

    try:
        root = Path(git("rev-parse", "--show-toplevel"))
        # An installed copy counts too, if it is this checkout's.
        if (root / "python" / "patchtransfer" / here.name).read_bytes() != here.read_bytes():
            return None
        changed = git("status", "--porcelain", "--", *(str(root / part) for part in ("python", "rust", "Cargo.lock")))
        return git("rev-parse", "HEAD") + ("-dirty" if changed else "")
    except (OSError, subprocess.CalledProcessError):
        return None


@click.command()
@click.option("-o", "--output", required=True, metavar="DIR", help="Folder for data, pictures and page.")
@click.option("--sample", "names", multiple=True, metavar="NAME", help="Only this sample (repeatable).")
@click.option("-v", "--verbose", is_flag=True, help="Say what is done also where no terminal is.")
@click.option("-q", "--quiet", is_flag=True, help="Print errors only.")
def main(output: str, names: tuple[str, ...], verbose: bool, quiet: bool) -> None:
    """Table 1 and Figures 8 to 12 of the paper on the bundled samples."""
    if verbose and quiet:
        raise click.UsageError("--verbose and --quiet exclude each other")
    told = verbose or (sys.stderr.isatty() and not quiet)
    try:
        data = reproduce(output, names or None, progress=(lambda text: click.echo(text, err=True)) if told else None)
    except InputError as error:
        raise click.UsageError(str(error)) from None
    uncertified = [r for r in data["table1"] if r["method"] == "certified" and r["status"] != "certified"]
    if not quiet:
        click.echo(f"written to {output}; {len(uncertified)} samples not certified")
