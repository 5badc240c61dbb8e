"""Isogeometric analysis on multi-patches: Poisson's equation with continuous splines."""

from .norms import ErrorNorms, error_norms
from .poisson import LinearSystem, PoissonResult, PoissonSolver, poisson
from .projection import l2_projection
from .space import Field, SplineSpace, Univariate

__all__ = [
    "ErrorNorms",
    "Field",
    "LinearSystem",
    "PoissonResult",
    "PoissonSolver",
    "SplineSpace",
    "Univariate",
    "error_norms",
    "l2_projection",
    "poisson",
]
