"""Command line: ``patchtransfer transfer | build | refine | check | plot | poisson | morph | batch | examples``.

Exit status: 0 a certified result (or model), 1 not certified, 2 bad input or an infeasible target. Nothing is
written with status 2, nor with 1 unless ``--keep-uncertified``.
"""

from __future__ import annotations

import math
import os
import sys
from typing import TYPE_CHECKING, Any

import click
from rich.table import Table

from .._core import __version__
from ..errors import InputError
from ..geometry.basis import knot_spans
from ..limits import MAX_ALONG, MAX_CONTROL_POINTS, MAX_DEGREE, at_most
from .batch import batch
from .morph import morph
from .poisson import poisson
from .support import (
    NOT_CERTIFIED,
    Commands,
    Report,
    all_or_nothing,
    check_outputs,
    failures,
    json_option,
    keep_inputs,
    say,
    set_threads,
    status_line,
    time_limit_option,
    warn,
)

if TYPE_CHECKING:
    from ..geometry.multipatch import MultiPatch

__all__ = ["main"]


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="patchtransfer")
def main() -> None:
    """Transfer multi-patch B-spline parameterizations to new boundaries, with a proof of injectivity."""


main.add_command(poisson)


@main.command()
@click.argument("source", type=click.Path())
@click.argument("target", type=click.Path())
@click.option("-o", "--output", required=True, metavar="OUT.xml", help="Transferred multi-patch (G+Smo XML).")
@click.option("--landmarks", metavar="L.csv", help="Corresponding boundary points, columns xs,ys,xt,yt.")
@click.option(
    "--continuity",
    type=click.Choice(["c0", "c1", "g1"]),
    default="c1",
    show_default=True,
    help="Across patches.",
)
@click.option("--method", type=click.Choice(["certified", "paper"]), default="certified", show_default=True)
@click.option(
    "--refine",
    type=click.Choice(["never", "auto"]),
    default="never",
    show_default=True,
    help="auto: insert knots into the source where it misses the target; refine it if no certified map is found.",
)
@click.option("--fit-tolerance", type=float, default=1e-3, show_default=True, metavar="X", help="Boundary error.")
@click.option(
    "--fixed-correspondence/--sliding-joints",
    default=None,
    help="Keep all joints where registration puts them (default with landmarks), or let those that are neither corners "
    "nor landmarks slide to lower the distortion (default without).",
)
@click.option("--keep-uncertified", is_flag=True, help="Write the best map even without a certificate.")
@click.option("--plot", "plot_path", metavar="P.png", help="Picture: source, target and result.")
@click.option("--plot-registration", metavar="P.png", help="Picture: which boundary points correspond.")
@time_limit_option
@json_option
@click.option("--threads", type=click.IntRange(1, 1024), metavar="N", help="Threads of the core (default: all).")
def transfer(
    source: str,
    target: str,
    output: str,
    landmarks: str | None,
    continuity: str,
    method: str,
    refine: str,
    fit_tolerance: float,
    fixed_correspondence: bool | None,
    keep_uncertified: bool,
    plot_path: str | None,
    plot_registration: str | None,
    time_limit: float | None,
    json_path: str | None,
    threads: int | None,
) -> None:
    """Transfer the parameterization SOURCE to the boundary TARGET.

    SOURCE is a multi-patch (G+Smo XML). TARGET is a boundary: G+Smo XML, closed point lists (CSV) or an SVG
    drawing.
    """
    from .. import io
    from ..pipeline.plan import transfer as run
    from ..plot import figures as plot

    report = Report(json_path)
    with failures(report):
        check_outputs(model=output, picture=plot_path, report=json_path)
        check_outputs(picture=plot_registration)
        keep_inputs([source, target, landmarks], [output, plot_path, plot_registration, json_path])
        set_threads(threads)
        model, boundary = io.read(source), io.read_boundary(target)
        points = None if landmarks is None else io.read_landmarks(landmarks)
        with status_line() as progress:
            result = run(
                model,
                boundary,
                points,
                continuity,
                method,
                progress,
                refine=refine,
                fit_tolerance=fit_tolerance,
                fixed_correspondence=fixed_correspondence,
                on_failure="return" if keep_uncertified else "raise",
                time_limit=time_limit,
            )
        with all_or_nothing(output, plot_path, plot_registration, json_path):
            if plot_path is not None:
                metrics = result.quality.scaled_jacobian
                caption = (
                    f"{result.certificate.status}; scaled Jacobian {metrics.min:.3f} to {metrics.max:.3f}, "
                    f"mean {metrics.mean:.3f}"
                )
                plot.savefig(plot.transfer(model, boundary, result.multipatch, caption=caption), plot_path)
            if plot_registration is not None:
                pairs = [[*a, *b] for a, b in result.registration.joints]
                fitted = result.multipatch.boundary()
                figure = plot.registration(
                    model.boundary(),
                    fitted,
                    pairs,
                    boundary,
                    matched=result.registration.pairs(120),
                    confidence=result.registration.confidence,
                )
                plot.savefig(figure, plot_registration)
            io.write(result.multipatch, output)
            content = result.to_dict()
            if not result.certificate.injective:
                content["error"] = str(result.certificate)
            report.write(content)
            if json_path != "-":
                _summary(result.to_dict(), output)
    warn(result.warnings)
    sys.exit(0 if result.certificate.injective else NOT_CERTIFIED)


