"""
How similar are two shapes?
===========================

The map from a source to the result of a transfer stretches, here more and there less. Its *dilatation* D, the ratio of
the largest to the smallest stretch at a point, says how far from similar they are: log D is a metric, bounds how much
the quality may get worse, and no map with this boundary correspondence goes below a bound of its own
(:doc:`the theorems </similarity>`).
"""

import patchtransfer as pt
from patchtransfer import examples

source, target, landmarks = examples.load("star")
result = pt.transfer(source, target, landmarks, continuity="c0")
found = result.dilatation
print(found)
print(f"log D: mean {found.mean:.3f}, rms {found.rms:.3f}, 95 % below {found.q95:.3f}")

# %%
# Colours are log D. The map makes of circles of the source the ellipses drawn here, scaled to one area: D is the ratio
# of their axes.

figure = pt.plot.dilatation(source, result.multipatch, title=str(found).partition(";")[0])

# %%
# What the source's quality guarantees of everything that is as similar to it, and what the result has.

proved = pt.quality(source, proved=True).proved
guaranteed = found.guaranteed_scaled_jacobian(proved.min_scaled_jacobian.lower)
true = result.quality.proved.min_scaled_jacobian
print(f"smallest scaled Jacobian: source {proved.min_scaled_jacobian.lower:.3f}, guaranteed {guaranteed:.3f}")
print(f"result {true.lower:.3f}")
assert guaranteed <= true.upper
assert found.least.best <= found.log_dilatation.upper
