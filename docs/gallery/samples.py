"""
The bundled samples
===================

Eight sources, two of them rational, with an outline each to carry them to. All are drawings of our own;
``patchtransfer examples`` lists them.
"""

import patchtransfer as pt
from patchtransfer import examples

results = {}
for name in examples.EXAMPLES:
    source, target, landmarks = examples.load(name)
    results[name] = pt.transfer(source, target, landmarks)
    metrics = results[name].quality.scaled_jacobian
    print(f"{name:15s} {results[name].certificate.status}, scaled Jacobian {metrics.min:.3f} / {metrics.mean:.3f}")
assert all(result.certificate.injective for result in results.values())
assert min(result.quality.scaled_jacobian.mean for result in results.values()) > 0.9

# %%
# One of them: the source, the drawing, and the source's 29 patches on it. White discs are extraordinary vertices, where
# three or five patches meet instead of four.

source, target, _ = examples.load("human")
figure = pt.plot.transfer(source, target, results["human"].multipatch)
