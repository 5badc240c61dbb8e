"""Proved bounds of the scaled Jacobian and the condition number: between samples, too, and in spite of rounding."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from .._core import MAX_QUALITY_DEGREES, prove_quality
from ..errors import InputError
from ..files import finite_or_none
from ..geometry.multipatch import MultiPatch

__all__ = ["Bounds", "ProvedQuality", "can_be_proved", "check_width", "outwards", "proved_quality"]


@dataclass(frozen=True)
class Bounds:
    """A number between two bounds that hold in spite of rounding: proved ``lower <= x <= upper``.

    Attributes
    ----------
    lower, upper : float
        Infinite where nothing is known, or where the number is.
    at : (patch, u, v) or None
        Where the bound that is a value is taken: the upper one of a minimum, the lower one of a maximum.
    """

    lower: float
    upper: float
    at: tuple[int, float, float] | None = None

    def __repr__(self) -> str:
        where = "" if self.at is None else ", at patch {} ({:.6g}, {:.6g})".format(*self.at)
        return f"<Bounds: {self.lower:.6g} to {self.upper:.6g}{where}>"

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON (infinity as None)."""
        at = None if self.at is None else dict(zip(("patch", "u", "v"), self.at, strict=True))
        return {"lower": finite_or_none(self.lower), "upper": finite_or_none(self.upper), "at": at}

    @staticmethod
    def from_dict(data: dict[str, Any], least: float = math.inf) -> Bounds:
        """Of `to_dict`; what is None there is infinite, the lower bound `least`."""
        lower = least if data["lower"] is None else data["lower"]
        upper = math.inf if data["upper"] is None else data["upper"]
        return Bounds(lower, upper, None if data["at"] is None else tuple(data["at"].values()))


@dataclass(frozen=True)
class ProvedQuality:
    """Scaled Jacobian and condition number at their worst, proved.

    Attributes
    ----------
    min_scaled_jacobian : Bounds
        Of a folded model the upper bound is negative, and the lower one -1.
    max_condition_number : Bounds
        Infinite where det J <= 0 somewhere; the upper bound also where det J > 0 is not proved.
    cells : int
        Cells looked at beyond the patches' Bézier pieces.
    """

    min_scaled_jacobian: Bounds
    max_condition_number: Bounds
    cells: int

    def __repr__(self) -> str:
        jacobian, condition = self.min_scaled_jacobian, self.max_condition_number
        return (
            f"<ProvedQuality: scaled Jacobian at least {jacobian.lower:.6g}, condition number at most "
            f"{condition.upper:.6g}, {self.cells} cells>"
        )

    def __str__(self) -> str:
        return f"minimum scaled Jacobian {self._jacobian()}; maximum condition number {self._condition()}"

    def _jacobian(self) -> str:
        bounds = self.min_scaled_jacobian
        if bounds.upper < 0:
            return f"at most {_rounded(bounds.upper, math.ceil)}, proved"
        return f"{_rounded(bounds.lower, math.floor)}, proved" if bounds.lower >= 0 else "not proved to be positive"

    def _condition(self) -> str:
        bounds = self.max_condition_number
        if math.isinf(bounds.lower):
            return "infinite, proved"
        return f"{_rounded(bounds.upper, math.ceil)}, proved" if math.isfinite(bounds.upper) else "not bounded"

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON (infinity as None)."""
        return {
            "min_scaled_jacobian": self.min_scaled_jacobian.to_dict(),
            "max_condition_number": self.max_condition_number.to_dict(),
            "cells": self.cells,
        }

    @staticmethod
    def from_dict(data: dict[str, Any]) -> ProvedQuality:
        """Of `to_dict`."""
        jacobian, condition = (Bounds.from_dict(data[k]) for k in ("min_scaled_jacobian", "max_condition_number"))
        return ProvedQuality(jacobian, condition, data["cells"])


def outwards(x: float, digits: int, towards: Callable[[float], int]) -> float:
    """A bound with fewer digits that still holds, by `math.floor` of a lower and `math.ceil` of an upper one."""
    if x == 0 or not math.isfinite(x):
        return x
    unit = 10.0 ** (digits - 1 - math.floor(math.log10(abs(x))))
    return towards(x * unit) / unit


def _rounded(x: float, towards: Callable[[float], int]) -> str:
    return f"{outwards(x, 4, towards):.4g}"


def can_be_proved(mp: MultiPatch) -> bool:
    """Whether the degrees of all patches allow proved bounds of the quality."""
    return all(max(patch.degrees) <= MAX_QUALITY_DEGREES[patch.weights is not None] for patch in mp.patches)


def check_width(width: float) -> None:
    """Refuse widths of bounds that mean nothing."""
    if not 0 < width < 1:
        raise InputError(
            f"width = {width}: how far bounds may be apart, relative to their size, is above 0 and below 1"
        )


def proved_quality(mp: MultiPatch, excluded: Sequence[Sequence[int]], size: float, width: float) -> ProvedQuality:
    """Bounds of the smallest scaled Jacobian and the largest condition number.

    Parameters
    ----------
    mp : MultiPatch
    excluded : sequence of sequences of int
        Corners to leave out, patch by patch.
    size : float
        Of what is left out there, relative to the knot span.
    width : float
        How far bounds may be apart, relative to their size.

    Raises
    ------
    InputError
        On degrees that are too high, or a `width` outside of (0, 1).
    """
    check_width(width)
    for k, patch in enumerate(mp.patches):
        most = MAX_QUALITY_DEGREES[patch.weights is not None]
        if max(patch.degrees) > most:
            kind = "polynomial" if patch.weights is None else "rational"
            raise InputError(
                f"patch {k}: degrees {patch.degrees} exceed {most}, the largest of {kind} patches whose quality is "
                "proved; leave proved=True (--proved) out, and it is sampled"
            )
    cores = [patch.to_core() for patch in mp.patches]
    signs = [float(sign) for sign in mp.topology.orientation]
    jacobian, condition, cells = prove_quality(cores, signs, [list(c) for c in excluded], size, width)
    return ProvedQuality(Bounds(*jacobian), Bounds(*condition), cells)
