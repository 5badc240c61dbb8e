"""Stage F: a layout by its connectivity becomes patches on the outline, certified."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ...errors import InfeasibleTargetError, InputError
from ...geometry.boundary import Boundary
from ...geometry.curve import BSplineCurve
from ...geometry.outline import Outline
from ...geometry.rectangles import rectangles
from ...measure.quality import sample
from ...numeric.arrays import FloatArray
from ...pipeline.plan import TransferPlan
from ...pipeline.result import TransferResult
from ..layout import from_layout
from .assembly import AbstractLayout
from .reasons import NoLayoutError
from .with_places import with_places

__all__ = ["coarse", "filled", "misses", "sliding"]

STAGE = "geometry"
#: Most rounds of sliding: the rectangles that distortion is measured against follow the patches, which follow the
#: joints. Ovals take three, most outlines one or two.
SLIDING_ROUNDS = 4
#: Mean scaled Jacobian below which an edge more is tried along the worst patch, and samples a span to tell which it is.
GOOD_MEAN, SAMPLES = 0.98, 4


def filled(
    layout: AbstractLayout,
    boundary: Boundary,
    outlines: Sequence[Outline],
    degree: int,
    spans: int,
    fit_tolerance: float,
) -> TransferResult:
    """Patches of a layout with its boundary vertices where they are.

    Raises
    ------
    NoLayoutError
        When the boundary with these vertices rules out an injective map.
    """
    try:
        return from_layout(
            layout.points,
            layout.quads,
            boundary,
            degree,
            spans,
            assignment=with_places(layout, outlines).assignment,
            fit_tolerance=fit_tolerance,
            refine="never",
            on_failure="return",
        )
    except (InfeasibleTargetError, InputError) as error:
        raise NoLayoutError(STAGE, str(error)) from error


def sliding(
    result: TransferResult,
    layout: AbstractLayout,
    boundary: Boundary,
    outlines: Sequence[Outline],
    fit_tolerance: float,
) -> Iterator[TransferResult]:
    """The patches with boundary vertices that are no corners moved to where the distortion is least, round by round.

    No further round follows one that leads to no injective map.
    """
    landmarks = _corners(layout, outlines)
    for _ in range(SLIDING_ROUNDS):
        plan = TransferPlan(result.multipatch, "c0", reference=rectangles(result.multipatch))
        try:
            result = plan.transfer(
                boundary,
                landmarks,
                fixed_correspondence=False,
                fit_tolerance=fit_tolerance,
                refine="never",
                on_failure="return",
            )
        except InfeasibleTargetError:
            return
        if not result.certificate.injective:
            return
        yield result


def coarse(
    result: TransferResult, layout: AbstractLayout, outlines: Sequence[Outline]
) -> list[tuple[int, float, float]]:
    """The longest stretch (loop, s0, s1) along the patch of the worst angles, in a layout too coarse for its bends.

    A layout without irregular vertices, such as a stroke's, is the same for all prices of collapses: its long patches
    follow a bend in a few spans.
    """
    inner = np.setdiff1d(np.arange(len(layout.valence)), layout.boundary_vertices)
    if (layout.valence[inner] != 4).any() or result.quality.scaled_jacobian.mean >= GOOD_MEAN:
        return []
    means = [float(values.mean()) for _, values in sample(result.multipatch, SAMPLES)]
    pairs = zip(result.multipatch.loops, result.fitted.loops, strict=True)
    sides = [(means[at.patch], side) for ats, fitted in pairs for at, side in zip(ats, fitted, strict=True)]
    worst = min(mean for mean, _ in sides)
    stretches = [_stretch(side.curve, outlines) for mean, side in sides if mean == worst]
    return [max(stretches, key=lambda at: (at[2] - at[1]) % outlines[at[0]].length)]


def misses(result: TransferResult, outlines: Sequence[Outline], fit_tolerance: float) -> list[tuple[int, float, float]]:
    """Stretches (loop, s0, s1) that their sides miss, in the order, sense and arc lengths of the user's loops."""
    found = []
    for side in (side for sides in result.fitted.loops for side in sides):
        if side.error > fit_tolerance:
            found.append(_stretch(side.curve, outlines))
    return found


def _stretch(curve: BSplineCurve, outlines: Sequence[Outline]) -> tuple[int, float, float]:
    """Where a side runs, by its places: registered loops have an order and a sense of their own."""
    points = curve(np.linspace(*curve.domain, 3))
    nearest = [outline.nearest(points) for outline in outlines]
    loop = int(np.argmin([distance.max() for _, distance in nearest]))
    start, middle, end = nearest[loop][0].tolist()
    length = outlines[loop].length
    forwards = (middle - start) % length <= (end - start) % length
    return (loop, start, end) if forwards else (loop, end, start)


def _corners(layout: AbstractLayout, outlines: Sequence[Outline]) -> FloatArray:
    """Rows (x, y, x, y) of the vertices that stay."""
    rows = []
    for k, outline in enumerate(outlines):
        kept = (layout.boundary_loop == k) & layout.corner
        points = outline.point(layout.boundary_s[kept])
        rows.append(np.column_stack([points, points]))
    return np.concatenate(rows)
