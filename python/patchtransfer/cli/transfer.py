"""Command line: ``patchtransfer transfer SOURCE TARGET -o OUT.xml``."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import click

from ..progress import Clock
from .delivery import deliver, leave
from .options import (
    FILE,
    continuity_option,
    html_option,
    json_option,
    polynomial_option,
    threads_option,
    volume_options,
)
from .outlines import Outlines, outline_options
from .support import Report, check_outputs, failures, keep_inputs, set_threads
from .transfer_options import chosen, transfer_options
from .watch import watched

if TYPE_CHECKING:
    from ..geometry.boundary import Boundary
    from ..geometry.multipatch import MultiPatch
    from ..pipeline.result import TransferResult

__all__ = ["transfer"]

#: A landmark is at a joint if it is no farther, relative to the diameter: arc lengths are computed to 1e-8.
ROUNDING = 1e-6


@click.command()
@click.argument("source", type=click.Path())
@click.argument("target", type=click.Path())
@click.option(
    "-o", "--output", required=True, type=FILE, metavar="OUT.xml", help="Transferred multi-patch (G+Smo XML)."
)
@click.option("--landmarks", type=FILE, metavar="L.csv", help="Corresponding boundary points, columns xs,ys,xt,yt.")
@continuity_option("c1")
@transfer_options
@outline_options
@polynomial_option(
    "Make a rational (NURBS) SOURCE polynomial first: its sides move by at most this part of the diameter."
)
@click.option("--plot", "plot_path", type=FILE, metavar="P.png", help="Picture: source, target and result.")
@click.option("--plot-registration", type=FILE, metavar="P.png", help="Picture: which boundary points correspond.")
@click.option(
    "--write-landmarks",
    type=FILE,
    metavar="F.csv",
    help="Landmarks that were given and found, named by the numbers of the pictures: correct them and hand them back.",
)
@html_option
@json_option
@volume_options
@threads_option
def transfer(
    source: str,
    target: str,
    output: str,
    landmarks: str | None,
    continuity: str,
    plot_path: str | None,
    plot_registration: str | None,
    write_landmarks: str | None,
    html_path: str | None,
    json_path: str | None,
    threads: int | None,
    outlines: Outlines,
    polynomial: float | None,
    **options: Any,
) -> None:
    """Transfer the parameterization SOURCE to the boundary TARGET.

    SOURCE is a multi-patch (G+Smo XML). TARGET is a boundary: G+Smo XML, closed point lists (CSV), a drawing (SVG,
    DXF), a polygon (GeoJSON), an airfoil or an image.
    """
    from .. import io
    from ..pipeline.transfer import transfer as run

    report = Report(json_path)
    with failures(report):
        check_outputs(model=output, picture=plot_path, page=html_path, report=json_path)
        check_outputs(picture=plot_registration, landmarks=write_landmarks)
        outputs = [output, plot_path, plot_registration, write_landmarks, html_path, json_path]
        keep_inputs([source, target, landmarks], outputs)
        set_threads(threads)
        with watched() as progress:
            with Clock(progress)("reading") as stage:
                model, boundary = io.read(source), outlines.read(target)
                points = None if landmarks is None else io.read_landmarks(landmarks)
                stage.found = f"{model!r}, {boundary!r}" + ("" if points is None else f", {len(points)} landmarks")
            notes = []
            if polynomial is not None and model.is_rational:
                from ..conversion import to_polynomial

                with Clock(progress)("conversion") as stage:
                    made = to_polynomial(model, polynomial)
                    model, notes = made.multipatch, [f"the source was {made}"]
                    stage.found = str(made)
            result = run(model, boundary, points, continuity, progress=progress, **chosen(options).keywords())
            result = result.with_warnings(notes)
        pictures = [
            (plot_path, partial(_draw_transfer, model, boundary, result)),
            (plot_registration, partial(_draw_registration, model, boundary, result)),
            (write_landmarks, partial(_write_landmarks, result)),
        ]
        deliver(result, output, report, pictures, html_path, boundary)
    leave(result, progress.warnings)


def _write_landmarks(result: TransferResult, path: str) -> None:
    """Those of the registration, each with the number of its joint in the pictures."""
    import numpy as np

    from .. import io

    registration = result.registration
    joints = np.array([source for source, _ in registration.joints])
    names = []
    for row in registration.landmarks:
        gaps = np.hypot(*(joints - row[:2]).T)
        # A landmark between joints has no number.
        names.append(str(gaps.argmin()) if gaps.min() <= ROUNDING * result.multipatch.diameter else "")
    io.write_landmarks(registration.landmarks, path, names)


def _draw_transfer(source: MultiPatch, target: Boundary, result: TransferResult, path: str) -> None:
    from ..plot import figures as plot

    metrics, proved = result.quality.scaled_jacobian, result.quality.proved
    least = f"minimum scaled Jacobian {metrics.min:.3f} of samples" if proved is None else str(proved).partition(";")[0]
    caption = (
        f"{result.certificate.status}; {least}; mean {metrics.mean:.3f} of samples; "
        f"C1 on {result.continuity.c1_share:.2f} of the interfaces' length"
    )
    plot.savefig(plot.transfer(source, target, result.multipatch, caption=caption), path)


def _draw_registration(source: MultiPatch, target: Boundary, result: TransferResult, path: str) -> None:
    from ..plot import figures as plot

    figure = plot.registration(
        source.boundary(),
        result.multipatch.boundary(),
        [[*a, *b] for a, b in result.registration.joints],
        target,
        matched=result.registration.pairs(120),
        confidence=result.registration.confidence,
    )
    plot.savefig(figure, path)
