"""What lines are coloured by: quantities of a multi-patch at the samples of its iso-lines, on fixed scales.

Scales are the same for every picture, so that pictures can be compared: equal steps of the bar are classes with the
bounds that are written beside it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..errors import InputError
from ..geometry.areas import polygon_area
from ..geometry.basis import knot_spans
from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch
from ..measure.common_layout import common_layout
from ..measure.quality import sample
from ..numeric.arrays import FloatArray, IntArray
from .palette import CLASSES, LIGHT

if TYPE_CHECKING:
    from matplotlib.colors import BoundaryNorm, Colormap

__all__ = ["COLORS", "QUANTITIES", "Quantity", "area_of", "check_color", "values_of"]

#: Steps of colour in a class.
PARTS = 2
#: What stands for a place where the map folds, below all bounds.
NOWHERE = -1.0
#: Of a span: derivatives at knots are those inside.
INSIDE = 1e-7
#: Points of a side, for areas.
ON_SIDE = 20


@dataclass(frozen=True)
class Quantity:
    """What lines are coloured by.

    Attributes
    ----------
    label : str
        Beside the bar.
    bounds : tuple of float
        Of its classes, upwards.
    colors : tuple of str
        Of equal parts of the classes, upwards.
    worse : ufunc
        Which of two values is drawn where lines have both.
    relative : bool
        Whether it is of a map from another model.
    """

    label: str
    bounds: tuple[float, ...]
    colors: tuple[str, ...]
    worse: np.ufunc
    relative: bool = False

    @property
    def levels(self) -> FloatArray:
        """Bounds of the colours."""
        parts = len(self.colors) // (len(self.bounds) - 1)
        levels = np.append(np.linspace(self.bounds[:-1], self.bounds[1:], parts, endpoint=False).T, self.bounds[-1])
        # The smallest positive number: zero itself counts as folded.
        levels[0] = np.nextafter(levels[0], 1.0) if levels[0] == 0 else levels[0]
        return levels

    def scale(self) -> tuple[Colormap, BoundaryNorm]:
        """Colour map and norm for matplotlib."""
        from matplotlib.colors import BoundaryNorm, ListedColormap

        colormap = ListedColormap(list(self.colors)).with_extremes(under=LIGHT.folded, over=self.colors[-1])
        return colormap, BoundaryNorm(self.levels, len(self.colors))

    def level_of(self, values: FloatArray) -> IntArray:
        """The number of the colour that values have, -1 where folded."""
        levels = np.searchsorted(self.levels, values, side="right") - 1
        return np.asarray(np.clip(levels, -1, len(self.colors) - 1))


_UP = tuple(LIGHT.levels(PARTS))
_DOWN = _UP[::-1]
#: From what has shrunk, blue, over what is as it was, grey, to what is stretched, red.
_TWO_WAYS = ("#16308c", "#2f66c0", "#6a9fd4", "#98acb8", "#a09c96", "#b89a6a", "#d0800a", "#b8401e", "#6a1030")
_HALVES = (0.25, 0.4, 0.6, 0.8, 0.95)

QUANTITIES = {
    "scaled_jacobian": Quantity("scaled Jacobian", (*CLASSES, 1.0), _UP, np.minimum),
    "condition": Quantity("condition number", (2, 2.2, 2.5, 3, 4, 6, 10, 20, 50), _DOWN, np.maximum),
    "stretch": Quantity("stretch", (*_HALVES, *(round(1 / x, 2) for x in _HALVES[::-1])), _TWO_WAYS, np.maximum, True),
    "dilatation": Quantity("dilatation", (1, 1.1, 1.25, 1.5, 1.75, 2, 2.5, 3.5, 5), _DOWN, np.maximum, True),
}
#: What `color` can be, besides None.
COLORS = ("patch", *QUANTITIES)


def check_color(color: str | None, source: MultiPatch | None) -> None:
    """Raise `InputError` when there is no such colouring, or no source where one is needed."""
    if color is not None and color not in COLORS:
        raise InputError(f"color = {color!r} is unknown; use one of {', '.join(COLORS)}, or None")
    if color in QUANTITIES and QUANTITIES[color].relative and source is None:
        raise InputError(f"color = {color!r} is of the map from another model: give it as source=... (--source)")


class Sampled(NamedTuple):
    """A patch's points (m, n, 2) and the values (m, n) there."""

    points: FloatArray
    values: FloatArray


