"""`MultiPatch` (patches glued along sides) and `Boundary` (closed loops of curves): immutable values."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from .errors import InputError
from .packing import PackedCurves, PackedPatches, pack_curves, pack_patches, unpack_curves, unpack_patches
from .splines import BSplineCurve, FloatArray, Patch, frozen_array

if TYPE_CHECKING:
    from .topology import BoundarySide, Topology, Vertex

Number = TypeVar("Number", bound=np.generic)

__all__ = ["Boundary", "Interface", "MultiPatch", "Side"]


class Side(IntEnum):
    """A side of a patch, numbered as in G+Smo."""

    WEST = 1
    """u = first knot."""
    EAST = 2
    """u = last knot."""
    SOUTH = 3
    """v = first knot."""
    NORTH = 4
    """v = last knot."""

    @property
    def axis(self) -> int:
        """Direction that runs along the side: 1 (v) for west and east, 0 (u) for south and north."""
        return 1 if self <= Side.EAST else 0

    @property
    def at_end(self) -> bool:
        """Whether the side lies at the last knot of the direction across it."""
        return self in (Side.EAST, Side.NORTH)

    def of(self, array: NDArray[Number], row: int = 0) -> NDArray[Number]:
        """The slice of an (n_u, n_v, ...) array on this side, `row` rows into the patch."""
        index = -1 - row if self.at_end else row
        return array[index] if self.axis == 1 else array[:, index]


@dataclass(frozen=True)
class Interface:
    """Two patch sides that are glued.

    `reversed` says whether the parameters along the two sides run in opposite directions.
    """

    patch_a: int
    side_a: Side
    patch_b: int
    side_b: Side
    reversed: bool


@dataclass(frozen=True, eq=False)
class MultiPatch:
    """Tensor-product patches and how they are glued.

    Parameters
    ----------
    patches : sequence of Patch
    interfaces : sequence of Interface, optional
        None (the default) infers them from coinciding side control points.
    ids : sequence of int, optional
        Identifiers of the patches in the file they came from; default 0, 1, ...

    Raises
    ------
    InputError
        When an interface names a patch that does not exist, sides whose degrees or knots differ, or sides
        whose control points do not coincide.
    """

    interfaces: tuple[Interface, ...]
    ids: tuple[int, ...]

    def __init__(
        self,
        patches: Iterable[Patch],
        interfaces: Iterable[Interface] | None = None,
        ids: Sequence[int] | None = None,
    ) -> None:
        from .interfaces import check_interfaces, infer_interfaces

        patches = tuple(patches)
        if not patches:
            raise InputError("a multi-patch needs at least one patch")
        ids = tuple(range(len(patches))) if ids is None else tuple(int(i) for i in ids)
        if len(set(ids)) != len(patches):
            raise InputError(f"{len(patches)} patches need as many distinct ids, got {ids}")
        glued = infer_interfaces(patches) if interfaces is None else tuple(interfaces)
        check_interfaces(patches, glued)
        object.__setattr__(self, "patches", patches)
        object.__setattr__(self, "interfaces", glued)
        object.__setattr__(self, "ids", ids)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, MultiPatch) and (
            self.patches == other.patches and self.interfaces == other.interfaces and self.ids == other.ids
        )

    __hash__ = None  # type: ignore[assignment]

    def __len__(self) -> int:
        return len(self.patches)

    @cached_property
    def patches(self) -> tuple[Patch, ...]:
        """The patches. Results bring them from other processes, and few are looked at there: made when asked for."""
        return unpack_patches(self._packed)

    @cached_property
    def _packed(self) -> PackedPatches:
        return pack_patches(self.patches)

    def __repr__(self) -> str:
        try:
            holes = max(len(self.loops) - self.topology.n_components, 0)
            loops = f"{holes} hole{'' if holes == 1 else 's'}"
        except InputError:
            loops = "open boundary"
        return (
            f"<MultiPatch: {len(self.patches)} patches, {len(self.interfaces)} interfaces, {loops}, "
            f"{self.topology.n_points} control points>"
        )

    @cached_property
    def topology(self) -> Topology:
        """Everything combinatorial: shared control points, loops, vertices, chords, orientation."""
        from .topology import Topology

        return Topology(self)

    @property
    def boundaries(self) -> tuple[tuple[int, Side], ...]:
        """Sides (patch, side) that belong to no interface."""
        return self.topology.boundaries

    @property
    def loops(self) -> tuple[tuple[BoundarySide, ...], ...]:
        """Boundary loops as chains of sides, the domain on their left; the outer loop first."""
        return self.topology.loops

    @property
    def vertices(self) -> tuple[Vertex, ...]:
        """Vertices with the patches around them and their valence."""
        return self.topology.vertices

    @property
    def is_rational(self) -> bool:
        """Whether any patch has weights."""
        return any(patch.weights is not None for patch in self.patches)

    @cached_property
    def diameter(self) -> float:
        """Diagonal of the control points' bounding box, the length that tolerances are relative to."""
        points = np.concatenate([patch.control_points.reshape(-1, 2) for patch in self.patches])
        return float(np.linalg.norm(np.ptp(points, axis=0)))

    def with_control_points(self, control_points: Sequence[FloatArray]) -> MultiPatch:
        """The same topology, degrees and knots with other control points, one (n_u, n_v, 2) array a patch."""
        from .interfaces import check_interfaces

        patches = tuple(p.with_control_points(c) for p, c in zip(self.patches, control_points, strict=True))
        check_interfaces(patches, self.interfaces)
        return self._with_patches(patches)

    def with_shared_points(self, points: FloatArray) -> MultiPatch:
        """The same with the shared control points (n_points, 2) of `topology`: both sides of interfaces bit-equal."""
        shared = frozen_array(points, "shared control points")
        if shared.shape != (self.topology.n_points, 2):
            raise InputError(f"shared control points must have shape {(self.topology.n_points, 2)}, got {shared.shape}")
        patches = []
        for patch, i in zip(self.patches, self.topology.points, strict=True):
            own = shared[i]
            own.flags.writeable = False
            patches.append(patch._moved(own))
        moved = self._with_patches(tuple(patches))
        moved.topology.__dict__["coordinates"] = shared
        return moved

    def _with_patches(self, patches: tuple[Patch, ...]) -> MultiPatch:
        """The same with patches that are known to fit the interfaces."""
        moved = object.__new__(MultiPatch)
        for name, value in (("patches", patches), ("interfaces", self.interfaces), ("ids", self.ids)):
            object.__setattr__(moved, name, value)
        moved.__dict__["topology"] = self.topology.moved(patches)
        return moved

    def __reduce__(self) -> tuple[Callable[..., MultiPatch], tuple[object, ...]]:
        # The topology is found again faster than it is sent.
        return _unpacked, (self._packed, self.interfaces, self.ids)

    def elevate(self, by: int = 1) -> MultiPatch:
        """The same geometry with all degrees raised; inner knots stay as smooth as they are."""
        return self._in_other_space(lambda patch: patch.elevate(by))

    def split_spans(self, parts: int = 2) -> MultiPatch:
        """The same geometry with every knot span cut into `parts` equal ones."""
        if parts < 1:
            raise InputError(f"knot spans can be split into 1 part or more, not {parts}")
        return self._in_other_space(lambda patch: patch.split_spans(parts))

    def reduce_continuity(self, smoothness: int) -> MultiPatch:
        """The same geometry with inner knots repeated until splines are only C^smoothness there."""
        return self._in_other_space(lambda patch: patch.reduce_continuity(smoothness))

    def _in_other_space(self, change: Callable[[Patch], Patch]) -> MultiPatch:
        """The multi-patch of changed patches; rounding may part glued points, so they are welded where they agreed."""
        other = MultiPatch([change(patch) for patch in self.patches], self.interfaces, self.ids)
        return other.with_shared_points(other.topology.coordinates)

    def boundary(self) -> Boundary:
        """The boundary curves, loop by loop, the domain on their left."""
        return Boundary([[side.curve(self.patches) for side in loop] for loop in self.loops])

    def _repr_png_(self) -> bytes:
        from .plot import png

        return png(self)

    def _repr_html_(self) -> str:
        from .plot import html

        return html(self)


