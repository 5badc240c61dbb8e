"""
Tutorial: from a drawing to a solved equation
=============================================

A heat sink is drawn, cut into patches, proved, and warmed; then one with longer fins, from the same patches. Nothing is
needed but the package, NumPy and this page.
"""

import tempfile
from pathlib import Path

import numpy as np

import patchtransfer as pt

DRAWING = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 120 110">
  <path d="M 0 100 V 64 H 12 L 14 {top} H 26 L 28 64 H 52 L 54 {top} H 66 L 68 64
           H 92 L 94 {top} H 106 L 108 64 H 120 V 100 Z"/>
  <circle cx="60" cy="82" r="9"/>
</svg>"""
folder = Path(tempfile.mkdtemp())

# %%
# 1. The outline
# --------------
#
# Closed paths become loops: the outer one and a hole. Units are those of the drawing, y points up. Files of CAD
# programs (DXF, Rhino), masks and polygons are read in the same way.

drawing = folder / "short.svg"
drawing.write_text(DRAWING.format(top=32))
outline = pt.read_boundary(drawing)
print(outline)

# %%
# 2. The patches
# --------------
#
# `patchtransfer.parameterize` finds a layout of quads, puts splines on it, and optimises their inner control points.
# Lines are coloured by the scaled Jacobian, the sine of the angle between them.

found = pt.parameterize(outline)
print(found)
print(f"the outline is missed by {found.boundary_error:.1e} of the diameter")
assert found.boundary_error < 1e-3

figure = pt.plot.multipatch(found.multipatch, title="what was found")

# %%
# 3. The proof
# ------------
#
# The certificate is no check of samples: it proves that no two points of the patches go to the same place. The worst
# angle is proved as well, between two bounds.

certificate = found.certificate
print(certificate)
print(found.quality.proved.min_scaled_jacobian)
assert certificate.injective
assert found.quality.proved.min_scaled_jacobian.lower > 0.3

# %%
# 4. Names for sides
# ------------------
#
# A pipe in the bore, a wall below, air all around. A side of the boundary is a patch's number and one of four sides;
# where its control points are tells which is which.


def named(model: pt.MultiPatch) -> pt.MultiPatch:
    """The model with labels on its boundary."""
    labels: dict[str, list] = {"pipe": [], "wall": [], "air": []}
    for k, side in model.boundaries:
        points = side.of(model[k].control_points)
        if np.hypot(*(points - (60, -82)).T).max() < 10:
            labels["pipe"].append((k, side))
        elif points[:, 1].max() < -99.9:
            labels["wall"].append((k, side))
        else:
            labels["air"].append((k, side))
    return model.with_labels(labels)


model = named(found.multipatch)
print({label: len(sides) for label, sides in model.sides.items()})

# %%
# 5. The equation
# ---------------
#
# :math:`-\Delta u = 0` with 80 degrees at the pipe, a flux of -0.4 through the wall (heat is lost there), and air of
# 20 degrees: :math:`\partial u / \partial n = -\alpha (u - 20)`, which is Robin's condition :math:`\partial u /
# \partial n + \alpha u = 20\,\alpha`.

alpha = 0.02


def warmed(model: pt.MultiPatch) -> pt.iga.PoissonResult:
    """Temperatures, by fields of degree 3 on the model's patches."""
    return pt.iga.poisson(
        model,
        f=0.0,
        g={"pipe": 80.0},
        neumann={"wall": -0.4},
        robin={"air": (alpha, 20 * alpha)},
        degree=3,
        points=9,
    )


solution = warmed(model)
print(f"{solution.dofs} unknowns, residual {solution.residual:.0e}")
assert solution.residual < 1e-12

warm = pt.plot.solution(solution)

# %%
# A solution is a function: it finds the patches of points by itself, and is NaN outside. Here along the middle fin,
# from the bore to its tip.

heights = np.linspace(-73, -33, 5)
along = solution(np.column_stack([np.full(5, 60.0), heights]))
print(np.round(along, 1))
assert abs(along[0] - 80) < 0.1
assert np.all(np.diff(along) < 0)

# %%
# Model and field go into one file for ParaView, exactly: cells are Bézier patches of the field's degree.

pt.write(model, folder / "short.vtu", fields={"temperature": solution})

# %%
# 6. A variant
# ------------
#
# Longer fins. The patches are carried over: their number, knots, interfaces and labels stay, so the same lines solve
# again, and the results can be compared number by number.

drawing = folder / "long.svg"
drawing.write_text(DRAWING.format(top=8))
longer = pt.transfer(model, pt.read_boundary(drawing))
print(longer)
assert longer.certificate.injective
assert longer.multipatch.sides == model.sides

carried = pt.plot.transfer(model, pt.read_boundary(drawing), longer.multipatch)

# %%
# The tip of the longer fin is colder.

again = warmed(longer.multipatch)
tips = [float(solution([[60, -33]])[0]), float(again([[60, -9]])[0])]
print(f"at the tip of the middle fin: {tips[0]:.1f} and {tips[1]:.1f} degrees")
assert 20 < tips[1] < tips[0] < 80

warm_again = pt.plot.solution(again)

# %%
# Where to go from here: what a result says (:doc:`the quickstart </guide/quickstart>`), landmarks where
# correspondence is not plain (:doc:`landmarks`), many variants at once (:doc:`batch`), and models for other programs
# (:doc:`/guide/hand-it-on`).
