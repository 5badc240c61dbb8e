"""Models and boundaries in notebooks: the picture of their page, and a table of facts beside it."""

from __future__ import annotations

import base64
import html as markup

from ..geometry.boundary import Boundary
from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch
from .figure import Figure, boundary_figure, model_figure
from .report import render

__all__ = ["html", "svg"]

#: Pixels of a picture at most.
WIDTH, HEIGHT = 560, 420


def svg(shown: MultiPatch | Patch | Boundary) -> str:
    """The picture of a model, a patch or a boundary as an SVG document of its own."""
    figure = _figure(shown)
    _, _, width, height = (float(x) for x in figure.view_box.split())
    scale = min(WIDTH / width, HEIGHT / height)
    return render("notebook.svg.j2", figure=figure, width=round(scale * width), height=round(scale * height))


def html(shown: MultiPatch | Patch | Boundary, picture: str) -> str:
    """A table of facts about a model, a patch or a boundary with its picture, an SVG document."""
    cells = "".join(
        f'<tr><th style="text-align:left">{markup.escape(name)}</th>'
        f'<td style="text-align:right">{markup.escape(str(value))}</td></tr>'
        for name, value in _facts(shown).items()
    )
    # As an image: its style and identifiers are its own, and notebooks that are not trusted show it, too.
    data = base64.b64encode(picture.encode()).decode("ascii")
    what = "curves" if isinstance(shown, Boundary) else "iso-parametric lines coloured by scaled Jacobian"
    return (
        '<div style="display:flex;flex-wrap:wrap;align-items:center;gap:1.5em">'
        f"<table><caption>{type(shown).__name__}</caption>{cells}</table>"
        f'<img alt="{what}" style="max-width:100%" src="data:image/svg+xml;base64,{data}"></div>'
    )


def _figure(shown: MultiPatch | Patch | Boundary) -> Figure:
    if isinstance(shown, Boundary):
        return boundary_figure(shown, "notebook", "boundary")
    # A patch alone may fold anywhere; it is drawn as it is, glued to nothing.
    model = MultiPatch([shown], []) if isinstance(shown, Patch) else shown
    return model_figure(model, "notebook", "model", detail=True, extras=False)[0]


def _facts(shown: MultiPatch | Patch | Boundary) -> dict[str, object]:
    """What the table in a notebook says, by name."""
    if isinstance(shown, Boundary):
        curves = [curve for loop in shown.loops for curve in loop]
        return {
            "loops": len(shown.loops),
            "curves": len(curves),
            "degrees": ", ".join(str(p) for p in sorted({curve.degree for curve in curves})),
            "control points": sum(len(curve.control_points) for curve in curves),
            "diameter": f"{shown.diameter:.4g}",
        }
    if isinstance(shown, Patch):
        return {
            "degrees": "{} × {}".format(*shown.degrees),
            "control points": "{} × {}".format(*shown.shape),
            "weights": "no" if shown.weights is None else "yes",
        }
    degrees = sorted({patch.degrees for patch in shown.patches})
    return {
        "patches": len(shown.patches),
        "degrees": ", ".join(f"{p} × {q}" for p, q in degrees),
        "control points": shown.topology.n_points,
        "interfaces": len(shown.interfaces),
        "holes": len(shown.loops) - 1,
        "extraordinary vertices": sum(vertex.extraordinary for vertex in shown.vertices),
    }
