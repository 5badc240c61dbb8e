"""Command line: ``patchtransfer compare A B``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from ..progress import Clock
from .options import json_option, volume_options
from .streams import say, table
from .support import Report, all_or_nothing, check_outputs, failures, keep_inputs
from .watch import watched

if TYPE_CHECKING:
    from ..geometry.multipatch import MultiPatch
    from ..measure.bounds import Bounds
    from ..measure.similarity import Similarity

__all__ = ["compare"]


@click.command()
@click.argument("a", type=click.Path())
@click.argument("b", type=click.Path())
@click.option("--width", type=float, default=1e-3, show_default=True, help="How far proved bounds may be apart.")
@json_option
@volume_options
def compare(a: str, b: str, width: float, json_path: str | None) -> None:
    """How similar the multi-patches A and B of one layout are: the dilatation of the map from A to B.

    Both have the same patches, interfaces and degrees, as a source and the result of a transfer.
    """
    from .. import io
    from ..measure.similarity import similarity

    report = Report(json_path)
    with failures(report):
        check_outputs(report=json_path)
        keep_inputs([a, b], [json_path])
        with watched() as progress:
            clock = Clock(progress)
            with clock("reading") as stage:
                first, second = io.read(a), io.read(b)
                stage.found = f"{first!r}, {second!r}"
            with clock("similarity") as stage:
                found = similarity(first, second, width=width)
                stage.found = str(found)
            with clock("quality") as stage:
                guaranteed = _guaranteed(first, found)
        content: dict[str, Any] = {"similarity": found.to_dict(), "guaranteed": guaranteed, "error": None}
        with all_or_nothing(json_path):
            report.write(content)
            if json_path != "-":
                say(str(found), table(_lines(found, content["guaranteed"])))


def _guaranteed(model: MultiPatch, found: Similarity) -> dict[str, float | None]:
    """What the quality of a model says of all models that are as similar to it."""
    from ..files import finite_or_none
    from ..measure.bounds import proved_quality

    proved = proved_quality(model, [()] * len(model), 0.5, 1e-3)
    jacobian = max(proved.min_scaled_jacobian.lower, 0.0)
    return {
        "scaled_jacobian": found.guaranteed_scaled_jacobian(jacobian),
        "condition_number": finite_or_none(found.guaranteed_condition_number(proved.max_condition_number.upper)),
    }


def _lines(found: Similarity, guaranteed: dict[str, float | None]) -> list[tuple[str, str]]:
    log, least = found.log_dilatation, found.least
    smallest, largest = found.size
    lines = [
        ("log dilatation", f"at most {_bounds(log)}, proved"),
        ("  of samples", f"mean {found.mean:.4g}   rms {found.rms:.4g}   95 % {found.q95:.4g}"),
        ("log size", f"from {_bounds(smallest)} to {_bounds(largest)}, proved"),
    ]
    if least is not None:
        energy = "-" if least.energy is None else f"{least.energy:.4g} (computed)"
        lines.append(("no map below", f"{least.corners:.4g} by corners, {energy} by energies"))
        lines.append(("  differentiable at corners", f"{least.smooth:.4g}"))
    kappa = guaranteed["condition_number"]
    jacobian = f"scaled Jacobian at least {guaranteed['scaled_jacobian']:.4g}"
    lines.append(("from the quality of A, B has", f"{jacobian}, condition number {_at_most(kappa)}"))
    return lines


def _bounds(bounds: Bounds) -> str:
    """One number where both bounds have the same four digits."""
    low, high = f"{bounds.lower:.4g}", f"{bounds.upper:.4g}"
    return high if low == high else f"{low} ... {high}"


def _at_most(x: float | None) -> str:
    return "not bounded" if x is None else f"at most {x:.4g}"
