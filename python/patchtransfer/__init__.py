"""Parameterization transfer for isogeometric analysis, with a proof of injectivity."""

from __future__ import annotations

from ._core import __version__
from .certificate import Certificate, certify
from .errors import InfeasibleTargetError, InputError, NotCertifiedError, TransferError
from .io import read, read_boundary, read_landmarks, write
from .multipatch import Boundary, Interface, MultiPatch, Side
from .splines import BSplineCurve, Patch

__all__ = [
    "BSplineCurve",
    "Boundary",
    "Certificate",
    "InfeasibleTargetError",
    "InputError",
    "Interface",
    "MultiPatch",
    "NotCertifiedError",
    "Patch",
    "Side",
    "TransferError",
    "__version__",
    "read",
    "read_boundary",
    "read_landmarks",
    "write",
    "certify",
]
