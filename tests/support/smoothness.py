"""How smooth a multi-patch is across interfaces, span by span, from evaluated patches alone.

A second opinion on rows and on `check_continuity`: it knows nothing of control points, chords or gluing data.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

import patchtransfer as pt
from patchtransfer.geometry.sides import Interface, Side

#: Gauss points per span.
POINTS = 16
#: Cross derivatives are opposite, and their ratio is constant, to this.
SMOOTH = 1e-8
CORNERS = {1: (0, 2), 2: (1, 3), 3: (0, 1), 4: (2, 3)}


@dataclass(frozen=True)
class Span:
    """A knot span of an interface: where it is, its length, mean kink in degrees, and whether it is C1.

    `place`: "extraordinary" and "boundary" touch such a vertex, "inside" neither.
    """

    interface: int
    place: str
    length: float
    kink: float
    smooth: bool


def spans(mp: pt.MultiPatch) -> list[Span]:
    """Every span of every interface."""
    return [span for index, f in enumerate(mp.interfaces) for span in _along(mp, index, f)]


def mean_kink(found: list[Span]) -> float:
    """Weighted by length."""
    return sum(s.length * s.kink for s in found) / sum(s.length for s in found)


def share(found: list[Span], place: str = "") -> float:
    """The part of length that is C1, of all spans or of those at a place."""
    counted = [s for s in found if place in ("", s.place)]
    return sum(s.length for s in counted if s.smooth) / sum(s.length for s in counted)


def _along(mp: pt.MultiPatch, index: int, f: Interface) -> Iterator[Span]:
    at = {corner: vertex for vertex in mp.vertices for corner in vertex.corners}
    ends = [at[f.patch_a, corner] for corner in CORNERS[int(f.side_a)]]
    a, b = mp.patches[f.patch_a], mp.patches[f.patch_b]
    knots, others = a.knots[f.side_a.axis], b.knots[f.side_b.axis]
    breaks, (x, weights) = np.unique(knots), np.polynomial.legendre.leggauss(POINTS)
    for k, (low, high) in enumerate(pairwise(breaks)):
        t = (low + high) / 2 + (high - low) / 2 * x
        part = (t - knots[0]) / (knots[-1] - knots[0])
        part = 1 - part if f.reversed else part
        first = _derivative(a, f.side_a, t, across=True)
        second = _derivative(b, f.side_b, others[0] + part * (others[-1] - others[0]), across=True)
        speed = np.hypot(*_derivative(a, f.side_a, t, across=False).T) * weights * (high - low) / 2
        sizes = [np.hypot(*d.T) for d in (first, second)]
        turn = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
        kink = np.degrees(np.abs(np.arctan2(turn, -(first * second).sum(axis=1))))
        apart = np.hypot(*(first / sizes[0][:, None] + second / sizes[1][:, None]).T)
        ratio = sizes[1] / sizes[0]
        touched = [v for v, here in zip(ends, (k == 0, k == len(breaks) - 2), strict=True) if here]
        place = "boundary" if any(not v.interior for v in touched) else "inside"
        place = "extraordinary" if any(v.extraordinary for v in touched) else place
        smooth = bool(apart.max() < SMOOTH and np.ptp(ratio) < SMOOTH * ratio.mean())
        yield Span(index, place, float(speed.sum()), float((speed * kink).sum() / speed.sum()), smooth)


def _derivative(patch: pt.Patch, side: Side, t: np.ndarray, across: bool) -> np.ndarray:
    """Along a side, or across it into the patch."""
    other = patch.knots[1 - side.axis]
    fixed = np.full_like(t, other[-1] if side.at_end else other[0])
    u, v = (t, fixed) if side.axis == 0 else (fixed, t)
    found = patch.derivative(u, v, *((1, 0) if (side.axis == 0) != across else (0, 1)))
    return -found if across and side.at_end else found
