"""The probability that a correspondence found without landmarks is the right one, calibrated.

A logistic function of what tells right ones from wrong ones best, of all that was tried: how far a piece of the
boundary is turned, how much better the shapes fit than in the runner-up, and how many corners hold the matching.
"""

from __future__ import annotations

import math

from .calibrated import RIGHT
from .mismatch import Mismatch

__all__ = ["DOUBTFUL", "confidence", "doubt", "traits"]

#: Below this confidence a correspondence is rather wrong than right, and a warning says so before the work.
DOUBTFUL = 0.5
#: Added to angles (radians), so that those of similar shapes are alike whatever rounding makes of them.
SMALL = 0.05
#: Corners that hold a matching as well as more of them do.
ENOUGH = 4


def traits(mismatch: Mismatch, margin: float, corners: int) -> tuple[float, float, float, float]:
    """What the probability is a logistic function of."""
    return 1.0, math.log(mismatch.turned + SMALL), margin, min(corners, ENOUGH) / ENOUGH


def confidence(mismatch: Mismatch, margin: float, corners: int) -> float:
    """The probability.

    Parameters
    ----------
    mismatch : Mismatch
    margin : float
        How much better the shapes fit than in the runner-up, from 0 to 1.
    corners : int
        Matched on the outer loop.
    """
    exponent = sum(a * b for a, b in zip(RIGHT, traits(mismatch, margin, corners), strict=True))
    return 1 / (1 + math.exp(-exponent))


def doubt(sure: float) -> str:
    """What to say of a confidence below `DOUBTFUL`."""
    return (
        f"the correspondence found without landmarks is rather wrong than right (confidence {sure:.2f}): give "
        "landmarks, or a source more like the target (patchtransfer library)"
    )
