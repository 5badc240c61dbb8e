"""Stage 1, topology: from patches and interfaces to shared control points, loops, vertices and chords.

Patches may be left-handed (det J < 0 throughout) as they often are in files. Nothing is flipped: each patch
carries a sign, and "the domain on the left" of a boundary side is decided with it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, lru_cache

import numpy as np

from ..errors import InputError
from ..numeric.arrays import FloatArray, IntArray, distinct
from ..numeric.components import components
from .areas import SideGroup, enclosed_areas, group_sides, numbered, sides_around
from .combinatorics import Combinatorics, Quantity, oriented
from .curve import BSplineCurve
from .patch import Patch
from .sides import CORNERS, Interface, Side

__all__ = ["BoundarySide", "Spoke", "Topology", "Vertex", "knot_gap"]


@dataclass(frozen=True)
class BoundarySide:
    """A patch side on the boundary, traversed with the domain on its left.

    `reversed` says whether that is against the side's own parameter.
    """

    patch: int
    side: Side
    reversed: bool

    def curve(self, patches: Sequence[Patch]) -> BSplineCurve:
        """The boundary curve in the sense of the loop."""
        patch = patches[self.patch]
        axis = self.side.axis
        weights = None if patch.weights is None else self.side.of(patch.weights)
        points = self.side.of(patch.control_points)
        curve = BSplineCurve._trusted(patch.knots[axis], patch.degrees[axis], points, weights)
        return curve.reversed() if self.reversed else curve

    def points(self, array: IntArray) -> IntArray:
        """Entries of an (n_u, n_v) array along the side in the sense of the loop."""
        along = self.side.of(array)
        return along[::-1] if self.reversed else along


@dataclass(frozen=True)
class Vertex:
    """A patch corner shared by `corners`, pairs (patch, corner), corner 0 to 3 = (0,0), (1,0), (0,1), (1,1).

    `valence` counts the patches around it. `extraordinary`: interior with a valence other than 4.
    """

    point: int
    corners: tuple[tuple[int, int], ...]
    interior: bool

    @property
    def valence(self) -> int:
        """Number of patches that meet here."""
        return len(self.corners)

    @property
    def extraordinary(self) -> bool:
        """Interior vertex with a valence other than 4."""
        return self.interior and self.valence != 4


@dataclass(frozen=True)
class Spoke:
    """An end of an interface at a vertex: its last point (`at_end`) or its first, run with patch a on the left."""

    interface: int
    at_end: bool


class Topology:
    """Combinatorics of a multi-patch, computed once.

    Attributes
    ----------
    n_points : int
        Number of control points after identification along interfaces.
    points : list of (n_u, n_v) int arrays
        Index of every patch control point among the shared ones.
    orientation : (n_patches,) int array
        +1 for right-handed patches, -1 for left-handed ones (sign of the signed area).
    boundaries : tuple of (patch, Side)
    loops : tuple of tuples of BoundarySide
        The outer loop first, the domain on the left.
    vertices : tuple of Vertex
    combinatorics : Combinatorics
        What depends on shapes, knots and interfaces alone: one for all control points.
    """

    def __init__(
        self, patches: tuple[Patch, ...], interfaces: tuple[Interface, ...], known: Combinatorics | None = None
    ) -> None:
        self.patches, self.interfaces = patches, interfaces
        self.combinatorics = Combinatorics([p.shape for p in patches], interfaces) if known is None else known
        self.points, self.n_points = self.combinatorics.points, self.combinatorics.n_points
        self.boundaries = self.combinatorics.boundaries
        # A rational patch has its control polygon's sign unless its sides bend strongly; the certificate
        # checks that.
        areas = enclosed_areas(patches, self._sides_around_patches, len(patches))
        self.orientation = np.where(areas >= 0, 1, -1)

    def __repr__(self) -> str:
        return f"<Topology: {len(self.patches)} patches, {len(self.interfaces)} interfaces, {self.n_points} points>"

    def moved(self, patches: tuple[Patch, ...]) -> Topology:
        """The topology of patches with the same shapes and interfaces and other control points."""
        return Topology(patches, self.interfaces, self.combinatorics)

    @Quantity
    def _sides_around_patches(self) -> list[SideGroup]:
        """The sides of the patches, for the areas that these enclose."""
        return sides_around(self.patches)

    @cached_property
    def coordinates(self) -> FloatArray:
        """Shared control points (n_points, 2); where files differ in the last digits, the mean."""
        total, count = np.zeros((self.n_points, 2)), np.zeros(self.n_points)
        flat = np.concatenate([p.ravel() for p in self.points])
        control = np.concatenate([p.control_points.reshape(-1, 2) for p in self.patches])
        np.add.at(total, flat, control)
        np.add.at(count, flat, 1.0)
        mean = total / count[:, None]
        # Where all copies agree to the bit, keep them: a mean of equal numbers may round.
        first = np.empty_like(mean)
        first[flat[::-1]] = control[::-1]
        differ = np.zeros(self.n_points, bool)
        np.logical_or.at(differ, flat, (first[flat] != control).any(axis=1))
        return np.where(differ[:, None], mean, first)

    @Quantity
    def glued_entries(self) -> tuple[IntArray, IntArray, IntArray]:
        """Control points that interfaces glue, numbered patch by patch, on side a and on side b; where each starts."""
        entries = numbered([patch.shape for patch in self.patches])
        a, b, starts = [np.empty(0, np.int64)], [np.empty(0, np.int64)], [0]
        for f in self.interfaces:
            first, second = (side.of(entries[k]) for k, side in ((f.patch_a, f.side_a), (f.patch_b, f.side_b)))
            a.append(first)
            b.append(second[::-1] if f.reversed else second)
            starts.append(starts[-1] + len(first))
        return np.concatenate(a), np.concatenate(b), np.array(starts[:-1], np.int64)

    @Quantity
    def knot_gaps(self) -> tuple[float, ...]:
        """Largest difference of the two sides' knots, mapped to [0, 1], interface by interface; 0 if there is none."""
        sides = [
            [self.patches[k].knots[side.axis].tobytes() for k, side in ((f.patch_a, f.side_a), (f.patch_b, f.side_b))]
            for f in self.interfaces
        ]
        return tuple(knot_gap(a, b, f.reversed) for f, (a, b) in zip(self.interfaces, sides, strict=True))

    @Quantity
    def boundary_points(self) -> IntArray:
        """Sorted indices of the shared control points on the boundary."""
        sides = [side.of(self.points[k]) for k, side in self.boundaries]
        return distinct(np.concatenate([np.empty(0, int), *sides]))

    @Quantity
    def interior_points(self) -> IntArray:
        """Sorted indices of the shared control points off the boundary: the unknowns of a transfer."""
        return np.setdiff1d(np.arange(self.n_points), self.boundary_points, assume_unique=True)

    @Quantity
    def n_components(self) -> int:
        """Number of connected components."""
        a = np.array([f.patch_a for f in self.interfaces], int)
        b = np.array([f.patch_b for f in self.interfaces], int)
        return int(components(len(self.patches), a, b).max()) + 1

    def directed_side(self, patch: int, side: Side) -> BoundarySide:
        """A side with the interior of its patch on the left."""
        # On a right-handed patch south and east run forwards with the patch on the left.
        against = side in (Side.NORTH, Side.WEST)
        return BoundarySide(patch, side, against != bool(self.orientation[patch] < 0))

    @cached_property
    def loops(self) -> tuple[tuple[BoundarySide, ...], ...]:
        """Boundary loops, the domain on the left: the outer loop first, then holes, the smallest first.

        Raises
        ------
        InputError
            When boundary sides do not chain into loops (inconsistent orientation) or loops touch in a vertex.
        """
        # The domain is on the left, so the outer loop is the one that runs counter-clockwise.
        if len(self._chains) < 2:
            return self._chains
        # A rational patch has its control polygon's sign unless its sides bend strongly; the certificate
        # checks that.
        areas = enclosed_areas(self.patches, self._sides_of_chains, len(self._chains))
        return tuple(self._chains[k] for k in np.argsort(-areas, kind="stable"))

    @oriented
    def _chains(self) -> tuple[tuple[BoundarySide, ...], ...]:
        """The loops in the order of their first sides."""
        start: dict[int, BoundarySide] = {}
        stop: dict[BoundarySide, int] = {}
        for k, side in self.boundaries:
            directed = self.directed_side(k, side)
            along = directed.points(self.points[k])
            if int(along[0]) in start:
                other = start[int(along[0])]
                raise InputError(
                    f"boundary is not a set of simple loops at {self.coordinates[along[0]]}: "
                    f"{side.name.lower()} of patch {k} and {other.side.name.lower()} of patch {other.patch} both "
                    "start there (a patch of wrong orientation, a missing interface, or loops that touch)"
                )
            start[int(along[0])] = directed
            stop[directed] = int(along[-1])
        loops = []
        while start:
            loop = [start.pop(next(iter(start)))]
            first = int(loop[0].points(self.points[loop[0].patch])[0])
            while stop[loop[-1]] != first:
                following = start.pop(stop[loop[-1]], None)
                if following is None:
                    last = loop[-1]
                    raise InputError(
                        f"boundary loop is open at {self.coordinates[stop[last]]}, the end of "
                        f"{last.side.name.lower()} of patch {last.patch} (a patch of wrong orientation or a "
                        "missing interface)"
                    )
                loop.append(following)
            loops.append(tuple(loop))
        return tuple(loops)

    @oriented
    def _sides_of_chains(self) -> list[SideGroup]:
        """The sides of the chains, for the areas that these enclose."""
        numbers = numbered([patch.shape for patch in self.patches])
        sides = []
        for k, chain in enumerate(self._chains):
            origin = int(chain[0].points(numbers[chain[0].patch])[0])
            sides += [(k, side.patch, side.side, -1.0 if side.reversed else 1.0, origin) for side in chain]
        return group_sides(self.patches, sides)

    @Quantity
    def vertices(self) -> tuple[Vertex, ...]:
        """Patch corners, shared ones once, in the order of the shared control points."""
        around: dict[int, list[tuple[int, int]]] = defaultdict(list)
        for k, points in enumerate(self.points):
            for corner, (i, j) in enumerate(CORNERS):
                around[int(points[i, j])].append((k, corner))
        boundary = set(self.boundary_points.tolist())
        return tuple(Vertex(v, tuple(around[v]), v not in boundary) for v in sorted(around))

    @oriented
    def directed_interfaces(self) -> tuple[BoundarySide, ...]:
        """Side a of every interface, run with patch a on its left."""
        return tuple(self.directed_side(f.patch_a, f.side_a) for f in self.interfaces)

    @oriented
    def folded_over(self) -> frozenset[int]:
        """Interfaces (indices) whose patches lie on the same side of them: one folds back on the other."""
        return frozenset(
            i
            for i, (f, a) in enumerate(zip(self.interfaces, self.directed_interfaces, strict=True))
            if (a.reversed != self.directed_side(f.patch_b, f.side_b).reversed) == f.reversed
        )

    @oriented
    def spokes(self) -> dict[int, tuple[Spoke, ...]]:
        """Interface ends around every vertex, counter-clockwise; by shared control point.

        At an interior vertex the interface after the last one is the first; at a boundary vertex the boundary
        lies between them.
        """
        follows: dict[int, dict[Spoke, Spoke]] = defaultdict(dict)
        found: dict[int, dict[Spoke, None]] = defaultdict(dict)
        ends = self._interface_ends()
        for k, points in enumerate(self.points):
            for i, j in CORNERS:
                along_u = (Side.SOUTH if j == 0 else Side.NORTH, i == -1)
                along_v = (Side.WEST if i == 0 else Side.EAST, j == -1)
                # Seen from the corner, u and v point into the patch: counter-clockwise, or mirrored.
                turns_left = (self.orientation[k] > 0) == ((i == 0) == (j == 0))
                pair = (along_u, along_v) if turns_left else (along_v, along_u)
                first, second = (ends.get((k, *side)) for side in pair)
                point = int(points[i, j])
                found[point].update({spoke: None for spoke in (first, second) if spoke is not None})
                if first is not None and second is not None:
                    follows[point][first] = second
        return {point: _chain(list(around), follows[point]) for point, around in found.items() if around}

    def _interface_ends(self) -> dict[tuple[int, Side, bool], Spoke]:
        """Interface ends by (patch, side, whether at the side's last parameter)."""
        ends = {}
        for index, (f, directed) in enumerate(zip(self.interfaces, self.directed_interfaces, strict=True)):
            for last in (False, True):
                ends[f.patch_a, f.side_a, last] = Spoke(index, last != directed.reversed)
                ends[f.patch_b, f.side_b, last] = Spoke(index, (last != f.reversed) != directed.reversed)
        return ends

    @oriented
    def directed_chords(self) -> tuple[tuple[tuple[int, bool], ...], ...]:
        """Interfaces joined through opposite edges of interior valence-4 vertices, as pairs (index, forward).

        All interfaces of a chord are run in one sense; `forward` says that it is that of `directed_interfaces`.
        """
        across: dict[Spoke, Spoke] = {}
        for vertex in self.vertices:
            if vertex.interior and vertex.valence == 4:
                around = self.spokes[vertex.point]
                if len(around) < 4:
                    continue  # Patches of inconsistent orientation, or glued to themselves.
                across.update({around[i]: around[(i + 2) % 4] for i in range(4)})
        chords: list[tuple[tuple[int, bool], ...]] = []
        seen: set[int] = set()
        for first in range(len(self.interfaces)):
            if first in seen:
                continue
            chord = {first: True}
            for forward in (True, False):
                spoke = across.get(Spoke(first, forward))
                while spoke is not None and spoke.interface not in chord:
                    # Leaving the vertex from its start is the sense of the walk.
                    chord[spoke.interface] = (not spoke.at_end) == forward
                    spoke = across.get(Spoke(spoke.interface, not spoke.at_end))
            seen |= chord.keys()
            chords.append(tuple(sorted(chord.items())))
        return tuple(chords)

    @property
    def chords(self) -> tuple[tuple[int, ...], ...]:
        """Interfaces (indices) joined through opposite edges of interior valence-4 vertices."""
        return tuple(tuple(index for index, _ in chord) for chord in self.directed_chords)


@lru_cache(maxsize=256)
def knot_gap(bytes_a: bytes, bytes_b: bytes, backwards: bool) -> float:
    """Largest difference of knots mapped to [0, 1]: exactly, for whether it is zero decides on the certificate."""
    if bytes_a == bytes_b and not backwards:
        return 0.0
    a, b = ([Fraction(t) for t in np.frombuffer(knots).tolist()] for knots in (bytes_a, bytes_b))
    if backwards:
        b = [-t for t in reversed(b)]
    length_a, length_b = a[-1] - a[0], b[-1] - b[0]
    return float(max(abs((s - a[0]) / length_a - (t - b[0]) / length_b) for s, t in zip(a, b, strict=True)))


def _chain(around: list[Spoke], follows: dict[Spoke, Spoke]) -> tuple[Spoke, ...]:
    """The spokes of a vertex in order, from the one that follows no other if there is one."""
    preceded = set(follows.values())
    chain = [next((spoke for spoke in around if spoke not in preceded), around[0])]
    while (following := follows.get(chain[-1])) is not None and following not in chain:
        chain.append(following)
    return tuple(chain)
