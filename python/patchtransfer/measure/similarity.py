"""How similar two models of one layout are: the dilatation of the map between them, and what it says about quality.

At a point the conformal class of a map's metric is a point of the hyperbolic plane. There log D, the scaled Jacobian
and the condition number are distances: of the two maps' classes, of a class from those of orthogonal and of square
nets. So the inverse hyperbolic functions of scaled Jacobian and condition number are 1-Lipschitz in log D
(``docs/similarity.md``, with proofs).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._core import COMPARED_NODES, compare_models, gauss
from ..errors import InputError
from ..files import finite_or_none
from ..geometry.multipatch import MultiPatch
from ..numeric.arrays import FloatArray
from .bounds import Bounds, check_width
from .common_layout import common_layout
from .corner_dilatation import corner_dilatations

__all__ = ["LowerBounds", "Similarity", "similarity"]

#: What exp and hyperbolic functions of a bound are off by at most, relative to it.
ROUNDING = 4 * float(np.finfo(float).eps)
#: Logarithms of dilatations below this are rounding: nothing is said of them.
NOTHING = 1e-6


@dataclass(frozen=True)
class LowerBounds:
    """What no map with this correspondence of the boundaries can go below, as logarithms of the largest dilatation.

    Attributes
    ----------
    corners : float
        Of every quasiconformal map, from the angles and the speeds at the joints of the boundary; up to 1e-9 of
        floating-point angles.
    energy : float or None
        Of every quasiconformal map, from Dirichlet energies: computed, for the quadrature of energies is not exact.
        None where it was not asked for, or a model folds.
    smooth : float
        Of every map that is differentiable at the corners which a single patch fills, as splines are.
    """

    corners: float
    energy: float | None
    smooth: float

    @property
    def best(self) -> float:
        """The largest of them: it holds for maps differentiable at the corners."""
        return max(self.corners, self.energy or 0.0, self.smooth)

    def __str__(self) -> str:
        every = max(self.corners, self.energy or 0.0)
        if self.best < NOTHING:
            return "nothing is known of the least one"
        if self.smooth > every:
            kind, said = "map differentiable at the corners", ""
        else:
            kind, said = "map", " (computed)" if every > self.corners else ""
        return f"no {kind} with this boundary correspondence below {_floor(math.exp(self.best))}{said}"

    def to_dict(self) -> dict[str, float | None]:
        """Plain data for JSON."""
        return {"corners": self.corners, "energy": self.energy, "smooth": self.smooth, "best": self.best}


@dataclass(frozen=True)
class Similarity:
    """How far the map between two models is from a similarity, with proved bounds.

    Attributes
    ----------
    dilatation : Bounds
        Of the largest ratio D of the map's singular values: 1 for a conformal map, infinite where it folds or a corner
        of one model is degenerate.
    log_dilatation : Bounds
        Of its logarithm, a metric between models of one layout.
    mean, rms, q95 : float
        Of log D over 5 x 5 Gauss points a knot span, every span alike: mean, root of the mean square, 95 % quantile.
    size : (Bounds, Bounds)
        Of the smallest and the largest log(det J_b / det J_a). A similarity has D = 1 and one size.
    least : LowerBounds or None
        What every map with this correspondence of the boundaries has at least; None if it was not asked for.
    cells : int
        Cells looked at beyond the patches' Bézier pieces.
    """

    dilatation: Bounds
    log_dilatation: Bounds
    mean: float
    rms: float
    q95: float
    size: tuple[Bounds, Bounds]
    least: LowerBounds | None
    cells: int

    def guaranteed_scaled_jacobian(self, scaled_jacobian: float) -> float:
        """Lower bound of the scaled Jacobian of one model where the other's is at least `scaled_jacobian`.

        Raises `InputError` when that is not in [0, 1].
        """
        s = scaled_jacobian
        if not 0 <= s <= 1:
            raise InputError(f"guaranteed_scaled_jacobian: {s} is no lower bound of a scaled Jacobian from 0 to 1")
        # sech(arsech s + log D), by the tangent of half the angle.
        half = s / (1 + math.sqrt((1 - s) * (1 + s))) / self.dilatation.upper
        return 2 * half / (1 + half * half) * (1 - ROUNDING)

    def guaranteed_condition_number(self, condition_number: float) -> float:
        """Upper bound of the condition number of one model where the other's is at most `condition_number`.

        Raises `InputError` when that is below 2.
        """
        k = condition_number
        if not k >= 2:
            raise InputError(
                f"guaranteed_condition_number: {k} is no upper bound of a condition number, which is 2 or more"
            )
        if math.isinf(k) or math.isinf(self.dilatation.upper):
            return math.inf
        root = k / 2 + math.sqrt((k / 2 - 1) * (k / 2 + 1))
        larger = root * self.dilatation.upper
        return (larger + 1 / larger) * (1 + ROUNDING)

    def __str__(self) -> str:
        bounds = self.dilatation
        if math.isinf(bounds.lower):
            said = "dilatation infinite (proved): a model folds or is degenerate"
        elif math.isinf(bounds.upper):
            said = "dilatation not bounded: a model folds or is degenerate"
        else:
            over = bounds.upper - 1
            said = f"dilatation at most {_ceil(bounds.upper) if over > NOTHING else f'1 + {over:.1g}'} (proved)"
        return said if self.least is None else f"{said}; {self.least}"

    def __repr__(self) -> str:
        return f"<Similarity: dilatation at most {self.dilatation.upper:.6g}, mean of log D {self.mean:.6g}>"

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON (infinity as None)."""
        return {
            "dilatation": self.dilatation.to_dict(),
            "log_dilatation": self.log_dilatation.to_dict(),
            "mean": finite_or_none(self.mean),
            "rms": finite_or_none(self.rms),
            "q95": finite_or_none(self.q95),
            "size": {name: bounds.to_dict() for name, bounds in zip(("min", "max"), self.size, strict=True)},
            "least": None if self.least is None else self.least.to_dict(),
            "cells": self.cells,
        }

    @staticmethod
    def from_dict(data: dict[str, Any]) -> Similarity:
        """Of `to_dict`; what is None there is infinite."""
        mean, rms, q95 = (math.inf if data[name] is None else data[name] for name in ("mean", "rms", "q95"))
        smallest, largest = (Bounds.from_dict(data["size"][name], -math.inf) for name in ("min", "max"))
        least = data["least"] and LowerBounds(*(data["least"][name] for name in ("corners", "energy", "smooth")))
        whole, log = (Bounds.from_dict(data[name]) for name in ("dilatation", "log_dilatation"))
        return Similarity(whole, log, mean, rms, q95, (smallest, largest), least, data["cells"])


