"""The report of a result as one HTML file: pictures, the certificate in words, quality, continuity, times.

Nothing is loaded from anywhere, and everything but zooming, sorting and linked highlights is there without scripts.
"""

from __future__ import annotations

import platform
import sys
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .._core import __version__
from ..geometry.boundary import Boundary
from ..geometry.multipatch import MultiPatch
from ..measure.continuity import ContinuityReport
from ..measure.quality import Quality, sample
from ..pipeline.result import TransferResult, failure_of
from ..plot.palette import CLASSES, DARK, LIGHT, style
from ..proof.certificate import Certificate
from .figure import Figure, Place, boundary_figure, model_figure
from .picture import class_of

if TYPE_CHECKING:
    from jinja2 import Environment

__all__ = ["model_page", "render", "transfer_page"]

#: Matched points of a picture; more would overlap.
MATCHES = 48
#: Joints that get numbers; of more only the matched points are drawn.
MAX_JOINTS = 60
#: Bars of the histogram between 0 and 1.
BARS = 20


class Bar(NamedTuple):
    """A bar of the histogram: from `low` to `high`, `part` of the samples, in the colour of a class."""

    low: float
    high: float
    part: float
    height: float
    kind: int


def transfer_page(result: TransferResult, command: str | None = None, notes: Sequence[str] = ()) -> str:
    """The report of a transfer or a parameterization.

    Parameters
    ----------
    result : TransferResult
    command : str, optional
        The command line that makes it again.
    notes : sequence of str
        What else was noticed, as in the outline's file.

    Returns
    -------
    str
        A whole HTML document.
    """
    registration, source = result.registration, result._source
    target = Boundary([loop.target.curves for loop in registration.loops])
    pairs = registration.pairs(max(4, MATCHES // len(registration.loops)))
    joints = np.array([np.concatenate(joint) for joint in registration.joints])
    if result.mirrored:
        # The picture is of the mirrored source, the correspondence of the source's own points.
        pairs, joints = pairs * [-1, 1, 1, 1], joints * [-1, 1, 1, 1]
    if len(joints) > MAX_JOINTS:
        joints = joints[:0]
    figures: list[Figure] = []
    if source is not None:
        changed = " (mirrored)" * result.mirrored + " (split)" * (result.split is not None)
        title = f"source{changed}"
        figures.append(model_figure(source, "source", title, joints=joints[:, :2], matches=pairs[:, :2])[0])
    on_target = {"joints": joints[:, 2:], "matches": pairs[:, 2:]} if source is not None else {}
    figures.append(boundary_figure(target, "target", "target" if source is not None else "outline", **on_target))
    own, places = model_figure(
        result.multipatch, "result", "result", worst=True, matches=on_target.get("matches"), joints=None
    )
    error = failure_of(result)
    facts = {
        "patches": str(len(result.multipatch)),
        "control points": str(result.multipatch.topology.n_points),
        "boundary error": f"{result.boundary_error:.2e} of the diameter",
        "method": result.method,
    }
    if result.polish is not None:
        facts["polish"] = result.polish.words
    if source is not None:
        facts["confidence of the correspondence"] = f"{registration.confidence:.2f}"
    return render(
        "report.html.j2",
        title="Transfer" if source is not None else "Parameterization",
        ok=result.succeeded,
        figures=[*figures, own],
        facts=facts,
        **_evidence(result.multipatch, result.certificate, result.quality, result.continuity, places),
        error=None if error is None else str(error),
        warnings=[*result.warnings, *notes],
        log=result.log,
        timings=result.timings,
        command=command,
    )


def model_page(
    mp: MultiPatch,
    certificate: Certificate,
    quality: Quality,
    continuity: ContinuityReport,
    *,
    command: str | None = None,
    warnings: Sequence[str] = (),
) -> str:
    """The report of a model, as of ``patchtransfer check``; parameters as of `transfer_page`."""
    figure, places = model_figure(mp, "result", "model", worst=True)
    return render(
        "report.html.j2",
        title="Check",
        ok=certificate.injective,
        figures=[figure],
        facts={"patches": str(len(mp)), "control points": str(mp.topology.n_points)},
        **_evidence(mp, certificate, quality, continuity, places),
        error=None,
        warnings=warnings,
        log=(),
        timings={},
        command=command,
    )


def render(template: str, **context: Any) -> str:
    """A page of the package's templates, with style and script inside."""
    versions = {"patchtransfer": __version__, "NumPy": np.__version__, "Python": platform.python_version()}
    return (
        _environment()
        .get_template(template)
        .render(versions=versions, platform=sys.platform, classes=_legend(), **context)
    )


@cache
def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("patchtransfer.web"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    folder = files("patchtransfer.web") / "templates"
    environment.globals["palette_css"] = (
        f":root,:host{{{style(LIGHT)}}}@media (prefers-color-scheme: dark){{:root,:host{{{style(DARK)}}}}}"
    )
    for name in ("picture.css", "page.css", "page.js", "studio.css", "studio.js", "studio_page.js"):
        environment.globals[name.replace(".", "_")] = (folder / name).read_text("utf-8")
    return environment


def _legend() -> list[tuple[int, str]]:
    """Classes of the scaled Jacobian with their words, the best first."""
    ends = [f"{low:g} to {high:g}" for low, high in zip(CLASSES, (*CLASSES[1:], 1.0), strict=True)]
    return [*((k + 1, text) for k, text in reversed(list(enumerate(ends)))), (0, "folded")]


def _evidence(
    mp: MultiPatch,
    certificate: Certificate,
    quality: Quality,
    continuity: ContinuityReport,
    places: list[Place],
) -> dict[str, Any]:
    return {
        "certificate": certificate,
        "proof": _proof(mp, certificate),
        "quality": quality,
        "bars": _histogram(mp),
        "places": places,
        "continuity": continuity,
    }


def _proof(mp: MultiPatch, certificate: Certificate) -> list[str]:
    """What is proved, in words."""
    loops = len(certificate.boundary.orientation)
    boundary = "the boundary loop is simple" if loops == 1 else f"the {loops} boundary loops are simple and apart"
    glued = f"patches meet at {len(mp.interfaces)} interfaces with common control points"
    if certificate.status == "certified":
        return [
            f"det J > 0 everywhere in all {len(mp)} patches, at least {certificate.lower_bound:.3g} of its mean",
            glued,
            f"{boundary}, so that no two points of the inside have the same image",
            "proved for the numbers as they are stored, with bounds on all rounding, not sampled",
        ]
    if certificate.injective:
        corners = sum(cell.kind == "degenerate" for cell in certificate.cells)
        return [
            f"det J is zero at {corners} patch corners and positive everywhere else; the map is injective",
            glued,
            boundary,
            *certificate.reasons,
        ]
    return list(certificate.reasons)


def _histogram(mp: MultiPatch) -> list[Bar]:
    """Samples by scaled Jacobian; what is not positive in a bar of its own."""
    values = np.concatenate([scaled.ravel() for _, scaled in sample(mp)])
    edges = np.linspace(0, 1, BARS + 1)
    counts = np.histogram(np.minimum(values[values > 0], 1.0), edges)[0].tolist()
    rows = [(-1.0, 0.0, int((values <= 0).sum())), *zip(edges[:-1].tolist(), edges[1:].tolist(), counts, strict=True)]
    most = max(count for *_, count in rows) or 1
    return [
        Bar(low, high, count / len(values), count / most, int(class_of(np.array([(low + high) / 2]))[0]))
        for low, high, count in rows
    ]
