"""
How a parameterization follows its outline
==========================================

``jvp`` gives the motion of all control points with the boundary, to first order and exactly: tangents of a family of
shapes, from one factorization. They predict a neighbour without solving for it, and they span what a basis of snapshots
(proper orthogonal decomposition, POD) has to find from many solved members.
"""

import matplotlib.pyplot as plt
import numpy as np

import patchtransfer as pt

source, target, landmarks = pt.examples.load("wrench")
frozen = pt.transfer(source, target, landmarks).freeze()
boundary = frozen.boundary
size = np.hypot(*np.ptp(boundary, axis=0))
x, y = ((boundary - boundary.mean(axis=0)) / size).T
# Three ways to change the outline: bend it, spread it, twist it.
ways = size * np.stack([[y**2, 0 * y], [x * y, 0 * y], [np.sin(4 * y) * x, np.sin(3 * x)]]).swapaxes(1, 2)
middle = frozen.fill(boundary)
tangents = middle.jvp(ways)

sizes, errors = 0.5 ** np.arange(1, 8), []
for step in sizes:
    moved = frozen.fill(boundary + 0.2 * step * ways.sum(axis=0))
    assert moved.certificate.injective
    errors.append(np.abs(moved.points - middle.points - 0.2 * step * tangents.sum(axis=0)).max() / size)
order = np.log2(errors[-2] / errors[-1])
print(f"the prediction errs by {errors[-1]:.1e} of the size, order {order:.3f}")
assert abs(order - 2) < 0.05

# Snapshots of random members, and how much of a new member different bases leave.
chosen = np.random.default_rng(0).uniform(-0.05, 0.05, (13, 3))
filled = [frozen.fill(boundary + np.tensordot(c, ways, 1)) for c in chosen]
*members, new = [(member.points - middle.points).ravel() for member in filled]


def left(basis):
    """Part of the new member that a basis does not hold."""
    q = np.linalg.qr(np.array(basis).reshape(len(basis), -1).T)[0]
    return np.linalg.norm(new - q @ (q.T @ new)) / np.linalg.norm(new)


modes = np.linalg.svd(np.array(members), full_matrices=False)[2]
print(f"left by 3 tangents {left(tangents):.1e}, by 3 POD modes of 12 snapshots {left(modes[:3]):.1e}")

figure, axes = plt.subplots(1, 4, figsize=(12, 4), layout="constrained", width_ratios=(1, 1, 1, 1.6))
for ax, c in zip(axes, (-0.4, 0, 0.4), strict=False):
    predicted = source.with_shared_points(middle.points + c * tangents[0])
    pt.plot.multipatch(predicted, ax=ax, colorbar=False, title=f"bent by {c}, predicted")
    ax.get_legend().remove()
axes[3].loglog(0.2 * sizes, errors, "o-", label="error of the prediction / size")
axes[3].loglog(0.2 * sizes, errors[0] * (sizes / sizes[0]) ** 2, ":", label="second order")
axes[3].set(xlabel="change of the outline")
axes[3].legend()