def similarity(
    a: MultiPatch, b: MultiPatch, *, bounds: bool = True, energy: bool = True, width: float = 1e-3
) -> Similarity:
    """Measure how far two models of one layout are from similar: by the dilatation of the map between them.

    The map takes the point of a patch of `a` to the point of the same patch of `b` with the same parameters.

    Parameters
    ----------
    a, b : MultiPatch
        With the same patches, interfaces and degrees; where knots differ those of both are inserted into both. A mirror
        image counts as similar.
    bounds : bool, default True
        Whether to bound from below what any map with this correspondence of the boundaries has.
    energy : bool, default True
        Whether that includes Dirichlet energies, which take most of the time.
    width : float, default 1e-3
        How far proved bounds may be apart: relative to the dilatation, and to the ratio of sizes.

    Returns
    -------
    Similarity

    Raises
    ------
    InputError
        When the models are not of one layout, degrees exceed 14 (7 of rational patches), or `width` is not in (0, 1).

    Notes
    -----
    With tangents as complex numbers, D = (|Q| + |P|) / (|Q| - |P|), P = S_u T_v - S_v T_u, Q = T_u S̄_v - T_v S̄_u;
    |Q|² / |P|² is enclosed by Bernstein coefficients. Ahlfors, Lectures on quasiconformal mappings; Agard and Gehring,
    Angles and quasiconformal mappings (1965).

    Examples
    --------
    >>> from patchtransfer import MultiPatch, Patch
    >>> def rectangle(x, y):
    ...     return MultiPatch([Patch(([0, 0, 1, 1],) * 2, (1, 1), [[[0, 0], [0, y]], [[x, 0], [x, y]]])])
    >>> found = similarity(rectangle(2, 1), rectangle(3, 1))
    >>> round(found.dilatation.upper, 9), round(found.mean, 9)
    (1.5, 0.405465108)
    """
    check_width(width)
    s, t = common_layout(a, b)
    signs = tuple([float(sign) for sign in model.topology.orientation] for model in (s, t))
    cores = [[patch.to_core() for patch in model.patches] for model in (s, t)]
    log, (smallest, largest), cells, samples = compare_models(cores[0], cores[1], (signs[0], signs[1]), width)
    mean, rms, q95 = _statistics(samples)
    low, high = math.exp(log[0]) * (1 - ROUNDING), math.inf if log[1] > 700 else math.exp(log[1]) * (1 + ROUNDING)
    return Similarity(
        Bounds(max(low, 1.0), high, log[2]),
        Bounds(*log),
        mean,
        rms,
        q95,
        (Bounds(*smallest), Bounds(*largest)),
        _least(s, t, energy and bool(np.isfinite(samples).all())) if bounds else None,
        cells,
    )


def _least(s: MultiPatch, t: MultiPatch, energy: bool) -> LowerBounds:
    corners, smooth = corner_dilatations(s, t)
    if not energy:
        return LowerBounds(corners, None, smooth)
    # Only this needs SciPy.
    from .dirichlet import energy_dilatation

    return LowerBounds(corners, energy_dilatation(s, t), smooth)


def _statistics(samples: FloatArray) -> tuple[float, float, float]:
    """Mean, root of the mean square and 95 % quantile of samples at Gauss points, every span alike."""
    _, w = gauss(COMPARED_NODES)
    per_span = np.outer(w, w).ravel() / 4
    weights = np.tile(per_span, len(samples) // len(per_span)) * (len(per_span) / len(samples))
    # Equal numbers may round out of their range.
    largest = float(samples.max())
    mean = min(float((weights * samples).sum()), largest)
    rms = min(math.sqrt(float((weights * samples**2).sum())), largest)
    order = np.argsort(samples, kind="stable")
    at = np.searchsorted(np.cumsum(weights[order]), 0.95)
    return mean, rms, float(samples[order[min(int(at), len(order) - 1)]])


def _ceil(x: float) -> str:
    return f"{math.ceil(x * 100 - 1e-9) / 100:.2f}" if x < 1e4 else f"{x * 1.001:.3g}"


def _floor(x: float) -> str:
    return f"{math.floor(x * 100 + 1e-9) / 100:.2f}"
