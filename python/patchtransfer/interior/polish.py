"""Polish: the worst place of a map made better, by minima of ever higher powers of the energy density.

The optimiser's minima have the least mean distortion, and a few places, corners mostly, bear the largest. In the p-norm
``(Σ w (f / f₀)^p)^(1/p)`` of the density f, whose least value is f₀, the largest counts ever more; each power starts
from the minimum of the one before. What such a map is worth is not said by its nodes: every one is certified, and kept
only if the number that was asked for, proved everywhere, is better.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch
from ..geometry.rectangles import rectangles
from ..measure.bounds import can_be_proved
from ..measure.common_layout import same_layout
from ..measure.quality import proved_bounds, quality
from ..measure.similarity import similarity
from ..numeric.arrays import FloatArray
from ..progress import Budget
from ..proof.certificate import Certificate
from .optimizer import AREA_WEIGHT, Certify, SplineOptimizer
from .polish_report import GOALS, PolishReport

__all__ = ["Goal", "goal_of", "polished", "scaled_jacobian_goal"]

#: Powers, each twice the last: from one minimum to the next few Newton steps are needed.
POWERS = (2, 4, 8, 16, 32)
#: Newton steps for a power, and the decrement at which they end: it is the next power's start.
STEPS, TOLERANCE = 20, 1e-4
#: Worse so many times in a row: higher powers trade the number away.
PATIENCE = 2
#: How far proved bounds are apart, and so the least gain that is one.
WIDTH = 1e-3


class Goal(NamedTuple):
    """What a map is to be better in.

    `worth` is a proved number from 0 to 1, 1 being the best, and `reference` what distortion is measured against on
    the way there. `reason` says why nothing can be proved, where that is so.
    """

    name: str
    worth: Callable[[MultiPatch], float]
    reference: Sequence[Patch]
    reason: str | None = None

    def number(self, worth: float) -> float:
        """What was asked for, of a worth."""
        if self.name == GOALS[0]:
            return worth
        return 1 / worth if worth > 0 else math.inf


def goal_of(name: str, source: MultiPatch, mp: MultiPatch, degenerate: Sequence[tuple[int, int]]) -> Goal:
    """One of `GOALS` for a map, by its name."""
    return scaled_jacobian_goal(mp, degenerate) if name == GOALS[0] else dilatation_goal(source)


def scaled_jacobian_goal(mp: MultiPatch, degenerate: Sequence[tuple[int, int]] = (), least_mean: float = 0.0) -> Goal:
    """The smallest scaled Jacobian, but at degenerate corners; with the mean of samples at least as given.

    Distortion is measured against rectangles with the patches' mean sides: a source's own angles need not be right
    ones.
    """

    def worth(mp: MultiPatch) -> float:
        if least_mean > 0 and quality(mp, exclude=degenerate).scaled_jacobian.mean < least_mean:
            return 0.0
        return proved_bounds(mp, degenerate, WIDTH).min_scaled_jacobian.lower

    reason = None if can_be_proved(mp) else "degrees are too high for a proof of the scaled Jacobian"
    return Goal(GOALS[0], worth, rectangles(mp), reason)


def dilatation_goal(source: MultiPatch) -> Goal:
    """The largest dilatation of the map from the source."""

    def worth(mp: MultiPatch) -> float:
        return 1 / similarity(source, mp, bounds=False, width=WIDTH).dilatation.upper

    return Goal(GOALS[1], worth, source.patches, same_layout(source, source))


class Better(NamedTuple):
    """A map that is better in what was asked for, and its proof."""

    points: FloatArray
    certificate: Certificate


def polished(
    goal: Goal,
    make: Callable[[Sequence[Patch]], SplineOptimizer],
    points: FloatArray,
    model: Callable[[FloatArray], MultiPatch],
    certify: Certify,
    budget: Budget,
) -> tuple[Better | None, PolishReport]:
    """The best of the minima of higher powers; None if the map as it was is the best.

    Parameters
    ----------
    goal : Goal
    make : callable
        ``make(reference)`` gives an optimizer, with the null space of the rows that are to hold.
    points : (n_points, 2) array
        A certified map under these rows.
    model : callable
        Shared control points to the model.
    certify : callable
        Shared control points to certificate.
    budget : Budget
    """
    optimizer = make(goal.reference)
    before = most = goal.worth(model(points))
    best, best_power, worse = None, 1, 0
    for power in POWERS:
        steps = budget.steps(optimizer.step_cost, STEPS)
        if not steps:
            break
        found = optimizer.minimise(
            points, AREA_WEIGHT, steps, tolerance=TOLERANCE, seconds=budget.seconds_left(), power=power
        )
        budget.spend(len(found.history) * optimizer.step_cost)
        if not found.min_determinant > 0:
            break
        points = found.points
        worth = goal.worth(model(points))
        proof = certify(points) if worth > most * (1 + WIDTH) else None
        if proof is not None and proof.injective:
            most, best, best_power, worse = worth, Better(points, proof), power, 0
            continue
        worse += 1
        if worse == PATIENCE:
            break
    return best, PolishReport(goal.name, best_power, goal.number(before), goal.number(most))
