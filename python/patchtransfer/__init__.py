"""Parameterization transfer for isogeometric analysis, with a proof of injectivity."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from ._core import __version__
from .certificate import Certificate, certify
from .continuity import ContinuityReport, check_continuity
from .errors import InfeasibleTargetError, InputError, NotCertifiedError, TransferError
from .io import read, read_boundary, read_landmarks, write
from .multipatch import Boundary, Interface, MultiPatch, Side
from .quality import Quality, quality
from .splines import BSplineCurve, Patch

__all__ = [
    "BSplineCurve",
    "Boundary",
    "Certificate",
    "ContinuityReport",
    "InfeasibleTargetError",
    "InputError",
    "Interface",
    "MultiPatch",
    "NotCertifiedError",
    "Patch",
    "Quality",
    "Side",
    "TransferError",
    "__version__",
    "read",
    "read_boundary",
    "read_landmarks",
    "write",
    "certify",
    "check_continuity",
    "plot",
    "quality",
]


def __getattr__(name: str) -> ModuleType:
    # Loaded on first use: drawing is optional for everything else.
    if name == "plot":
        return import_module(".plot", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
