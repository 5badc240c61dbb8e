"""Best approximation in L², what an error is measured against."""

from __future__ import annotations

import numpy as np

from ..geometry.multipatch import MultiPatch
from .nodes import ScalarFunction, all_nodes, geometry_at, sampled
from .space import Field, SplineSpace
from .system import Assembler, DefiniteSystem

__all__ = ["l2_projection"]


def l2_projection(space: SplineSpace, mp: MultiPatch, f: ScalarFunction, quadrature: int | None = None) -> Field:
    """Function of the space nearest to f in L²(Ω).

    Parameters
    ----------
    space : SplineSpace
    mp : MultiPatch
        The geometry; its interfaces are the space's.
    f : callable
        ``f(x, y)`` of arrays.
    quadrature : int, optional
        Gauss nodes per span and direction; default one more than the larger degree of field and geometry.

    Returns
    -------
    Field

    Raises
    ------
    InputError
        When f fails or the model is folded; the message names the patch.

    Examples
    --------
    >>> from patchtransfer import examples, iga
    >>> source, _, _ = examples.load("star")
    >>> space = iga.SplineSpace(source, degree=3, points=8)
    >>> field = iga.l2_projection(space, source, lambda x, y: x * y)
    >>> iga.error_norms(field, source, lambda x, y: x * y).max < 1e-3
    True
    """
    nodes = all_nodes(space, mp, quadrature)
    assembler = Assembler(space, nodes)
    maps = geometry_at(mp, nodes)
    mass = assembler.values([(0, 0)], [at.dx[None] for at in maps])
    load = space.gather([at.nodes.tested(at.dx * sampled(f, at.x, "function", f"patch {at.index}")) for at in maps])
    x, _ = DefiniteSystem(assembler.indptr, assembler.indices).solve(mass, load, np.zeros(space.size))
    return Field(space, x)
