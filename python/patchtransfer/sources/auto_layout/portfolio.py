"""All layouts of an outline that are worth a try: roundings of the corners, modes and prices of the quantization."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...geometry.boundary import Boundary
from ...numeric.arrays import IntArray
from .assembly import AbstractLayout, assemble
from .cross_field import compute_cross_field
from .layout_key import LayoutKey, layout_key
from .mesh import corner_valences, generate_mesh, sample_simply
from .prices import CollapsePrice, collapse_prices
from .quantize import arcs_between, quantize
from .reasons import NoLayoutError
from .sampling import SampledOutline
from .seamless_map import compute_seamless_map
from .symmetric_places import symmetric_places
from .symmetry import Isometry
from .t_mesh import TMesh, build_t_mesh

__all__ = ["Portfolio", "Proposal"]

#: Added to a corner's angle in quarter turns before it is rounded: first to the nearest, then so that angles near
#: 135, 225 and 315 degrees go up, then down. Which is best the certified result decides.
OFFSETS = (0.0, 0.13, -0.2)
MODES = ("strict", "merging")


@dataclass(frozen=True, eq=False)
class Proposal:
    """A layout, and what it was made of.

    Attributes
    ----------
    layout : AbstractLayout
    t_mesh : TMesh
    lengths : (a,) array of int
        Edges on every arc.
    price : CollapsePrice
    mode : {"strict", "merging"}
    at_least : mapping
        Demands on numbers of edges; see `quantize`.
    origin : str
        For the log.
    """

    layout: AbstractLayout
    t_mesh: TMesh
    lengths: IntArray
    price: CollapsePrice
    mode: str
    at_least: Mapping[Collection[int], int]
    origin: str


class Portfolio:
    """Layouts of an outline.

    Parameters
    ----------
    boundary : Boundary
    isometries : sequence of Isometry
        Symmetries of the outline, which layouts get where they can.
    prefer : {"few", "quality"}
    max_patches : int, optional
    corner_patches : mapping of (loop, corner) to int, optional
        Numbers of patches at corners.
    note : callable
        Told why a choice leads to no layout.
    """

    def __init__(
        self,
        boundary: Boundary,
        isometries: Sequence[Isometry],
        prefer: str,
        max_patches: int | None,
        corner_patches: Mapping[tuple[int, int], int] | None,
        note: Callable[[str], None],
    ) -> None:
        self.outline: SampledOutline = sample_simply(boundary)
        self.isometries = isometries
        self.prices = collapse_prices(prefer)
        self.max_patches = max_patches
        self.corner_patches = corner_patches
        self.note = note
        self._seen: set[LayoutKey] = set()

    def __iter__(self) -> Iterator[Proposal]:
        for offset, t_mesh in self._t_meshes():
            for mode in MODES:
                for price in self.prices:
                    origin = f"corners rounded {offset:+g}, {mode}, collapse at {price.size:.3g}, turn {price.turn:g}"
                    proposal = self._proposal(t_mesh, price, mode, {}, origin)
                    if proposal is not None:
                        yield proposal

    def with_more_edges(self, proposal: Proposal, stretches: Sequence[tuple[int, float, float]]) -> Proposal | None:
        """The proposal with an edge more on stretches (loop, s0, s1) of the outline that need one."""
        demands = dict(proposal.at_least)
        layout = proposal.layout
        for loop, s0, s1 in stretches:
            length = self.outline.outlines[loop].length
            joints = np.sort(layout.boundary_s[layout.boundary_loop == loop] % length)
            # A side starts and ends at vertices; a stretch that reached beyond them would count its neighbours' edges.
            first, last = (int(np.argmin(abs((joints - s + length / 2) % length - length / 2))) for s in (s0, s1))
            arcs = arcs_between(proposal.t_mesh, self.outline, loop, joints[first], joints[last])
            # An arc may reach beyond the stretch where joints divide it.
            demands[arcs] = max(demands.get(arcs, 0), sum(int(proposal.lengths[a]) for a in arcs) + 1)
        return self._proposal(
            proposal.t_mesh, proposal.price, proposal.mode, demands, f"{proposal.origin}, edges added"
        )

    def _t_meshes(self) -> Iterator[tuple[float, TMesh]]:
        tried: set[bytes] = set()
        for offset in OFFSETS:
            try:
                valences = corner_valences(self.outline, offset, self.corner_patches)
                if valences.tobytes() in tried:
                    continue
                tried.add(valences.tobytes())
                yield offset, self._t_mesh(valences)
            except NoLayoutError as error:
                self.note(f"corners rounded {offset:+g}: {error}")

    def _t_mesh(self, valences: np.ndarray) -> TMesh:
        mesh = generate_mesh(self.outline, valences)
        field = compute_cross_field(mesh)
        seamless = compute_seamless_map(mesh, field)
        return build_t_mesh(
            mesh.points,
            mesh.triangles,
            seamless.uv,
            seamless.rotation,
            field.index,
            self.outline.next,
            self.outline.loop,
            valences > 0,
        )

    def _proposal(
        self,
        t_mesh: TMesh,
        price: CollapsePrice,
        mode: str,
        at_least: Mapping[Collection[int], int],
        origin: str,
    ) -> Proposal | None:
        """A layout that was not proposed before; None without one."""
        try:
            found = quantize(
                t_mesh, self.outline, price, mode=mode, max_patches=self.max_patches, at_least=dict(at_least)
            )
            layout = assemble(t_mesh, self.outline, found.lengths)
        except NoLayoutError as error:
            self.note(f"{origin}: {error}")
            return None
        key = layout_key(layout)
        if key in self._seen:
            return None
        self._seen.add(key)
        layout = symmetric_places(layout, self.outline.outlines, self.isometries)
        return Proposal(layout, t_mesh, np.asarray(found.lengths), price, mode, at_least, origin)
