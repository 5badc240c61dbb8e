"""Continuity report: how smooth a multi-patch is across its interfaces.

In the plane any two patches that share a side are G1 there, so three finer things are measured: the residual
of the C1 rows, the kink of iso-lines, and the residual of analysis-suitable G1 gluing.
"""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .multipatch import Interface, MultiPatch, Side
from .quality import span_basis
from .splines import FloatArray, Patch
from .topology import Vertex

__all__ = ["ContinuityReport", "InterfaceContinuity", "Kink", "VertexContinuity", "check_continuity"]


@dataclass(frozen=True)
class Kink:
    """Angle in degrees by which iso-lines bend where they cross interfaces.

    `at` is (patch, side, t), where the largest kink is, t in the side's own knots; None without interfaces.
    """

    mean: float
    max: float
    at: tuple[int, Side, float] | None

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        at = None if self.at is None else {"patch": self.at[0], "side": int(self.at[1]), "t": self.at[2]}
        return {"mean": self.mean, "max": self.max, "at": at}


@dataclass(frozen=True)
class InterfaceContinuity:
    """Continuity across one interface.

    Attributes
    ----------
    interface : Interface
    c0_gap, c1_residual, c1_residual_all : float
        As in :class:`ContinuityReport`.
    speed_ratio : float
        ω_a / ω_b of the C1 rows, the chord's log-mean of |D_b| / |D_a|.
    kink : Kink
    as_g1_residual : float
    gluing : tuple of 7 float
        The best gluing data: a(0), a(1), b(0), b(1) and the Bernstein coefficients of c, of unit norm, for
        cross derivatives and tangent divided by their largest lengths and the interface mapped to [0, 1].
    """

    interface: Interface
    c0_gap: float
    c1_residual: float
    c1_residual_all: float
    speed_ratio: float
    kink: Kink
    as_g1_residual: float
    gluing: tuple[float, ...]

    @property
    def gluing_positive(self) -> bool:
        """Whether a and b are positive on the whole interface, as analysis-suitable gluing requires."""
        return min(self.gluing[:4]) > 0

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        f = self.interface
        return {
            "patches": [f.patch_a, f.patch_b],
            "sides": [int(f.side_a), int(f.side_b)],
            "c0_gap": self.c0_gap,
            "c1_residual": self.c1_residual,
            "c1_residual_all": self.c1_residual_all,
            "speed_ratio": self.speed_ratio,
            "kink_deg": self.kink.to_dict(),
            "as_g1_residual": self.as_g1_residual,
            "gluing": list(self.gluing),
            "gluing_positive": self.gluing_positive,
        }


@dataclass(frozen=True)
class VertexContinuity:
    """How well the gluing identity holds at an extraordinary vertex.

    Attributes
    ----------
    point : int
        Index among the shared control points.
    position : (float, float)
    valence : int
    tangent_residual : float
        Largest |g(0)| over the edges at the vertex, g = a D_a + b D_b − c C' with the best gluing data of
        each interface (unit norm, scaled as in :class:`InterfaceContinuity`).
    twist_residual : float
        Largest |g'(0)|, the first-order row, which ties the twists together.
    """

    point: int
    position: tuple[float, float]
    valence: int
    tangent_residual: float
    twist_residual: float

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "position": list(self.position),
            "valence": self.valence,
            "tangent_residual": self.tangent_residual,
            "twist_residual": self.twist_residual,
        }


