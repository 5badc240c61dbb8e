"""Sphinx configuration: ``sphinx-build -W -n -b html docs docs/_build``, without a network."""

from __future__ import annotations

import logging
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_ext"))

from numpydoc.xref import DEFAULT_LINKS

import patchtransfer

# A library that gallery scripts load shows all records of the root logger; thousands of stages would hide warnings.
logging.getLogger("patchtransfer").propagate = False

project = "patchtransfer"
author = "The patchtransfer developers"
project_copyright = author
version = release = patchtransfer.__version__

extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "bars",
    "checked_pages",
    "sphinx.ext.autosummary",
    "references",
    "shipped_mathjax",
    "sphinx.ext.extlinks",
    "sphinx.ext.intersphinx",
    "sphinx.ext.viewcode",
    "sphinx_click",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["_build", "inventories", "_ext", "_templates", "gallery"]
templates_path = ["_templates"]
# Single backticks in docstrings name other objects, and link where they can.
default_role = "py:in_backticks"
# Names of other projects that docstrings and pages mention, in the plain form of an inventory. The projects' own
# inventories would have to be fetched: a build would need the network, and end otherwise without it.
intersphinx_mapping = {
    project: (f"https://{where}", f"inventories/{project}.txt")
    for project, where in {
        "python": "docs.python.org/3/",
        "numpy": "numpy.org/doc/stable/",
        "scipy": "docs.scipy.org/doc/scipy/",
        "matplotlib": "matplotlib.org/stable/",
    }.items()
}

myst_enable_extensions = ["colon_fence", "dollarmath", "deflist"]
myst_heading_anchors = 3
extlinks = {"doi": ("https://doi.org/%s", "doi:%s")}

autosummary_generate = True
autodoc_typehints = "none"
autodoc_member_order = "bysource"
numpydoc_show_class_members = False
# Types in parameter lists link to the package's classes, and those of other projects that are named here.
numpydoc_xref_param_type = True
numpydoc_xref_ignore = "all"
numpydoc_xref_aliases = {word: word for word in DEFAULT_LINKS}
numpydoc_xref_aliases |= {name: f"patchtransfer.{name}" for name in patchtransfer.__all__ if name[0].isupper()}
numpydoc_xref_aliases |= {"Path": "pathlib.Path", "Axes": "matplotlib.axes.Axes"}
numpydoc_xref_aliases |= {"matplotlib.figure.Figure": "matplotlib.figure.Figure"}

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
