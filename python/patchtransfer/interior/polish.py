"""Polish: the largest distortion pushed down, by minima of ever higher powers of the energy density.

The optimiser's minima have the least mean distortion, and a few places, corners mostly, bear the largest. With the p-norm
``(Σ w (f / f₀)^p)^(1/p)`` of the density f, whose least value is f₀, the largest counts ever more; each power starts from
the minimum of the one before. What such a map is worth is not said by its nodes: every one is certified, and kept only if
the number that was asked for, proved everywhere, is better.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from ..numeric.arrays import FloatArray
from ..proof.certificate import Certificate
from .optimizer import AREA_WEIGHT, SplineOptimizer

__all__ = ["POWERS", "Polished", "polished"]

#: Powers, each twice the last: from one minimum to the next few Newton steps are needed.
POWERS = (2, 4, 8, 16, 32)
#: Newton steps for a power, and the decrement at which they end: it is the next power's start.
STEPS, TOLERANCE = 20, 1e-4
#: Worse so many times in a row: higher powers trade the number away.
PATIENCE = 2


class Polished(NamedTuple):
    """A map that is better in the number asked for, and which power it is the minimum of; 1 for the map as it was."""

    points: FloatArray
    certificate: Certificate
    worth: float
    power: int


def polished(
    optimizer: SplineOptimizer,
    start: Polished,
    certify: Callable[[FloatArray], Certificate],
    worth: Callable[[FloatArray], float],
    expired: Callable[[], bool],
) -> Polished:
    """The best of the minima of higher powers, or the start.

    Parameters
    ----------
    optimizer : SplineOptimizer
        With the null space of the rows that are to hold.
    start : Polished
        A certified map under these rows.
    certify, worth : callable
        Proof for a map, and the number that should be large.
    expired : callable
        Whether no time is left.
    """
    best, points, worse = start, start.points, 0
    for power in POWERS:
        if expired():
            break
        found = optimizer.minimise(points, AREA_WEIGHT, STEPS, tolerance=TOLERANCE, power=power)
        if not found.min_determinant > 0:
            break
        points = found.points
        number = worth(points)
        if number > best.worth:
            certificate = certify(points)
            if certificate.injective:
                best, worse = Polished(points, certificate, number, power), 0
                continue
        worse += 1
        if worse == PATIENCE:
            break
    return best