@dataclass(frozen=True)
class ContinuityReport:
    """What :func:`check_continuity` found, the worst over all interfaces.

    Attributes
    ----------
    c0_gap : float
        Largest distance between glued control points / diameter; exactly 0 when they are bit-equal.
    c1_residual : float
        Largest distance / diameter between an interface control point and where its C1 row puts it. Rows that
        no map of this topology and boundary is free to fulfil are left out: the first at the boundary, the
        first two at an extraordinary vertex (its rows are in `vertices`).
    c1_residual_all : float
        The same over all rows.
    kink_deg : Kink
        Mean and maximum over all samples of all interfaces.
    as_g1_residual : float
        0 up to rounding for analysis-suitable G1 parameterizations.
    interfaces : tuple of InterfaceContinuity
        In the order of the multi-patch.
    vertices : tuple of VertexContinuity
        Extraordinary vertices.
    """

    c0_gap: float
    c1_residual: float
    c1_residual_all: float
    kink_deg: Kink
    as_g1_residual: float
    # A line an interface would bury the summary.
    interfaces: tuple[InterfaceContinuity, ...] = field(repr=False)
    vertices: tuple[VertexContinuity, ...] = field(repr=False)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "c0_gap": self.c0_gap,
            "c1_residual": self.c1_residual,
            "c1_residual_all": self.c1_residual_all,
            "kink_deg": self.kink_deg.to_dict(),
            "as_g1_residual": self.as_g1_residual,
            "interfaces": [f.to_dict() for f in self.interfaces],
            "extraordinary_vertices": [v.to_dict() for v in self.vertices],
        }


def check_continuity(mp: MultiPatch, samples: int = 20) -> ContinuityReport:
    """Measure the continuity of a multi-patch across its interfaces.

    Parameters
    ----------
    mp : MultiPatch
        Polynomial or rational, of any orientation.
    samples : int, default 20
        Uniform parameters per knot span along the interfaces, both ends included; at least 2.

    Returns
    -------
    ContinuityReport
        Without interfaces all numbers are 0.

    Raises
    ------
    InputError
        When `samples` is below 2.

    Notes
    -----
    D_a, D_b are the derivatives across the interface, pointing into the two patches, whose domains are taken to
    be unit squares; p the degree and h the first knot span across; L_j, s_j, R_j the control points in the first
    row of one patch, on the interface, and in the first row of the other.

    C1 rows: ω_a (p_a/h_a)(L_j − s_j) + ω_b (p_b/h_b)(R_j − s_j) = 0, scaled so that the factors of s_j add up
    to one. This is 2s − p − q = 0 of the paper (Eq. 10) where speeds and spans agree. The ratio ω_a : ω_b is
    the log-mean of |D_b| / |D_a| over the whole chord, the interfaces joined through opposite edges of
    valence-4 vertices. Rational patches have no such rows: there it is the largest |ω_a D_a + ω_b D_b| over
    the samples in the same scaling.

    Kink: the angle between D_b and −D_a.

    Analysis-suitable G1 (Collin, Sangalli, Takacs 2016): a D_a + b D_b = c C' with a, b > 0 linear and c
    quadratic along the interface. With D_a, D_b, C' divided by their largest lengths the residual is the
    ratio of the smallest to the largest singular value of the system of all samples in these seven
    coefficients (Bernstein form, trapezoidal weights). On regular patches a residual of 0 makes a and b have
    one sign, for a det(D_a, C') = −b det(D_b, C'); where it is not small they may change sign
    (`gluing_positive`).
    """
    if not mp.interfaces:
        return ContinuityReport(0.0, 0.0, 0.0, Kink(0.0, 0.0, None), 0.0, (), ())
    vertices = {vertex.point: vertex for vertex in mp.topology.vertices}
    edges = [_edge(mp, f, vertices) for f in mp.interfaces]
    groups: dict[Any, list[int]] = defaultdict(list)
    for i, edge in enumerate(edges):
        groups[edge.knots.tobytes(), edge.degree].append(i)
    sampled: dict[int, _Samples] = {}
    for members in groups.values():
        sampled.update(zip(members, _sample([edges[i] for i in members], samples), strict=True))
    found = [sampled[i] for i in range(len(edges))]
    ratios = _chord_ratios(mp, found)
    interfaces = tuple(_report(mp, *item) for item in zip(mp.interfaces, edges, found, ratios, strict=True))
    count = sum(s.count for s in found)
    worst = max(interfaces, key=lambda f: f.kink.max).kink
    return ContinuityReport(
        max(f.c0_gap for f in interfaces),
        max(f.c1_residual for f in interfaces),
        max(f.c1_residual_all for f in interfaces),
        Kink(sum(s.angle_sum for s in found) / max(count, 1), worst.max, worst.at),
        max(f.as_g1_residual for f in interfaces),
        interfaces,
        _vertex_reports(mp, edges, found),
    )


