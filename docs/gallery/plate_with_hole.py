"""
Shape optimisation: the best hole in a plate
============================================

A large plate is pulled twice as hard along x as along y. Of all holes of one area the ellipse with axes in the ratio of
the stresses weakens it least, for the stress along its edge is constant (Cherepanov 1974). A quarter is enough, by
symmetry; the hole begins as a circle. Compliance is differentiated by all control points, they by those of the hole.
"""

import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import minimize

import patchtransfer as pt
from patchtransfer import iga

knots = np.array([0, 0, 0, 0, 1, 2, 3, 3, 3, 3]) / 3
turn = np.pi / 36 * np.array([0, 1, 3, 6, 8, 9, 10, 12, 15, 17, 18])
rays = np.column_stack([np.cos(turn), np.sin(turn)])
edge = 20 * rays / np.abs(rays).max(axis=1, keepdims=True)
along = np.array([0, 0.01, 0.04, 0.12, 0.35, 1])[:, None]


def plate(radii):
    """Two patches between a hole of these radii and the edges, along rays."""
    net = np.stack([(1 - s) * radii[:, None] * rays + s * edge for s in along], axis=1)
    return pt.MultiPatch([pt.Patch((knots, knots), (3, 3), net[part]) for part in (slice(0, 6), slice(5, 11))])


sides = {"bottom": [(0, "west")], "right": [(0, "north")], "top": [(1, "north")], "left": [(1, "east")]}
model = plate(np.ones(11)).with_labels(sides)
loads = {"left": (0.0, None), "bottom": (None, 0.0)}, {"right": (2.0, 0.0), "top": (0.0, 1.0)}
frozen = pt.TransferPlan(model).freeze()
changes = [plate(1 + e).topology.coordinates - model.topology.coordinates for e in np.eye(11)]
motions = np.stack(changes)[:, frozen.boundary_points]


def compliance(q):
    """Scaled, so that first steps are short; with its derivative."""
    filled = frozen.fill(frozen.boundary + np.tensordot(q, motions, 1))
    value, by_points = iga.elasticity(filled.multipatch, *loads, degree=4, points=11).compliance()
    return 0.03 * value, 0.03 * np.tensordot(motions, filled.vjp(by_points), 2)


start, inside = np.zeros(11), frozen.area(frozen.boundary)[0]
same = {"type": "eq", "fun": lambda q: frozen.area(frozen.boundary + np.tensordot(q, motions, 1))[0] - inside}
found = minimize(compliance, start, jac=True, constraints=same, bounds=[(-0.7, 1.5)] * 11)
ratio = (1 + found.x[0]) / (1 + found.x[-1])
assert abs(ratio - 2) < 0.01

figure, axes = plt.subplots(1, 3, figsize=(12, 3.6), layout="constrained")
for ax, q, title in zip(axes, (start, found.x), ("before", f"axes {ratio:.3f} : 1"), strict=False):
    filled = frozen.fill(frozen.boundary + np.tensordot(q, motions, 1))
    assert filled.certificate.injective
    pt.plot.multipatch(filled.multipatch, ax=ax, colorbar=False)
    ax.set(xlim=(0, 3), ylim=(0, 3), title=title)
    result = iga.elasticity(filled.multipatch, *loads, degree=4, points=11)
    stress = [result.stress(k, np.linspace(0, 1, 40), 0.0)[:2].sum(axis=0) for k in (0, 1)]
    axes[2].plot(np.linspace(0, 90, 80), np.concatenate(stress), label=title)
axes[2].legend(title="stress along the edge of the hole")
