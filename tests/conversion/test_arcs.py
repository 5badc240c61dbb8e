"""A spline beside a rational curve: near, with its ends and tangents, and the distance is what it is said to be."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import conics
from patchtransfer import BSplineCurve
from patchtransfer.conversion.arcs import fit_arc


def knots(degree: int, spans: int) -> np.ndarray:
    return np.concatenate([[0.0] * degree, np.linspace(0, 1, spans + 1), [1.0] * degree])


def farthest(a: BSplineCurve, b: BSplineCurve) -> float:
    """Of points of `a` from `b`: the nearest of many samples, then Newton's method on the squared distance."""
    p, t = a(np.linspace(*a.domain, 301)), np.linspace(*b.domain, 1001)
    s = t[[((b(t) - q) ** 2).sum(axis=1).argmin() for q in p]]
    q, d, dd = b(s), b(s, 1), b(s, 2)
    for _ in range(8):
        off = q - p
        s = (s - (off * d).sum(axis=1) / ((d * d).sum(axis=1) + (off * dd).sum(axis=1))).clip(*b.domain)
        q, d, dd = b(s), b(s, 1), b(s, 2)
    return float(np.hypot(*(q - p).T).max())


#: Radial error of a quarter circle's best fit with the tangents held, by degree and spans; `docs/nurbs.md` has them.
QUARTER = {
    (3, 1): 2.1e-4,
    (3, 2): 3.4e-5,
    (3, 4): 2.7e-6,
    (4, 1): 6.3e-7,
    (4, 2): 1.1e-7,
    (4, 4): 1.5e-8,
    (4, 8): 6.4e-10,
}


@pytest.mark.parametrize(("degree", "spans"), QUARTER)
def test_a_quarter_circle_is_missed_by_as_little_as_is_possible(degree, spans):
    fit = fit_arc(conics.arc(np.pi / 2), knots(degree, spans), degree, 0.0)
    curve = BSplineCurve(knots(degree, spans), degree, fit.points)
    off = float(np.abs(np.hypot(*curve(np.linspace(0, 1, 5001)).T) - 1).max())
    assert off == pytest.approx(QUARTER[degree, spans], rel=0.08)
    assert off <= fit.distances.max() <= 1.1 * off


@settings(max_examples=15, deadline=None)
@given(
    st.floats(0.2, 2.8),
    st.floats(0.3, 3.0),
    st.floats(0.35, 2.0),
    st.sampled_from([3, 4]),
    st.integers(1, 4),
    st.data(),
)
def test_random_conics(turn, length, weight, degree, spans, data):
    corner = np.array([1.0, 0.0])
    end = corner + length * np.array([np.cos(turn), np.sin(turn)])
    curve = conics.conic([0.0, 0.0], corner, end, weight)
    limit = data.draw(st.sampled_from([0.0, 1e-4, 1e-2]))
    fit = fit_arc(curve, knots(degree, spans), degree, limit)
    image = BSplineCurve(knots(degree, spans), degree, fit.points)
    # Ends to the bit, and legs along the tangents.
    assert np.array_equal(fit.points[[0, -1]], curve.control_points[[0, -1]])
    for t in (0.0, 1.0):
        a, b = curve(t, 1), image(t, 1)
        assert abs(a[0] * b[1] - a[1] * b[0]) <= 1e-9 * np.hypot(*a) * np.hypot(*b)
        assert a @ b > 0
    # What is said of the distance bounds it both ways, and is not far above.
    found = max(farthest(image, curve), farthest(curve, image))
    said = float(fit.distances.max())
    assert found <= said * 1.001 + 1e-14
    assert said <= 1.3 * found + 1e-13
    # More spans are no worse, but for what steps miss of the best.
    finer = fit_arc(curve, knots(degree, 2 * spans), degree, limit)
    assert finer.distances.max() <= max(limit, 1.5 * said, 1e-14)


def test_a_side_that_is_a_point_stays_one():
    point = BSplineCurve([0, 0, 0, 1, 1, 1], 2, [[1, 2]] * 3, [1, 0.5, 1])
    fit = fit_arc(point, knots(3, 2), 3, 1e-6)
    np.testing.assert_allclose(fit.points, [[1, 2]] * 5, atol=1e-15)
    assert fit.distances.max() < 1e-15