def values_of(color: str, mp: MultiPatch, samples: int, source: MultiPatch | None) -> list[Sampled]:
    """Points and values of all patches at `samples` parameters a knot span and direction, ends included.

    Raises
    ------
    InputError
        When `source` is not of the layout of `mp`.
    """
    grids = [Sampled(points, values) for points, values in sample(mp, samples)]
    if color == "scaled_jacobian":
        return grids
    if color == "condition":
        forms = [_metric(patch, samples) for patch in mp.patches]
        values = [_quotient((e + g), _det(e, f, g)) for e, f, g in forms]
    else:
        assert source is not None, "checked before"
        # The parameters are those of `mp`.
        mp, source = common_layout(mp, source)
        grids = [Sampled(*pair) for pair in sample(mp, samples)]
        pairs = [(_metric(a, samples), _metric(b, samples)) for a, b in zip(source.patches, mp.patches, strict=True)]
        values = [_of_map(color, *pair) for pair in pairs]
        if color == "stretch":
            scale = np.sqrt(area_of(mp) / area_of(source))
            values = [value / scale for value in values]
    return [
        Sampled(grid.points, np.where(grid.values > 0, value, NOWHERE))
        for grid, value in zip(grids, values, strict=True)
    ]


Metric = tuple[FloatArray, FloatArray, FloatArray]


def _metric(patch: Patch, samples: int) -> Metric:
    """E = B_u·B_u, F = B_u·B_v and G = B_v·B_v, at parameters that are drawn to the inside of their span."""
    u, v = (_parameters(knots, samples) for knots in patch.knots)
    jacobian = patch.jacobian(u[:, None], v)
    b_u, b_v = jacobian[..., 0], jacobian[..., 1]
    return (b_u * b_u).sum(axis=-1), (b_u * b_v).sum(axis=-1), (b_v * b_v).sum(axis=-1)


def _parameters(knots: FloatArray, samples: int) -> FloatArray:
    breaks = knot_spans(knots)
    inside = INSIDE * (breaks[1:] - breaks[:-1])
    return np.asarray(np.linspace(breaks[:-1] + inside, breaks[1:] - inside, samples).T.ravel())


def _det(e: FloatArray, f: FloatArray, g: FloatArray) -> FloatArray:
    return np.sqrt(np.maximum(e * g - f * f, 0.0))


def _quotient(over: FloatArray, under: FloatArray) -> FloatArray:
    """Infinite, not an error, where a map is degenerate."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return np.asarray(np.nan_to_num(over / under, nan=np.inf))


def _of_map(color: str, a: Metric, b: Metric) -> FloatArray:
    """Dilatation, or the factor of lengths in the mean of all directions, of the map between two patches."""
    (e, f, g), (p, q, r) = a, b
    first, second = _det(e, f, g), _det(p, q, r)
    if color == "stretch":
        return np.sqrt(_quotient(second, first))
    # Half the squared norm of the map's Jacobian, over its determinant.
    mean = np.maximum(_quotient(p * g - 2 * q * f + r * e, 2 * first * second), 1.0)
    with np.errstate(invalid="ignore", over="ignore"):
        return np.asarray(np.nan_to_num(mean + np.sqrt(mean**2 - 1), nan=np.inf))


def area_of(mp: MultiPatch) -> float:
    """Inside the outer loop and outside holes, which run the other way."""
    curves = [[side.curve(mp.patches) for side in loop] for loop in mp.loops]
    return sum(
        polygon_area(np.concatenate([curve(np.linspace(*curve.domain, ON_SIDE))[:-1] for curve in loop]))
        for loop in curves
    )
