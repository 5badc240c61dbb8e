"""Nearest points of a curve."""

from __future__ import annotations

import numpy as np

from ...numeric.arrays import FloatArray
from ..basis import knot_spans
from ..curve import BSplineCurve

__all__ = ["nearest_on_curve"]

#: Samples a span, for each degree: between two of them a curve of the degree bends little.
SAMPLES = 6
#: Steps from the middle of two samples: each doubles the digits where the point lies on the curve.
STEPS = 12


def nearest_on_curve(curve: BSplineCurve, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Parameters (m,) of the points of a curve that are nearest to given ones, and the distances (m,).

    Exact to rounding for points on the curve; for points off it by less than its radius of curvature, nearly.

    Parameters
    ----------
    curve : BSplineCurve
    points : (m, 2) array
    """
    breaks = knot_spans(curve.knots)
    steps = np.arange(SAMPLES * curve.degree) / (SAMPLES * curve.degree)
    t = np.append((breaks[:-1, None] + np.diff(breaks)[:, None] * steps).ravel(), breaks[-1])
    samples = curve(t)
    distances = np.hypot(*(samples - points[:, None]).transpose(2, 0, 1))
    closest = distances.argmin(axis=1)
    best, least = t[closest], distances.min(axis=1)
    for low, high in ((np.maximum(closest - 1, 0), closest), (closest, np.minimum(closest + 1, len(t) - 1))):
        at = (t[low] + t[high]) / 2
        for _ in range(STEPS):
            off, slope = curve(at) - points, curve(at, 1)
            length = np.hypot(*off.T)
            better = length < least
            best, least = np.where(better, at, best), np.where(better, length, least)
            # By the direction, for squares of slopes between near knots overflow.
            with np.errstate(all="ignore"):
                speed = np.hypot(*slope.T)
                step = np.nan_to_num((off * (slope / speed[:, None])).sum(axis=1) / speed, posinf=0.0, neginf=0.0)
            at = np.clip(at - step, t[low], t[high])
    return best, least
