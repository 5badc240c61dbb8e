"""MathJax beside the pages: they show formulas without a network, and tell nobody that they are read.

The files are those of MathJax's own release, in a package of PyPI that carries nothing else. Only what pages load is
copied, 1.6 of 22 MB: the component for TeX, and its fonts.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import mathjax

RELEASE = Path(mathjax.__file__).parent / "static" / "mathjax" / "es5"
COMPONENT = "tex-chtml.js"
FONTS = Path("output", "chtml", "fonts", "woff-v2")
#: Below ``_static``.
FOLDER = "mathjax"


def copied(app: Any) -> None:
    """Put them into the folder that is built."""
    if app.builder.format != "html":
        return
    folder = Path(app.outdir) / "_static" / FOLDER
    shutil.copytree(RELEASE / FONTS, folder / FONTS, dirs_exist_ok=True)
    shutil.copy(RELEASE / COMPONENT, folder)


def setup(app: Any) -> dict[str, bool]:
    """Set the path that `sphinx.ext.mathjax` asks for."""
    app.setup_extension("sphinx.ext.mathjax")
    app.config.mathjax_path = f"{FOLDER}/{COMPONENT}"
    app.connect("builder-inited", copied)
    return {"parallel_read_safe": True}
