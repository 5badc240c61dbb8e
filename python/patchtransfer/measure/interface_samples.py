"""Interfaces of a multi-patch sampled for the continuity report, all of equal degree and knots at once."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..geometry.areas import numbered
from ..geometry.basis import end_rate, span_basis
from ..geometry.combinatorics import Quantity
from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch
from ..geometry.sides import Side
from ..geometry.topology import Topology, Vertex
from ..numeric.arrays import FloatArray, IntArray
from ..numeric.dense import product, svd
from .best_gluing import OF_VECTOR, factors, nearest_to_one

__all__ = [
    "InterfaceGroup",
    "InterfaceLayout",
    "Measured",
    "coordinates",
    "cross_derivatives",
    "curve_derivatives",
    "interface_layout",
    "measure",
    "norms",
]

#: Singular values of the gluing data's equations below this part of the largest are rounding.
ZERO = 1e-12
#: Both ends of an interface, among its samples.
ENDS = [0, -1]


@dataclass(frozen=True)
class InterfaceGroup:
    """Interfaces of equal degree and knots along them, each in the sense of its side a.

    `rows` (4, k, n) are entries of the control points of all patches, one patch after the other: side a, side b, and
    the next row inwards of each. `scales` (2, k) are p/h across, `kept` (k, n) the C1 rows that count, `domains` (k, 2)
    the first and last knot of side a.
    """

    members: IntArray
    knots: FloatArray
    degree: int
    rational: bool
    rows: IntArray
    scales: FloatArray
    kept: NDArray[np.bool_]
    domains: FloatArray


@dataclass(frozen=True)
class InterfaceLayout:
    """Groups of interfaces, and the interfaces with their ends (0 or 1) at every extraordinary vertex."""

    groups: tuple[InterfaceGroup, ...]
    extraordinary: tuple[tuple[Vertex, IntArray, IntArray], ...]


@dataclass(frozen=True)
class Measured:
    """What was measured on the interfaces of a group, over the `count` samples where both cross derivatives exist.

    `across` are the vectors (k, r, 2) of both sides that the C1 residual compares; `end_residuals` (k, 2, 2) are |g|
    and |g'| in columns, start and end in rows.
    """

    across: tuple[FloatArray, FloatArray]
    gap: FloatArray
    count: IntArray
    angle_sum: FloatArray
    angle_max: FloatArray
    angle_max_at: FloatArray
    log_ratio_sum: FloatArray
    as_g1: FloatArray
    gluing: FloatArray
    end_residuals: FloatArray


@Quantity
def interface_layout(topology: Topology) -> InterfaceLayout:
    """Grouping of the interfaces."""
    vertices = {vertex.point: vertex for vertex in topology.vertices}
    entries = numbered([patch.shape for patch in topology.patches])
    members: dict[tuple[bytes, int, bool], list[int]] = defaultdict(list)
    spokes: dict[int, list[tuple[int, int]]] = defaultdict(list)
    rows, scales, kept, domains = [], [], [], []
    for i, f in enumerate(topology.interfaces):
        a, b = topology.patches[f.patch_a], topology.patches[f.patch_b]
        knots = a.knots[f.side_a.axis]
        domains.append(knots[[0, -1]])
        knots = (knots - knots[0]) / (knots[-1] - knots[0])
        rational = a.weights is not None or b.weights is not None
        members[knots.tobytes(), a.degrees[f.side_a.axis], rational].append(i)
        of_a = [f.side_a.of(entries[f.patch_a], row) for row in (0, 1)]
        of_b = [f.side_b.of(entries[f.patch_b], row)[:: -1 if f.reversed else 1] for row in (0, 1)]
        rows.append(np.array([of_a[0], of_b[0], of_a[1], of_b[1]]))
        scales.append((_rate_across(a, f.side_a), _rate_across(b, f.side_b)))
        along = f.side_a.of(topology.points[f.patch_a])
        kept.append(np.ones(len(along), bool))
        for end, point in enumerate((int(along[0]), int(along[-1]))):
            vertex = vertices[point]
            kept[-1][:: 1 - 2 * end][: 2 if vertex.extraordinary else 0 if vertex.interior else 1] = False
            if vertex.extraordinary:
                spokes[point].append((i, end))
    groups = [
        InterfaceGroup(
            members=np.array(index),
            knots=np.frombuffer(knots),
            degree=degree,
            rational=rational,
            rows=np.stack([rows[i] for i in index], axis=1),
            scales=np.array([scales[i] for i in index]).T,
            kept=np.array([kept[i] for i in index]),
            domains=np.array([domains[i] for i in index]),
        )
        for (knots, degree, rational), index in members.items()
    ]
    extraordinary = [(vertices[point], *np.array(at).T) for point, at in sorted(spokes.items())]
    return InterfaceLayout(tuple(groups), tuple(extraordinary))


def _rate_across(patch: Patch, side: Side) -> float:
    """p/h across a side, h the first knot span."""
    return end_rate(patch.knots[1 - side.axis], patch.degrees[1 - side.axis], side.at_end)


def coordinates(mp: MultiPatch) -> FloatArray:
    """Control points of all patches, one after the other: homogeneous (n, 3) if any is rational, else (n, 2)."""
    points = np.concatenate([patch.control_points.reshape(-1, 2) for patch in mp.patches])
    if not mp.is_rational:
        return points
    weights = np.concatenate(
        [(np.ones(patch.shape) if patch.weights is None else patch.weights).ravel() for patch in mp.patches]
    )[:, None]
    return np.concatenate([points * weights, weights], axis=1)


def measure(group: InterfaceGroup, control: FloatArray, samples: int) -> Measured:
    """Measure the interfaces of a group at once: arrays (k, m, 2), k interfaces, m parameters."""
    sampled = _samples(group.knots.tobytes(), group.degree, samples)
    t, basis = sampled.t, sampled.basis
    side_a, side_b, next_a, next_b = control[group.rows]
    slope_a, slope_b = (
        scale[:, None, None] * (inner - side)
        for scale, inner, side in zip(group.scales, (next_a, next_b), (side_a, side_b), strict=True)
    )
    tangent, bend = curve_derivatives(side_a, basis)[1:]
    first, turn_a = cross_derivatives(side_a, slope_a, basis)
    second, turn_b = cross_derivatives(side_b, slope_b, basis)
    dot = -(first * second).sum(axis=2)
    cross = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
    length_a, length_b = norms(first), norms(second)
    exists = (length_a > 0) & (length_b > 0)
    angles = np.where(exists, np.degrees(np.arctan2(np.abs(cross), dot)), 0.0)
    log_ratios = np.log(np.where(exists, length_b, 1.0) / np.where(exists, length_a, 1.0))
    as_g1, gluing, end_residuals = _gluing(sampled, (first, second, tangent), (turn_a, turn_b, bend))
    gaps = norms(_projected(side_a) - _projected(side_b)).max(axis=1)
    if group.rational:
        # Control points decide (0 when bit-equal); weights that differ can open a gap between them.
        gaps = np.maximum(
            gaps, norms(curve_derivatives(side_a, basis)[0] - curve_derivatives(side_b, basis)[0]).max(axis=1)
        )
    peak = angles.argmax(axis=1)
    return Measured(
        across=(first, second) if group.rational else (slope_a[..., :2], slope_b[..., :2]),
        gap=gaps,
        count=exists.sum(axis=1),
        angle_sum=angles.sum(axis=1),
        angle_max=angles.max(axis=1),
        angle_max_at=t[peak],
        log_ratio_sum=log_ratios.sum(axis=1),
        as_g1=as_g1,
        gluing=gluing,
        end_residuals=end_residuals,
    )


def norms(vectors: FloatArray) -> FloatArray:
    """Lengths (...) of vectors (..., 2)."""
    return np.hypot(vectors[..., 0], vectors[..., 1])


def _projected(h: FloatArray) -> FloatArray:
    return h if h.shape[-1] == 2 else h[..., :2] / h[..., 2:]


def curve_derivatives(h: FloatArray, basis: tuple[FloatArray, ...]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """C, C' and C'' of curves with coefficients (k, n, 2), or homogeneous ones (k, n, 3)."""
    value, slope, curvature = (product(b, h) for b in basis)
    if h.shape[-1] == 2:
        return value, slope, curvature
    w = value[..., 2:]
    point = value[..., :2] / w
    tangent = (slope[..., :2] - slope[..., 2:] * point) / w
    bend = (curvature[..., :2] - 2 * slope[..., 2:] * tangent - curvature[..., 2:] * point) / w
    return point, tangent, bend


