"""
Which source for this target?
=============================

Several models, and an outline that one of them may suit. A library compares them by a signature and by registration,
transfers the best three, and takes the best proved result (:doc:`the page on libraries </library>`).
"""

import tempfile
from pathlib import Path

import patchtransfer as pt
from patchtransfer import examples

folder = Path(tempfile.mkdtemp())
for name in examples.EXAMPLES:
    pt.write(examples.load(name)[0], folder / f"{name}.xml")
library = pt.Library.open(folder, cache=folder / "cache")
print(library, library.names)

# %%
# A drawing of a rabbit. Only looking takes a fraction of a transfer's time, and says which models come near.

target = examples.load("rabbit")[1]
for candidate in library.rank(target)[:3]:
    print(candidate)

# %%
# The best of three transfers, and why it is that.

found = library.transfer(target)
print(found)
assert found.chosen == "rabbit.xml"
assert found.result.quality.proved.min_scaled_jacobian.lower > 0.1

figure = pt.plot.multipatch(found.multipatch, title=found.chosen)

# %%
# Where no model fits, the last candidate is a layout of the target's own: here all models have holes, and it has none.

square = pt.Boundary.from_points([(0, 0), (2, 0), (2, 1), (0, 1)])
plates = pt.Library({name: library[f"{name}.xml"] for name in ("wrench", "frame")})
own = plates.transfer(square)
print(own)
assert own.chosen == "(parameterize)"
assert len(own.multipatch) == 1
