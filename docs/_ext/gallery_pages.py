"""The gallery: order of its scripts, and pictures of figures made without pyplot, as `patchtransfer.plot` does."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib.animation import Animation, PillowWriter
from matplotlib.figure import Figure
from sphinx_gallery.scrapers import figure_rst

from patchtransfer.plot import savefig

#: What comes first; other scripts follow by name.
ORDER = (
    "tutorial",
    "samples",
    "landmarks",
    "own_outline",
    "own_layout",
    "conics",
    "alphabet",
    "airfoils",
    "continuity",
    "similarity",
    "morph",
    "deform",
    "batch",
    "poisson",
    "reduced_order_model",
    "torsion",
    "plate_with_hole",
    "sensitivity",
)


def order(filename: str) -> tuple[int, str]:
    """Sort key of a script."""
    name = filename.removesuffix(".py")
    return ORDER.index(name) if name in ORDER else len(ORDER), name


def scrape(block: Any, block_vars: dict[str, Any], gallery_conf: dict[str, Any]) -> str:
    """Save figures and animations among the script's variables that no earlier block has shown."""
    paths, values = [], list(block_vars["example_globals"].values())
    films = [value for value in values if isinstance(value, Animation) and not hasattr(value, "in_gallery")]
    for film in films:
        film.in_gallery = film._fig.in_gallery = True
    for value in values:
        if isinstance(value, Figure) and not hasattr(value, "in_gallery"):
            value.in_gallery = True
            path = next(block_vars["image_path_iterator"])
            savefig(value, path, dpi=110)
            paths.append(path)
    # After the pictures, the first of which stands for the script.
    for film in films:
        path = Path(next(block_vars["image_path_iterator"])).with_suffix(".gif")
        film.save(path, writer=PillowWriter(fps=3), dpi=80)
        paths.append(str(path))
    return figure_rst(paths, gallery_conf["src_dir"])
