"""`Boundary`: closed loops of curves that bound a planar domain, an immutable value."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from .curve import BSplineCurve
from .display import Shown
from .origins import make
from .packing import PackedCurves, pack_curves, unpack_curves

__all__ = ["Boundary"]

#: Loops whose numbers of curves are told one by one; more are counted together, on one line.
SHOWN = 8


@dataclass(frozen=True, eq=False)
class Boundary(Shown):
    """Closed boundary loops of a planar domain, each a chain of curves.

    Parameters
    ----------
    loops : sequence of sequences of BSplineCurve
        Within a loop every curve ends where the next one starts, and the last where the first starts; order
        of the loops and their sense are free. (`patchtransfer.io` chains loose curves.)
    notes : sequence of str, optional
        What was changed or decided where it was read, each with its size; not part of comparisons.

    Raises
    ------
    InputError
        When a loop is empty or open; the message names loop and curve.

    Examples
    --------
    >>> from patchtransfer import Boundary
    >>> square = Boundary.from_points([(0, 0), (2, 0), (2, 2), (0, 2)])
    >>> square
    <Boundary: 1 loop of 4 curves>
    >>> square.loops[0][0](0.5).tolist()
    [1.0, 0.0]
    """

    loops: tuple[tuple[BSplineCurve, ...], ...]
    notes: tuple[str, ...]

    def __init__(self, loops: Iterable[Iterable[BSplineCurve]], notes: Iterable[str] = ()) -> None:
        chains = tuple(tuple(loop) for loop in loops)
        if not chains or not all(chains):
            raise InputError("a boundary needs at least one loop, and every loop at least one curve")
        object.__setattr__(self, "loops", chains)
        object.__setattr__(self, "notes", tuple(notes))
        tolerance = 1e-6 * self.diameter
        for k, loop in enumerate(chains):
            for i, curve in enumerate(loop):
                gap = float(np.linalg.norm(curve.end - loop[(i + 1) % len(loop)].start))
                if gap > tolerance:
                    raise InputError(
                        f"boundary loop {k} is open: curve {i} ends {gap:.3g} away from the start of curve "
                        f"{(i + 1) % len(loop)} (tolerance {tolerance:.3g}); close the loop"
                    )

    @classmethod
    def from_points(
        cls,
        loops: ArrayLike | Sequence[ArrayLike],
        *,
        smooth: bool | None = None,
        corner_angle: float = 30.0,
        clean: bool = True,
    ) -> Boundary:
        """Boundary through closed lists of points: polygons, or smooth curves with corners.

        Parameters
        ----------
        loops : (n, 2) array, or sequence of (n, 2) arrays
            At least 3 points a loop, in order; the first may be repeated at the end.
        smooth : bool, optional
            Whether the points are samples of smooth curves, through which cubic splines go (True), or corners of
            polygons (False); None (the default) decides for each loop by all turns together, and tells in ``notes``.
        corner_angle : float, default 30
            Turn, in degrees, from which a point of a smooth curve is a corner, where curves end.
        clean : bool, default True
            Mend what is plainly a slip: repeated points, edges of rounding, specks; ``notes`` tell. False refuses
            repeated points.

        Returns
        -------
        Boundary

        Raises
        ------
        InputError
            When a loop is no such array, or has fewer than 3 distinct points.

        Examples
        --------
        >>> import numpy as np
        >>> t = 2 * np.pi * np.arange(60) / 60
        >>> ring = Boundary.from_points([3 * np.c_[np.cos(t), np.sin(t)], [(-1, -1), (1, -1), (1, 1), (-1, 1)]])
        >>> ring
        <Boundary: 2 loops of 1, 4 curves>
        >>> ring.notes[0]
        'loop 1 (4 points): taken as corners of a polygon; smooth=True (--smooth) draws a smooth curve through them'
        """
        boundary: Boundary = make("points", loops, smooth=smooth, corner_angle=corner_angle, clean=clean)
        return boundary

    @classmethod
    def from_shapely(cls, polygon: Any, *, smooth: bool | None = None) -> Boundary:
        """Boundary of a Shapely polygon, holes included.

        Parameters
        ----------
        polygon : shapely.Polygon
            Or a MultiPolygon of one part. Third coordinates are left out, with a note.
        smooth : bool, optional
            Whether the rings are samples of smooth curves (True) or polygons (False); None (the default) decides by
            all turns together, as for points from CSV.

        Returns
        -------
        Boundary
            The outer loop first.

        Raises
        ------
        InputError
            When it is no polygon, empty, not valid, or has several parts.

        Examples
        --------
        >>> import shapely
        >>> Boundary.from_shapely(shapely.box(0, 0, 4, 3) - shapely.box(1, 1, 2, 2))
        <Boundary: 2 loops of 4, 4 curves>
        """
        boundary: Boundary = make("shapely", polygon, smooth=smooth)
        return boundary

    @classmethod
    def from_mask(
        cls,
        mask: ArrayLike,
        *,
        tolerance: float = 0.5,
        corner_angle: float = 30.0,
        smooth: bool | None = None,
    ) -> Boundary:
        """Boundary of the region that a mask or a grey image shows, smoothed.

        Parameters
        ----------
        mask : (rows, columns) array
            True inside. Numbers are grey levels: inside is above the mean of the smallest and the largest one, and
            the outline runs between the pixels where they say.
        tolerance : float, default 0.5
            How far the curves may be from the traced outline, in pixels; corners, which tracing cuts, are farther out
            by the length of the cut.
        corner_angle : float, default 30
            Least turn of a corner, in degrees. A turn counts where no circle follows the outline within the tolerance:
            what is rounder than pixels can tell stays smooth.
        smooth : bool, optional
            True for no corners at all, False for a polygon; None (the default) finds corners.

        Returns
        -------
        Boundary
            In pixels: that of row i and column j covers [j, j + 1] x [rows - 1 - i, rows - i], so that the picture is
            upright. The outer loop first. Specks and pinholes of up to 16 pixels are left out, with a note.

        Raises
        ------
        InputError
            When nothing or more than one region is inside; the message has their sizes.

        Examples
        --------
        >>> import numpy as np
        >>> mask = np.zeros((60, 80), bool)
        >>> mask[10:50, 10:70] = True
        >>> Boundary.from_mask(mask)
        <Boundary: 1 loop of 4 curves>
        """
        boundary: Boundary = make("mask", mask, tolerance=tolerance, corner_angle=corner_angle, smooth=smooth)
        return boundary

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Boundary) and self.loops == other.loops

    __hash__ = None  # type: ignore[assignment]

    def __reduce__(self) -> tuple[Callable[..., Boundary], tuple[list[PackedCurves], tuple[str, ...]]]:
        return _unpacked_boundary, ([pack_curves(loop) for loop in self.loops], self.notes)

    def __repr__(self) -> str:
        counts = [len(loop) for loop in self.loops]
        loops = f"{len(counts)} loop{'' if len(counts) == 1 else 's'}"
        if len(counts) > SHOWN:
            return f"<Boundary: {loops}, {sum(counts)} curves>"
        return f"<Boundary: {loops} of {', '.join(map(str, counts))} curve{'' if counts == [1] else 's'}>"

    @cached_property
    def diameter(self) -> float:
        """Diagonal of the control points' bounding box."""
        points = np.concatenate([curve.control_points for loop in self.loops for curve in loop])
        # Without squares, which overflow.
        return float(np.hypot(*np.ptp(points, axis=0)))


def _unpacked_boundary(loops: list[PackedCurves], notes: tuple[str, ...]) -> Boundary:
    """A boundary that was checked before it was pickled."""
    boundary = object.__new__(Boundary)
    boundary.__dict__.update(loops=tuple([unpack_curves(loop) for loop in loops]), notes=notes)
    return boundary
