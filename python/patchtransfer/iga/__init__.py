"""Isogeometric analysis on multi-patches (§4 of the paper): fields of their own degree and knots on given geometries.

:func:`poisson` and :func:`elasticity` solve with fields that are continuous across patches, :func:`biharmonic` with C¹
fields, which exist on analysis-suitable G1 models. :class:`PoissonSolver` serves many models with the same patches,
such as all the targets of a transfer.
"""

from .biharmonic import BiharmonicResult, biharmonic
from .c1_space import C1Space
from .elasticity import ElasticityResult, elasticity
from .norms import ErrorNorms, error_norms
from .poisson import LinearSystem, PoissonResult, PoissonSolver, poisson
from .projection import l2_projection
from .space import Field, SplineSpace, Univariate

__all__ = [
    "BiharmonicResult",
    "C1Space",
    "ElasticityResult",
    "ErrorNorms",
    "Field",
    "LinearSystem",
    "PoissonResult",
    "PoissonSolver",
    "SplineSpace",
    "Univariate",
    "biharmonic",
    "elasticity",
    "error_norms",
    "l2_projection",
    "poisson",
]
