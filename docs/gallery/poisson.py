"""
Poisson's equation on a transferred model
=========================================

The paper's test (Fig. 11): −Δφ = 2π² sin(πx) sin(πy), whose solution φ = sin(πx) sin(πy) is known. The field has a
degree and a number of control points of its own, whatever those of the geometry are.
"""

import patchtransfer as pt
from patchtransfer import examples, iga
from patchtransfer.plot import solution

source, target, landmarks = examples.load("rabbit")
model = pt.transfer(source, target, landmarks).multipatch
errors = []
for points in (5, 7, 13):
    result = iga.poisson(model, degree=4, points=points)
    errors.append(result.errors.max / result.errors.exact_max)
    print(f"{points:2d} × {points:2d} points a patch, {result.dofs:4d} unknowns: largest error {errors[-1]:.1e}")
assert errors[0] > errors[1] > errors[2]
assert errors[2] < 1e-5

figure = solution(result)