@dataclass(frozen=True)
class _Rows:
    """Homogeneous control points (n, 3) of a side, and p/h times the step to the next row."""

    side: FloatArray
    slope: FloatArray
    scale: float


@dataclass(frozen=True)
class _Edge:
    """An interface in the sense of side a, its knots mapped to [0, 1]."""

    knots: FloatArray
    degree: int
    a: _Rows
    b: _Rows
    ends: tuple[int, int]
    dropped: tuple[int, int]
    rational: bool


@dataclass(frozen=True)
class _Samples:
    """What was sampled on an interface, over the `count` samples where both cross derivatives exist."""

    across: tuple[FloatArray, FloatArray]
    gap: float
    count: int
    angle_sum: float
    angle_max: float
    angle_max_at: float
    log_ratio_sum: float
    as_g1: float
    gluing: FloatArray
    end_residuals: FloatArray
    """|g| and |g'| in columns, start and end in rows."""


def _edge(mp: MultiPatch, f: Interface, vertices: dict[int, Vertex]) -> _Edge:
    a, b = mp.patches[f.patch_a], mp.patches[f.patch_b]
    knots = a.knots[f.side_a.axis]
    directed = mp.topology.directed_side(f.patch_a, f.side_a)
    points = directed.points(mp.topology.points[f.patch_a])
    ends = (int(points[-1]), int(points[0])) if directed.reversed else (int(points[0]), int(points[-1]))
    dropped = [2 if vertices[v].extraordinary else 0 if vertices[v].interior else 1 for v in ends]
    return _Edge(
        (knots - knots[0]) / (knots[-1] - knots[0]),
        a.degrees[f.side_a.axis],
        _rows(a, f.side_a, False),
        _rows(b, f.side_b, f.reversed),
        ends,
        (dropped[0], dropped[1]),
        a.weights is not None or b.weights is not None,
    )


def _rows(patch: Patch, side: Side, reverse: bool) -> _Rows:
    axis = 1 - side.axis
    knots, p = patch.knots[axis], patch.degrees[axis]
    # On a domain of length 1: along a chord, speeds of patches with other domains are comparable then.
    span = knots[-1] - knots[-p - 2] if side.at_end else knots[p + 1] - knots[0]
    scale = p * float((knots[-1] - knots[0]) / span)

    def row(k: int) -> FloatArray:
        points = side.of(patch.control_points, k)
        w = np.ones((len(points), 1)) if patch.weights is None else side.of(patch.weights, k)[:, None]
        rows = np.concatenate([points * w, w], axis=1)
        return rows[::-1] if reverse else rows

    first = row(0)
    return _Rows(first, scale * (row(1) - first), scale)


