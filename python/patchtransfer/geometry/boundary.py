"""`Boundary`: closed loops of curves that bound a planar domain, an immutable value."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..errors import InputError
from . import display
from .curve import BSplineCurve
from .packing import PackedCurves, pack_curves, unpack_curves

__all__ = ["Boundary"]

#: Loops whose numbers of curves are told one by one; more are counted together, on one line.
SHOWN = 8


@dataclass(frozen=True, eq=False)
class Boundary:
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
        return float(np.linalg.norm(np.ptp(points, axis=0)))

    def _repr_png_(self) -> bytes | None:
        return display.as_png(self)

    def _repr_html_(self) -> str | None:
        return display.as_html(self)


def _unpacked_boundary(loops: list[PackedCurves], notes: tuple[str, ...]) -> Boundary:
    """A boundary that was checked before it was pickled."""
    boundary = object.__new__(Boundary)
    boundary.__dict__.update(loops=tuple([unpack_curves(loop) for loop in loops]), notes=notes)
    return boundary
