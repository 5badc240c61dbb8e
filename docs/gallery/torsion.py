"""
Shape optimisation: the stiffest bar in torsion
===============================================

Of all sections of one area the disc resists torsion best (Saint-Venant's conjecture, proved by Pólya). A dented disc
finds that out: Poisson's equation −Δu = 1 on the section gives its rigidity T = ∫ u, and 8π T / A² is 1 for the disc
only. ``freeze`` makes the parameterization a smooth function of the outline, so that derivatives go from T by all
control points to the radii of the outline, and every iterate is proved injective.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.animation import FuncAnimation
from scipy.optimize import minimize

import patchtransfer as pt
from patchtransfer import iga

turn = np.linspace(0, 2 * np.pi, 200, endpoint=False)
circle = pt.Boundary.from_points(np.column_stack([np.cos(turn), np.sin(turn)]), smooth=True)
disc = pt.parameterize(circle).multipatch.split_spans(3)
points, on = disc.topology.coordinates.copy(), disc.topology.boundary_points
radii, angles = np.hypot(*points[on].T), np.arctan2(points[on, 1], points[on, 0])
rays = points[on] / radii[:, None]
radii *= 1 - 0.3 * np.exp(-(((angles - 1.2) / 0.4) ** 2)) + 0.15 * np.cos(3 * angles) + 0.1 * np.cos(2 * angles)
points[on] = radii[:, None] * rays
frozen = pt.TransferPlan(disc).freeze(points)
# Variables whose square is the H¹ norm of the motion: rough steps are long.
smooth = np.linalg.inv(np.linalg.cholesky(frozen.inner_product.matrix.toarray()))


def loss(q):
    """−8π T / A² and its derivative."""
    filled = maps[q.tobytes()] = frozen.fill((radii + smooth.T @ q)[:, None] * rays)
    rigidity, by_points = iga.poisson(filled.multipatch, f=1.0).integral()
    area, by_area = frozen.area(filled.points[on])
    by_boundary = 8 * np.pi * (filled.vjp(by_points) - 2 * rigidity / area * by_area) / area**2
    return -8 * np.pi * rigidity / area**2, -smooth @ (by_boundary * rays).sum(axis=1)


maps, path = {}, [np.zeros(len(on))]
found = minimize(loss, path[0], jac=True, method="L-BFGS-B", callback=path.append, options={"maxiter": 15})
print(f"8π T / A²: {-loss(path[0])[0]:.4f} -> {-found.fun:.7f} in {found.nit} iterations")
assert all(maps[q.tobytes()].certificate.injective for q in path)
assert -found.fun > 0.9999

figure, axes = plt.subplots(1, 4, figsize=(12, 3.4), layout="constrained")
for ax, q in zip(axes, (*path[:3], path[-1]), strict=True):
    pt.plot.multipatch(maps[q.tobytes()].multipatch, ax=ax, colorbar=False, title=f"8π T / A² = {-loss(q)[0]:.4f}")
    ax.get_legend().remove()

# %%
# The patches on the way:
film, stage = plt.subplots(figsize=(4, 4), layout="constrained")
moving = FuncAnimation(
    film,
    lambda q: (stage.clear(), pt.plot.multipatch(maps[q.tobytes()].multipatch, ax=stage, colorbar=False)),
    path,
)
