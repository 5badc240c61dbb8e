"""What multi-patches of the same shapes, knots and interfaces have in common, found once for all control points.

A `Quantity` is a function that finds such a value: of this package or of a later stage, which keeps its own there.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from ..numeric.arrays import IntArray
from ..numeric.components import components
from .areas import numbered
from .sides import Interface, Side

__all__ = ["Combinatorics", "Quantity", "identify", "oriented"]

T = TypeVar("T")


class Combinatorics:
    """What does not depend on control points.

    Attributes
    ----------
    interfaces : tuple of Interface
    points : list of (n_u, n_v) int arrays
        Index of every patch control point among the shared ones.
    n_points : int
        Number of shared control points.
    boundaries : tuple of (patch, Side)
        Sides in no interface.
    """

    def __init__(self, shapes: Sequence[tuple[int, int]], interfaces: tuple[Interface, ...]) -> None:
        self.interfaces = interfaces
        self.points, self.n_points = identify(shapes, interfaces)
        glued = {(f.patch_a, f.side_a) for f in interfaces} | {(f.patch_b, f.side_b) for f in interfaces}
        self.boundaries = tuple((k, s) for k in range(len(shapes)) for s in Side if (k, s) not in glued)
        self._found: dict[tuple[Quantity[Any], bytes], Any] = {}

    def __getstate__(self) -> dict[str, Any]:
        # Found again faster than sent.
        return self.__dict__ | {"_found": {}}

    def once(self, quantity: Quantity[T], topology: Combined) -> T:
        """The quantity, found from `topology` unless it is known."""
        key = quantity, topology.orientation.astype(np.int8).tobytes() if quantity.oriented else b""
        if key not in self._found:
            self._found[key] = quantity.find(topology)
        found: T = self._found[key]
        return found


class Combined(Protocol):
    """A topology, as far as quantities need it."""

    @property
    def combinatorics(self) -> Combinatorics: ...

    @property
    def orientation(self) -> IntArray: ...


class Quantity(Generic[T]):
    """A function of a topology whose value depends on shapes, knots and interfaces alone, so that it is called once.

    In the body of a class it makes a property, elsewhere a function. With `oriented` the value depends on the
    orientation of the patches besides.
    """

    def __init__(self, find: Callable[[Any], T], oriented: bool = False) -> None:
        self.find, self.oriented = find, oriented
        self.__doc__ = find.__doc__

    def __call__(self, topology: Combined) -> T:
        """The value for a topology."""
        return topology.combinatorics.once(self, topology)

    def __get__(self, topology: Any, owner: type) -> T:
        if topology is None:
            return self  # type: ignore[return-value]
        return self(topology)


def oriented(find: Callable[[Any], T]) -> Quantity[T]:
    """Quantity that depends on the patches' orientation besides."""
    return Quantity(find, oriented=True)


def identify(shapes: Sequence[tuple[int, int]], interfaces: Sequence[Interface]) -> tuple[list[IntArray], int]:
    """Number the coefficients of patches of these shapes, glued ones once: an index array a patch, and how many."""
    sizes = [m * n for m, n in shapes]
    offsets = np.concatenate([[0], np.cumsum(sizes)])
    raw = numbered(shapes)
    first, second = [np.empty(0, int)], [np.empty(0, int)]
    for f in interfaces:
        first.append(f.side_a.of(raw[f.patch_a]))
        along_b = f.side_b.of(raw[f.patch_b])
        second.append(along_b[::-1] if f.reversed else along_b)
    shared = components(int(offsets[-1]), np.concatenate(first), np.concatenate(second))
    points = [shared[offsets[k] : offsets[k + 1]].reshape(shape) for k, shape in enumerate(shapes)]
    return points, int(shared.max()) + 1
