"""Conditions on the flux through sides: ∂u/∂n = h (Neumann), or ∂u/∂n = h - α u (Robin)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..geometry.multipatch import MultiPatch
from ..geometry.sides import Side
from ..numeric.arrays import FloatArray, IntArray
from ..numeric.dense import product
from .nodes import ScalarFunction, SideNodes, sampled
from .shape import Sensitivity, slope_of
from .space import SplineSpace

__all__ = ["Flux", "Neumann", "Robin", "add_flux_matrix", "add_flux_work", "flux_load", "fluxes_of", "on_sides"]

#: What a flux is on the sides of labels.
Neumann = Mapping[str, ScalarFunction | float]
#: Pairs (α, h): ∂u/∂n + α u = h.
Robin = Mapping[str, tuple[ScalarFunction | float, ScalarFunction | float]]
VALUE, RATE = "flux", "Robin coefficient"


@dataclass(frozen=True, eq=False)
class Flux:
    """∂u/∂n = value - rate u on a side; without a rate the flux is given."""

    side: SideNodes
    value: ScalarFunction
    rate: ScalarFunction | None

    def sampled(self) -> tuple[FloatArray, FloatArray]:
        """Value and rate at the nodes."""
        value = sampled(self.value, self.side.x, VALUE, self.side.name)
        if self.rate is None:
            return value, np.zeros_like(value)
        rate = sampled(self.rate, self.side.x, RATE, self.side.name)
        if rate.min() < 0:
            x, y = self.side.x[:, int(rate.argmin())]
            raise InputError(
                f"{RATE} on {self.side.name}: {rate.min():.3g} at ({x:.6g}, {y:.6g}); it is 0 or more, or the equation "
                "may have no solution"
            )
        return value, rate


def on_sides(mp: MultiPatch, given: Mapping[str, object], what: str) -> dict[tuple[int, Side], str]:
    """The boundary sides of labels, each with its label.

    Raises
    ------
    InputError
        On a label that the model does not have, one on an interface, and a side with two labels.
    """
    boundary, owner = set(mp.boundaries), dict[tuple[int, Side], str]()
    for label in given:
        if label not in mp.sides:
            known = ", ".join(map(repr, mp.sides)) or "none"
            raise InputError(f"{what}: the model has no label {label!r}; its labels are {known}")
        for k, side in mp.sides[label]:
            name = f"{what}: patch {k} {side.name.lower()} of label {label!r}"
            if (k, side) not in boundary:
                raise InputError(f"{name} is glued to another patch; name sides of the boundary")
            if (k, side) in owner:
                raise InputError(f"{name} has values by label {owner[k, side]!r} already; give it one")
            owner[k, side] = label
    return owner


def fluxes_of(
    mp: MultiPatch, neumann: Neumann | None, robin: Robin | None
) -> dict[tuple[int, Side], tuple[ScalarFunction, ScalarFunction | None]]:
    """Value and rate of every side with a condition on its flux; `InputError` on sides that have two."""
    out: dict[tuple[int, Side], tuple[ScalarFunction, ScalarFunction | None]] = {}
    for at, label in on_sides(mp, neumann or {}, "Neumann data").items():
        assert neumann is not None
        out[at] = as_function(neumann[label]), None
    for (k, side), label in on_sides(mp, robin or {}, "Robin data").items():
        assert robin is not None
        pair = robin[label]
        if not isinstance(pair, tuple | list) or len(pair) != 2:
            raise InputError(f"Robin data: label {label!r} needs a pair (α, h) of ∂u/∂n + α u = h, got {pair!r}")
        if (k, side) in out:
            raise InputError(f"Robin data: patch {k} {side.name.lower()} of label {label!r} has Neumann data already")
        out[k, side] = as_function(pair[1]), as_function(pair[0])
    return out


def as_function(value: ScalarFunction | float) -> ScalarFunction:
    """A constant as a function of (x, y)."""
    return value if callable(value) else lambda x, y: np.full_like(x, value)


def flux_load(space: SplineSpace, fluxes: Sequence[Flux]) -> FloatArray:
    """∮ value φ ds, (n,)."""
    out = np.zeros(space.size)
    for flux in fluxes:
        basis, number = _on(space, flux)
        np.add.at(out, number, product(basis.T, flux.side.ds * flux.sampled()[0]))
    return out


def add_flux_matrix(
    values: FloatArray, indptr: IntArray, indices: IntArray, space: SplineSpace, fluxes: Sequence[Flux]
) -> FloatArray:
    """An upper triangle with ∮ rate φ ψ ds added, in its own pattern."""
    out, n = values.copy(), len(indptr) - 1
    places = np.repeat(np.arange(n), np.diff(indptr)) * n + indices
    for flux in fluxes:
        if flux.rate is None:
            continue
        basis, number = _on(space, flux)
        mass = product(basis.T, (flux.side.ds * flux.sampled()[1])[:, None] * basis)
        rows, columns = np.meshgrid(number, number, indexing="ij")
        upper = rows <= columns
        at = np.searchsorted(places, columns[upper] * n + rows[upper])
        np.add.at(out, at, mass[upper])
    return out


def add_flux_work(
    out: Sensitivity, space: SplineSpace, fluxes: Sequence[Flux], u: FloatArray, v: FloatArray, diameter: float
) -> None:
    """Of the geometry in ∮ (value - rate u) v ds, coefficients held."""
    for flux in fluxes:
        basis, number = _on(space, flux)
        at_u, at_v = product(basis, u[number]), product(basis, v[number])
        value, rate = flux.sampled()
        force = slope_of(flux.value, diameter)(flux.side.x, VALUE, flux.side.name)
        if flux.rate is not None:
            force = force - at_u * slope_of(flux.rate, diameter)(flux.side.x, RATE, flux.side.name)
        out.add_side(flux.side, (value - rate * at_u) * at_v * flux.side.tangent, force * at_v)


def _on(space: SplineSpace, flux: Flux) -> tuple[FloatArray, IntArray]:
    """The basis functions of a side at its nodes, and their numbers."""
    side = flux.side
    return side.nodes.field[side.side.axis][0], side.side.of(space.points[side.patch]).ravel()
