"""Errors of a discrete solution against a known one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..geometry.multipatch import MultiPatch
from ..numeric.arrays import FloatArray
from .nodes import GeometryAt, PatchNodes, ScalarFunction, all_nodes, geometry_at, sampled, sampled_vector
from .space import Field

__all__ = ["ErrorNorms", "VectorFunction", "error_norms"]

#: Arrays x, y to a tuple of arrays of their shape: a gradient (u_x, u_y) or a Hessian (u_xx, u_xy, u_yy).
VectorFunction = Callable[[FloatArray, FloatArray], Any]

#: Gauss nodes per span beyond the degree, so that the error's own quadrature does not show.
EXTRA_NODES = 3
#: Uniform intervals per span for the maximum.
SAMPLES = 8


@dataclass(frozen=True)
class ErrorNorms:
    """Errors u − u_h, absolute, in the model's units.

    Attributes
    ----------
    l2 : float
        ‖u − u_h‖ in L²(Ω).
    h1 : float or None
        ‖∇(u − u_h)‖ in L²(Ω), the H¹ seminorm; None without the exact gradient.
    h2 : float or None
        The H² seminorm; None without the exact second derivatives.
    max : float
        Largest |u − u_h| at the quadrature nodes and on a grid of 8 intervals a span, sides included.
    exact_l2, exact_max : float
        L² norm and largest value of the exact solution at the same nodes, for relative errors.
    """

    l2: float
    h1: float | None
    h2: float | None
    max: float
    exact_l2: float
    exact_max: float

    def __repr__(self) -> str:
        given = {"L2": self.l2, "H1": self.h1, "H2": self.h2, "largest": self.max}
        return f"<ErrorNorms: {', '.join(f'{k} {x:.2e}' for k, x in given.items() if x is not None)}>"


def error_norms(
    field: Field,
    mp: MultiPatch,
    exact: ScalarFunction,
    gradient: VectorFunction | None = None,
    hessian: VectorFunction | None = None,
) -> ErrorNorms:
    """Measure a field on a model against a known function.

    Parameters
    ----------
    field : Field
    mp : MultiPatch
    exact : callable
        ``exact(x, y)`` with arrays.
    gradient : callable, optional
        ``gradient(x, y)`` gives (u_x, u_y).
    hessian : callable, optional
        ``hessian(x, y)`` gives (u_xx, u_xy, u_yy).

    Returns
    -------
    ErrorNorms

    Raises
    ------
    InputError
        When a callable fails or the model is folded; the message names the patch.

    Examples
    --------
    >>> from patchtransfer import examples, iga
    >>> source, _, _ = examples.load("star")
    >>> field = iga.poisson(source, f=0.0, g=lambda x, y: x - 2 * y).field
    >>> iga.error_norms(field, source, lambda x, y: x - 2 * y).max < 1e-10
    True
    """
    squares = np.zeros(4)
    largest = size = 0.0
    finest = max(basis.degree for pair in field.space.bases for basis in pair)
    finest = max(finest, *(p for patch in mp.patches for p in patch.degrees))
    for k, at in enumerate(geometry_at(mp, all_nodes(field.space, mp, finest + EXTRA_NODES))):
        place, c = f"patch {k}", field.patch(k)
        u = sampled(exact, at.x, "exact solution", place)
        gap = u - at.nodes.value(c)
        squares[0] += (at.dx * gap**2).sum()
        squares[3] += (at.dx * u**2).sum()
        if gradient is not None:
            slopes = sampled_vector(gradient, at.x, 2, "exact gradient", place) - at.gradient(c)
            squares[1] += (at.dx * slopes**2).sum()
        if hessian is not None:
            bends = sampled_vector(hessian, at.x, 3, "exact second derivatives", place)
            bends = bends[np.array([[0, 1], [1, 2]])] - at.hessian(c)
            squares[2] += (at.dx * bends**2).sum()
        grid = GeometryAt(PatchNodes.uniform(field.space, mp.patches[k], k, SAMPLES), mp.patches[k], k, 1)
        on_grid = sampled(exact, grid.x, "exact solution", place)
        gap_on_grid = on_grid - grid.nodes.value(c)
        largest = max(largest, float(np.abs(gap).max()), float(np.abs(gap_on_grid).max()))
        size = max(size, float(np.abs(u).max()), float(np.abs(on_grid).max()))
    l2, h1, h2, exact_l2 = np.sqrt(squares).tolist()
    return ErrorNorms(l2, None if gradient is None else h1, None if hessian is None else h2, largest, exact_l2, size)
