"""Command line: ``patchtransfer poisson``, isogeometric analysis on a model."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import click

from ..errors import InputError
from ..progress import Clock
from .options import FILE, json_option, threads_option, volume_options
from .streams import say, table, warn
from .support import Report, all_or_nothing, check_outputs, failures, keep_inputs, set_threads
from .watch import read_model, watched

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
@click.option(
    "--neumann", multiple=True, metavar="LABEL=VALUE", help="A constant flux ∂u/∂n through the sides of a label."
)
@click.option("--robin", multiple=True, metavar="LABEL=A,H", help="∂u/∂n + A u = H on the sides of a label, A >= 0.")
@click.option("--load", type=float, metavar="F", help="With these: a constant right-hand side (default 0).")
@click.option("--uniform", is_flag=True, help="Uniform knots, even where the geometry's knots could be kept.")
@json_option
@click.option("-o", "--output", type=FILE, metavar="U.vtu", help="Model and solution, for ParaView.")
@click.option("--plot", "plot_path", type=FILE, metavar="P.png", help="Picture: solution and absolute error.")
@threads_option
@volume_options
def poisson(
    file: str,
    degree: int | None,
    points: int | None,
    dirichlet: tuple[str, ...],
    neumann: tuple[str, ...],
    robin: tuple[str, ...],
    load: float | None,
    output: str | None,
    uniform: bool,
    json_path: str | None,
    plot_path: str | None,
    threads: int | None,
) -> None:
    """Solve -Δu = f on the multi-patch FILE, with values and fluxes on the sides of labels.

    Without any the known solution is u = sin(πx/L) sin(πy/L), and errors are measured: L = 1 for models of about unit
    size, the power of ten nearest to half the diameter for others.
    """
    from .. import io
    from ..iga import poisson as solve
    from ..plot import figures as plot
    from ..plot.fields import solution

    report = Report(json_path)
    with failures(report):
        check_outputs(model=output, picture=plot_path, report=json_path)
        keep_inputs([file], [output, plot_path, json_path])
        set_threads(threads)
        with watched() as progress:
            clock = Clock(progress)
            model = read_model(clock, file)
            given = _conditions(dirichlet, neumann, robin, load)
            knots = "uniform" if uniform else "auto"
            result = solve(model, degree=degree, points=points, knots=knots, progress=progress, **given)
        warnings = _unresolved(result)
        with all_or_nothing(output, plot_path, json_path):
            if written := [path for path in (plot_path, output) if path is not None]:
                with watched() as progress, Clock(progress)("writing") as stage:
                    if plot_path is not None:
                        plot.savefig(solution(result), plot_path)
                    if output is not None:
                        io.write(model, output, fields={"u": result})
                    stage.found = ", ".join(written)
            report.write(result.to_dict() | {"warnings": warnings, "error": None})
            if json_path != "-":
                _summary(result.to_dict())
    warn(warnings)


def _conditions(
    dirichlet: tuple[str, ...], neumann: tuple[str, ...], robin: tuple[str, ...], load: float | None
) -> dict[str, Any]:
    """Right-hand side and what is given on sides, as keyword arguments; nothing for the known solution."""
    if not (dirichlet or neumann or robin):
        if load is not None:
            raise InputError("--load needs conditions on the boundary; give --dirichlet LABEL=VALUE too")
        return {}
    values, fluxes = (
        {label: x[0] for label, x in _by_label(o, g, 1).items()}
        for o, g in (("--dirichlet", dirichlet), ("--neumann", neumann))
    )
    pairs = {label: (x[0], x[1]) for label, x in _by_label("--robin", robin, 2).items()}
    return {"f": load or 0.0, "g": values, "neumann": fluxes, "robin": pairs}


def _by_label(option: str, given: tuple[str, ...], count: int) -> dict[str, list[float]]:
    """Numbers a label, from LABEL=NUMBER,..."""
    out: dict[str, list[float]] = {}
    for text in given:
        label, equals, numbers = text.rpartition("=")
        try:
            found = [float(number) for number in numbers.split(",")] if equals else []
        except ValueError:
            found = []
        if len(found) != count or not all(map(math.isfinite, found)):
            what = "a number; write LABEL=VALUE" if count == 1 else "two numbers; write LABEL=A,H"
            raise InputError(f"{option} {text}: not a label and {what}")
        if label in out:
            raise InputError(f"{option} {text}: label {label!r} has a value already; give it one")
        out[label] = found
    return out


def _unresolved(result: PoissonResult) -> list[str]:
    """A warning where the field is too coarse for the waves of u."""
    errors = result.errors
    if errors is None or errors.l2 <= COARSE * errors.exact_l2:
        return []
    return [
        f"the error is {errors.l2 / errors.exact_l2:.0%} of u: too coarse a field for its waves; take more --points"
    ]


def _summary(content: dict[str, object]) -> None:
    rows = [(key, str(content[key])) for key in ("degree", "points", "dofs")]
    for key in ("l2_error", "h1_error", "max_error", "exact_max") if content["l2_error"] is not None else ():
        rows.append((key.replace("_", " "), f"{content[key]:.3e}"))
    timings = content["timings"]
    assert isinstance(timings, dict)
    rows.append(("time", f"{1e3 * sum(timings.values()):.1f} ms"))
    say(table(rows))