def _unpacked(packed: PackedPatches, interfaces: tuple[Interface, ...], ids: tuple[int, ...]) -> MultiPatch:
    """A multi-patch that was checked before it was pickled."""
    multipatch = object.__new__(MultiPatch)
    multipatch.__dict__.update(_packed=packed, interfaces=interfaces, ids=ids)
    return multipatch


@dataclass(frozen=True, eq=False)
class Boundary:
    """Closed boundary loops of a planar domain, each a chain of curves.

    Parameters
    ----------
    loops : sequence of sequences of BSplineCurve
        Within a loop every curve ends where the next one starts, and the last where the first starts; order
        of the loops and their sense are free. (`patchtransfer.io` chains loose curves.)

    Raises
    ------
    InputError
        When a loop is empty or open; the message names loop and curve.
    """

    loops: tuple[tuple[BSplineCurve, ...], ...]

    def __init__(self, loops: Iterable[Iterable[BSplineCurve]]) -> None:
        chains = tuple(tuple(loop) for loop in loops)
        if not chains or not all(chains):
            raise InputError("a boundary needs at least one loop, and every loop at least one curve")
        object.__setattr__(self, "loops", chains)
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

    def __reduce__(self) -> tuple[Callable[..., Boundary], tuple[list[PackedCurves]]]:
        return _unpacked_boundary, ([pack_curves(loop) for loop in self.loops],)

    def __repr__(self) -> str:
        return f"<Boundary: {len(self.loops)} loops of {', '.join(str(len(x)) for x in self.loops)} curves>"

    @cached_property
    def diameter(self) -> float:
        """Diagonal of the control points' bounding box."""
        points = np.concatenate([curve.control_points for loop in self.loops for curve in loop])
        return float(np.linalg.norm(np.ptp(points, axis=0)))


def _unpacked_boundary(loops: list[PackedCurves]) -> Boundary:
    """A boundary that was checked before it was pickled."""
    boundary = object.__new__(Boundary)
    boundary.__dict__["loops"] = tuple([unpack_curves(loop) for loop in loops])
    return boundary
