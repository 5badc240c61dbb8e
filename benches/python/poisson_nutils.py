"""Poisson's equation side by side with nutils, in one process: ``python poisson_nutils.py [EXAMPLE] [REFINEMENTS]``.

Both take the same model, splines, quadrature and boundary fit, so the solutions agree to rounding. nutils couples only
patches whose sides run alike; here its patches are discontinuous and glued by a sparse matrix, whatever their sides.
Its system is solved as nutils does by default, by SciPy's SuperLU. Times are of one run, setup included, errors not;
what counts is the ratio.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
import scipy.sparse as sp
from nutils import function, mesh
from scipy.sparse.linalg import splu

import patchtransfer as pt
from patchtransfer import examples, iga
from patchtransfer.iga.manufactured import Wave

sine = Wave()
sine_load = sine.load

SIDES = {pt.Side.WEST: "left", pt.Side.EAST: "right", pt.Side.SOUTH: "bottom", pt.Side.NORTH: "top"}


def solve_nutils(mp: pt.MultiPatch, space: iga.SplineSpace, refinements: int = 0, quadrature: int = 0):
    """Coefficients of the solution in the unknowns of `space`, and seconds of assembly and solve.

    The model's knots are uniform and simple, all patches alike; the field has the geometry's degree on its spans halved
    `refinements` times, and `space` is just that.
    """
    begin = time.perf_counter()
    patch = mp.patches[0]
    p, spans = patch.degrees[0], patch.shape[0] - patch.degrees[0]
    # Patches without common vertices: every side is a boundary.
    coarse, _ = mesh.multipatch(np.arange(4 * len(mp)).reshape(-1, 2, 2), nelems=spans)
    control = np.concatenate([q.control_points.reshape(-1, 2) for q in mp.patches])
    x = control.T @ coarse.basis("spline", degree=p, patchcontinuous=False)
    topo = coarse
    for _ in range(refinements):
        topo = topo.refined
    basis = topo.basis("spline", degree=p, patchcontinuous=False)
    degree = 2 * (quadrature or p + 1) - 1
    u = np.sin(np.pi * x[0]) * np.sin(np.pi * x[1])
    gradient = function.grad(basis, x)
    dx = function.J(x)
    stiffness, load = topo.sample("gauss", degree).integrate(
        [(gradient[:, None, :] * gradient[None, :, :]).sum(-1) * dx, 2 * np.pi**2 * u * basis * dx], legacy=True
    )
    sides = topo.boundary[",".join(f"patch{k}-{SIDES[side]}" for k, side in mp.boundaries)]
    ds = function.J(x)
    mass, trace = sides.sample("gauss", degree).integrate(
        [basis[:, None] * basis[None, :] * ds, u * basis * ds], legacy=True
    )
    numbers = np.concatenate([n.ravel() for n in space.points])
    glue = sp.csr_array((np.ones(len(numbers)), (np.arange(len(numbers)), numbers)))

    def glued(matrix):
        values, columns, offsets = matrix.export("csr")
        return glue.T @ sp.csr_array((values, columns, offsets), shape=(len(numbers),) * 2) @ glue

    boundary, interior = space.boundary, space.interior
    out = np.zeros(space.size)
    on_boundary = sp.csc_array(glued(mass)[boundary][:, boundary])
    out[boundary] = splu(on_boundary).solve((glue.T @ trace)[boundary])
    whole = glued(stiffness)
    rhs = (glue.T @ load - whole @ out)[interior]
    assembled = time.perf_counter()
    out[interior] = splu(sp.csc_array(whole[interior][:, interior])).solve(rhs)
    return out, (assembled - begin, time.perf_counter() - assembled)


def refined(mp: pt.MultiPatch, refinements: int) -> int:
    """Spans of the refined field."""
    patch = mp.patches[0]
    return (patch.shape[0] - patch.degrees[0]) * 2**refinements


def solve_here(mp: pt.MultiPatch, refinements: int):
    """The same with this package: coefficients, seconds of setup and assembly, and of the solve."""
    p = mp.patches[0].degrees[0]
    solver = iga.PoissonSolver(mp, degree=p, points=refined(mp, refinements) + p, knots="uniform")
    result = solver.solve(mp, sine_load, sine)
    return result, (solver.setup_seconds + result.timings["assembly"], result.timings["solve"])


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("example", nargs="?", default="frame", choices=list(examples.EXAMPLES))
    parser.add_argument("refinements", nargs="?", type=int, default=5)
    options = parser.parse_args()
    name, refinements = options.example, options.refinements
    source, _, _ = examples.load(name)
    result, (assembly, solve) = solve_here(source, refinements)
    print(f"{name}, {result.dofs} unknowns, degree {result.field.space.degree}")
    print(f"patchtransfer  setup and assembly {assembly:7.2f} s   solve {solve:7.2f} s")
    peer, (peer_assembly, peer_solve) = solve_nutils(source, result.field.space, refinements)
    print(f"nutils         setup and assembly {peer_assembly:7.2f} s   solve {peer_solve:7.2f} s")
    print(f"nutils / patchtransfer: {(peer_assembly + peer_solve) / (assembly + solve):.1f} in all, ", end="")
    print(f"{peer_assembly / assembly:.1f} for the assembly, {peer_solve / solve:.1f} for the solve")
    print(f"largest difference of the solutions' coefficients {np.abs(peer - result.field.coefficients).max():.1e}")


if __name__ == "__main__":
    main()