def cross_derivatives(h: FloatArray, e: FloatArray, basis: tuple[FloatArray, ...]) -> tuple[FloatArray, FloatArray]:
    """Cross derivative D and its derivative along the side, from side `h` and its step `e` inwards."""
    inward, inward_slope = (product(b, e) for b in basis[:2])
    if h.shape[-1] == 2:
        return inward, inward_slope
    value, slope = (product(b, h) for b in basis[:2])
    w = value[..., 2:]
    point = value[..., :2] / w
    tangent = (slope[..., :2] - slope[..., 2:] * point) / w
    d = (inward[..., :2] - inward[..., 2:] * point) / w
    turn = inward_slope[..., :2] - inward_slope[..., 2:] * point - inward[..., 2:] * tangent
    return d, (turn - slope[..., 2:] * d) / w


def _gluing(
    samples: _Samples, vectors: tuple[FloatArray, ...], slopes: tuple[FloatArray, ...]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Residuals (k,), gluing data (k, 7) and end residuals (k, 2, 2) of a D_a + b D_b = c C'."""
    v = np.stack(vectors, axis=3)
    largest = np.hypot(v[:, :, 0], v[:, :, 1]).max(axis=1)
    largest[largest == 0] = 1.0
    v = (v / largest[:, None, None])[..., OF_VECTOR]
    flat = (v * samples.weighted[:, None]).reshape(len(v), -1, len(OF_VECTOR))
    # Vectors of absurd weights overflow; of those sides nothing is known.
    known = np.isfinite(flat).all(axis=(1, 2))
    _, sigma, vt = svd(np.where(known[:, None, None], flat, 0.0))
    x = np.where(known[:, None], nearest_to_one(sigma, vt, ZERO), np.nan)
    dv = (np.stack([slope[:, ENDS] for slope in slopes], axis=3) / largest[:, None, None])[..., OF_VECTOR]
    rows = v[:, ENDS] * samples.ends
    slope_rows = dv * samples.ends + v[:, ENDS] * samples.end_slopes
    at_ends = [norms((m * x[:, None, None]).sum(axis=3)) for m in (rows, slope_rows)]
    residual = np.divide(sigma[:, -1], sigma[:, 0], out=np.full(len(sigma), np.nan), where=known)
    return residual, x, np.stack(at_ends, axis=2)


class _Samples(NamedTuple):
    """Parameters (m,) with bases, and what every coefficient of the gluing data is multiplied by there, but vectors.

    `weighted` (m, 7) holds the roots of trapezoidal weights, with which the singular values converge with the number of
    samples; `ends` and `end_slopes` (2, 1, 7) do not.
    """

    t: FloatArray
    basis: tuple[FloatArray, ...]
    weighted: FloatArray
    ends: FloatArray
    end_slopes: FloatArray


@lru_cache(maxsize=256)
def _samples(knot_bytes: bytes, degree: int, samples: int) -> _Samples:
    t, basis = span_basis(np.frombuffer(knot_bytes), degree, samples)
    multiplied = factors(t)
    end_slopes = np.array([[-1, 1, -1, 1, 2, -2, 0], [-1, 1, -1, 1, 0, 2, -2.0]])
    # The breaks occur twice, with half a step each.
    steps = np.diff(t)
    weights = (np.append(steps, 0.0) + np.insert(steps, 0, 0.0)) / 2
    return _Samples(t, basis, np.sqrt(weights)[:, None] * multiplied, multiplied[ENDS, None], end_slopes[:, None])
