"""
C0, C1 and exact G1 side by side
================================

``continuity`` says how patches join: "c0" shares control points, "c1" (the default) asks for equal derivatives across
interfaces up to a constant factor, "g1" for exact, analysis-suitable G1, on which C1 functions approximate well.
Rows at the boundary and at extraordinary vertices are left out where they would fold the map.
"""

import patchtransfer as pt
from patchtransfer import examples

source, target, landmarks = examples.load("wrench")
# Exact G1 needs inner knots that are C1 only.
source = source.reduce_continuity(1)
results = {kind: pt.transfer(source, target, landmarks, continuity=kind) for kind in ("c0", "c1", "g1")}
for kind, result in results.items():
    report, metrics = result.continuity, result.quality.scaled_jacobian
    print(
        f"{kind}: {result.certificate.status}, scaled Jacobian {metrics.min:.3f} / {metrics.mean:.3f}, mean kink "
        f"{report.kink_deg.mean:.1f}°, analysis-suitable G1 up to {report.as_g1_residual:.0e}"
    )

# %%
# Iso-lines of "c1" bend less where they cross interfaces; "g1" gives this up for its exactness.

kinks = {kind: result.continuity.kink_deg.mean for kind, result in results.items()}
assert kinks["c1"] < 0.8 * kinks["c0"] < kinks["g1"]
assert results["g1"].continuity.as_g1_residual < 1e-11 < results["c1"].continuity.as_g1_residual
assert all(result.certificate.injective for result in results.values())

figure = pt.plot.kinks({kind: result.multipatch for kind, result in results.items()})

# %%
# The paper's Fig. 10: how control polygons bend across the interfaces that bend most.

slopes = pt.plot.slope_difference(results["c0"].multipatch, results["c1"].multipatch)
