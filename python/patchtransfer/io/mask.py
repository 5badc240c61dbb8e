"""Masks and images: the outline of the one region that they show, traced between the pixels and smoothed.

**Tracing.** The contour at the middle between the darkest and the brightest level, where linear interpolation between
the pixels' centres reaches it (scikit-image); regions hang together by edges of pixels, their surroundings by corners.

**Corners.** The contour is a staircase, so corners are looked for near the vertices of a polygon that simplifies it
(Douglas and Peucker). On both sides of a point the contour follows a line as far as that fits it. The point is a corner
if the lines turn by more than an angle *and* no circle follows the contour along both of them within the tolerance:
what is rounder than pixels can tell stays smooth. The corner stands where the lines meet, for tracing cuts it.

**Smoothing.** Between corners: a line where the contour is within the tolerance of it, else the smoothest cubic
spline (FITPACK's) that is, of points from which parabolas through their neighbours took most of the stairs.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from ..geometry.boundary import Boundary
from ..geometry.curve import BSplineCurve
from ..libraries import library
from ..limits import MAX_BOUNDARY_POINTS, MAX_LOOPS, MAX_PIXELS, at_most
from ..numeric.arrays import FloatArray
from ..numeric.dense import svd
from .damage import damaged
from .loops import clamp, close_loop
from .options import DEFAULT, BoundaryOptions

__all__ = ["boundary_of_mask", "looks_like_image", "read_boundary"]

SIGNATURES = (b"\x89PNG\r\n\x1a\n", b"II*\0", b"MM\0*", b"BM")
#: Pixels of a region that says nothing at the resolution: 4 by 4.
SPECK = 16
#: Sizes that a message lists.
LISTED = 8
TOLERANCE = 0.5
CORNER_ANGLE = 30.0
#: Pixels of outside around a mask, so that all contours are closed.
FRAME = 1
#: Farthest that the staircase is from the true outline, in pixels: what simplifies it may be off by so much more.
STAIRCASE = 0.5
#: What stairs add to the distance from a circle that fits best, in pixels, and changing curvature for each pixel of
#: reach: without the one discs had corners, without the other flowers.
STAIRS_ON_CIRCLE, UNLIKE_A_CIRCLE = 0.1, 0.02
#: Corners closer than this, in pixels, are one that tracing has cut.
CUT_SIDE = 3.0
#: Points of contour on both sides of a polygon's vertex where its corner may be.
ASIDE = 5
#: Sine of the angle of lines that do not meet in a place that is certain enough.
PARALLEL = 0.1
#: Pixels of contour next to a corner that tracing has cut off, and how many behind them tell the side's line.
CUT, SIDE, SHORTEST_SIDE = 1.0, 16.0, 5.0
#: Root mean square distance of a staircase from its line, in pixels; a bent side is farther off.
STRAIGHT = 0.3
#: Farthest that a corner is moved off the contour, in pixels: tracing cuts half a pixel off a right angle, two off 15°.
FARTHEST = 2.0
#: Points of contour that a parabola is laid through to calm the stairs.
CALM = 9
#: Halvings of the smoothing before a spline goes through all points.
HALVINGS = 12


def looks_like_image(data: bytes) -> bool:
    """Whether this is a PNG, TIFF or BMP image."""
    return data.startswith(SIGNATURES)


def read_boundary(data: bytes, options: BoundaryOptions = DEFAULT) -> Boundary:
    """Boundary of the region in an image; see `patchtransfer.read_boundary`."""
    grey, notes = _grey(data)
    return boundary_of_mask(grey, smooth=options.smooth, notes=notes)


def _grey(data: bytes) -> tuple[FloatArray, list[str]]:
    """Levels of an image, larger inside, and what was decided about it."""
    image_module = library("PIL.Image", "image")
    bomb = image_module.DecompressionBombError
    with damaged("damaged image", "save it again as PNG", bomb), warnings.catch_warnings():
        # Pillow warns of large images, for which the limit is below, and of odd metadata.
        warnings.simplefilter("ignore")
        try:
            image = image_module.open(BytesIO(data), formats=("PNG", "TIFF", "BMP"))
        except bomb:
            raise InputError(f"the image has more than {MAX_PIXELS} pixels; scale it down") from None
        at_most(image.width * image.height, MAX_PIXELS, "pixels", "scale the image down")
        notes = [f"first of {image.n_frames} pages of the image"] if getattr(image, "n_frames", 1) > 1 else []
        if "A" in image.getbands() or "transparency" in image.info:
            alpha = np.asarray(image.convert("RGBA").getchannel("A"), dtype=np.float64)
            if np.ptp(alpha) > 0:
                return alpha, [*notes, "inside is what is opaque"]
        if image.mode not in ("1", "L", "F", "I", "I;16", "I;16B", "I;16L"):
            image = image.convert("L")
        grey = np.asarray(image, dtype=np.float64)
    rim = np.concatenate([grey[0], grey[-1], grey[:, 0], grey[:, -1]])
    middle = (grey.min() + grey.max()) / 2
    if np.count_nonzero(rim > middle) > len(rim) / 2:
        return -grey, [*notes, "inside is what is dark, for the rim of the image is bright"]
    return grey, [*notes, "inside is what is bright, for the rim of the image is dark"]


def boundary_of_mask(
    mask: ArrayLike,
    tolerance: float = TOLERANCE,
    corner_angle: float = CORNER_ANGLE,
    smooth: bool | None = None,
    notes: Sequence[str] = (),
) -> Boundary:
    """Boundary of the region in a mask; see `patchtransfer.Boundary.from_mask`."""
    if not (math.isfinite(tolerance) and tolerance > 0):
        raise InputError(f"tolerance must be a positive number of pixels, got {tolerance}")
    if not 0 < corner_angle <= 180:
        raise InputError(f"corner_angle must be in (0, 180] degrees, got {corner_angle}")
    levels, told = _one_region(_levels(mask))
    contours = library("skimage.measure", "image").find_contours(levels, 0.5, fully_connected="low")
    at_most(len(contours), MAX_LOOPS, "outlines", "clean the mask")
    at_most(sum(map(len, contours)), MAX_BOUNDARY_POINTS, "points of outline", "scale the mask down or smooth it")
    # Indices are of pixels' centres.
    x, y = 0.5 - FRAME, len(levels) - FRAME - 0.5
    rings = [np.column_stack([c[:-1, 1] + x, y - c[:-1, 0]]) for c in contours]
    rings.sort(key=lambda ring: -abs(_area(ring)))
    loops = [_smoothed(ring, tolerance, math.radians(corner_angle), smooth) for ring in rings]
    return Boundary(loops, [*notes, *told, f"outline smoothed to within {tolerance:g} pixels"])


def _levels(mask: ArrayLike) -> FloatArray:
    """Levels from 0 to 1, with a frame of the outside around them."""
    try:
        levels = np.asarray(mask).astype(np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"the mask is not an array of numbers ({error})") from None
    if levels.ndim != 2 or min(levels.shape) < 1:
        raise InputError(f"the mask must have two axes, rows and columns, got shape {levels.shape}")
    at_most(levels.size, MAX_PIXELS, "pixels", "scale the mask down")
    if not np.isfinite(levels).all():
        raise InputError("the mask has NaN or infinity; give numbers")
    low, high = levels.min(), levels.max()
    # Of a mask without any difference, truth is inside.
    scaled = (levels - low) / (high - low) if high > low else np.full(levels.shape, float(low > 0))
    return np.pad(scaled, FRAME)


def _one_region(levels: FloatArray) -> tuple[FloatArray, list[str]]:
    """Levels without specks and pinholes; `InputError` unless one region is left."""
    measure = library("skimage.measure", "image")
    notes = []
    for inside, what, level in ((True, "specks", 0.0), (False, "pinholes", 1.0)):
        labels = measure.label((levels > 0.5) == inside, connectivity=1 if inside else 2)
        sizes = np.bincount(labels.ravel())
        sizes[0] = 0
        small = (sizes > 0) & (sizes <= SPECK)
        if small.any() and not small[sizes > 0].all():
            levels = np.where(small[labels], level, levels)
            notes.append(
                f"{np.count_nonzero(small)} {what} of up to {sizes[small].max()} pixels "
                f"{'left out' if inside else 'filled'}"
            )
            sizes[small] = 0
        if inside:
            regions = np.sort(sizes[sizes > 0])[::-1]
            if len(regions) == 0:
                raise InputError("nothing is inside the mask; set its pixels to True there")
            if len(regions) > 1:
                told = ", ".join(map(str, regions[:LISTED])) + (" ..." if len(regions) > LISTED else "")
                raise InputError(
                    f"shows {len(regions)} regions, of {told} pixels; keep one: erase the others, or pass "
                    "Boundary.from_mask(labels == k) with skimage.measure.label"
                )
    return levels, notes


def _area(ring: FloatArray) -> float:
    x, y = ring.T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


def _smoothed(ring: FloatArray, tolerance: float, corner_angle: float, smooth: bool | None) -> list[BSplineCurve]:
    """Curves within the tolerance of a closed ring of points."""
    # A vertex of the polygon at any rate: the point farthest from the middle is one that the outline has.
    first = int(np.argmax(np.linalg.norm(ring - ring.mean(axis=0), axis=1)))
    ring = np.roll(ring, -first, axis=0)
    corners: dict[int, FloatArray] = {}
    if smooth is None:
        corners = _corners(ring, corner_angle, tolerance)
    elif not smooth:
        corners = {int(k): ring[k] for k in _vertices(ring, tolerance)}
    if not corners:
        return close_loop([_closed_spline(ring, tolerance)])
    at, places = list(corners), list(corners.values())
    curves = [
        _open_curve(_between(ring, a, b), start, end, tolerance, smooth is False)
        for a, b, start, end in zip(at, at[1:] + at[:1], places, places[1:] + places[:1], strict=True)
    ]
    return close_loop(curves)


def _between(ring: FloatArray, a: int, b: int) -> FloatArray:
    """Points of a ring from one index to another; all of it if they are the same."""
    return ring[(a + np.arange((b - a - 1) % len(ring) + 2)) % len(ring)]


def _vertices(ring: FloatArray, tolerance: float) -> NDArray[np.int64]:
    """Indices of the simplified polygon of a ring; at least three."""
    closed = np.vstack([ring, ring[:1]])
    kept = np.zeros(len(closed), bool)
    half = len(ring) // 2
    # Also the point opposite the first one, for a chord from a point to itself has no direction.
    far = int(np.argmax(np.linalg.norm(ring - ring[0], axis=1)))
    stack = [(0, far or half), (far or half, len(ring))]
    kept[[0, far or half]] = True
    while stack:
        a, b = stack.pop()
        if b - a < 2:
            continue
        away = _off_line(closed[a + 1 : b], closed[a], closed[b])
        k = int(np.argmax(away))
        if away[k] > tolerance:
            kept[a + 1 + k] = True
            stack += [(a, a + 1 + k), (a + 1 + k, b)]
    return np.flatnonzero(kept[:-1])


def _off_line(points: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """Distances of points from the segment between two others."""
    chord = b - a
    along = np.clip((points - a) @ chord / max(float(chord @ chord), 1e-300), 0, 1)
    return np.asarray(np.linalg.norm(points - a - along[:, None] * chord, axis=1))


@dataclass(frozen=True)
class _Side:
    """How a ring goes on from a point: point and direction of a line, and how far it follows that line."""

    middle: FloatArray
    direction: FloatArray
    reach: float
    off: float


def _corners(ring: FloatArray, corner_angle: float, tolerance: float) -> dict[int, FloatArray]:
    """Index and place of every corner, in order."""
    found: list[tuple[float, int, FloatArray]] = []
    for vertex in _vertices(ring, tolerance + STAIRCASE):
        # The polygon's vertex may be a few points off, where the staircase has a step.
        around = [(vertex + k) % len(ring) for k in range(-ASIDE, ASIDE + 1)]
        best = max((_candidate(ring, k, corner_angle, tolerance) for k in around), key=lambda c: c[0])
        if best[0] > 0:
            found.append(best)
    kept: dict[int, FloatArray] = {}
    for _, k, place in sorted(found, key=lambda c: -c[0]):
        if all(np.linalg.norm(place - other) > CUT_SIDE for other in kept.values()):
            kept[int(k)] = place
    return {k: kept[k] for k in sorted(kept)}


def _candidate(ring: FloatArray, k: int, corner_angle: float, tolerance: float) -> tuple[float, int, FloatArray]:
    """How good a corner a point of a ring is (0 for none), the point, and where the corner is."""
    none = (0.0, k, ring[k])
    # Points are at least half a pixel apart on average.
    count = min(int(2 * SIDE), len(ring) // 2)
    runs = [ring[(k + way * np.arange(count + 1)) % len(ring)] for way in (-1, 1)]
    before, after = (_side(run) for run in runs)
    if before is None or after is None:
        return none
    turn = math.pi - math.acos(float(np.clip(before.direction @ after.direction, -1, 1)))
    cross = before.direction[0] * after.direction[1] - before.direction[1] * after.direction[0]
    if turn <= corner_angle or abs(cross) < PARALLEL:
        return none
    apart = after.middle - before.middle
    along = (apart[0] * after.direction[1] - apart[1] * after.direction[0]) / cross
    place = before.middle + along * before.direction
    reach = min(before.reach, after.reach)
    smooth = tolerance + STAIRS_ON_CIRCLE + UNLIKE_A_CIRCLE * reach
    near = np.concatenate([run[_lengths(run) <= reach] for run in runs])
    if np.linalg.norm(place - ring[k]) > FARTHEST or _off_circle(near) <= smooth:
        return none
    return reach / (1 + before.off + after.off + float(np.linalg.norm(place - ring[k]))), k, place


def _side(run: FloatArray) -> _Side | None:
    """The line that a run of points from a corner follows, None if it is too short to tell."""
    s = _lengths(run)
    reach = min(SIDE, s[-1])
    while True:
        near = run[(s >= CUT) & (s <= reach)]
        if len(near) < 3:
            return None
        middle = near.mean(axis=0)
        _, spread, axes = svd(near - middle)
        off = float(spread[1]) / math.sqrt(len(near))
        if off <= STRAIGHT or reach <= SHORTEST_SIDE:
            outwards = axes[0] if axes[0] @ (near[-1] - near[0]) > 0 else -axes[0]
            return _Side(middle, outwards, reach, off)
        reach = max(reach / 1.25, SHORTEST_SIDE)


def _lengths(points: FloatArray) -> FloatArray:
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))


def _off_circle(points: FloatArray) -> float:
    """Largest distance of points from the circle (or line) that fits them best."""
    centred = points - points.mean(axis=0)
    size = float(np.abs(centred).max()) or 1.0
    q = centred / size
    # a (x² + y²) + b x + c y + d = 0 with the smallest residual; the distance is that over the gradient.
    rows = np.column_stack([(q**2).sum(axis=1), q, np.ones(len(q))])
    a, b, c, _ = coefficients = svd(rows, full=len(rows) < 4)[2][-1]
    gradient = np.hypot(2 * a * q[:, 0] + b, 2 * a * q[:, 1] + c)
    return size * float((np.abs(rows @ coefficients) / np.maximum(gradient, 1e-9)).max())


def _open_curve(
    points: FloatArray, start: FloatArray, end: FloatArray, tolerance: float, straight: bool
) -> BSplineCurve:
    """The curve from corner to corner along points that begin and end next to them."""
    inner = points[1:-1]
    near = np.minimum(*(np.linalg.norm(inner - corner, axis=1) for corner in (start, end))) if len(inner) else inner
    inner = inner[near > CUT] if len(inner) else inner
    if straight or len(inner) < 3 or _off_line(inner, start, end).max() <= tolerance:
        return BSplineCurve([0.0, 0.0, 1.0, 1.0], 1, [start, end])
    through = np.vstack([start, _calm(inner, False), end])
    weights = np.ones(len(through))
    # The ends are corners, and stay.
    weights[[0, -1]] = 1e3
    knots, control = _spline(through, weights, tolerance, False)
    control[0], control[-1] = start, end
    return BSplineCurve(knots, 3, control)


def _closed_spline(ring: FloatArray, tolerance: float) -> BSplineCurve:
    calm = _calm(ring, True)
    closed = np.vstack([calm, calm[:1]])
    knots, control = _spline(closed, np.ones(len(closed)), tolerance, True)
    knots, control = clamp(knots, 3, control)
    return BSplineCurve(knots, 3, control)


def _calm(points: FloatArray, closed: bool) -> FloatArray:
    """Points with less of the staircase."""
    from scipy.signal import savgol_filter

    window = min(CALM, len(points) - (len(points) + 1) % 2)
    return (
        points
        if window < 5
        else np.asarray(savgol_filter(points, window, 2, axis=0, mode="wrap" if closed else "interp"))
    )


def _spline(points: FloatArray, weights: FloatArray, tolerance: float, periodic: bool) -> tuple[FloatArray, FloatArray]:
    """The smoothest cubic spline that passes all points within the tolerance."""
    from scipy.interpolate import splev, splprep

    # The variance of what is spread evenly over half the tolerance: more lets round outlines shrink.
    smoothing = len(points) * tolerance**2 / 12
    s = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    for _ in range(HALVINGS):
        tck: Any
        with warnings.catch_warnings():
            # That the smoothing is not met to its last digits; the distance is checked.
            warnings.simplefilter("ignore")
            tck, _ = splprep(points.T, w=weights, u=s, s=smoothing, per=periodic)
        (x, y), (dx, dy) = splev(s, tck), splev(s, tck, 1)
        # Across the curve: along it the parameters are off.
        away = np.abs((x - points[:, 0]) * dy - (y - points[:, 1]) * dx) / np.hypot(dx, dy)
        if away.max() <= tolerance:
            break
        smoothing /= 2
    return np.asarray(tck[0]), np.column_stack(tck[1])