def _sample(edges: list[_Edge], samples: int) -> list[_Samples]:
    """Sample interfaces of equal degree and knots at once: arrays (k, m, 2), k interfaces, m parameters."""
    t, basis = span_basis(edges[0].knots, edges[0].degree, samples)
    side_a, side_b, slope_a, slope_b = (
        np.array([getattr(rows, name) for rows in both])
        for name in ("side", "slope")
        for both in ([e.a for e in edges], [e.b for e in edges])
    )
    curve, tangent, bend = _curve(side_a, basis)
    other, _, _ = _curve(side_b, basis)
    first, turn_a = _across(side_a, slope_a, basis)
    second, turn_b = _across(side_b, slope_b, basis)
    dot = -(first * second).sum(axis=2)
    cross = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
    length_a, length_b = np.hypot(*first.transpose(2, 0, 1)), np.hypot(*second.transpose(2, 0, 1))
    exists = (length_a > 0) & (length_b > 0)
    angles = np.where(exists, np.degrees(np.arctan2(np.abs(cross), dot)), 0.0)
    log_ratios = np.log(np.where(exists, length_b, 1.0) / np.where(exists, length_a, 1.0))
    as_g1, gluing, end_residuals = _gluing(t, (first, second, tangent), (turn_a, turn_b, bend))
    # Control points decide (0 when bit-equal); weights that differ can open a gap between them.
    gaps = _norms(side_a[..., :2] / side_a[..., 2:] - side_b[..., :2] / side_b[..., 2:]).max(axis=1)
    if (side_a[..., 2] != side_b[..., 2]).any():
        gaps = np.maximum(gaps, _norms(curve - other).max(axis=1))
    peak = angles.argmax(axis=1)
    return [
        _Samples(
            across=(first[k], second[k]),
            gap=float(gaps[k]),
            count=int(exists[k].sum()),
            angle_sum=float(angles[k].sum()),
            angle_max=float(angles[k, peak[k]]),
            angle_max_at=float(t[peak[k]]),
            log_ratio_sum=float(log_ratios[k].sum()),
            as_g1=float(as_g1[k]),
            gluing=gluing[k],
            end_residuals=end_residuals[k],
        )
        for k in range(len(edges))
    ]


def _norms(vectors: FloatArray) -> FloatArray:
    return np.hypot(vectors[..., 0], vectors[..., 1])


