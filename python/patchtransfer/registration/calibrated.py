"""Constants of `confidence` and `expected`, written by ``benches/python/calibration.py --write``."""

from __future__ import annotations

__all__ = ["MEAN", "MINIMUM", "RIGHT"]

#: Weights of 1, log(turned), margin and corners, for the probability that a correspondence is right.
RIGHT = (-0.267, -2, 2.17, 2.11)
#: Weights of 1, turned, jump and distances, for quantiles of how much arcosh(1/mean scaled Jacobian) grows.
MEAN = {
    0.1: (-0.0652, 0.0278, -0.00362, 0.615),
    0.5: (-0.0564, -0.0124, 0.0528, 1.47),
    0.9: (-0.015, -0.0489, 0.0328, 2.8),
}
#: The same of arcosh(1/least scaled Jacobian).
MINIMUM = {
    0.1: (-0.272, 0.169, 0.027, 1.97),
    0.5: (-0.116, 0.28, 0.322, 2.37),
    0.9: (-0.0225, 0.85, 0.703, 1.76),
}
