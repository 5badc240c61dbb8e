"""
A family of airfoils from one parameterization
==============================================

The flow around a wing section is computed in a box with a hole. `patchtransfer.parameterize` finds patches for one
section; every other one, at any angle, gets the same patches, so that solutions can be compared number by number.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.interpolate import make_interp_spline

import patchtransfer as pt


def naca(digits: str, degrees: float) -> pt.BSplineCurve:
    """A four-digit section of chord 1 as one cubic curve, from the trailing edge round the nose and back."""
    camber, place, thickness = int(digits[0]) / 100, int(digits[1]) / 10, int(digits[2:]) / 100
    # The abscissa as a square makes the thickness a polynomial, with either sign of the root: the nose is smooth.
    root = np.linspace(1, -1, 61)
    x = root**2
    half = 5 * thickness * np.sign(root) * np.polyval([-0.1036, 0.2843, -0.3516, -0.126, 0], x)
    half += 5 * thickness * 0.2969 * root
    mean = camber * (1 - ((x - place) / np.where(x < place, place, 1 - place)) ** 2)
    turned = (x - 0.5 + 1j * (mean + half)) * np.exp(-1j * np.radians(degrees))
    spline = make_interp_spline((1 - root) / 2, np.column_stack([turned.real, turned.imag]), k=3)
    return pt.BSplineCurve(spline.t, 3, spline.c)


def boxed(section: pt.BSplineCurve) -> pt.Boundary:
    """The domain around a section."""
    corners = np.array([[-1, -0.75], [1.5, -0.75], [1.5, 0.75], [-1, 0.75]])
    box = [pt.BSplineCurve([0, 0, 1, 1], 1, [corners[k], corners[(k + 1) % 4]]) for k in range(4)]
    return pt.Boundary([box, [section]])


source = pt.parameterize(boxed(naca("2412", 0)))
print(source)
assert source.certificate.injective
assert source.boundary_error < 1e-3
assert len(source.multipatch) <= 12

figure = pt.plot.multipatch(source.multipatch)

# %%
# A plan does what depends on the source only once. Landmarks are not needed: the trailing edge is a corner, the rest is
# found by shape.

plan = pt.TransferPlan(source.multipatch)
family = [("0012", 0), ("4412", 6), ("2409", -5), ("0012", 15)]
results = [plan.transfer(boxed(naca(digits, degrees))) for digits, degrees in family]
for (digits, degrees), result in zip(family, results, strict=True):
    jacobian = result.quality.scaled_jacobian
    print(f"NACA {digits} at {degrees:2}°: {result.certificate.status}, {jacobian.min:.2f} / {jacobian.mean:.3f}")
assert all(result.certificate.injective for result in results)
assert max(result.boundary_error for result in results) < 1e-3
assert min(result.quality.scaled_jacobian.mean for result in results) > 0.99

figure, axes = plt.subplots(2, 2, figsize=(10, 6.4), layout="constrained")
for ax, (digits, degrees), result in zip(axes.flat, family, results, strict=True):
    pt.plot.multipatch(result.multipatch, ax, colorbar=False, title=f"NACA {digits} at {degrees}°")
