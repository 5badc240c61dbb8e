"""Command line: ``patchtransfer check | plot | refine FILE``: one model, looked at or written in another space."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..errors import InputError
from ..files import write_atomic
from ..limits import MAX_ALONG, MAX_CONTROL_POINTS, MAX_DEGREE, at_most
from .delivery import summary
from .options import html_option, json_option
from .streams import say, warn
from .support import NOT_CERTIFIED, Report, all_or_nothing, check_outputs, command_line, failures, keep_inputs

if TYPE_CHECKING:
    from ..geometry.multipatch import MultiPatch

__all__ = ["check", "plot", "refine"]


@click.command()
@click.argument("file", type=click.Path())
@click.option("-o", "--output", required=True, metavar="OUT.xml", help="The same model in another spline space.")
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
        model = io.read(file)
        done = conformed(model, weld=weld or 0.0) if conform else None
        model, left = (model, ()) if done is None else (done.multipatch, done.left)
        _check_size(model, elevate, split)
        model = (model.elevate(elevate) if elevate else model).split_spans(split)
        model = model if smoothness is None else model.reduce_continuity(smoothness)
        # Rounding takes straight corners to either side of straight.
        model, certificate, notes = certify_straight(model)
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


@click.command()
@click.argument("file", type=click.Path())
@html_option
@json_option
def check(file: str, html_path: str | None, json_path: str | None) -> None:
    """Topology, certificate, quality and continuity of the multi-patch FILE."""
    from .. import io
    from ..geometry.conformity.coincidences import coincidences
    from ..geometry.labels import plain
    from ..measure.bounds import can_be_proved
    from ..measure.continuity import check_continuity
    from ..measure.quality import quality
    from ..proof.certificate import certify

    report = Report(json_path)
    with failures(report):
        check_outputs(page=html_path, report=json_path)
        keep_inputs([file], [html_path, json_path])
        model = io.read(file)
        certificate = certify(model)
        degenerate = [(cell.patch, cell.corner) for cell in certificate.cells if cell.kind == "degenerate"]
        unglued = [c.text for c in coincidences(model.patches, model.interfaces)]
        metrics, continuity = quality(model, exclude=degenerate, proved=can_be_proved(model)), check_continuity(model)
        content = {
            "topology": _topology(model),
            "labels": plain(model.sides),
            "certificate": certificate.to_dict(),
            "quality": metrics.to_dict(),
            "continuity": continuity.to_dict(),
            "unglued": unglued,
            "error": None,
        }
        with all_or_nothing(html_path, json_path):
            if html_path is not None:
                from ..web.report import model_page

                page = model_page(model, certificate, metrics, continuity, command=command_line(), warnings=unglued)
                write_atomic(Path(html_path), page)
            report.write(content)
            if json_path != "-":
                summary(content, None)
                say(*certificate.reasons, *(text for text in unglued if text not in certificate.reasons))
    sys.exit(0 if certificate.injective else NOT_CERTIFIED)


@click.command()
@click.argument("file", type=click.Path())
@click.option("-o", "--output", required=True, metavar="P.png", help="Picture (PNG, PDF or SVG).")
@click.option(
    "--color",
    default="scaled_jacobian",
    metavar="NAME",
    show_default=True,
    help="What lines show: scaled_jacobian, condition, stretch, dilatation, patch or none.",
)
@click.option(
    "--source", "source_path", metavar="S.xml", help="For stretch and dilatation: a model of the same layout."
)
@click.option("--ids", is_flag=True, help="Number the patches.")
@click.option("--control-net", is_flag=True, help="Draw the control nets.")
def plot(file: str, output: str, color: str, source_path: str | None, ids: bool, control_net: bool) -> None:
    """Draw the multi-patch FILE: iso-parametric lines coloured by quality."""
    from .. import io
    from ..plot import figures as plots

    with failures(Report(None)):
        check_outputs(picture=output)
        keep_inputs([file, *([source_path] if source_path else [])], [output])
        source = io.read(source_path) if source_path else None
        named = None if color == "none" else color
        figure = plots.multipatch(io.read(file), color=named, source=source, ids=ids, control_net=control_net)
        plots.savefig(figure, output)


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


def _topology(model: Any) -> dict[str, Any]:
    vertices = model.vertices
    try:
        loops = len(model.loops)
    except InputError:
        # The certificate says what is wrong with them.
        loops = None
    return {
        "patches": len(model.patches),
        "interfaces": len(model.interfaces),
        "boundary_loops": loops,
        "control_points": model.topology.n_points,
        "left_handed_patches": int((model.topology.orientation < 0).sum()),
        "extraordinary_vertices": [
            {"point": model.topology.coordinates[v.point].tolist(), "valence": v.valence}
            for v in vertices
            if v.extraordinary
        ],
    }
