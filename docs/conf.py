"""Sphinx configuration: ``sphinx-build -W -b html docs docs/_build``."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

from numpydoc.xref import DEFAULT_LINKS

import patchtransfer

project = "patchtransfer"
author = "The patchtransfer developers"
project_copyright = author
version = release = patchtransfer.__version__

extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "bars",
    "sphinx.ext.autosummary",
    "sphinx.ext.extlinks",
    "sphinx.ext.mathjax",
    "sphinx_click",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["_build", "_ext", "_templates", "gallery"]
templates_path = ["_templates"]
# Single backticks in docstrings name other objects, and link where they can.
default_role = "py:obj"

myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 3
extlinks = {"doi": ("https://doi.org/%s", "doi:%s")}

autosummary_generate = True
autodoc_typehints = "none"
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
# Types in parameter lists link to the package's classes, and to nothing else.
numpydoc_xref_param_type = True
numpydoc_xref_ignore = "all"
numpydoc_xref_aliases = {word: word for word in DEFAULT_LINKS}
numpydoc_xref_aliases |= {name: f"patchtransfer.{name}" for name in patchtransfer.__all__ if name[0].isupper()}

sphinx_gallery_conf = {
    "examples_dirs": "gallery",
    "gallery_dirs": "auto_gallery",
    "within_subsection_order": "gallery_pages.order",
    "filename_pattern": r"\.py$",
    "image_scrapers": ("gallery_pages.scrape",),
    "abort_on_example_error": True,
    # A script that has not changed may still fail with another version of the package.
    "run_stale_examples": True,
    "write_computation_times": False,
    "download_all_examples": False,
    "remove_config_comments": True,
}

html_theme = "furo"
html_title = f"patchtransfer {release}"
html_static_path: list[str] = []
# Under the address that it has as its name.
html_extra_path = ["../python/patchtransfer/report.schema.json"]
html_show_copyright = False
