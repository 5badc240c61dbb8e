"""Legs at smooth joints made as long as chords that end there ask for, where the fit's own error permits.

A leg says how fast its side sets out from the joint; the shape leaves that free to first order. With both legs in the
ratio of the speeds on either side of a chord, C1 holds to the chord's very end.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..geometry.outline import Outline
from ..numeric.arrays import FloatArray
from ..numeric.dense import product, solve_definite
from ..registration.register import Registration
from .fit import FittedBoundary, FittedSide, basis_key, sampled_basis
from .own_curves import distance

__all__ = ["with_legs"]

#: Gauss-Newton steps, and every so many of the fit's samples that count in them; all count for the error.
STEPS, STRIDE = 2, 2
#: Weight of how far samples slide along the target in one step, beside that of the error: that of the fit.
DAMPING = 1e-2
#: Part of the tolerance up to which a side may miss the target for the sake of its legs (with a tenth yeti's bend has
#: 0.16 less of its interfaces C1, with a half nothing gains but the wrench loses), ...
PERMITTED = 0.25
#: ... and the part of the diameter below which it follows the target exactly, and is left alone.
EXACT = 1e-9


def with_legs(
    fitted: FittedBoundary,
    registration: Registration,
    wanted: Mapping[tuple[int, int], tuple[float, float]],
    tolerance: float,
) -> FittedBoundary:
    """The fit with other lengths of the legs at joints.

    Parameters
    ----------
    fitted : FittedBoundary
    registration : Registration
        That it was made for.
    wanted : mapping
        From (loop, side) to the lengths of the legs, of the side before and of the side, at the side's start.
    tolerance : float
        As of the fit.

    Returns
    -------
    FittedBoundary
        With the wanted lengths at all joints both of whose sides follow the target as closely as before, or as a small
        part of the tolerance; at all others as it was.
    """
    diameter, loops = registration.loops[0].target.diameter, []
    for k, (loop, sides) in enumerate(zip(registration.loops, fitted.loops, strict=True)):
        asked = {i: lengths for (of, i), lengths in wanted.items() if of == k}
        loops.append(_with_legs(sides, loop.target, asked, PERMITTED * tolerance, diameter))
    errors = [
        distance([side.curve for side in sides], loop) / diameter
        for sides, loop in zip(loops, registration.loops, strict=True)
    ]
    return FittedBoundary(loops, max(errors), fitted.warnings)


def _with_legs(
    sides: tuple[FittedSide, ...],
    target: Outline,
    asked: dict[int, tuple[float, float]],
    permitted: float,
    diameter: float,
) -> tuple[FittedSide, ...]:
    """The sides of a loop; joints whose sides miss the target give way until all others do not."""
    n = len(sides)
    known: dict[_Wish, FittedSide] = {}
    while True:
        wishes = []
        for i in sorted({i for j in asked for i in (j, (j - 1) % n)}):
            after = (i + 1) % n
            wishes.append(_Wish(i, asked[i][1] if i in asked else None, asked[after][0] if after in asked else None))
        new = [wish for wish in wishes if wish not in known]
        known.update(zip(new, _refitted(sides, new, target, diameter), strict=True))
        missed = {w.side for w in wishes if known[w].error > max(sides[w.side].error, permitted)}
        lost = {j for j in asked if {j, (j - 1) % n} & missed}
        if not lost:
            found = {wish.side: known[wish] for wish in wishes}
            return tuple(found.get(i, side) for i, side in enumerate(sides))
        asked = {j: lengths for j, lengths in asked.items() if j not in lost}


class _Wish(NamedTuple):
    """A side of a loop, and lengths of the legs at its start and end, None where they have none of their own."""

    side: int
    start: float | None
    end: float | None


def _refitted(
    sides: Sequence[FittedSide], wishes: Sequence[_Wish], target: Outline, diameter: float
) -> list[FittedSide]:
    """Sides with legs of given lengths on their lines; other legs at smooth joints stay.

    The error is infinite where a leg cannot have a length of its own, or a side follows the target exactly.
    """
    found = [replace(sides[wish.side], error=math.inf) for wish in wishes]
    alike: dict[tuple[int, bytes, bytes | None], list[int]] = defaultdict(list)
    for k, wish in enumerate(wishes):
        side = sides[wish.side]
        if len(side.curve.control_points) > 3 and side.error >= EXACT:
            alike[basis_key(side.curve)].append(k)
    for key, members in alike.items():
        basis = sampled_basis(*key)[1]
        curves = [sides[wishes[k].side].curve for k in members]
        points = np.array([curve.control_points for curve in curves])
        # Where the curves were, so that samples begin beside their feet.
        at = product(basis, points)
        free = np.ones(points.shape[:2], bool)
        free[:, [0, -1]] = False
        for row, k in enumerate(members):
            wish, smooth = wishes[k], (sides[wishes[k].side].smooth, sides[(wishes[k].side + 1) % len(sides)].smooth)
            for end, beside, length, held in ((0, 1, wish.start, smooth[0]), (-1, -2, wish.end, smooth[1])):
                free[row, beside] &= length is None and not held
                if length is not None:
                    leg = points[row, beside] - points[row, end]
                    points[row, beside] = points[row, end] + leg * (length / float(np.hypot(*leg)))
        for _ in range(STEPS):
            _step(np.ascontiguousarray(basis[::STRIDE]), points, free, at[:, ::STRIDE], target)
            at = product(basis, points)
        errors = target.nearest(at.reshape(-1, 2))[1].reshape(len(members), -1).max(axis=1) / diameter
        for k, curve, x, error in zip(members, curves, points, errors.tolist(), strict=True):
            found[k] = replace(found[k], curve=curve.with_control_points(x), error=error)
    return found


def _step(basis: FloatArray, points: FloatArray, free: NDArray[np.bool_], at: FloatArray, target: Outline) -> None:
    """A Gauss-Newton step on the distance from the target, slides along it damped, of the free points (m, n, 2)."""
    m, n = free.shape
    feet = target.evaluate(target.nearest(at.reshape(-1, 2))[0]).reshape(*at.shape[:2], 4)
    along = DAMPING * feet[..., 2:]
    across = np.stack([-feet[..., 3], feet[..., 2]], axis=-1)
    directions = np.concatenate([across, along], axis=1)
    wanted = np.concatenate([feet[..., :2], at], axis=1)
    rows = np.concatenate([basis, basis])[None, :, :, None] * directions[:, :, None]
    rows = rows.reshape(m, -1, 2 * n)
    turned = np.ascontiguousarray(rows.transpose(0, 2, 1))
    normal = product(turned, rows)
    right = product(turned, (wanted * directions).sum(axis=2)[..., None])[..., 0]
    # What is held keeps its equation x = x.
    there, x = free.repeat(2, axis=1), points.reshape(m, -1)
    right = (right - product(normal, np.where(there, 0.0, x)[..., None])[..., 0]) * there
    normal = normal * (there[:, :, None] & there[:, None])
    normal[:, range(2 * n), range(2 * n)] += ~there
    for k in np.flatnonzero(there.any(axis=1)).tolist():
        x[k, there[k]] = solve_definite(normal[k], right[k])[there[k]]