@main.command()
@click.argument("layout", type=click.Path())
@click.option("-o", "--output", required=True, metavar="OUT.xml", help="Multi-patch (G+Smo XML).")
@click.option("--keep-uncertified", is_flag=True, help="Write the best map even without a certificate.")
@click.option("--plot", "plot_path", metavar="P.png", help="Picture of the multi-patch.")
@json_option
def build(layout: str, output: str, keep_uncertified: bool, plot_path: str | None, json_path: str | None) -> None:
    """Parameterize a domain from the quad layout LAYOUT (JSON) and the boundary that it names."""
    from .. import io
    from ..plot import figures as plot
    from ..sources.layout import from_layout

    report = Report(json_path)
    with failures(report):
        check_outputs(model=output, picture=plot_path, report=json_path)
        given = io.read_layout(layout)
        keep_inputs([layout, given.boundary_file], [output, plot_path, json_path])
        try:
            result = from_layout(
                given.vertices,
                given.quads,
                given.boundary,
                given.degree,
                given.spans,
                assignment=given.assignment,
                on_failure="return" if keep_uncertified else "raise",
            )
        except InputError as error:
            raise InputError(f"{layout}: {error}") from None
        with all_or_nothing(output, plot_path, json_path):
            if plot_path is not None:
                plot.savefig(plot.multipatch(result.multipatch), plot_path)
            io.write(result.multipatch, output)
            report.write(result.to_dict())
            if json_path != "-":
                _summary(result.to_dict(), output)
    warn(result.warnings)
    sys.exit(0 if result.certificate.injective else NOT_CERTIFIED)


@main.command()
@click.argument("file", type=click.Path())
@click.option("-o", "--output", required=True, metavar="OUT.xml", help="The same model in another spline space.")
@click.option("--elevate", type=click.IntRange(0, 10), default=0, metavar="N", help="Raise all degrees by N.")
@click.option("--split", type=click.IntRange(1, 64), default=1, metavar="N", help="Cut every knot span into N.")
@click.option("--smoothness", type=click.IntRange(0), metavar="R", help="Repeat inner knots until C^R.")
def refine(file: str, output: str, elevate: int, split: int, smoothness: int | None) -> None:
    """Raise degrees, split knot spans or repeat knots of the multi-patch FILE; its geometry stays.

    Straight corners whose det J is negative by rounding are put straight, with a note.
    """
    from .. import io
    from ..proof.source_corners import certify_straight

    with failures(Report(None)):
        check_outputs(model=output)
        keep_inputs([file], [output])
        model = io.read(file)
        _check_size(model, elevate, split)
        model = (model.elevate(elevate) if elevate else model).split_spans(split)
        model = model if smoothness is None else model.reduce_continuity(smoothness)
        # Rounding takes straight corners to either side of straight.
        model, _, notes = certify_straight(model)
        with all_or_nothing(output):
            io.write(model, output)
            say(f"{model!r} written to {output}")
    warn(notes)


