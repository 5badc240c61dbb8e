"""
No source: from your drawing alone
==================================

`patchtransfer.parameterize` finds the layout of quads itself. Here an SVG drawing of a key becomes a certified model,
and the model the source for another key.
"""

import tempfile
from pathlib import Path

import patchtransfer as pt

KEY = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 112 60">
  <path d="M 37.3 25 H 105 L 110 30 L 105 35 H 98 V {first} H 91 V 35 H 84 V {second} H 77 V 35 H 37.3
           A 18 18 0 1 1 37.3 25 Z"/>
  <circle cx="{hole}" cy="30" r="7"/>
</svg>"""


def outline(**sizes: float) -> pt.Boundary:
    """Read the drawing with other sizes, as from a file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "key.svg"
        path.write_text(KEY.format(**sizes))
        return pt.read_boundary(path)


key = outline(first=43, second=41, hole=14)
source = pt.parameterize(key)
print(source)
assert source.certificate.injective
assert source.boundary_error < 1e-3

figure = pt.plot.multipatch(source.multipatch)

# %%
# What else was tried, the best first. ``prefer="quality"`` and ``max_patches`` ask for other ones.

for candidate in source.candidates[:5]:
    print(f"{len(candidate.layout.quads):3} patches, score {candidate.score:.3f}: {candidate.origin}")

# %%
# ``source.layout`` is the layout kept. Changed or not, `patchtransfer.from_layout` takes it: here with other splines.

layout = source.layout
finer = pt.from_layout(layout.vertices, layout.quads, key, degree=2, spans=6, assignment=layout.assignment)
print(finer)
assert finer.certificate.injective
assert finer.boundary_error < source.boundary_error

# %%
# Another key, from the same patches.

other = outline(first=40, second=45, hole=17)
result = pt.transfer(source.multipatch, other)
print(result)
assert result.certificate.injective
assert result.quality.scaled_jacobian.mean > 0.98

figure = pt.plot.transfer(source.multipatch, other, result.multipatch)

# %%
# ``patchtransfer parameterize KEY.svg -o OUT.xml`` does the same from a drawing in a file.
