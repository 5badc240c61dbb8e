"""Quality of a parameterization: scaled Jacobian and condition number (§4, Eq. 19–21 of the paper)."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .._core import measure_quality, sample_patch
from ..errors import InputError
from ..files import finite_or_none
from ..geometry.basis import check_samples
from ..geometry.multipatch import MultiPatch
from ..numeric.arrays import FloatArray
from .bounds import ProvedQuality, proved_quality

__all__ = ["Quality", "Statistics", "proved_bounds", "quality", "sample"]

#: Samples per knot span and direction where nothing else is said.
SAMPLES = 10


@dataclass(frozen=True)
class Statistics:
    """Minimum, mean and maximum of a quantity over samples."""

    min: float
    mean: float
    max: float

    def to_dict(self) -> dict[str, float | None]:
        """Plain data for JSON, which has no infinity: None stands for it."""
        return {name: finite_or_none(getattr(self, name)) for name in ("min", "mean", "max")}


@dataclass(frozen=True)
class Quality:
    """Scaled Jacobian and condition number of a multi-patch over the samples of :func:`quality`.

    Attributes
    ----------
    scaled_jacobian : Statistics
        det J / (|B_u| |B_v|), in [-1, 1], best 1; 0 where a tangent vanishes.
    condition_number : Statistics
        ‖J‖_F ‖J⁻¹‖_F, at least 2. It is infinite where det J <= 0, and then so is `max`; `mean` is over the
        samples of positive det J (infinite if there are none), so that it stays comparable between models.
    nonpositive : int
        Number of samples with det J <= 0.
    n_samples : int
        Number of samples, without the excluded corners.
    worst : (patch, u, v)
        Where the scaled Jacobian is smallest.
    proved : ProvedQuality or None
        Bounds of the smallest scaled Jacobian and the largest condition number anywhere, samples or not; None if they
        were not asked for. Equal samples make equal qualities, with or without them.
    """

    scaled_jacobian: Statistics
    condition_number: Statistics
    nonpositive: int
    n_samples: int
    worst: tuple[int, float, float]
    proved: ProvedQuality | None = field(default=None, compare=False)

    def __repr__(self) -> str:
        jacobian, condition = self.scaled_jacobian, self.condition_number
        return (
            f"<Quality: scaled Jacobian {jacobian.min:.3f} / {jacobian.mean:.3f}, condition number "
            f"{condition.mean:.3g} / {condition.max:.3g}, {self.nonpositive} of {self.n_samples} samples folded>"
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON (infinity as None)."""
        patch, u, v = self.worst
        return {
            "scaled_jacobian": self.scaled_jacobian.to_dict(),
            "condition_number": self.condition_number.to_dict(),
            "nonpositive": self.nonpositive,
            "n_samples": self.n_samples,
            "worst": {"patch": patch, "u": u, "v": v},
            "proved": None if self.proved is None else self.proved.to_dict(),
        }


