"""Constants of `confidence` and `expected`, written by ``python benches/python/calibration.py --fit``; do not edit."""

from __future__ import annotations

__all__ = ["MEAN", "MINIMUM", "RIGHT"]

#: Weights of 1, log(turned), margin and corners, for the probability that a correspondence is right.
RIGHT = (0.48, -1.45, 0.78, 0.94)
#: Weights of 1, turned, jump and distances, for quantiles of how much arcosh(1/mean scaled Jacobian) grows.
MEAN = {
    0.1: (0.0, 0.0, 0.0, 0.0),
    0.5: (0.0, 0.1, 0.0, 0.5),
    0.9: (0.0, 0.2, 0.0, 1.0),
}
#: The same of arcosh(1/least scaled Jacobian).
MINIMUM = {
    0.1: (0.0, 0.2, 0.0, 0.5),
    0.5: (0.2, 0.7, 0.1, 1.0),
    0.9: (0.7, 1.0, 0.2, 2.0),
}
