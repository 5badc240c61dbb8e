"""On which knot spans of its interfaces a multi-patch is C1, and what keeps it from being C1 on the others."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..geometry.basis import knot_spans, span_basis
from ..geometry.multipatch import MultiPatch
from ..geometry.sides import Side
from ..geometry.topology import Vertex
from ..numeric.arrays import FloatArray
from .interface_samples import (
    InterfaceGroup,
    coordinates,
    cross_derivatives,
    curve_derivatives,
    interface_layout,
    norms,
)

__all__ = ["InterfaceSpans", "c1_share", "obstacles", "share_of", "smooth_spans"]

#: Cross derivatives are opposite, and their ratio is constant, to this; to rounding of coordinates far from the origin.
SMOOTH, ROUNDINGS = 1e-8, 64.0
#: Parameters per span: C1 in so many of them is C1 on the span of degree 8 and less, and lengths are good to 1e-3.
SAMPLES = 9
#: From so many spans on only those at extraordinary vertices need not be C1.
MANY_SPANS = 4


@dataclass(frozen=True, eq=False)
class InterfaceSpans:
    """The knot spans of an interface, in the sense of its side a.

    Attributes
    ----------
    breaks : (n + 1,) array
        Distinct knots of side a.
    lengths : (n,) array
    smooth : (n,) bool array
        Where the derivatives across the interface are opposite, with one constant ratio of speeds.
    ends : pair of Vertex
        Where it starts and ends.
    straight : pair of bool
        Whether the sides of the two patches go on in one line there.
    lowest_degree : int
        Of the patches on either side.
    """

    breaks: FloatArray
    lengths: FloatArray
    smooth: NDArray[np.bool_]
    ends: tuple[Vertex, Vertex]
    straight: tuple[bool, bool]
    lowest_degree: int

    @property
    def share(self) -> float:
        """The part of its length that is C1."""
        return c1_share((self,))

    def obstacles(self) -> Iterator[tuple[str, float]]:
        """What keeps spans from being C1, and the length of each of these spans."""
        n = len(self.lengths)
        for k in np.flatnonzero(~self.smooth).tolist():
            touched = [i for i, here in enumerate((k == 0, k == n - 1)) if here]
            yield self._obstacle(touched), float(self.lengths[k])

    def _obstacle(self, touched: list[int]) -> str:
        if self.lowest_degree < 2:
            return "patches of degree 1"
        if any(self.ends[i].extraordinary for i in touched):
            return "extraordinary vertices"
        for i in touched:
            if not self.ends[i].interior:
                patches = self.ends[i].valence
                if patches > 2:
                    return "boundary vertices of three patches and more"
                return (
                    "boundary joints where speeds of the sides differ"
                    if self.straight[i]
                    else "corners of the boundary"
                )
        if any(end.extraordinary for end in self.ends):
            few = len(self.lengths) < MANY_SPANS
            return (
                "fewer than 4 spans beside an extraordinary vertex" if few else "rows relaxed beside extraordinary ones"
            )
        return "rows that are not kept"


def c1_share(interfaces: Iterable[InterfaceSpans]) -> float:
    """The part of the length of interfaces that is C1; 1 without any."""
    found = list(interfaces)
    total = sum(float(i.lengths.sum()) for i in found)
    return sum(float(i.lengths[i.smooth].sum()) for i in found) / total if total > 0 else 1.0


def obstacles(interfaces: Iterable[InterfaceSpans]) -> dict[str, float]:
    """What keeps interfaces from being C1, with the part of their length, the longest first."""
    found = list(interfaces)
    total = sum(float(i.lengths.sum()) for i in found)
    parts: dict[str, float] = {}
    for spans in found:
        for reason, length in spans.obstacles():
            parts[reason] = parts.get(reason, 0.0) + length / total
    return dict(sorted(parts.items(), key=lambda item: -item[1]))


def share_of(mp: MultiPatch) -> float:
    """The same as ``c1_share(smooth_spans(mp))``, in a third of the time."""
    total = good = 0.0
    for _, lengths, smooth, _ in _by_group(mp):
        total, good = total + float(lengths.sum()), good + float(lengths[smooth].sum())
    return good / total if total > 0 else 1.0


def smooth_spans(mp: MultiPatch) -> tuple[InterfaceSpans, ...]:
    """The knot spans of every interface, and which of them are C1.

    Parameters
    ----------
    mp : MultiPatch
        Polynomial or rational.

    Returns
    -------
    tuple of InterfaceSpans
        In the order of the interfaces.
    """
    at = {corner: vertex for vertex in mp.vertices for corner in vertex.corners}
    found: dict[int, InterfaceSpans] = {}
    for group, lengths, smooth, straight in _by_group(mp):
        for k, index in enumerate(group.members.tolist()):
            f = mp.interfaces[index]
            patch = mp.patches[f.patch_a]
            degrees = (*patch.degrees, *mp.patches[f.patch_b].degrees)
            first, last = (at[f.patch_a, corner] for corner in _corners(f.side_a))
            found[index] = InterfaceSpans(
                knot_spans(patch.knots[f.side_a.axis]),
                lengths[k],
                smooth[k],
                (first, last),
                (bool(straight[k, 0]), bool(straight[k, 1])),
                min(degrees),
            )
    return tuple(found[i] for i in range(len(mp.interfaces)))


def _corners(side: Side) -> tuple[int, int]:
    """Corners of a patch, counted (0, 0), (1, 0), (0, 1), (1, 1), at the start and the end of a side."""
    fixed = int(side.at_end)
    return (2 * fixed, 2 * fixed + 1) if side.axis == 0 else (fixed, fixed + 2)


def _by_group(mp: MultiPatch) -> Iterator[tuple[InterfaceGroup, FloatArray, NDArray[np.bool_], NDArray[np.bool_]]]:
    """Interfaces of equal degree and knots, with what `_measured` finds of them."""
    if not mp.interfaces:
        return
    control = coordinates(mp)
    rounding = float(np.spacing(np.abs(control).max()))
    for group in interface_layout(mp.topology).groups:
        yield group, *_measured(group, control, rounding)


# Absurd models have infinite slopes.
@np.errstate(over="ignore", divide="ignore", invalid="ignore")
def _measured(
    group: InterfaceGroup, control: FloatArray, rounding: float
) -> tuple[FloatArray, NDArray[np.bool_], NDArray[np.bool_]]:
    """Lengths (k, n) of the spans of k interfaces, whether they are C1, and whether boundary sides go on straight."""
    t, basis = span_basis(group.knots, group.degree, SAMPLES)
    side_a, side_b, next_a, next_b = control[group.rows]
    scale_a, scale_b = group.scales[..., None, None]
    first = cross_derivatives(side_a, scale_a * (next_a - side_a), basis)[0]
    second = cross_derivatives(side_b, scale_b * (next_b - side_b), basis)[0]
    length_a, length_b = norms(first), norms(second)
    apart = norms(first / length_a[..., None] + second / length_b[..., None])
    ratio = length_b / length_a
    limit = SMOOTH + ROUNDINGS * rounding * (scale_a[..., 0] / length_a + scale_b[..., 0] / length_b)
    speed = norms(curve_derivatives(side_a, basis)[1])
    by_span = (len(first), -1, SAMPLES)
    steps = np.diff(t.reshape(-1, SAMPLES), axis=1)
    speed = speed.reshape(by_span)
    lengths = ((speed[..., 1:] + speed[..., :-1]) / 2 * steps).sum(axis=2)
    ratio, limit = ratio.reshape(by_span), limit.reshape(by_span).max(axis=2)
    # What is not a number is not smooth.
    smooth = (apart.reshape(by_span).max(axis=2) < limit) & (np.ptp(ratio, axis=2) < limit * ratio.mean(axis=2))
    return lengths, smooth, apart[:, [0, -1]] < np.sqrt(SMOOTH)
