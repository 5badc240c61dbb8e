"""What Poisson's equation is given: right-hand side, values and fluxes on sides, with defaults put in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ..errors import InputError
from ..geometry.multipatch import MultiPatch
from ..geometry.sides import Side
from .fluxes import Neumann, Robin, as_function, fluxes_of, on_sides
from .manufactured import Wave
from .nodes import ScalarFunction
from .norms import VectorFunction

__all__ = ["Conditions", "Dirichlet", "Load", "dirichlet_data", "problem"]

#: Values of a right-hand side: a function, a constant, or None for the default.
Load = ScalarFunction | float | None
#: Boundary values: everywhere, or label by label.
Dirichlet = Load | Mapping[str, ScalarFunction | float]
#: Boundary values with the defaults put in.
Values = ScalarFunction | Mapping[str, ScalarFunction | float]


def dirichlet_data(
    mp: MultiPatch, g: ScalarFunction | Mapping[str, ScalarFunction | float], what: str = "Dirichlet data"
) -> dict[tuple[int, Side], ScalarFunction]:
    """The boundary values of every side that has some.

    Raises
    ------
    InputError
        On a label that the model does not have, one on an interface, a side with two labels, or no side at all.
    """
    if not isinstance(g, Mapping):
        return dict.fromkeys(mp.boundaries, g)
    data = {at: as_function(g[label]) for at, label in on_sides(mp, g, what).items()}
    if not data:
        raise InputError(f"{what}: no side has values, and the solution is not unique; name a label with sides")
    return data


@dataclass(frozen=True, eq=False)
class Conditions:
    """What is given on the sides of a model: values, or fluxes."""

    values: dict[tuple[int, Side], ScalarFunction]
    fluxes: dict[tuple[int, Side], tuple[ScalarFunction, ScalarFunction | None]]

    @classmethod
    def of(cls, mp: MultiPatch, g: Values, neumann: Neumann | None, robin: Robin | None) -> Conditions:
        """Of what is given by label; `InputError` where a side has two, or no side has values."""
        fluxes = fluxes_of(mp, neumann, robin)
        if not fluxes:
            return cls(dirichlet_data(mp, g), fluxes)
        if isinstance(g, Mapping):
            values = dirichlet_data(mp, g) if g else {}
            for k, side in set(values) & set(fluxes):
                raise InputError(f"patch {k} {side.name.lower()} has Dirichlet data and a flux; give it one of them")
        else:
            values = {at: g for at in mp.boundaries if at not in fluxes}
        if not values and all(rate is None for _, rate in fluxes.values()):
            raise InputError(
                "every side has Neumann data, and the solution is not unique; give values (g) or Robin data on a side"
            )
        return cls(values, fluxes)


def problem(
    mp: MultiPatch,
    f: Load,
    g: Dirichlet,
    exact: ScalarFunction | None,
    gradient: VectorFunction | None,
    with_flux: bool = False,
) -> tuple[ScalarFunction, Values, ScalarFunction | None, VectorFunction | None]:
    """Fill in what is not given: the paper's problem without f, boundary values of the exact solution, or zero."""
    if f is None:
        if with_flux:
            raise InputError("conditions on fluxes need a right-hand side; give f (0.0 for none)")
        if exact is not None:
            raise InputError("a known solution needs its right-hand side f = −Δ exact too")
        wave = Wave.of_size(mp.diameter)
        f = wave.load
        if g is None:
            exact, gradient = wave, wave.gradient
    if g is None:
        g = exact if exact is not None else 0.0
    return as_function(f), g if isinstance(g, Mapping) else as_function(g), exact, gradient
