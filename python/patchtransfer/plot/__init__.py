"""Pictures: iso-parametric lines coloured by quality, boundaries and their correspondence, fields, animations."""

from .continuity import c1_spans
from .dilatation import dilatation
from .fields import solution
from .figures import boundary, multipatch, png, registration, savefig, slope_difference, transfer
from .kinks import kinks

__all__ = [
    "boundary",
    "c1_spans",
    "dilatation",
    "kinks",
    "multipatch",
    "png",
    "registration",
    "savefig",
    "slope_difference",
    "solution",
    "transfer",
]
