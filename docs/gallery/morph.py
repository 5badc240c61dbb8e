"""
A morph, certified at every step
================================

Two transfers of one source, or a source and its transfer, have the same patches. `patchtransfer.morph` makes the shapes
in between, rotations blended as rotations, and proves each of them injective.
"""

import matplotlib.pyplot as plt

import patchtransfer as pt
from patchtransfer import examples

source, target, landmarks = examples.load("human")
result = pt.transfer(source, target, landmarks)
frames = pt.morph(source, result.multipatch, n=9)
print(frames)
assert frames.certified
assert min(pt.quality(mp).scaled_jacobian.min for mp in frames) > 0.3

figure, axes = plt.subplots(1, 5, figsize=(12, 3), layout="constrained")
for ax, frame in zip(axes, frames.frames[::2], strict=True):
    pt.plot.multipatch(frame.multipatch, ax=ax, colorbar=False, title=f"t = {frame.t:g}")
    ax.get_legend().remove()

# %%
# ``patchtransfer morph A.xml B.xml -n 30 -o DIR --gif`` writes every frame, an animation, and a series for ParaView.
