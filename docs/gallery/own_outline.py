"""
A source of your own, from an SVG outline
=========================================

A coarse layout of quads and an outline are enough: `patchtransfer.from_layout` fits the layout's boundary to the
outline and fills it. The result is a source for transfers, or the model itself.
"""

import tempfile
from pathlib import Path

import patchtransfer as pt

svg = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 120 90">
  <path d="M 10 80 L 10 20 C 40 5 80 5 110 20 L 110 80 C 80 70 40 70 10 80 Z"/>
  <circle cx="60" cy="44" r="14"/>
</svg>"""
with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "plate.svg"
    path.write_text(svg)
    outline = pt.read_boundary(path)

# %%
# The layout in the drawing's coordinates, y pointing up (SVG's points down): a ring of quads, counter-clockwise,
# between the four corners and four points of the circle.

corners = [(10, -80), (110, -80), (110, -20), (10, -20)]
around = [(60 + 9.9 * x, -44 + 9.9 * y) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
quads = [[k, (k + 1) % 4, 4 + (k + 1) % 4, 4 + k] for k in range(4)]
result = pt.from_layout([*corners, *around], quads, outline, degree=3, spans=4)
print(result)
assert result.certificate.injective
assert result.boundary_error < 1e-3
assert len(result.multipatch) == 4

figure = pt.plot.multipatch(result.multipatch)

# %%
# ``patchtransfer build LAYOUT.json -o OUT.xml`` does the same from a file with ``vertices``, ``quads``, ``boundary``.
