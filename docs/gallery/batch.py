"""
Many targets
============

``TransferPlan`` does the work that depends on the source only once; each target then takes a fraction of a second.
"""

import matplotlib.pyplot as plt

import patchtransfer as pt
from patchtransfer import examples

source, _, _ = examples.load("wrench")
plan = pt.TransferPlan(source)
targets = [examples.load("wrench", step)[1:] for step in range(1, examples.STEPS["wrench"] + 1)]
results = list(plan.map(targets))
smallest = [result.quality.scaled_jacobian.min for result in results]
print([f"{value:.3f}" for value in smallest])
assert all(result.certificate.injective for result in results)
assert min(smallest) > 0.3

figure, axes = plt.subplots(1, 4, figsize=(9, 5), layout="constrained")
for k, (ax, result) in enumerate(zip(axes, results, strict=True), 1):
    pt.plot.multipatch(result.multipatch, ax=ax, colorbar=False, title=f"step {k}")
    ax.get_legend().remove()

# %%
# For files there is ``patchtransfer batch SOURCE TARGETS... -o DIR --workers 4``: in processes, a failure of one target
# does not stop the others, and a second call does only what is missing. With ``--scheduler ADDRESS`` the workers of a
# Dask cluster do it: see "Many targets, many machines" in the guide.
