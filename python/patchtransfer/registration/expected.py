"""What scaled Jacobian to expect of a map, from the correspondence of the boundaries and the source's alone.

rho = arcosh(1/SJ) is a distance in the metric in which a dilatation bounds how much quality may get worse
(``docs/similarity.md``). So it is rho that grows with the mismatch, whatever the source has; its quantiles are linear
in it, calibrated.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from .calibrated import MEAN, MINIMUM
from .mismatch import Mismatch

__all__ = ["POOR", "Expected", "Quantiles", "distance", "expected"]

#: Below this least scaled Jacobian a map is of little use (the guide calls it good above), and a warning says so before
#: the work if it is expected.
POOR = 0.1


class Quantiles(NamedTuple):
    """Of a number that is not known yet: one in ten is below `low`, half below `median`, one in ten above `high`."""

    low: float
    median: float
    high: float


class Expected(NamedTuple):
    """Of a map.

    Attributes
    ----------
    mean_scaled_jacobian, min_scaled_jacobian : Quantiles
    """

    mean_scaled_jacobian: Quantiles
    min_scaled_jacobian: Quantiles

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {name: quantiles._asdict() for name, quantiles in self._asdict().items()}

    def __str__(self) -> str:
        low, median, high = self.min_scaled_jacobian
        mean = self.mean_scaled_jacobian.median
        return f"expected scaled Jacobian: minimum about {median:.2f} ({low:.2f} to {high:.2f}), mean about {mean:.2f}"

    @property
    def doubt(self) -> str | None:
        """What to say before the work, if a poor map is to be expected."""
        if self.min_scaled_jacobian.median >= POOR:
            return None
        return f"{self}: a source more like the target does better (patchtransfer library, or parameterize)"


def distance(scaled_jacobian: float) -> float:
    """Of a scaled Jacobian to 1, in the metric."""
    return math.acosh(1 / min(max(scaled_jacobian, 1e-3), 1.0))


def expected(mismatch: Mismatch, mean: float, least: float) -> Expected:
    """Quantiles of a map's scaled Jacobian.

    Parameters
    ----------
    mismatch : Mismatch
    mean, least : float
        The source's mean and least scaled Jacobian.
    """
    return Expected(_quantiles(MEAN, mismatch, mean), _quantiles(MINIMUM, mismatch, least))


def _quantiles(growth: Mapping[float, tuple[float, ...]], mismatch: Mismatch, before: float) -> Quantiles:
    traits = (1.0, *mismatch)
    found = [distance(before) + sum(a * b for a, b in zip(weights, traits, strict=True)) for weights in growth.values()]
    # Lines of different quantiles may cross where shapes are nearly similar.
    low, median, high = sorted(1 / math.cosh(max(rho, 0.0)) for rho in found)
    return Quantiles(low, median, high)