@main.command()
@click.argument("file", type=click.Path())
@json_option
def check(file: str, json_path: str | None) -> None:
    """Topology, certificate, quality and continuity of the multi-patch FILE."""
    from .. import io
    from ..measure.continuity import check_continuity
    from ..measure.quality import quality
    from ..proof.certificate import certify

    report = Report(json_path)
    with failures(report):
        check_outputs(report=json_path)
        keep_inputs([file], [json_path])
        model = io.read(file)
        certificate = certify(model)
        degenerate = [(cell.patch, cell.corner) for cell in certificate.cells if cell.kind == "degenerate"]
        content = {
            "topology": _topology(model),
            "certificate": certificate.to_dict(),
            "quality": quality(model, exclude=degenerate).to_dict(),
            "continuity": check_continuity(model).to_dict(),
            "error": None,
        }
        with all_or_nothing(json_path):
            report.write(content)
            if json_path != "-":
                _summary(content, None)
                say(*certificate.reasons)
    sys.exit(0 if certificate.injective else NOT_CERTIFIED)


@main.command()
@click.argument("file", type=click.Path())
@click.option("-o", "--output", required=True, metavar="P.png", help="Picture (PNG, PDF or SVG).")
def plot(file: str, output: str) -> None:
    """Draw the multi-patch FILE: iso-parametric lines coloured by scaled Jacobian."""
    from .. import io
    from ..plot import figures as plots

    with failures(Report(None)):
        check_outputs(picture=output)
        keep_inputs([file], [output])
        figure = plots.multipatch(io.read(file))
        plots.savefig(figure, output)


def _check_size(model: MultiPatch, elevate: int, split: int) -> None:
    """Refuse to refine a model to one that could not be read again."""
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


def _summary(content: dict[str, Any], output: str | None) -> None:
    """Certificate, metrics, errors and times as a table."""
    table = Table(show_header=False, box=None, pad_edge=False)
    certificate, metrics = content["certificate"], content["quality"]
    bound = f", det J ≥ {certificate['lower_bound']:.3g} of its mean" if certificate["status"] == "certified" else ""
    colour = "green" if certificate["injective"] else "red"
    table.add_row("certificate", f"[bold {colour}]{certificate['status']}[/]{bound}")
    for name in ("scaled_jacobian", "condition_number"):
        low, mean, high = (_number(metrics[name][k]) for k in ("min", "mean", "max"))
        table.add_row(name.replace("_", " "), f"min {low}   mean {mean}   max {high}")
    if "corner_bound" in content:
        table.add_row("  corners allow at most", _number(content["corner_bound"]))
    kink = content["continuity"]["kink_deg"]
    table.add_row("kink across patches", f"mean {_number(kink['mean'])}°   max {_number(kink['max'])}°")
    smooth = content["continuity"]
    table.add_row(
        "residuals across patches",
        f"C0 {smooth['c0_gap']:.1e}   C1 rows {smooth['c1_residual']:.1e}   AS-G1 {smooth['as_g1_residual']:.1e}",
    )
    if smooth.get("rows") is not None:
        rows = smooth["rows"]
        table.add_row(
            "continuity rows", f"{rows['active']} kept to {rows['residual']:.1e}, {rows['left_out']} left out"
        )
    if "topology" in content:
        topology = content["topology"]
        valences = ", ".join(map(str, sorted(v["valence"] for v in topology["extraordinary_vertices"])))
        table.add_row(
            "topology",
            f"{topology['patches']} patches, {topology['interfaces']} interfaces, "
            f"{topology['boundary_loops']} boundary loops, valences of extraordinary vertices: {valences or 'none'}",
        )
    if "boundary_error" in content:
        table.add_row("boundary error", f"{content['boundary_error']:.2e} of the diameter")
        times = content["timings"]
        table.add_row("time", f"{1e3 * sum(times.values()):.1f} ms")
        for stage, seconds in times.items():
            table.add_row(f"  {stage}", f"{1e3 * seconds:.1f} ms")
    if output is not None:
        table.add_row("written", output)
    say(table)


def _number(x: float | None) -> str:
    return "-" if x is None or math.isnan(x) else f"{x:.4g}"


@main.command()
@click.argument("name", required=False)
@click.option("-o", "--output", metavar="DIR", help="Folder for all files (default: the example's name).")
def examples(name: str | None, output: str | None) -> None:
    """List the bundled examples, or run the example NAME and keep its files in DIR."""
    from .. import examples as bundled

    if name is None:
        say(*(f"{key}: {description}" for key, description in bundled.EXAMPLES.items()))
        return
    folder = name if output is None else output
    with failures(Report(None)), status_line() as progress:
        result = bundled.run(name, folder, progress)
    _summary(result.to_dict(), os.path.join(folder, ""))
    warn(result.warnings)


main.add_command(batch)
main.add_command(morph)
