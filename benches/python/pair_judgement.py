"""One direction of a pair: the transfer, judged by measures of its own, not by those of the result."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy.spatial import cKDTree

import patchtransfer as pt

#: A joint turns by more than a smooth place of an outline on the integer grid of a font ever does (degrees).
CORNER_DEGREES = 25.0
#: What a clean result misses at most, and a success in any case, relative to the target's diameter.
CLEAN, SUCCESS = 1e-3, 5e-3
#: Samples along a diameter, and nearest ones of which the segments are looked at: where thin parts or corners bring
#: several lines together, the nearest sample need not be on the nearest line.
DENSITY, NEAREST = 3000, 12
#: Samples of a span however short.
LEAST = 4
#: Tangents are chords of this part of a span.
CHORD = 1e-6
#: More than this below the mean scaled Jacobian of the target's own layout, a layout does not suit.
UNSUITED = 0.1
#: Processor seconds after which an answer is late.
LATE = 5.0


@dataclass
class Direction:
    """What became of one direction; numbers are None where there is no map to measure.

    `status` is "certified" or "degenerate" where a result was returned, "missed" or "refused" with the documented
    error in `reason`, "exception" for any other error, "no answer" at the limit, "no source" where the source's
    outline could not be parameterized.
    """

    family: str
    source: str
    target: str
    status: str = "no answer"
    reason: str = ""
    seconds: float = float("nan")
    corners: int = 0
    #: Target corners without a joint, and places where a corner of the source lies on a smooth place of the target.
    lost: list[list[float]] = field(default_factory=list)
    smoothed: list[list[float]] = field(default_factory=list)
    boundary_error: float | None = None
    reported_error: float | None = None
    #: Scaled Jacobian, least and mean: of the result, of the source, and of the target's own layout.
    jacobian: tuple[float, float] | None = None
    source_jacobian: tuple[float, float] | None = None
    own_jacobian: tuple[float, float] | None = None
    patches: int = 0
    #: Of every patch of a split source the source's own.
    origins: list[int] = field(default_factory=list)
    confidence: float | None = None
    warnings: list[str] = field(default_factory=list)

    @property
    def name(self) -> str:
        return f"{self.source} → {self.target}"

    @property
    def success(self) -> bool:
        """Whether it was returned as one, with a reason where it is degenerate."""
        return self.status == "certified" or (self.status == "degenerate" and bool(self.reason))

    @property
    def clean(self) -> bool:
        """Whether it is what a person wants."""
        met = self.boundary_error is not None and self.boundary_error <= CLEAN
        return self.status == "certified" and not self.lost and met

    @property
    def loss(self) -> float | None:
        """Mean scaled Jacobian below that of the target's own layout."""
        return self.own_jacobian[1] - self.jacobian[1] if self.jacobian and self.own_jacobian else None

    def causes(self) -> Iterator[str]:
        """What keeps it from being clean or good, by what can be seen in the numbers."""
        if self.status in ("exception", "no source"):
            yield self.status
        if self.status == "no answer" or self.seconds > LATE:
            yield "late"
        unsuited = self.loss is not None and self.loss > UNSUITED
        if self.family == "mirrored" and (unsuited or not self.clean):
            yield "mirrored"
        if self.lost:
            yield "corner without joint"
        if self.smoothed and self.status != "certified":
            yield "corner on a smooth place"
        if self.boundary_error is not None and self.boundary_error > CLEAN and not self.lost:
            yield "boundary missed although no corner is lost"
        if unsuited:
            yield "layout unsuited"
        if self.status == "degenerate" and not self.smoothed:
            yield "degenerate although no corner is on a smooth place"
        if self.status == "refused" and not self.smoothed:
            yield "refused although no corner is on a smooth place"


def judge(
    blank: Direction, source: pt.MultiPatch, target: pt.Boundary, options: dict[str, str]
) -> tuple[Direction, pt.MultiPatch | None]:
    """Transfer and measure; with the map, if there is any."""
    result = None
    begin = time.process_time()
    try:
        result = pt.transfer(source, target, **options)
        blank.status, blank.reason = result.certificate.status, "; ".join(result.certificate.reasons)
    except pt.TransferError as error:
        blank.status = "missed" if isinstance(error, pt.BoundaryMissedError) else "refused"
        blank.reason = f"{type(error).__name__}: {error}"
        result = getattr(error, "result", None)
    except Exception as error:
        blank.status, blank.reason = "exception", f"{type(error).__name__}: {error}"
    blank.seconds = time.process_time() - begin
    if result is None:
        return blank, None
    measure(blank, source, result.multipatch, target)
    blank.reported_error, blank.confidence = result.boundary_error, result.registration.confidence
    blank.warnings = list(result.warnings)
    blank.origins = [] if result.split is None else [origin.patch for origin in result.split.origin]
    return blank, result.multipatch


