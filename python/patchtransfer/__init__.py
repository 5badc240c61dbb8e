"""Parameterization transfer for isogeometric analysis, with a proof of injectivity."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from . import interruption

# First of all: what follows takes a second to load.
interruption.leave_silently()

# ruff: noqa: E402
from ._core import __version__
from .certificate import Certificate, certify
from .continuity_report import ContinuityReport, check_continuity
from .deform import Deformer, DeformResult, deform
from .errors import InfeasibleTargetError, InputError, InputWarning, NotCertifiedError, TransferError
from .io import read, read_boundary, read_landmarks, write
from .layout import QuadLayout, from_layout
from .morph import Morph, morph
from .multipatch import Boundary, Interface, MultiPatch, Side
from .quality import Quality, quality
from .result import TransferResult
from .splines import BSplineCurve, Patch
from .transfer import TransferPlan, transfer

__all__ = [
    "BSplineCurve",
    "Boundary",
    "Certificate",
    "ContinuityReport",
    "DeformResult",
    "Deformer",
    "InfeasibleTargetError",
    "InputError",
    "InputWarning",
    "Interface",
    "Morph",
    "MultiPatch",
    "NotCertifiedError",
    "Patch",
    "QuadLayout",
    "Quality",
    "Side",
    "TransferError",
    "TransferPlan",
    "TransferResult",
    "__version__",
    "certify",
    "check_continuity",
    "deform",
    "from_layout",
    "iga",
    "morph",
    "plot",
    "quality",
    "read",
    "read_boundary",
    "read_landmarks",
    "transfer",
    "write",
]


def __getattr__(name: str) -> ModuleType:
    # Loaded on first use: drawing and analysis are optional for everything else.
    if name in ("iga", "plot"):
        return import_module(f".{name}", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
