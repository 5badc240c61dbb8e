"""`MultiPatch`: patches glued along sides, an immutable value."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from .._core import Locator
from ..errors import InputError, InputWarning
from ..numeric.arrays import FloatArray, IntArray, frozen_array
from . import exchange
from .blocks import Block, Parts, renumbered
from .boundary import Boundary
from .conformity.conforming import Conforming, conforming
from .display import Shown
from .interfaces import check_interfaces, infer_interfaces
from .labels import Labels, checked, relabelled
from .location import locate
from .packing import PackedPatches, pack_patches, unpack_patches
from .patch import Patch
from .sides import Interface, Side
from .topology import BoundarySide, Topology, Vertex

if TYPE_CHECKING:
    import geomdl.multi
    import meshio
    import nutils.function
    import nutils.topology
    import pyvista
    import splinepy

__all__ = ["MultiPatch"]


@dataclass(frozen=True, eq=False)
class MultiPatch(Shown):
    """Tensor-product patches and how they are glued.

    Parameters
    ----------
    patches : sequence of Patch
        Weights that are all equal on a patch are left out: it is polynomial.
    interfaces : sequence of Interface, optional
        None (the default) infers them from coinciding side control points.
    ids : sequence of int, optional
        Identifiers of the patches in the file they came from; default 0, 1, ...
    labels : mapping of str to iterables of (patch, side), optional
        Names of sides, of the boundary or inside, such as ``{"inlet": [(0, Side.WEST)]}``.
    blocks : sequence of Block, optional
        What else the file holds.

    Raises
    ------
    InputError
        When an interface names a patch that does not exist, sides whose degrees or knots differ, or sides
        whose control points do not coincide; when a label names a patch or side that does not exist.

    Examples
    --------
    >>> corners, knots = np.array([[[0, 0], [0, 1]], [[1, 0], [1, 1]]], float), [0, 0, 1, 1]
    >>> MultiPatch([Patch((knots, knots), (1, 1), corners + [x, 0]) for x in range(3)])
    <MultiPatch: 3 patches, 2 interfaces, 0 holes, 8 control points>
    """

    interfaces: tuple[Interface, ...]
    ids: tuple[int, ...]
    sides: Labels
    blocks: tuple[Block, ...]

    def __init__(
        self,
        patches: Iterable[Patch],
        interfaces: Iterable[Interface] | None = None,
        ids: Sequence[int] | None = None,
        labels: Mapping[str, Iterable[tuple[int, Side | int]]] | None = None,
        blocks: Iterable[Block] = (),
    ) -> None:
        patches = tuple(patch._without_equal_weights() for patch in patches)
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
        object.__setattr__(self, "sides", checked(labels or {}, len(patches)))
        object.__setattr__(self, "blocks", tuple(blocks))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, MultiPatch) and (
            self.patches == other.patches
            and self.interfaces == other.interfaces
            and self.ids == other.ids
            and self.sides == other.sides
            and self.blocks == other.blocks
        )

    __hash__ = None  # type: ignore[assignment]

    def __len__(self) -> int:
        return len(self.patches)

    def __getitem__(self, k: int) -> Patch:
        return self.patches[k]

    def __iter__(self) -> Iterator[Patch]:
        return iter(self.patches)

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
        interfaces = len(self.interfaces)
        return (
            f"<MultiPatch: {len(self.patches)} patch{'' if len(self.patches) == 1 else 'es'}, "
            f"{interfaces} interface{'' if interfaces == 1 else 's'}, {loops}, "
            f"{self.topology.n_points} control points>"
        )

    @cached_property
    def topology(self) -> Topology:
        """Everything combinatorial: shared control points, loops, vertices, chords, orientation."""
        return Topology(self.patches, self.interfaces)

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
        moved = self._with(patches=patches)
        moved.__dict__["topology"] = self.topology.moved(patches)
        return moved

    def _with(self, **changed: object) -> MultiPatch:
        """The same with other fields that are known to fit, everything derived to be found anew."""
        other = object.__new__(MultiPatch)
        kept = {name: getattr(self, name) for name in ("patches", "interfaces", "ids", "sides", "blocks")}
        other.__dict__.update(kept | changed)
        return other

    def with_labels(self, labels: Mapping[str, Iterable[tuple[int, Side | int]]]) -> MultiPatch:
        """The same with these names of sides instead of its own.

        Parameters
        ----------
        labels : mapping of str to iterables of (patch, side)
            Patches by their position, 0 is the first; sides as `Side`, number or name ("west").
            ``{**mp.sides, "inlet": [(0, "west")]}`` adds one.

        Raises
        ------
        InputError
            When a patch or a side does not exist, a side is named twice in a label, a name is empty, or something is
            not a pair.

        Examples
        --------
        >>> from patchtransfer.examples import load
        >>> mp = load("wrench")[0].with_labels({"jaw": [(0, Side.WEST), (3, Side.NORTH)]})
        >>> mp.sides["jaw"]
        ((0, <Side.WEST: 1>), (3, <Side.NORTH: 4>))
        """
        moved = self._with(sides=checked(labels, len(self.patches)))
        moved.__dict__["topology"] = self.topology
        return moved

    def __reduce__(self) -> tuple[Callable[..., MultiPatch], tuple[object, ...]]:
        # The topology is found again faster than it is sent.
        return _unpacked, (self._packed, self.interfaces, self.ids, dict(self.sides), self.blocks)

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

    def conform(self, *, weld: float = 0.0) -> MultiPatch:
        """The same domain with patches that agree exactly along all sides that coincide.

        Degrees are raised and knots inserted through whole strips, where patches meet with other splines; patches are
        split where sides meet a part of another one (T-junctions), along a parameter line through the whole strip;
        gaps up to `weld` are closed by moving both sides to their mean. Nothing else moves. Labels go to all pieces of
        a side; first pieces keep number and identifier of their patch, further ones follow at the end. What was done
        and what was left is told by `patchtransfer.conform`.

        Parameters
        ----------
        weld : float, default 0
            Length up to which gaps are closed, in the model's unit; rounding always is. No patch moves by more than a
            quarter of its thickness.

        Returns
        -------
        MultiPatch
            This one if nothing is to be done.

        Raises
        ------
        InputError
            When `weld` is negative or not finite, or splits go round in a spiral without end.

        Examples
        --------
        >>> from patchtransfer import Patch
        >>> knots = ([0, 0, 1, 1], [0, 0, 1, 1])
        >>> left = Patch(knots, (1, 1), [[[0, 0], [0, 1]], [[1, 0], [1, 1]]])
        >>> right = Patch(knots, (1, 1), [[[1, 0], [1, 1]], [[2, 0], [2, 1]]]).insert_knots(1, [0.3])
        >>> mp = MultiPatch([left, right])
        >>> len(mp.interfaces), len(mp.conform().interfaces)
        (0, 1)
        """
        mended, _, lost = self._conformed(weld)
        for line in lost:
            warnings.warn(line, InputWarning, stacklevel=2)
        return mended

    def _conformed(self, weld: float) -> tuple[MultiPatch, Conforming, list[str]]:
        """The multi-patch that conforms, how it was made, and what in its blocks could not follow."""
        if not 0 <= weld < np.inf:
            raise InputError(f"weld is a length, 0 or more, not {weld!r}")
        made = conforming(self.patches, self.interfaces, weld)
        if made.patches == list(self.patches) and made.interfaces == list(self.interfaces):
            return self, made, []
        pieces, lost = self._in_pieces(made.patches, made.interfaces, made.parts)
        return pieces, made, lost

    def _in_pieces(
        self, patches: Sequence[Patch], interfaces: Sequence[Interface], parts: Parts
    ) -> tuple[MultiPatch, list[str]]:
        """The model of patches that these were cut into, and what in its blocks could not follow."""
        first = max(self.ids) + 1
        ids = [*self.ids, *range(first, first + len(patches) - len(self.ids))]
        labels, _ = relabelled(self.sides, parts)
        blocks, lost = renumbered(self.blocks, parts) if len(patches) > len(self) else (self.blocks, [])
        return MultiPatch(patches, interfaces, ids, labels, blocks), lost

    def _in_other_space(self, change: Callable[[Patch], Patch]) -> MultiPatch:
        """The multi-patch of changed patches; rounding may part glued points, so they are welded where they agreed."""
        other = MultiPatch(
            [change(patch) for patch in self.patches], self.interfaces, self.ids, self.sides, self.blocks
        )
        return other.with_shared_points(other.topology.coordinates)

    def to_polynomial(self, tolerance: float = 1e-6) -> MultiPatch:
        """The domain by polynomial patches, but for a part of its diameter: `patchtransfer.to_polynomial` says how.

        Parameters
        ----------
        tolerance : float, default 1e-6
        """
        made: MultiPatch = exchange.call("to_polynomial", self, tolerance).multipatch
        return made

    def boundary(self) -> Boundary:
        """The boundary curves, loop by loop, the domain on their left."""
        return Boundary([[side.curve(self.patches) for side in loop] for loop in self.loops])

    @classmethod
    def from_splinepy(cls, splines: splinepy.Multipatch | Iterable[splinepy.Spline] | splinepy.Spline) -> MultiPatch:
        """The model of splinepy's (and gustaf's) objects.

        Parameters
        ----------
        splines : splinepy.Multipatch, spline or sequence of splines
            Of any type, in the plane. Interfaces of a Multipatch are taken over, and inferred of splines alone; numbers
            of boundaries other than 1 become labels such as "boundary 2".
        """
        made: MultiPatch = exchange.call("from_splinepy", splines)
        return made

    def to_splinepy(self) -> splinepy.Multipatch:
        """A `splinepy.Multipatch` with the same interfaces; labels become numbers of boundaries from 2, which is told.

        Raises
        ------
        InputError
            Without splinepy: ``pip install 'patchtransfer[splinepy]'``.

        Examples
        --------
        >>> from patchtransfer.examples import load
        >>> made = load("frame")[0].to_splinepy()
        >>> len(made.patches), made.dim
        (14, 2)
        """
        return exchange.call("to_splinepy", self)

    @classmethod
    def from_geomdl(cls, surfaces: Any) -> MultiPatch:
        """The model of geomdl's surfaces: one, a sequence, or a `SurfaceContainer`; interfaces are inferred."""
        made: MultiPatch = exchange.call("from_geomdl", surfaces)
        return made

    def to_geomdl(self) -> geomdl.multi.SurfaceContainer:
        """A container of surfaces of geomdl, in space with z = 0, on the same knots.

        Raises
        ------
        InputError
            Without geomdl: ``pip install 'patchtransfer[geomdl]'``.

        Examples
        --------
        >>> from patchtransfer.examples import load
        >>> [surface.degree_u for surface in load("star")[0].to_geomdl()]
        [3, 3, 3, 3, 3, 3]
        """
        return exchange.call("to_geomdl", self)

    def to_nutils(self) -> tuple[nutils.topology.Topology, nutils.function.Array]:
        """Domain and geometry of nutils, exact: a knot span is an element.

        Where necessary u and v of patches are turned around, since nutils wants glued sides to run in the same sense.
        Labels of the boundary are names there: ``domain.boundary["inlet"]``. Models with two sides that have both
        corners in common and are not glued cannot be coupled in nutils: their patches are left apart, with a warning.

        Returns
        -------
        domain : nutils.topology.Topology
        geom : nutils.function.Array
            Shape (2,).

        Raises
        ------
        InputError
            Without nutils: ``pip install 'patchtransfer[nutils]'``.

        Examples
        --------
        >>> from patchtransfer.examples import load
        >>> domain, geom = load("star")[0].to_nutils()
        >>> len(domain), geom.shape
        (54, (2,))
        """
        made: tuple[nutils.topology.Topology, nutils.function.Array] = exchange.call("to_nutils", self)
        return made

    def to_meshio(self, samples: int = 4) -> meshio.Mesh:
        """A mesh of quadrilaterals through sampled points, which neighbours share, for meshio and scikit-fem.

        Parameters
        ----------
        samples : int, default 4
            Cells of a knot span in each direction; 1 joins the knots by straight lines.

        Returns
        -------
        meshio.Mesh
            Cells "quad", counter-clockwise, and "line", the boundary with the domain on its left, and labelled sides
            inside. The cell data "patch" are positions of patches; every label is a set of lines.

        Raises
        ------
        InputError
            Without meshio: ``pip install 'patchtransfer[meshio]'``.

        Examples
        --------
        >>> from patchtransfer.examples import load
        >>> mesh = load("star")[0].to_meshio(samples=2)
        >>> {kind: len(cells) for kind, cells in mesh.cells_dict.items()}
        {'quad': 216, 'line': 72}
        """
        return exchange.call("to_meshio", self, samples)

    def to_pyvista(self) -> pyvista.UnstructuredGrid:
        """A grid of exact Bézier cells, with the data that are written to VTU files.

        Raises
        ------
        InputError
            Without PyVista: ``pip install 'patchtransfer[pyvista]'``.
        """
        return exchange.call("to_pyvista", self)

    @cached_property
    def _locator(self) -> Locator:
        return Locator([patch.to_core() for patch in self.patches])

    def locate(self, points: ArrayLike, *, tolerance: float = 1e-12) -> tuple[IntArray, FloatArray, FloatArray]:
        """Which patch points lie in, and at which parameters: many at once, a million in about a second.

        The model is prepared at the first call, in milliseconds; the result is the same for any number of threads.

        Parameters
        ----------
        points : (..., 2) array
        tolerance : float, default 1e-12
            A point outside gets the nearest point of the patches' sides if that is at most so far away, relative to
            :attr:`diameter`. The default is what coordinates of twelve digits miss a boundary by, and the residual that
            one may rely on; what rounding does to the largest coordinate (1.5e-14 of it) counts as inside in any case.

        Returns
        -------
        patch : (...) array of int
            Number of the patch, the lowest one on interfaces and at vertices; -1 for points that lie in none.
        u, v : (...) arrays
            Parameters with ``mp.patches[patch](u, v)`` at the point; NaN where `patch` is -1.

        Raises
        ------
        InputError
            On another shape, a coordinate that is not finite, or a negative tolerance.

        Examples
        --------
        >>> square = Patch(([0, 0, 1, 1], [0, 0, 1, 1]), (1, 1), [[[0, 0], [0, 2]], [[2, 0], [2, 2]]])
        >>> patch, u, v = MultiPatch([square]).locate([[0.5, 1.5], [3.0, 1.0]])
        >>> patch
        array([ 0, -1])
        >>> u, v
        (array([0.25,  nan]), array([0.75,  nan]))
        """
        return locate(self._locator, points, tolerance, self.diameter)


def _unpacked(
    packed: PackedPatches,
    interfaces: tuple[Interface, ...],
    ids: tuple[int, ...],
    sides: dict[str, tuple[tuple[int, Side], ...]],
    blocks: tuple[Block, ...],
) -> MultiPatch:
    """A multi-patch that was checked before it was pickled."""
    multipatch = object.__new__(MultiPatch)
    multipatch.__dict__.update(
        _packed=packed, interfaces=interfaces, ids=ids, sides=MappingProxyType(sides), blocks=blocks
    )
    return multipatch