# Absurd models have infinite metrics, and that is what they are told.
@np.errstate(over="ignore", divide="ignore", invalid="ignore")
def quality(
    mp: MultiPatch,
    samples: int = SAMPLES,
    exclude: Iterable[tuple[int, int]] = (),
    proved: bool = False,
    width: float = 1e-3,
) -> Quality:
    """Measure scaled Jacobian and condition number of a multi-patch.

    Left-handed patches count by their orientation: an injective model has a positive scaled Jacobian however
    its patches are handed. Minimum, mean and maximum are over the samples, the mean unweighted: every span
    counts alike, whatever its size.

    Parameters
    ----------
    mp : MultiPatch
        Polynomial or rational.
    samples : int, default 10
        Uniform parameters per knot span and direction, both ends of every span included, each seen from
        inside its span (at a C0 knot the derivatives of both sides count). At least 2.
    exclude : iterable of (patch, corner), optional
        Degenerate corners to leave out, corner 0 to 3 = (0,0), (1,0), (0,1), (1,1): a sample at each, and of what is
        proved the square up to the next samples.
    proved : bool, default False
        Whether to prove bounds of the smallest scaled Jacobian and the largest condition number, too. Means remain
        those of samples.
    width : float, default 1e-3
        How far these bounds may be apart, relative to their size.

    Returns
    -------
    Quality

    Raises
    ------
    InputError
        When `samples` is below 2 (3 with `exclude`), `exclude` names a corner that does not exist, or, with `proved`,
        degrees exceed 28 (14 of rational patches) or `width` is not in (0, 1).

    Notes
    -----
    Eq. 19 and 20 of the paper. With J = (B_u, B_v), ‖J‖_F ‖J⁻¹‖_F = (|B_u|² + |B_v|²) / |det J|, which is at
    least 2 / |scaled Jacobian|. Both depend on the scaling of u against v, as in the paper.

    Bounds come from Bernstein coefficients of B_u·B_v over those of det J, and of |B_u|² + |B_v|² over det J, on Bézier
    pieces that are halved until the bounds meet.

    Examples
    --------
    >>> from patchtransfer import MultiPatch, Patch
    >>> knots = ([0, 0, 1, 1], [0, 0, 1, 1])
    >>> found = quality(MultiPatch([Patch(knots, (1, 1), [[[0, 0], [0, 1]], [[1, 0], [2, 2]]])]), proved=True)
    >>> print(found.proved)
    minimum scaled Jacobian 0.5999, proved; maximum condition number 3.334, proved
    """
    excluded = _check_corners(mp, exclude)
    check_samples(samples)
    if excluded and samples < 3:
        raise InputError(f"samples = {samples}: leaving out corners needs at least 3 per knot span")
    corners = [excluded.get(k, []) for k in range(len(mp.patches))]
    bounds = _proved(mp, corners, samples, width) if proved else None
    found = measure_quality(
        [patch.to_core() for patch in mp.patches],
        [float(sign) for sign in mp.topology.orientation],
        samples,
        corners,
    )
    jacobian, condition, counts, worst = zip(*found, strict=True)
    n, positive = (sum(column) for column in zip(*counts, strict=True))
    k = min(range(len(found)), key=lambda k: jacobian[k][0])
    return Quality(_statistics(jacobian, n), _statistics(condition, positive), n - positive, n, (k, *worst[k]), bounds)


def proved_bounds(mp: MultiPatch, exclude: Iterable[tuple[int, int]] = (), width: float = 1e-3) -> ProvedQuality:
    """What `quality` proves, without its samples; parameters as there."""
    excluded = _check_corners(mp, exclude)
    return _proved(mp, [excluded.get(k, []) for k in range(len(mp.patches))], SAMPLES, width)


def _proved(mp: MultiPatch, corners: list[list[int]], samples: int, width: float) -> ProvedQuality:
    # Of a degenerate corner the square up to the next samples is left out.
    return proved_quality(mp, corners, 1 / (samples - 1), width)


def _statistics(ranges: Iterable[tuple[float, float, float]], count: int) -> Statistics:
    """Of ranges (min, max, sum); the mean is over `count` samples, infinite if there are none."""
    lows, highs, sums = zip(*ranges, strict=True)
    low, high = min(lows), max(highs)
    mean = math.fsum(sums) / count if count else math.inf
    # The mean of equal numbers may round out of their range.
    return Statistics(low, min(max(mean, low), high), high)


def sample(mp: MultiPatch, samples: int = SAMPLES) -> list[tuple[FloatArray, FloatArray]]:
    """Points and scaled Jacobians on the sample grid of :func:`quality`, for plotting.

    Returns
    -------
    list of (points, scaled_jacobian)
        One pair a patch, (m_u, m_v, 2) and (m_u, m_v), with m = spans · samples.
    """
    check_samples(samples)
    return [
        sample_patch(patch.to_core(), float(sign), samples)
        for patch, sign in zip(mp.patches, mp.topology.orientation, strict=True)
    ]


def _check_corners(mp: MultiPatch, exclude: Iterable[tuple[int, int]]) -> dict[int, list[int]]:
    corners: dict[int, list[int]] = defaultdict(list)
    for patch, corner in exclude:
        if not (0 <= patch < len(mp.patches) and 0 <= corner < 4):
            raise InputError(
                f"corner {corner} of patch {patch} to exclude does not exist; patches are 0 to "
                f"{len(mp.patches) - 1}, corners 0 to 3"
            )
        corners[int(patch)].append(int(corner))
    return corners
