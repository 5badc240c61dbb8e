"""
Dragging the boundary
=====================

`patchtransfer.Deformer` does the work that depends on the model only once. Every call then moves boundary points and
gives the certified parameterization of the new shape, always from the original.
"""

import time

import patchtransfer as pt
from patchtransfer import examples

source, _, _ = examples.load("frame")
deformer = pt.Deformer(source)
x, y = source.boundary().loops[0][1].start
times = []
for k in range(1, 6):
    begin = time.perf_counter()
    result = deformer.deform([[x, y, x, y - 0.01 * k * source.diameter]])
    times.append(time.perf_counter() - begin)
    assert result.certificate.injective
print(f"{1000 * min(times):.0f} to {1000 * max(times):.0f} ms a drag")
assert pt.quality(result.multipatch).scaled_jacobian.mean > 0.9

figure = pt.plot.multipatch(result.multipatch)