def measure(o: Direction, source: pt.MultiPatch, mapped: pt.MultiPatch, target: pt.Boundary) -> None:
    """Corners, boundary error and scaled Jacobians of a map."""
    found = mapped.boundary()
    o.patches = len(mapped)
    o.jacobian = jacobian(mapped)
    o.boundary_error = distance(found, target)
    size = diameter(target)
    wanted, ends = corners(target), corners(found, all_joints=True)
    o.corners = len(wanted)
    near = CLEAN * size > np.hypot(*(wanted[:, None, :2] - ends[None, :, :2]).T).T
    # A joint at the corner that turns less than half as much has rounded it off.
    kept = near & (wanted[:, None, 2] * ends[None, :, 2] > 0)
    kept &= abs(ends[None, :, 2]) > 0.5 * abs(wanted[:, None, 2])
    o.lost = wanted[~kept.any(axis=1), :2].tolist()
    before = corners(source.boundary(), all_joints=True)
    if len(before) == len(ends):
        turned = abs(before[:, 2]) > CORNER_DEGREES
        o.smoothed = ends[turned & ~near.any(axis=0), :2].tolist()


def jacobian(mp: pt.MultiPatch) -> tuple[float, float]:
    """Least and mean scaled Jacobian."""
    scaled = pt.quality(mp).scaled_jacobian
    return scaled.min, scaled.mean


def corners(boundary: pt.Boundary, all_joints: bool = False) -> np.ndarray:
    """Rows x, y and turning angle in degrees; without `all_joints` those above `CORNER_DEGREES` only.

    At ends of curves and, without `all_joints`, at knots inside them, too.
    """
    rows = []
    for loop in boundary.loops:
        pieces = [span for curve in loop for span in ([_whole(curve)] if all_joints else _spans(curve))]
        legs = np.array([(c(a + CHORD * (b - a)) - c(a), c(b) - c(b - CHORD * (b - a))) for c, a, b in pieces])
        ahead, behind = legs[:, 0] @ [1, 1j], np.roll(legs[:, 1], 1, axis=0) @ [1, 1j]
        turn = np.degrees(np.angle(ahead / behind))
        # Of either sense a loop's convex corners are positive.
        turn *= np.sign(_area(np.concatenate([_points(curve, boundary.diameter / DENSITY) for curve in loop])))
        rows += [(*c(a), angle) for (c, a, _), angle in zip(pieces, turn, strict=True)]
    found = np.array(rows)
    return found if all_joints else found[abs(found[:, 2]) > CORNER_DEGREES]


def _whole(curve: pt.BSplineCurve) -> tuple[pt.BSplineCurve, float, float]:
    return curve, *curve.domain


def _spans(curve: pt.BSplineCurve) -> list[tuple[pt.BSplineCurve, float, float]]:
    breaks = np.unique(curve.knots)
    breaks = breaks[(breaks >= curve.domain[0]) & (breaks <= curve.domain[1])]
    return [(curve, a, b) for a, b in pairwise(breaks)]


def _points(curve: pt.BSplineCurve, step: float) -> np.ndarray:
    """Points about a step apart, without the last one, which the next curve starts with."""
    parameters = []
    for _, a, b in _spans(curve):
        way = np.diff(curve(np.linspace(a, b, 9)), axis=0)
        number = max(LEAST, int(np.ceil(np.hypot(*way.T).sum() / step)))
        parameters.append(a + (b - a) / number * np.arange(number))
    return curve(np.concatenate(parameters))


def _area(points: np.ndarray) -> float:
    x, y = points.T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def _polygons(boundary: pt.Boundary, step: float) -> list[np.ndarray]:
    return [np.concatenate([_points(curve, step) for curve in loop]) for loop in boundary.loops]


def diameter(boundary: pt.Boundary) -> float:
    """Diagonal of the bounding box of dense points."""
    return float(np.hypot(*np.ptp(np.concatenate(_polygons(boundary, boundary.diameter / DENSITY)), axis=0)))


def distance(found: pt.Boundary, target: pt.Boundary) -> float:
    """Hausdorff distance of dense polygons, relative to the target's diameter."""
    size = diameter(target)
    a, b = (_polygons(boundary, size / DENSITY) for boundary in (found, target))
    return max(_one_sided(a, b), _one_sided(b, a)) / size


def _one_sided(points: list[np.ndarray], lines: list[np.ndarray]) -> float:
    """Largest distance of the points from the lines: of each, from the segments at the nearest vertices."""
    x, vertices = np.concatenate(points)[:, None], np.concatenate(lines)
    _, nearest = cKDTree(vertices).query(x[:, 0], NEAREST)
    at, least = vertices[nearest], np.full(len(x), np.inf)
    for way in (1, -1):
        along = np.concatenate([np.roll(line, way, axis=0) for line in lines])[nearest] - at
        square = np.maximum((along**2).sum(axis=-1), np.finfo(float).tiny)
        share = np.clip(((x - at) * along).sum(axis=-1) / square, 0, 1)
        gaps = np.hypot(*np.moveaxis(at + share[..., None] * along - x, -1, 0))
        least = np.minimum(least, gaps.min(axis=1))
    return float(least.max())
