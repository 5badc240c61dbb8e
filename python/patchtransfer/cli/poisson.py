"""Command line: ``patchtransfer poisson``, isogeometric analysis on a model."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import click

from ..errors import InputError
from .options import json_option
from .streams import say, table, warn
from .support import Report, all_or_nothing, check_outputs, failures, keep_inputs, set_threads

if TYPE_CHECKING:
    from ..iga import PoissonResult

__all__ = ["poisson"]

#: Relative L2 error above which a field does not resolve the solution.
COARSE = 0.1


@click.command()
@click.argument("file", type=click.Path())
@click.option("--degree", type=int, metavar="P", help="Degree of the field (default: the geometry's).")
@click.option("--points", type=int, metavar="N", help="Control points of the field per patch and direction.")
@click.option(
    "--dirichlet",
    multiple=True,
    metavar="LABEL=VALUE",
    help="A constant on the sides of a label of FILE, no flux elsewhere; may be repeated.",
)
@click.option("--load", type=float, metavar="F", help="With --dirichlet: a constant right-hand side (default 0).")
@click.option("--uniform", is_flag=True, help="Uniform knots, even where the geometry's knots could be kept.")
@json_option
@click.option("--plot", "plot_path", metavar="P.png", help="Picture: solution and absolute error.")
@click.option("--threads", type=click.IntRange(1, 1024), metavar="N", help="Threads of the core (default: all).")
def poisson(
    file: str,
    degree: int | None,
    points: int | None,
    dirichlet: tuple[str, ...],
    load: float | None,
    uniform: bool,
    json_path: str | None,
    plot_path: str | None,
    threads: int | None,
) -> None:
    """Solve -Δu = 2π² sin(πx) sin(πy) on the multi-patch FILE and compare with u = sin(πx) sin(πy).

    With --dirichlet -Δu = F, with values on the sides of labels.
    """
    from .. import io
    from ..iga import poisson as solve
    from ..plot import figures as plot
    from ..plot.fields import solution

    report = Report(json_path)
    with failures(report):
        check_outputs(picture=plot_path, report=json_path)
        keep_inputs([file], [plot_path, json_path])
        set_threads(threads)
        model = io.read(file)
        f, g = _problem(dirichlet, load)
        result = solve(model, f, g, degree=degree, points=points, knots="uniform" if uniform else "auto")
        warnings = _unresolved(result)
        with all_or_nothing(plot_path, json_path):
            if plot_path is not None:
                plot.savefig(solution(result), plot_path)
            report.write(result.to_dict() | {"warnings": warnings, "error": None})
            if json_path != "-":
                _summary(result.to_dict())
    warn(warnings)


def _problem(dirichlet: tuple[str, ...], load: float | None) -> tuple[float | None, dict[str, float] | None]:
    """Right-hand side and boundary values, None for the problem with the known solution."""
    if not dirichlet:
        if load is not None:
            raise InputError("--load needs values on the boundary; give --dirichlet LABEL=VALUE too")
        return None, None
    values = {}
    for given in dirichlet:
        label, equals, text = given.rpartition("=")
        try:
            value = float(text) if equals else math.nan
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise InputError(f"--dirichlet {given}: not a label and a number; write LABEL=VALUE")
        if label in values:
            raise InputError(f"--dirichlet {given}: label {label!r} has a value already; give it one")
        values[label] = value
    return load or 0.0, values


def _unresolved(result: PoissonResult) -> list[str]:
    """A warning where the field is too coarse for the waves of u, as on models in millimetres."""
    errors = result.errors
    if errors is None or errors.l2 <= COARSE * errors.exact_l2:
        return []
    waves = result.multipatch.diameter / 2
    return [
        f"the error is {errors.l2 / errors.exact_l2:.0%} of u: its waves have length 2, and the model is {waves:.3g} "
        "of them across, too many for this field; scale the model to about unit size, or take more --points"
    ]


def _summary(content: dict[str, object]) -> None:
    rows = [(key, str(content[key])) for key in ("degree", "points", "dofs")]
    for key in ("l2_error", "h1_error", "max_error", "exact_max") if content["l2_error"] is not None else ():
        rows.append((key.replace("_", " "), f"{content[key]:.3e}"))
    timings = content["timings"]
    assert isinstance(timings, dict)
    rows.append(("time", f"{1e3 * sum(timings.values()):.1f} ms"))
    say(table(rows))
