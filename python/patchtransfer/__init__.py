"""Parameterization transfer for isogeometric analysis, with a proof of injectivity."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from ._core import __version__
from .continuity import ContinuityReport, check_continuity
from .errors import InfeasibleTargetError, InputError, NotCertifiedError, TransferError
from .multipatch import Boundary, Interface, MultiPatch, Side
from .quality import Quality, quality
from .splines import BSplineCurve, Patch

__all__ = [
    "BSplineCurve",
    "Boundary",
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
    "check_continuity",
    "plot",
    "quality",
]


def __getattr__(name: str) -> ModuleType:
    # Loaded on first use: drawing is optional for everything else.
    if name == "plot":
        return import_module(".plot", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
