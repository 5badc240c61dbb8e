"""Real models, from the folder that PATCHTRANSFER_MODELS names; tests that need them are skipped without it."""

import os
from pathlib import Path

import pytest

from patchtransfer import MultiPatch, read

_FOLDER = os.environ.get("PATCHTRANSFER_MODELS")

#: Mark of tests that read real models.
needed = pytest.mark.skipif(not _FOLDER, reason="PATCHTRANSFER_MODELS is not set")


def path(name: str) -> Path:
    """The file of a model."""
    return Path(_FOLDER or "") / f"{name}.xml"


def model(name: str) -> MultiPatch:
    """A model by its name: yeti, turtle, disc, ..."""
    return read(path(name))
