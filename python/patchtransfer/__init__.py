"""Parameterization transfer for isogeometric analysis, with a proof of injectivity."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING

from . import interruption

# First of all: what follows takes a second to load.
interruption.leave_silently()

# ruff: noqa: E402
from ._core import __version__
from .errors import InfeasibleTargetError, InputError, InputWarning, TransferError
from .geometry import display
from .geometry.boundary import Boundary
from .geometry.curve import BSplineCurve
from .geometry.multipatch import MultiPatch
from .geometry.patch import Patch
from .geometry.sides import Interface, Side
from .io import read, read_boundary, read_landmarks, write
from .measure.continuity import ContinuityReport, check_continuity
from .measure.quality import Quality, quality
from .motion.deform import Deformer, DeformResult, deform
from .motion.morph import Morph, morph
from .pipeline.plan import TransferPlan, transfer
from .pipeline.result import NotCertifiedError, TransferResult
from .proof.certificate import Certificate, certify
from .sources.layout import QuadLayout, from_layout

if TYPE_CHECKING:
    from . import batch, examples, iga, plot, reproduce

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
    "batch",
    "certify",
    "check_continuity",
    "deform",
    "examples",
    "from_layout",
    "iga",
    "morph",
    "plot",
    "quality",
    "read",
    "read_boundary",
    "read_landmarks",
    "reproduce",
    "transfer",
    "write",
]


# Loaded on first use: drawing, analysis and what runs many transfers are optional for everything else.
_ON_FIRST_USE = ("batch", "examples", "iga", "plot", "reproduce")


def __getattr__(name: str) -> ModuleType:
    if name in _ON_FIRST_USE:
        return import_module(f".{name}", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return list(__all__)


display.draw_with(
    lambda shown: import_module(".plot", __name__).png(shown),
    lambda shown: import_module(".plot", __name__).html(shown),
)
