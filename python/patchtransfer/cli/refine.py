"""Command line: ``patchtransfer refine FILE -o OUT.xml``: a model in another spline space."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from ..errors import InputError
from ..limits import MAX_ALONG, MAX_CONTROL_POINTS, MAX_DEGREE, at_most
from ..progress import Clock
from .options import FILE, json_option, volume_options
from .streams import say, warn
from .support import Report, all_or_nothing, check_outputs, failures, keep_inputs
from .watch import read_model, watched

if TYPE_CHECKING:
    from ..geometry.multipatch import MultiPatch

__all__ = ["refine"]


@click.command()
@click.argument("file", type=click.Path())
@click.option(
    "-o", "--output", required=True, type=FILE, metavar="OUT.xml", help="The same model in another spline space."
)
@click.option("--elevate", type=click.IntRange(0, 10), default=0, metavar="N", help="Raise all degrees by N.")
@click.option("--split", type=click.IntRange(1, 64), default=1, metavar="N", help="Cut every knot span into N.")
@click.option("--smoothness", type=click.IntRange(0), metavar="R", help="Repeat inner knots until C^R.")
@click.option(
    "--conform",
    is_flag=True,
    help="Make patches agree where their sides coincide: elevation, knot insertion, splits at T-junctions.",
)
@click.option(
    "--weld",
    type=float,
    metavar="TOL",
    help="With --conform: close gaps up to this length, in the model's unit, by moving both sides.",
)
@json_option
@volume_options
def refine(
    file: str,
    output: str,
    elevate: int,
    split: int,
    smoothness: int | None,
    conform: bool,
    weld: float | None,
    json_path: str | None,
) -> None:
    """Raise degrees, split knot spans or repeat knots of the multi-patch FILE; its geometry stays.

    With --conform patches with different splines along a side, or with T-junctions, are made to agree first; only
    --weld moves what is more than rounding apart. Straight corners whose det J is negative by rounding are put
    straight, with a note.
    """
    from .. import io
    from ..geometry.conform import conform as conformed
    from ..proof.source_corners import certify_straight

    report = Report(json_path)
    with failures(report):
        check_outputs(model=output, report=json_path)
        keep_inputs([file], [output, json_path])
        if weld is not None and not conform:
            raise InputError("--weld closes gaps with --conform only; give both")
        with watched() as progress:
            clock = Clock(progress)
            model = read_model(clock, file)
            done = None
            if conform:
                with clock("conforming") as stage:
                    done = conformed(model, weld=weld or 0.0)
                    stage.found = repr(done.multipatch)
            model, left = (model, ()) if done is None else (done.multipatch, done.left)
            with clock("refinement") as stage:
                _check_size(model, elevate, split)
                model = (model.elevate(elevate) if elevate else model).split_spans(split)
                model = model if smoothness is None else model.reduce_continuity(smoothness)
                stage.found = repr(model)
            with clock("certificate") as stage:
                # Rounding takes straight corners to either side of straight.
                model, certificate, notes = certify_straight(model)
                stage.found = certificate.status
        content = {
            "conform": None if done is None else done.to_dict(),
            "certificate": certificate.to_dict(),
            "warnings": [*left, *notes],
            "error": None,
        }
        with all_or_nothing(output, json_path):
            io.write(model, output)
            report.write(content)
            if json_path != "-":
                if done is not None:
                    moved = f"points moved by at most {done.moved:.3g}" if done.moved else "no point moved"
                    say(*done.notes, f"{moved}; {certificate}")
                say(f"{model!r} written to {output}")
    warn([*left, *notes])


def _check_size(model: MultiPatch, elevate: int, split: int) -> None:
    """Refuse to refine a model to one that could not be read again."""
    from ..geometry.basis import knot_spans

    total = 0
    for k, patch in enumerate(model.patches):
        along = []
        for knots, degree in zip(patch.knots, patch.degrees, strict=True):
            at_most(degree + elevate, MAX_DEGREE, f"as degree of patch {k}", "raise it less")
            spans = len(knot_spans(knots)) - 1
            along.append(len(knots) - degree - 1 + spans * elevate + spans * (split - 1))
        at_most(max(along), MAX_ALONG, f"control points in one direction of patch {k}", "split less")
        total += along[0] * along[1]
    at_most(total, MAX_CONTROL_POINTS, "control points", "split less")
