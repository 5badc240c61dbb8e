"""Stage F: a layout by its connectivity becomes patches on the outline, certified."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...errors import InfeasibleTargetError, InputError
from ...geometry.boundary import Boundary
from ...geometry.outline import Outline
from ...numeric.arrays import FloatArray
from ...pipeline.plan import TransferPlan
from ...pipeline.result import TransferResult
from ..layout import from_layout, rectangles
from .assembly import AbstractLayout
from .reasons import NoLayoutError
from .with_places import with_places

__all__ = ["filled", "misses", "slid"]

STAGE = "geometry"
#: Rounds of sliding: the rectangles that distortion is measured against follow the patches, which follow the joints.
SLIDING_ROUNDS = 2


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
            on_failure="return",
        )
    except (InfeasibleTargetError, InputError) as error:
        raise NoLayoutError(STAGE, str(error)) from error


def slid(
    result: TransferResult,
    layout: AbstractLayout,
    boundary: Boundary,
    outlines: Sequence[Outline],
    fit_tolerance: float,
) -> TransferResult:
    """The patches with boundary vertices that are no corners moved to where the distortion is least.

    The result as it is where sliding leads to none that is certified.
    """
    landmarks = _pinned(layout, outlines)
    best = result
    for _ in range(SLIDING_ROUNDS):
        plan = TransferPlan(best.multipatch, "c0", reference=rectangles(best.multipatch))
        try:
            moved = plan.transfer(
                boundary, landmarks, fixed_correspondence=False, fit_tolerance=fit_tolerance, on_failure="return"
            )
        except InfeasibleTargetError:
            break
        if not moved.certificate.injective:
            break
        best = moved
    return best


def misses(result: TransferResult, outlines: Sequence[Outline], fit_tolerance: float) -> list[tuple[int, float, float]]:
    """Stretches (loop, s0, s1) that their sides miss, in the order, sense and arc lengths of the user's loops."""
    found = []
    for side in (side for sides in result.fitted.loops for side in sides):
        if side.error > fit_tolerance:
            # By their places: registered loops have an order and a sense of their own.
            points = side.curve(np.linspace(*side.curve.domain, 3))
            nearest = [outline.nearest(points) for outline in outlines]
            loop = int(np.argmin([distance.max() for _, distance in nearest]))
            start, middle, end = nearest[loop][0].tolist()
            length = outlines[loop].length
            forwards = (middle - start) % length <= (end - start) % length
            found.append((loop, start, end) if forwards else (loop, end, start))
    return found


def _pinned(layout: AbstractLayout, outlines: Sequence[Outline]) -> FloatArray:
    """Rows (x, y, x, y) of the vertices that stay: the corners, and one on every loop without any.

    A loop could otherwise turn in itself, which nothing decides.
    """
    rows = []
    for k, outline in enumerate(outlines):
        on = np.flatnonzero(layout.boundary_loop == k)
        kept = on[layout.corner[on]]
        points = outline.point(layout.boundary_s[on])
        if not len(kept):
            away = np.linalg.norm(points - points.mean(axis=0), axis=1)
            kept = on[[int(np.argmax(away))]]
        rows.append(outline.point(layout.boundary_s[kept]))
    return np.concatenate([np.column_stack([points, points]) for points in rows])
