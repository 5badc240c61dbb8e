"""The last step of matching by shape: matched points slide along the target until inner distances are kept best.

Metric multidimensional scaling (least squares on distances, near ones weighted up) with the points confined to the
target's boundary. All loops slide together, so that holes without a shape of their own find their start. Distances
alone cannot tell how a boundary stretches where a bend lengthens one side and shortens the other: with `bending` the
map is also made smooth (`thin_plate`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .._core import Sliding
from ..numeric.arrays import FloatArray
from .sampled_boundary import SOFT, WINDOWS, BoundaryShape, cyclic_gap, image_of
from .thin_plate import plate

__all__ = ["energy_of", "slide", "sliding"]

#: Weights of stretch along the loops and of unlike turning.
STRETCH, TURNING = 0.03, 1.0
#: Distances below this many steps between nodes are left to the stretch term: interpolation cannot tell them.
NEAR = 12.0


def slide(
    source: BoundaryShape,
    target: BoundaryShape,
    partners: Sequence[int],
    anchors: Sequence[FloatArray],
    keep: Sequence[FloatArray],
    bending: float = 0.0,
) -> tuple[list[FloatArray], float]:
    """Improve a matching of the first loops of `source`.

    Parameters
    ----------
    source, target : BoundaryShape
    partners : sequence of int
        Target loop of each of the source's first loops.
    anchors : sequence of (m + 1, 2) arrays
        The matching of each loop to start from.
    keep : sequence of (r,) arrays
        Arc lengths of source nodes whose images stay: corners and landmarks.
    bending : float, default 0
        Weight of the bending energy.

    Returns
    -------
    anchors : list of (n + 1, 2) arrays
        At all nodes of the source.
    energy : float
        Weighted mean square of the change of distances, relative to the distances; never above what the given anchors
        have. Bending is part of it.
    """
    x = [image_of(a, s) for a, s in zip(anchors, source.s, strict=False)]
    held = np.concatenate(
        [
            cyclic_gap(s, at, o.length) < 1e-9 * o.length
            for s, at, o in zip(source.s, keep, source.outlines, strict=False)
        ]
    )
    slid, energy = sliding(source, target, partners, bending).slide(np.concatenate(x), held)
    x = np.split(slid, np.cumsum([len(y) for y in x])[:-1])
    lengths = [target.outlines[t].length for t in partners]
    loops = zip(source.s, source.outlines, x, lengths, strict=False)
    closed = [
        np.column_stack([np.append(s, s[0] + o.length), np.append(y, y[0] + length)]) for s, o, y, length in loops
    ]
    return closed, energy


def energy_of(
    source: BoundaryShape, target: BoundaryShape, partners: Sequence[int], anchors: Sequence[FloatArray]
) -> float:
    """Energy of a matching of the first loops as it is, without bending; see `slide`."""
    x = np.concatenate([image_of(a, s) for a, s in zip(anchors, source.s, strict=False)])
    return sliding(source, target, partners).slide(x, np.ones(len(x), bool))[1]


def sliding(source: BoundaryShape, target: BoundaryShape, partners: Sequence[int], bending: float = 0.0) -> Sliding:
    """What positions of the nodes of the source's first loops on their partners cost, and the slide that lowers it.

    Least squares on the inner distances of matched points, weighted by 1/d², on turning and on stretch; with `bending`
    as its weight also the bending energy of the map.
    """
    loops = range(len(partners))
    n = source.rows(len(partners) - 1).stop
    wanted = source.distances[:n, :n]
    parts = [source.outlines[k].length / source.outlines[0].length for k in loops]
    shares = [source.shares(k) for k in loops]
    share = np.concatenate([x * part for x, part in zip(shares, parts, strict=True)])
    both = np.outer(share, share)
    weight = np.where(wanted < NEAR * np.sqrt(both), 0.0, both / (wanted**2 + SOFT))
    of_loops = [
        (
            target.outlines[t].core,
            target.s[t],
            target.rows(t).start,
            source.turning[k],
            TURNING * parts[k] * shares[k] / len(WINDOWS),
            np.diff(source.positions(k)),
            STRETCH * parts[k] ** 2,
        )
        for k, t in zip(loops, partners, strict=True)
    ]
    bent = plate(source, target, partners, bending) if bending else None
    return Sliding(of_loops, target.distances, wanted, weight / weight.sum(), WINDOWS, bent)
