"""Fields beside a model, each a spline of its own on every patch, brought into one space with the geometry."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from ..errors import InputError
from ..geometry.basis import collocation_matrix, greville
from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch
from ..numeric.arrays import FloatArray
from ..numeric.dense import solve

__all__ = ["SplineField", "in_one_space"]

#: Knots and degree in one direction.
Direction = tuple[FloatArray, int]


class Component(Protocol):
    """A scalar field: on every patch a spline in its parameters."""

    def directions(self, k: int) -> tuple[Direction, Direction]:
        """Knots and degrees on patch k."""

    def grid(self, k: int, u: FloatArray, v: FloatArray) -> FloatArray:
        """Values (len(u), len(v)) on patch k."""


@runtime_checkable
class SplineField(Protocol):
    """What has components: a field, or a solution of `patchtransfer.iga`."""

    @property
    def components(self) -> Sequence[Component]:
        """One of a scalar field, two of a vector field."""


def in_one_space(mp: MultiPatch, fields: Mapping[str, SplineField]) -> tuple[MultiPatch, dict[str, list[FloatArray]]]:
    """The same geometry in a spline space that holds the fields as well, and their coefficients (n_u, n_v, d) there.

    On rational patches these are of rational functions with the patch's weights. Vectors get a third component, 0.

    Raises
    ------
    InputError
        On a field of another model.
    """
    patches: list[Patch] = []
    out: dict[str, list[FloatArray]] = {name: [] for name in fields}
    for k, patch in enumerate(mp.patches):
        pairs = [(name, c, c.directions(k)) for name, field in fields.items() for c in field.components]
        for name, _, directions in pairs:
            for axis, (knots, _) in enumerate(directions):
                if knots[0] != patch.knots[axis][0] or knots[-1] != patch.knots[axis][-1]:
                    raise InputError(f"field {name!r}: patch {k} has other parameters in the model; is it another's?")
        finer = _raised(patch, [d for *_, d in pairs])
        patches.append(finer)
        for name, field in fields.items():
            found = [_coefficients(finer, c, k) for c in field.components]
            # Vectors have three components in VTK: what warps by a field, or draws arrows, takes no others.
            found += [np.zeros_like(found[0])] * (len(found) == 2)
            out[name].append(np.stack(found, axis=2))
    return MultiPatch(patches, mp.interfaces, mp.ids, mp.sides, mp.blocks), out


def _raised(patch: Patch, fields: Sequence[tuple[Direction, Direction]]) -> Patch:
    """The patch in a space that holds the fields; on a rational patch their products with the weights."""
    rational = patch.weights is not None
    highest = [max(d[axis][1] + rational * p for d in fields) for axis, p in enumerate(patch.degrees)]
    finer = patch.elevate(max(0, *(h - p for h, p in zip(highest, patch.degrees, strict=True))))
    for axis in (0, 1):
        new: list[float] = []
        degree, own = finer.degrees[axis], finer.knots[axis]
        smoothness = _smoothness(own, degree)
        for field in fields:
            for t, r in _smoothness(*field[axis]).items():
                smoothness[t] = min(r, smoothness.get(t, degree))
        for t, r in smoothness.items():
            new += [t] * (degree - r - int(np.count_nonzero(own == t)))
        if new:
            finer = finer.insert_knots(axis, sorted(new))
    return finer


def _smoothness(knots: FloatArray, degree: int) -> dict[float, int]:
    """Continuous derivatives at every knot inside."""
    inside = [float(t) for t in knots if knots[0] < t < knots[-1]]
    return {t: degree - inside.count(t) for t in inside}


def _coefficients(patch: Patch, field: Component, k: int) -> FloatArray:
    """Coefficients (n_u, n_v) of a field in the space of a patch, by interpolation, which is exact there."""
    u, v = (greville(knots, p) for knots, p in zip(patch.knots, patch.degrees, strict=True))
    values = field.grid(k, u, v)
    matrices = [collocation_matrix(k, p, t) for k, p, t in zip(patch.knots, patch.degrees, (u, v), strict=True)]
    if patch.weights is None:
        return _solved(matrices, values)
    denominator = np.einsum("ai,ij,bj->ab", matrices[0], patch.weights, matrices[1])
    return _solved(matrices, values * denominator) / patch.weights


def _solved(matrices: Sequence[FloatArray], values: FloatArray) -> FloatArray:
    return np.ascontiguousarray(solve(matrices[1], np.ascontiguousarray(solve(matrices[0], values).T)).T)
