"""
Circles that stay circles
=========================

NURBS keep their weights: control points move. Where the target's curves have the weights of the source's sides, the
result's boundary is the target, to rounding. Others are followed as near as degree 2 can, or by converted patches.
"""

import numpy as np

import patchtransfer as pt
from patchtransfer import examples

source, target, landmarks = examples.load("annulus")
result = pt.transfer(source, target, landmarks)
print(result)
print(result.log[0])
assert result.certificate.injective
assert result.boundary_error < 1e-12
figure = pt.plot.transfer(source, target, result.multipatch)

# %%
# The rim is a circle of radius 1.3, the hole one of 0.4, moved aside, between the control points as well.

for (centre, radius), loop in zip([((0, 0), 1.3), ((0.25, 0.1), 0.4)], result.multipatch.boundary().loops, strict=True):
    points = np.concatenate([curve(np.linspace(*curve.domain, 101)) for curve in loop])
    off = np.abs(np.hypot(*(points - centre).T) - radius).max()
    print(f"radius {radius}: off by {off:.0e}")
    assert off < 1e-14

# %%
# A plate with a hole: the circle becomes an ellipse, and patches meet with one tangent where knots allow.

source, target, landmarks = examples.load("plate-with-hole")
result = pt.transfer(source, target, landmarks)
print(result, result.continuity.c1_share)
assert result.certificate.injective
assert result.boundary_error < 1e-12
figure_of_plate = pt.plot.transfer(source, target, result.multipatch)

# %%
# What takes no weights works on a copy without them, of degree 3 or 4, as near as asked for.

made = pt.to_polynomial(source, tolerance=1e-6)
print(made)
curved = pt.transfer(made.multipatch, target, landmarks)
print(curved)
assert made.loss <= 1e-6
assert curved.certificate.injective
