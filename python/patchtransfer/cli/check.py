"""Command line: ``patchtransfer check FILE``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from ..errors import InputError
from ..files import write_atomic
from ..progress import Clock
from .delivery import figures, summary
from .options import html_option, json_option, volume_options
from .streams import say
from .support import NOT_CERTIFIED, Report, all_or_nothing, check_outputs, command_line, failures, keep_inputs
from .watch import read_model, watched

__all__ = ["check"]


@click.command()
@click.argument("file", type=click.Path())
@html_option
@json_option
@volume_options
def check(file: str, html_path: str | None, json_path: str | None) -> None:
    """Topology, certificate, quality and continuity of the multi-patch FILE."""
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
        with watched() as progress:
            clock = Clock(progress)
            model = read_model(clock, file)
            with clock("certificate") as stage:
                certificate = certify(model)
                stage.found = certificate.status
            degenerate = [(cell.patch, cell.corner) for cell in certificate.cells if cell.kind == "degenerate"]
            with clock("sides") as stage:
                unglued = [c.text for c in coincidences(model.patches, model.interfaces)]
                stage.found = f"{len(unglued)} without interface that coincide"
            with clock("quality") as stage:
                metrics = quality(model, exclude=degenerate, proved=can_be_proved(model))
                stage.found = figures(metrics)
            with clock("continuity") as stage:
                continuity = check_continuity(model)
                stage.found = f"C1 on {continuity.c1_share:.2f} of the interfaces' length"
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

                with watched() as progress, Clock(progress)("writing") as stage:
                    page = model_page(model, certificate, metrics, continuity, command=command_line(), warnings=unglued)
                    write_atomic(Path(html_path), page)
                    stage.found = html_path
            report.write(content)
            if json_path != "-":
                summary(content, None)
                say(*certificate.reasons, *(text for text in unglued if text not in certificate.reasons))
    sys.exit(0 if certificate.injective else NOT_CERTIFIED)


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
