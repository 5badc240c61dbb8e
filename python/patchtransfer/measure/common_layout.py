"""Two models of one layout in one spline space: the map from the one to the other, patch by patch."""

from __future__ import annotations

import numpy as np

from .._core import MAX_COMPARED_DEGREES
from ..errors import InputError
from ..geometry.conformity.overlaps import missing_knots
from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch
from ..geometry.sides import Interface
from ..numeric.arrays import FloatArray

__all__ = ["common_layout", "same_layout"]

TRANSFER = (
    "`pt.transfer(a, b.boundary())` carries a's layout over to b's shape, and its `result.dilatation` compares these"
)


def same_layout(a: MultiPatch, b: MultiPatch) -> str | None:
    """Why two models cannot be compared patch by patch; None if they can."""
    if len(a) != len(b):
        return f"the models have {len(a)} and {len(b)} patches"
    for k, (p, q) in enumerate(zip(a.patches, b.patches, strict=True)):
        if p.degrees != q.degrees:
            return f"patch {k} has the degrees {p.degrees} in one model and {q.degrees} in the other"
        most = MAX_COMPARED_DEGREES[p.weights is not None or q.weights is not None]
        if max(p.degrees) > most:
            kind = "polynomial" if most == MAX_COMPARED_DEGREES[0] else "rational"
            return (
                f"patch {k} has the degrees {p.degrees}, above {most}, the largest of {kind} patches that are compared"
            )
    others = {_ends(f) for f in a.interfaces} ^ {_ends(f) for f in b.interfaces}
    if others:
        (k, side), (m, other), _ = min(others)
        return f"only one of the models glues patch {k} to patch {m} (sides {side} and {other}) like that"
    return None


def _ends(f: Interface) -> tuple[tuple[int, int], tuple[int, int], bool]:
    """An interface whichever of its patches comes first."""
    one, other = sorted([(f.patch_a, int(f.side_a)), (f.patch_b, int(f.side_b))])
    return one, other, f.reversed


def common_layout(a: MultiPatch, b: MultiPatch) -> tuple[MultiPatch, MultiPatch]:
    """Both models with the knots of both, those of `b` on the parameters of `a`.

    A mirror image of the layout, all of whose patches have the other hand, is mirrored (x -> -x).

    Raises
    ------
    InputError
        When they are not of one layout.
    """
    reason = same_layout(a, b)
    if reason is not None:
        raise InputError(f"similarity: {reason}; compare models of one layout: {TRANSFER}")
    if (a.topology.orientation == -b.topology.orientation).all():
        b = b.with_control_points([patch.control_points * [-1.0, 1.0] for patch in b.patches])
    if all(
        np.array_equal(s, t)
        for p, q in zip(a.patches, b.patches, strict=True)
        for s, t in zip(p.knots, q.knots, strict=True)
    ):
        return a, b
    pairs = [_common(p, q) for p, q in zip(a.patches, b.patches, strict=True)]
    return MultiPatch([p for p, _ in pairs], a.interfaces), MultiPatch([q for _, q in pairs], a.interfaces)


def _common(a: Patch, b: Patch) -> tuple[Patch, Patch]:
    for axis in range(2):
        if np.array_equal(a.knots[axis], b.knots[axis]):
            continue
        b = _with_knots(b, axis, _on_domain(b.knots[axis], a.knots[axis]))
        a = a.insert_knots(axis, missing_knots(a.knots[axis], b.knots[axis], a.degrees[axis]))
        b = b.insert_knots(axis, missing_knots(b.knots[axis], a.knots[axis], a.degrees[axis]))
        # What is left is rounding.
        b = _with_knots(b, axis, a.knots[axis])
    return a, b


def _on_domain(knots: FloatArray, others: FloatArray) -> FloatArray:
    """Knots mapped to the domain of others, its ends to the bit."""
    low, high = others[0], others[-1]
    if (knots[0], knots[-1]) == (low, high):
        return knots
    moved = low + (knots - knots[0]) * ((high - low) / (knots[-1] - knots[0]))
    return np.asarray(np.where(knots == knots[0], low, np.where(knots == knots[-1], high, moved)))


def _with_knots(patch: Patch, axis: int, knots: FloatArray) -> Patch:
    both = (knots, patch.knots[1]) if axis == 0 else (patch.knots[0], knots)
    return Patch(both, patch.degrees, patch.control_points, patch.weights)
