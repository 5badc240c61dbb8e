"""
No source: from an outline alone
================================

`patchtransfer.parameterize` finds the layout of quads itself. Here a wing section in a box becomes a model, and the
model the source for other sections at other angles.
"""

import numpy as np
from scipy.interpolate import make_interp_spline

import patchtransfer as pt


def section(camber: float, thickness: float, degrees: float) -> pt.BSplineCurve:
    """A four-digit NACA section of chord 1 as one cubic curve, from the trailing edge round the nose and back."""
    s = np.linspace(1, -1, 61)
    t = s**2
    half = 5 * thickness * (0.2969 * np.abs(s) - 0.126 * t - 0.3516 * t**2 + 0.2843 * t**3 - 0.1036 * t**4)
    points = np.column_stack([t - 0.5, 4 * camber * t * (1 - t) + np.sign(s) * half])
    angle = -np.radians(degrees)
    points = points @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    spline = make_interp_spline((1 - s) / 2, points, k=3)
    return pt.BSplineCurve(spline.t, 3, spline.c)


def boxed(hole: pt.BSplineCurve) -> pt.Boundary:
    """The domain around a section."""
    corners = np.array([[-1, -0.75], [1.5, -0.75], [1.5, 0.75], [-1, 0.75]])
    box = [pt.BSplineCurve([0, 0, 1, 1], 1, [corners[k], corners[(k + 1) % 4]]) for k in range(4)]
    return pt.Boundary([box, [hole]])


source = pt.parameterize(boxed(section(0.02, 0.14, 0)))
print(source)
assert source.certificate.injective
assert source.boundary_error < 1e-3

figure = pt.plot.multipatch(source.multipatch)

# %%
# What else was tried, the best first; ``source.layout`` is the layout kept, ready to be changed and given to
# `patchtransfer.from_layout`.

for candidate in source.candidates[:5]:
    print(f"{len(candidate.layout.quads):3} patches, score {candidate.score:.3f}: {candidate.origin}")

# %%
# Another section, at another angle: patches and knots stay, so that solutions of both can be compared number by number.

target = boxed(section(0.05, 0.09, 8))
result = pt.transfer(source.multipatch, target)
print(result.certificate.status, result.quality.scaled_jacobian)
assert result.certificate.injective
assert len(result.multipatch) == len(source.multipatch)
assert result.quality.scaled_jacobian.mean > 0.9

figure = pt.plot.transfer(source.multipatch, target, result.multipatch)

# %%
# ``patchtransfer parameterize OUTLINE.svg -o OUT.xml`` does the same from a drawing.
