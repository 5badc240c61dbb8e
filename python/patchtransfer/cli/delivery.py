"""Command line: a result shown, written and judged."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from ..files import write_atomic
from ..progress import Clock
from .streams import one_line, say, table, warn
from .support import NOT_CERTIFIED, Report, all_or_nothing, command_line
from .watch import watched

if TYPE_CHECKING:
    from ..geometry.boundary import Boundary
    from ..measure.quality import Quality
    from ..pipeline.result import TransferResult

__all__ = ["deliver", "draw_patches", "figures", "leave", "quality_lines", "summary"]


def deliver(
    result: TransferResult,
    output: str,
    report: Report,
    pictures: Sequence[tuple[str | None, Callable[[str], None]]],
    html_path: str | None,
    outline: Boundary,
    more: Mapping[str, Any] | None = None,
) -> None:
    """Write pictures (path, or None for none, and what draws there), model and report, all or none of them.

    The report has the outline's notes besides, and `more`; the page has the notes.
    """
    from .. import io
    from ..pipeline.result import failure_of

    content = result.to_dict() | {"notes": list(outline.notes)} | dict(more or {})
    pictures = [*pictures, (html_path, partial(_write_page, result, command_line(), outline.notes))]
    error = failure_of(result)
    if error is not None:
        content["error"] = str(error)
    with all_or_nothing(output, *(path for path, _ in pictures), report.path):
        with watched() as progress, Clock(progress)("writing") as stage:
            for path, draw in pictures:
                if path is not None:
                    draw(path)
            io.write(result.multipatch, output)
            stage.found = ", ".join([*(path for path, _ in pictures if path is not None), output])
        report.write(content)
        if report.path != "-":
            summary(content, output)
    warn(outline.notes, "note", "cyan")


def _write_page(result: TransferResult, command: str | None, notes: Sequence[str], path: str) -> None:
    from ..web.report import transfer_page

    write_atomic(Path(path), transfer_page(result, command, notes))


def leave(result: TransferResult, shown: Collection[str] = ()) -> NoReturn:
    """End with the result's warnings, but for those that were shown before, and its status."""
    warn(text for text in result.warnings if text not in shown)
    sys.exit(0 if result.succeeded else NOT_CERTIFIED)


def draw_patches(result: TransferResult, path: str) -> None:
    """Picture of a result's patches."""
    from ..plot import figures as plot

    plot.savefig(plot.multipatch(result.multipatch), path)


def summary(content: dict[str, Any], output: str | None) -> None:
    """Certificate, metrics, errors and times as a table."""
    lines: list[tuple[str, str]] = []

    def add(name: str, text: str) -> None:
        lines.append((name, text))

    certificate, metrics = content["certificate"], content["quality"]
    bound = f", det J ≥ {certificate['lower_bound']:.3g} of its mean" if certificate["status"] == "certified" else ""
    colour = "green" if certificate["injective"] else "red"
    add("certificate", click.style(certificate["status"], fg=colour, bold=True) + bound)
    lines += quality_lines(metrics)
    if "corner_bound" in content:
        add("  corners allow at most", _number(content["corner_bound"]))
    if content.get("polish") is not None:
        from ..interior.polish_report import PolishReport

        add("  polish", PolishReport.from_dict(content["polish"]).words)
    if content.get("similarity") is not None:
        from ..measure.similarity import Similarity

        add("similarity to the source", str(Similarity.from_dict(content["similarity"])))
    kink = content["continuity"]["kink_deg"]
    add("kink across patches", f"mean {_number(kink['mean'])}°   max {_number(kink['max'])}°")
    smooth = content["continuity"]
    add(
        "residuals across patches",
        f"C0 {smooth['c0_gap']:.1e}   C1 rows {smooth['c1_residual']:.1e}   AS-G1 {smooth['as_g1_residual']:.1e}",
    )
    why = "".join(f"; {reason} {part:.2g}" for reason, part in list(smooth["c1_obstacles"].items())[:2])
    add("C1 across patches", f"{smooth['c1_share']:.2f} of the interfaces' length{why}")
    if smooth.get("rows") is not None:
        rows = smooth["rows"]
        add("continuity rows", f"{rows['active']} kept to {rows['residual']:.1e}, {rows['left_out']} left out")
    if "topology" in content:
        topology = content["topology"]
        valences = ", ".join(map(str, sorted(v["valence"] for v in topology["extraordinary_vertices"])))
        add(
            "topology",
            f"{topology['patches']} patches, {topology['interfaces']} interfaces, "
            f"{topology['boundary_loops']} boundary loops, valences of extraordinary vertices: {valences or 'none'}",
        )
    if content.get("labels"):
        add("labels", "; ".join(_label(*item) for item in content["labels"].items()))
    if "patches" in content:
        add("patches", str(content["patches"]))
    if content.get("split") is not None:
        corners, origin = content["split"]["corners"], content["split"]["origin"]
        before = len({piece["patch"] for piece in origin})
        add("split", f"{before} -> {len(origin)} patches, for {len(corners)} corners of the target")
    if content.get("mirrored"):
        add("mirrored", "yes: the target is a mirror image of the source")
    if "boundary_error" in content:
        add("boundary error", f"{content['boundary_error']:.2e} of the diameter")
        missed = content.get("registration", {}).get("missed_corners")
        if missed:
            worst = max(corner["cost"] for corner in missed)
            add("  corners inside sides", f"{len(missed)}, rounded off by about {worst:.1e} at most")
        times = content["timings"]
        add("time", f"{1e3 * sum(times.values()):.1f} ms")
        for stage, seconds in times.items():
            add(f"  {stage}", f"{1e3 * seconds:.1f} ms")
    if output is not None:
        add("written", output)
    say(table(lines))


def figures(metrics: Quality) -> str:
    """The figures of a model's quality that matter, for the log."""
    scaled = metrics.scaled_jacobian
    sampled = f"scaled Jacobian min {scaled.min:.3f}, mean {scaled.mean:.3f} of samples"
    return sampled if metrics.proved is None else f"{sampled}; {metrics.proved}"


def quality_lines(metrics: dict[str, Any]) -> list[tuple[str, str]]:
    """Names and texts of a report's quality: what is proved, and what samples say."""
    from ..measure.bounds import ProvedQuality

    lines = []
    if metrics["proved"] is not None:
        lines += [("quality", text) for text in str(ProvedQuality.from_dict(metrics["proved"])).split("; ")]
    for name in ("scaled_jacobian", "condition_number"):
        low, mean, high = (_number(metrics[name][k]) for k in ("min", "mean", "max"))
        lines.append((name.replace("_", " "), f"min {low}   mean {mean}   max {high}   of samples"))
    return lines


def _label(name: str, sides: list[dict[str, int]]) -> str:
    from ..geometry.sides import Side

    where = ", ".join(f"{side['patch']} {Side(side['side']).name.lower()}" for side in sides)
    return f"{one_line(name)}: {where or 'no side'}"


def _number(x: float | None) -> str:
    return "-" if x is None or math.isnan(x) else f"{x:.4g}"
