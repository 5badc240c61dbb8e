"""Pictures: iso-parametric lines coloured by quality, boundaries and their correspondence, fields, animations."""

from .continuity import c1_spans
from .dilatation import dilatation
from .fields import solution
from .figures import boundary, html, multipatch, png, registration, savefig, slope_difference, transfer

__all__ = [
    "boundary",
    "c1_spans",
    "dilatation",
    "html",
    "multipatch",
    "png",
    "registration",
    "savefig",
    "slope_difference",
    "solution",
    "transfer",
]
