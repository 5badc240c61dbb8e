"""Continuity report: how smooth a multi-patch is across its interfaces.

In the plane any two patches that share a side are G1 there, so three finer things are measured: the residual
of the C1 rows, the kink of iso-lines, and the residual of analysis-suitable G1 gluing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from ..geometry.multipatch import MultiPatch
from ..geometry.sides import Interface, Side
from ..numeric.arrays import FloatArray
from .interface_samples import InterfaceGroup, InterfaceLayout, Measured, coordinates, interface_layout, measure, norms
from .smooth_spans import InterfaceSpans, c1_share, obstacles, smooth_spans

__all__ = ["ContinuityReport", "InterfaceContinuity", "Kink", "VertexContinuity", "check_continuity"]


class Kink(NamedTuple):
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


class InterfaceContinuity(NamedTuple):
    """Continuity across one interface.

    Attributes
    ----------
    interface : Interface
    c0_gap, c1_residual, c1_residual_all : float
        As in :class:`ContinuityReport`.
    speed_ratio : float
        ω_a / ω_b of the C1 rows, the median over the chord.
    kink : Kink
    as_g1_residual : float
    gluing : tuple of 7 float
        The best gluing data: a(0), a(1), b(0), b(1) and the Bernstein coefficients of c, of unit norm, for
        cross derivatives and tangent divided by their largest lengths and the interface mapped to [0, 1].
    c1_share : float
        The part of its length that is C1, as in :class:`ContinuityReport`.
    c1_obstacles : tuple of str
        What keeps the rest from being C1, the longest part first.
    """

    interface: Interface
    c0_gap: float
    c1_residual: float
    c1_residual_all: float
    speed_ratio: float
    kink: Kink
    as_g1_residual: float
    gluing: tuple[float, ...]
    c1_share: float
    c1_obstacles: tuple[str, ...]

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
            "c1_share": self.c1_share,
            "c1_obstacles": list(self.c1_obstacles),
        }


class VertexContinuity(NamedTuple):
    """How well analysis-suitable gluing holds at an extraordinary vertex.

    Vertex rows of ``continuity="c1"`` hold with gluing data that bend near the vertex, so these numbers do not vanish
    there; ``result.rows.residual`` is theirs.

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


@dataclass(frozen=True, eq=False)
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
    c1_share : float
        The part of the interfaces' length on which the derivatives across them are opposite with one constant ratio
        on every knot span, to 1e-8. 1 without interfaces.
    c1_obstacles : dict of str to float
        What keeps the rest from being C1, with the part of the length, the longest first: extraordinary vertices,
        boundary vertices, rows that are left out or not kept.
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
    vertices: tuple[VertexContinuity, ...]
    c1_share: float
    c1_obstacles: dict[str, float]
    _spans: tuple[InterfaceSpans, ...]
    _interfaces: tuple[Interface, ...]
    # Numbers of every interface in the order of `InterfaceContinuity`, the kink as mean, maximum and t.
    _table: FloatArray

    def __repr__(self) -> str:
        return (
            f"<ContinuityReport: {len(self._interfaces)} interfaces, gap {self.c0_gap:.1e}, C1 residual "
            f"{self.c1_residual:.1e}, AS-G1 residual {self.as_g1_residual:.1e}, kinks up to {self.kink_deg.max:.1f}°>"
        )

    @cached_property
    def interfaces(self) -> tuple[InterfaceContinuity, ...]:
        """Every interface, in the order of the multi-patch."""
        reports = []
        for f, spans, (gap, c1, c1_all, ratio, mean, most, t, as_g1, *gluing) in zip(
            self._interfaces, self._spans, self._table.tolist(), strict=True
        ):
            kink = Kink(mean, most, (f.patch_a, f.side_a, t))
            why = tuple(obstacles((spans,)))
            reports.append(InterfaceContinuity(f, gap, c1, c1_all, ratio, kink, as_g1, tuple(gluing), spans.share, why))
        return tuple(reports)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ContinuityReport) and (
            (self.kink_deg.mean, self.interfaces, self.vertices)
            == (other.kink_deg.mean, other.interfaces, other.vertices)
        )

    __hash__ = None  # type: ignore[assignment]

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "c0_gap": self.c0_gap,
            "c1_residual": self.c1_residual,
            "c1_residual_all": self.c1_residual_all,
            "kink_deg": self.kink_deg.to_dict(),
            "as_g1_residual": self.as_g1_residual,
            "c1_share": self.c1_share,
            "c1_obstacles": self.c1_obstacles,
            "interfaces": [f.to_dict() for f in self.interfaces],
            "extraordinary_vertices": [v.to_dict() for v in self.vertices],
        }