def _curve(h: FloatArray, basis: tuple[FloatArray, ...]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """C, C' and C'' of rational curves with homogeneous coefficients (k, n, 3)."""
    value, slope, curvature = (np.matmul(b, h) for b in basis)
    w = value[..., 2:]
    point = value[..., :2] / w
    tangent = (slope[..., :2] - slope[..., 2:] * point) / w
    bend = (curvature[..., :2] - 2 * slope[..., 2:] * tangent - curvature[..., 2:] * point) / w
    return point, tangent, bend


def _across(h: FloatArray, e: FloatArray, basis: tuple[FloatArray, ...]) -> tuple[FloatArray, FloatArray]:
    """Cross derivative D and its derivative along the side, from side `h` and its step `e` inwards."""
    value, slope = (np.matmul(b, h) for b in basis[:2])
    inward, inward_slope = (np.matmul(b, e) for b in basis[:2])
    w = value[..., 2:]
    point = value[..., :2] / w
    tangent = (slope[..., :2] - slope[..., 2:] * point) / w
    d = (inward[..., :2] - inward[..., 2:] * point) / w
    turn = inward_slope[..., :2] - inward_slope[..., 2:] * point - inward[..., 2:] * tangent
    return d, (turn - slope[..., 2:] * d) / w


def _gluing(
    t: FloatArray, vectors: tuple[FloatArray, ...], slopes: tuple[FloatArray, ...]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Residuals (k,), gluing data (k, 7) and end residuals (k, 2, 2) of a D_a + b D_b = c C'."""
    scaled = []
    for v, dv in zip(vectors, slopes, strict=True):
        largest = _norms(v).max(axis=1)
        largest[largest == 0] = 1.0
        scaled.append((v / largest[:, None, None], dv / largest[:, None, None]))
    (a, da), (b, db), (c, dc) = scaled
    linear = np.stack([1 - t, t])
    quadratic = -np.stack([(1 - t) ** 2, 2 * t * (1 - t), t**2])

    def columns(x: FloatArray, y: FloatArray, z: FloatArray, one: FloatArray, two: FloatArray) -> FloatArray:
        # (k, m, 2, 7)
        parts = [v[..., None] * w.T[:, None, :] for v, w in ((x, one), (y, one), (z, two))]
        return np.concatenate(parts, axis=3)

    system = columns(a, b, c, linear, quadratic)
    # Trapezoidal weights: the singular values converge with the number of samples.
    weights = np.sqrt(_trapezoidal(t))
    flat = (system * weights[:, None, None]).reshape(len(system), -1, 7)
    _, sigma, vt = np.linalg.svd(flat, full_matrices=False)
    ends = [0, -1]
    d_linear, d_quadratic = np.array([[-1.0] * 2, [1.0] * 2]), np.array([[2.0, 0], [-2, 2], [0, -2]])
    moved = columns(da[:, ends], db[:, ends], dc[:, ends], linear[:, ends], quadratic[:, ends])
    slope = moved + columns(a[:, ends], b[:, ends], c[:, ends], d_linear, d_quadratic)
    x = _nearest_to_one(sigma, vt)
    at_ends = [_norms(np.einsum("kexi,ki->kex", m, x)) for m in (system[:, ends], slope)]
    return sigma[:, -1] / sigma[:, 0], x, np.stack(at_ends, axis=2)


def _trapezoidal(t: FloatArray) -> FloatArray:
    """Weights of the composite trapezoidal rule at `t`, where breaks occur twice."""
    steps = np.diff(t)
    return (np.append(steps, 0.0) + np.insert(steps, 0, 0.0)) / 2


def _nearest_to_one(sigma: FloatArray, vt: FloatArray) -> FloatArray:
    """Pick the smallest singular vectors (k, 7), signed so that a and b are positive rather than negative.

    On C1 models the null space has several dimensions (any linear a = b): its vector nearest to a = b = 1.
    """
    null = sigma <= np.maximum(sigma[:, -1:], 1e-12 * sigma[:, :1])
    x = np.einsum("kij,ki->kj", vt, null * vt[..., :4].sum(axis=2))
    length = np.linalg.norm(x, axis=1, keepdims=True)
    return np.where(length > 0, x / np.where(length > 0, length, 1.0), vt[:, -1])


def _chord_ratios(mp: MultiPatch, found: list[_Samples]) -> list[float]:
    """ω_a / ω_b of every interface: the log-mean of |D_right| / |D_left| along its chord."""
    ratios = [1.0] * len(found)
    for chord in mp.topology.directed_chords:
        # Run with the chord, patch a is on the left, or run against it, on the right.
        signs = {i: 1 if forward else -1 for i, forward in chord}
        count = sum(found[i].count for i in signs)
        mean = sum(sign * found[i].log_ratio_sum for i, sign in signs.items()) / max(count, 1)
        for i, sign in signs.items():
            ratios[i] = math.exp(sign * mean)
    return ratios


def _report(mp: MultiPatch, f: Interface, edge: _Edge, found: _Samples, ratio: float) -> InterfaceContinuity:
    first, second = found.across if edge.rational else (edge.a.slope[:, :2], edge.b.slope[:, :2])
    rows = _norms(ratio * first + second) / ((ratio * edge.a.scale + edge.b.scale) * mp.diameter)
    kept = rows if edge.rational else rows[edge.dropped[0] : len(rows) - edge.dropped[1]]
    knots = mp.patches[f.patch_a].knots[f.side_a.axis]
    t = float(knots[0] + found.angle_max_at * (knots[-1] - knots[0]))
    kink = Kink(found.angle_sum / max(found.count, 1), found.angle_max, (f.patch_a, f.side_a, t))
    return InterfaceContinuity(
        f,
        found.gap / mp.diameter,
        float(kept.max(initial=0.0)),
        float(rows.max()),
        ratio,
        kink,
        found.as_g1,
        tuple(found.gluing.tolist()),
    )


def _vertex_reports(mp: MultiPatch, edges: list[_Edge], found: list[_Samples]) -> tuple[VertexContinuity, ...]:
    residuals: dict[int, list[FloatArray]] = defaultdict(list)
    for edge, s in zip(edges, found, strict=True):
        for point, residual in zip(edge.ends, s.end_residuals, strict=True):
            residuals[point].append(residual)
    reports = []
    for vertex in mp.topology.vertices:
        if vertex.extraordinary:
            tangent, twist = np.max(residuals[vertex.point], axis=0)
            x, y = mp.topology.coordinates[vertex.point].tolist()
            reports.append(VertexContinuity(vertex.point, (x, y), vertex.valence, float(tangent), float(twist)))
    return tuple(reports)
