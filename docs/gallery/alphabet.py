"""
A font's alphabet
=================

Letters have thin arms, sharp corners, round bowls and holes, and nobody draws quads for them by hand. Here outlines
come from a font, layouts from `patchtransfer.parameterize`. A bold font's letters get the same patches by transfer.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.font_manager import FontProperties
from matplotlib.path import Path
from matplotlib.textpath import TextPath

import patchtransfer as pt


def letter(character: str, weight: str = "normal") -> pt.Boundary:
    """Outline of a letter of DejaVu Sans, which comes with matplotlib."""
    font = FontProperties(family="DejaVu Sans", weight=weight)
    loops: list[list[pt.BSplineCurve]] = []
    for flat, code in TextPath((0, 0), character, size=1, prop=font).iter_segments(simplify=False, curves=True):
        points = flat.reshape(-1, 2)
        if code == Path.MOVETO:
            loops.append([])
            start = at = points[0]
            continue
        if code == Path.CLOSEPOLY:
            points = start[None]
        if not np.allclose(at, points[-1]):
            # A line, or a quadratic curve.
            degree = len(points)
            loops[-1].append(pt.BSplineCurve([0] * (degree + 1) + [1] * (degree + 1), degree, [at, *points]))
            at = points[-1]
    return pt.Boundary([loop for loop in loops if loop])


lines = ("ABDEHO", "PRSaet")
results = {character: pt.parameterize(letter(character)) for character in "".join(lines)}
for character, result in results.items():
    jacobian = result.quality.scaled_jacobian
    print(f"{character}: {len(result.multipatch):2} patches, scaled Jacobian {jacobian.min:.2f} / {jacobian.mean:.3f}")
assert all(result.certificate.injective for result in results.values())
assert max(result.boundary_error for result in results.values()) < 1e-3
assert max(len(result.multipatch) for result in results.values()) <= 15

figure, ax = plt.subplots(figsize=(12, 5), layout="constrained")
for row, line in enumerate(lines):
    x = 0.0
    for character in line:
        patches = results[character].multipatch
        nets = [patch.control_points for patch in patches.patches]
        left = min(net[..., 0].min() for net in nets)
        moved = patches.with_control_points([net + np.array([x - left, -0.95 * row]) for net in nets])
        last = character == lines[-1][-1]
        pt.plot.multipatch(moved, ax, iso_lines=1, colorbar=last)
        x += max(net[..., 0].max() for net in nets) - left + 0.12

# %%
# The patches of one letter carried over to the bold font.

target = letter("a", "bold")
bold = pt.transfer(results["a"].multipatch, target)
print(bold)
assert bold.certificate.injective
assert bold.quality.scaled_jacobian.mean > 0.95

figure = pt.plot.transfer(results["a"].multipatch, target, bold.multipatch, titles=("regular", "bold", "result"))
