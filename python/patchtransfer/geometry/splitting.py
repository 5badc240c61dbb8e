"""A model's patches split along parameter lines through whole strips: the same geometry, more patches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..limits import MAX_PATCHES, at_most
from .blocks import Parts
from .conformity.common_splines import with_common_splines
from .conformity.cutting import Pieces
from .multipatch import MultiPatch
from .patch import Patch
from .sides import Interface, Side

__all__ = ["Cuts", "Origin", "SplitModel", "origins", "split_model", "split_patches"]

#: Parameters of cuts, sorted, by (patch, axis); they match along interfaces, as `along_strips` makes them.
Cuts = Mapping[tuple[int, int], Sequence[float]]


@dataclass(frozen=True)
class Origin:
    """Where a piece was in the model before: a patch, and ranges of its parameters."""

    patch: int
    u: tuple[float, float]
    v: tuple[float, float]

    def within(self, patch: Patch, outer: Origin) -> Origin:
        """The same in terms of an older model, of which `patch`, which this one is of, is the piece `outer`."""
        ranges = []
        for own, knots, whole in zip((self.u, self.v), patch.knots, (outer.u, outer.v), strict=True):
            low, high = np.interp(own, knots[[0, -1]], whole).tolist()
            ranges.append((low, high))
        return Origin(outer.patch, *ranges)

    def to_dict(self) -> dict[str, object]:
        """Plain values for JSON."""
        return {"patch": self.patch, "u": list(self.u), "v": list(self.v)}


@dataclass(frozen=True)
class SplitModel:
    """Outcome of `split_model`.

    Attributes
    ----------
    multipatch : MultiPatch
        First pieces keep number and identifier of their patch, further ones follow at the end.
    origin : tuple of Origin
        Of every patch.
    parts : mapping of (patch, Side) to sequences of (patch, Side)
        Of every side as it was, its parts in order along it.
    lost : list of str
        What in the blocks could not follow.
    """

    multipatch: MultiPatch
    origin: tuple[Origin, ...]
    parts: Parts
    lost: list[str]

    def piece_at(self, patch: int, corner: int) -> tuple[int, int]:
        """The piece (patch, corner) that has the corner of a patch as it was, and still is."""
        along_v = self.parts[patch, Side.EAST if corner & 1 else Side.WEST]
        return along_v[-1 if corner & 2 else 0][0], corner

    def then(self, later: SplitModel) -> SplitModel:
        """What was made of the outcome in turn, seen from the model before."""
        patches = self.multipatch.patches
        origin = tuple(o.within(patches[o.patch], self.origin[o.patch]) for o in later.origin)
        parts = {side: [q for p in own for q in later.parts[p]] for side, own in self.parts.items()}
        return SplitModel(later.multipatch, origin, parts, [*self.lost, *later.lost])


def split_model(multipatch: MultiPatch, cuts: Cuts) -> SplitModel:
    """Split patches by inserting knots up to full multiplicity; labels and blocks go to all pieces of a side."""
    pieces = Pieces(multipatch.patches, cuts)
    at_most(len(pieces.patches), MAX_PATCHES, "patches after splitting", "split less, or take a coarser model")
    parts = {(k, side): pieces.on((k, side)) for k in range(len(multipatch)) for side in Side}
    interfaces = pieces.glued(multipatch.interfaces)
    patches, _ = with_common_splines(pieces.patches, interfaces)
    split, lost = multipatch._in_pieces(patches, interfaces, parts)
    # Rounding may part what was glued.
    split = split.with_shared_points(split.topology.coordinates)
    return SplitModel(split, origins(multipatch.patches, cuts, pieces), parts, lost)


def split_patches(patches: Sequence[Patch], interfaces: Sequence[Interface], cuts: Cuts) -> list[Patch]:
    """Other patches on the same knots as a model's, split as the model is."""
    pieces = Pieces(patches, cuts)
    return with_common_splines(pieces.patches, pieces.glued(interfaces))[0]


def origins(patches: Sequence[Patch], cuts: Cuts, pieces: Pieces) -> tuple[Origin, ...]:
    """Of all pieces, from the cuts: common splines may have other domains."""
    origins: dict[int, Origin] = {}
    for k, patch in enumerate(patches):
        us, vs = (
            list(pairwise([patch.knots[axis][0].item(), *cuts.get((k, axis), ()), patch.knots[axis][-1].item()]))
            for axis in (0, 1)
        )
        for column, u in zip(pieces.grid(k), us, strict=True):
            origins |= {piece: Origin(k, u, v) for piece, v in zip(column, vs, strict=True)}
    return tuple(origins[k] for k in range(len(pieces.patches)))