# Absurd models have infinite slopes, and that is what the report says.
@np.errstate(over="ignore", divide="ignore", invalid="ignore")
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
        Without interfaces all numbers are 0, but for a share of C1 of 1.

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
    the median of (p_b/h_b) |R_j − s_j| / ((p_a/h_a) |L_j − s_j|) over the rows that count of the whole chord, the
    interfaces joined through opposite edges of valence-4 vertices: so rows that hold with one ratio have no
    residual, even if a few others do not hold. Rational patches have no such rows: there it is the largest
    |ω_a D_a + ω_b D_b| over the samples in the same scaling.

    Kink: the angle between D_b and −D_a.

    Analysis-suitable G1 (Collin, Sangalli, Takacs 2016): a D_a + b D_b = c C' with a, b > 0 linear and c
    quadratic along the interface. With D_a, D_b, C' divided by their largest lengths the residual is the
    ratio of the smallest to the largest singular value of the system of all samples in these seven
    coefficients (Bernstein form, trapezoidal weights). On regular patches a residual of 0 makes a and b have
    one sign, for a det(D_a, C') = −b det(D_b, C'); where it is not small they may change sign
    (`gluing_positive`).

    Examples
    --------
    >>> from patchtransfer import check_continuity, examples
    >>> report = check_continuity(examples.load("star")[0])
    >>> report.c1_share < 0.1, report.kink_deg.max > 1
    (True, True)
    """
    if not mp.interfaces:
        return ContinuityReport(0.0, 0.0, 0.0, Kink(0.0, 0.0, None), 0.0, (), 1.0, {}, (), (), np.empty((0, 15)))
    layout = interface_layout(mp.topology)
    control = coordinates(mp)
    found = [measure(group, control, samples) for group in layout.groups]
    ratios = _chord_ratios(mp, layout, found)
    table, ends = np.empty((len(mp.interfaces), 15)), np.empty((len(mp.interfaces), 2, 2))
    for group, measured in zip(layout.groups, found, strict=True):
        ends[group.members] = measured.end_residuals
        table[group.members] = _rows(mp.diameter, group, measured, ratios[group.members])
    gap, c1, c1_all, _, _, most, at, as_g1 = table[:, :8].T
    worst = int(most.argmax())
    f = mp.interfaces[worst]
    count = sum(int(measured.count.sum()) for measured in found)
    total = sum(float(measured.angle_sum.sum()) for measured in found)
    spans = smooth_spans(mp)
    kink = Kink(total / max(count, 1), float(most[worst]), (f.patch_a, f.side_a, float(at[worst])))
    return ContinuityReport(
        c0_gap=float(gap.max()),
        c1_residual=float(c1.max()),
        c1_residual_all=float(c1_all.max()),
        kink_deg=kink,
        as_g1_residual=float(as_g1.max()),
        vertices=_vertex_reports(mp, layout, ends),
        c1_share=c1_share(spans),
        c1_obstacles=obstacles(spans),
        _spans=spans,
        _interfaces=mp.interfaces,
        _table=table,
    )


def _chord_ratios(mp: MultiPatch, layout: InterfaceLayout, found: Sequence[Measured]) -> FloatArray:
    """ω_a / ω_b of every interface: the median ratio of its chord's C1 rows, or of the speeds where none counts."""
    logs: list[list[float]] = [[]] * len(mp.interfaces)
    means = np.empty((len(mp.interfaces), 2))
    for group, measured in zip(layout.groups, found, strict=True):
        a, b = (norms(vectors) for vectors in measured.across)
        there = (a > 0) & (b > 0)
        if not group.rational:
            there &= group.kept
        rows_of = np.log(np.where(there, b, 1.0) / np.where(there, a, 1.0))
        for i, row, use in zip(group.members.tolist(), rows_of.tolist(), there.tolist(), strict=True):
            logs[i] = [x for x, used in zip(row, use, strict=True) if used]
        means[group.members] = np.column_stack([measured.log_ratio_sum, measured.count])
    ratios = np.ones(len(logs))
    for chord in mp.topology.directed_chords:
        # Run with the chord, patch a is on the left, or run against it, on the right.
        signs = {i: 1 if forward else -1 for i, forward in chord}
        rows = [sign * x for i, sign in signs.items() for x in logs[i]]
        if rows:
            mean = median(rows)
        else:
            speeds, counts = (means[list(signs)] * [[sign, 1.0] for sign in signs.values()]).sum(axis=0)
            mean = speeds / max(counts, 1.0)
        for i, sign in signs.items():
            ratios[i] = math.exp(sign * mean)
    return ratios


def _rows(diameter: float, group: InterfaceGroup, found: Measured, ratios: FloatArray) -> FloatArray:
    """Rows of the report's table for the interfaces of a group, with ω_a / ω_b given."""
    first, second = found.across
    size = (ratios * group.scales[0] + group.scales[1]) * diameter
    rows = norms(ratios[:, None, None] * first + second) / size[:, None]
    kept = rows if group.rational else np.where(group.kept, rows, 0.0)
    at = group.domains[:, 0] + found.angle_max_at * np.diff(group.domains)[:, 0]
    columns = [found.gap / diameter, kept.max(axis=1), rows.max(axis=1), ratios]
    columns += [found.angle_sum / np.maximum(found.count, 1), found.angle_max, at, found.as_g1]
    return np.column_stack([*columns, found.gluing])


def _vertex_reports(mp: MultiPatch, layout: InterfaceLayout, end_residuals: FloatArray) -> tuple[VertexContinuity, ...]:
    reports = []
    for vertex, interfaces, ends in layout.extraordinary:
        tangent, twist = end_residuals[interfaces, ends].max(axis=0).tolist()
        x, y = mp.topology.coordinates[vertex.point].tolist()
        reports.append(VertexContinuity(vertex.point, (x, y), vertex.valence, tangent, twist))
    return tuple(reports)
