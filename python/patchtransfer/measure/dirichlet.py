"""What Dirichlet energies demand of every map between two shapes: a lower bound of the largest dilatation.

A map of dilatation at most K changes the energy of a function at most by the factor K, so that K is at least the ratio
of the least energies with any boundary values. The least energy is bounded from above by that in the space of splines
(Dirichlet's principle), and from below by conjugate functions v in it (Thomson's principle), whose gradients turned by
a right angle are free of divergence: ``E(φ) >= 2 ∫ φ dv - ∫ |∇v|²``. The largest ratio of the two over all boundary
values is an eigenvalue. Around a hole v may grow by a constant, the flux through it.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np
from scipy.sparse import csc_array, csr_array, hstack

from .._core import Galerkin, gauss
from ..geometry.basis import collocation_matrix, knot_spans
from ..geometry.multipatch import MultiPatch
from ..geometry.sides import Side
from ..geometry.topology import BoundarySide
from ..numeric.arrays import FloatArray, IntArray
from ..numeric.definite import DefiniteFactor
from ..numeric.dense import eigen, product

__all__ = ["energy_dilatation"]

#: Eigenvalues of an energy below this part of the largest are those of constants.
CONSTANT = 1e-11


def energy_dilatation(a: MultiPatch, b: MultiPatch) -> float | None:
    """Lower bound of max log D of all quasiconformal maps, up to the quadrature of energies; None where one folds.

    Parameters
    ----------
    a, b : MultiPatch
        Of one layout in one spline space, with det J > 0 inside.
    """
    space = _Space(a)
    stiffness = [space.stiffness(model) for model in (a, b)]
    if any(matrix is None for matrix in stiffness):
        return None
    roots = [space.inverse_roots(matrix) for matrix in stiffness]
    best = 1.0
    for (above, _), (_, below) in (roots, roots[::-1]):
        # With boundary values R x the ratio of energies is that of |(middle)ᵀ x|² and |x|².
        middle = product(product(above.T, space.pairing), below)
        best = max(best, float(eigen(product(middle.T, middle))[0][-1]))
    return math.log(best)


class _Space:
    """Splines of a layout: shared control points, the boundary's first, then a function for every hole.

    The last ones jump across a cut from the hole to another loop by 1. `pairing` (n_b, n_b + holes) is ∫ φ_i dv_j along
    the loops.
    """

    def __init__(self, mp: MultiPatch) -> None:
        topology = mp.topology
        self.boundary, self.inside = topology.boundary_points, topology.interior_points
        numbers = [p.ravel() for p in topology.points]
        starts = np.cumsum([0, *map(len, numbers)])
        self.local = [
            np.arange(s, e).reshape(p.shape) for s, e, p in zip(starts, starts[1:], topology.points, strict=False)
        ]
        shared = np.concatenate(numbers)
        glue = csr_array(
            (np.ones(len(shared)), (np.arange(len(shared)), shared)), shape=(len(shared), topology.n_points)
        )
        jumps = [_offsets(mp, self.local, hole, len(shared)) for hole in mp.loops[1:]]
        self.glue = csc_array(glue)
        self.extended = csc_array(hstack([glue, *(csc_array(j[:, None]) for j in jumps)]))
        self.pairing = self._pairing(mp)

    def _pairing(self, mp: MultiPatch) -> FloatArray:
        """∫ φ_i dv_j along the loops, of functions on the boundary and the extended ones."""
        first, second = self.glue[:, self.boundary], self._kept()
        total = np.zeros((first.shape[1], second.shape[1]))
        for loop in mp.loops:
            for side in loop:
                patch, axis = mp.patches[side.patch], side.side.axis
                knots, degree = patch.knots[axis], patch.degrees[axis]
                t, w = _nodes(knots, degree + 1)
                values, slopes = (collocation_matrix(knots, degree, t, order) for order in (0, 1))
                along = product((values * w[:, None]).T, slopes) * (-1.0 if side.reversed else 1.0)
                rows = side.side.of(self.local[side.patch])
                total += (first[rows].T @ csr_array(along) @ second[rows]).toarray()
        return total

    def _kept(self) -> csc_array:
        """The boundary's columns of the extended functions, then those of holes."""
        n = self.glue.shape[1]
        return self.extended[:, np.concatenate([self.boundary, np.arange(n, self.extended.shape[1])])]

    def inverse_roots(self, broken: csc_array) -> tuple[FloatArray, FloatArray]:
        """Factors R with R Rᵀ = S⁺, of the least energy of boundary values and that of extended ones."""
        whole = csc_array(self.extended.T @ broken @ self.extended)
        n = self.glue.shape[1]
        kept = np.concatenate([self.boundary, np.arange(n, whole.shape[0])])
        least = whole[kept][:, kept].toarray()
        if len(self.inside):
            across = whole[self.inside][:, kept].toarray()
            solved = DefiniteFactor(whole[self.inside][:, self.inside]).solve(across)
            least = least - product(across.T, solved)
        least = (least + least.T) / 2
        m = len(self.boundary)
        return _inverse_root(least[:m, :m]), _inverse_root(least)

    def stiffness(self, mp: MultiPatch) -> csc_array | None:
        """∫ ∇φ·∇ψ of all patches' basis functions, those of different patches apart; None where det J <= 0."""
        spaces, forms = [], []
        for patch, numbers, sign in zip(mp.patches, self.local, mp.topology.orientation.tolist(), strict=True):
            (u, wu), (v, wv) = (_nodes(k, p + 2) for k, p in zip(patch.knots, patch.degrees, strict=True))
            spaces.append((*patch.knots, *patch.degrees, u, v, np.ascontiguousarray(numbers)))
            # Energies do not depend on the size, which squares of derivatives might lose.
            x, y = (patch.derivative(u[:, None], v, k, 1 - k) / mp.diameter for k in (1, 0))
            det = sign * (x[..., 0] * y[..., 1] - x[..., 1] * y[..., 0])
            if not (det > 0).all():
                return None
            weights = wu[:, None] * wv / det
            e, f, g = ((p * q).sum(axis=-1) for p, q in ((x, x), (x, y), (y, y)))
            forms.append(np.ascontiguousarray(np.stack([weights * g, -weights * f, weights * e])))
        size = self.glue.shape[0]
        core = Galerkin(spaces, size)
        indptr, indices = core.pattern()
        upper = csc_array((core.assemble([(1, 0), (0, 1)], forms), indices, indptr), shape=(size, size))
        full = upper + upper.T
        full.setdiag(upper.diagonal())
        return csc_array(full)


def _nodes(knots: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Gauss nodes and weights, `count` on every span."""
    (x, w), breaks = gauss(count), knot_spans(knots)
    half, middle = np.diff(breaks) / 2, (breaks[1:] + breaks[:-1]) / 2
    return (middle[:, None] + half[:, None] * x).ravel(), (half[:, None] * w).ravel()


def _inverse_root(s: FloatArray) -> FloatArray:
    values, vectors = eigen(s)
    keep = values > CONSTANT * values[-1]
    return np.asarray(vectors[:, keep] / np.sqrt(values[keep]))


def _offsets(mp: MultiPatch, local: list[IntArray], hole: Sequence[BoundarySide], size: int) -> FloatArray:
    """What patches' own control points have more than the shared ones, of a function that jumps by 1 across a cut."""
    jump = _cut(mp, hole)
    offset, seen = np.zeros(size), np.zeros(size, bool)
    beside: dict[int, list[tuple[int, int]]] = {}
    for i, f in enumerate(mp.interfaces):
        a, b = f.side_a.of(local[f.patch_a]), f.side_b.of(local[f.patch_b])
        for one, other in zip(a.tolist(), (b[::-1] if f.reversed else b).tolist(), strict=True):
            beside.setdefault(one, []).append((other, jump.get(i, 0)))
            beside.setdefault(other, []).append((one, -jump.get(i, 0)))
    for start in beside:
        if seen[start]:
            continue
        seen[start] = True
        waiting = deque([start])
        while waiting:
            here = waiting.popleft()
            for other, step in beside[here]:
                if not seen[other]:
                    seen[other], offset[other] = True, offset[here] + step
                    waiting.append(other)
    return offset


def _cut(mp: MultiPatch, hole: Sequence[BoundarySide]) -> dict[int, int]:
    """Interfaces of a shortest way from a hole to another loop, and by what functions jump from patch a to patch b."""
    topology = mp.topology
    ends: dict[int, list[tuple[int, int, int]]] = {}
    for i, f in enumerate(mp.interfaces):
        directed = topology.directed_side(f.patch_a, Side(f.side_a))
        along = directed.points(topology.points[f.patch_a])
        first, last = int(along[0]), int(along[-1])
        # From first to last patch a is on the left.
        ends.setdefault(first, []).append((last, i, 1))
        ends.setdefault(last, []).append((first, i, -1))
    starts = {int(side.points(topology.points[side.patch])[0]) for side in hole}
    goals = {int(side.points(topology.points[side.patch])[0]) for loop in mp.loops for side in loop} - starts
    came: dict[int, tuple[int, int, int] | None] = dict.fromkeys(sorted(starts))
    waiting = deque(sorted(starts))
    while waiting:
        here = waiting.popleft()
        if here in goals:
            jumps = {}
            while (step := came[here]) is not None:
                here, i, sense = step
                jumps[i] = sense
            return jumps
        for there, i, sense in ends.get(here, []):
            if there not in came:
                came[there] = (here, i, sense)
                waiting.append(there)
    # Loops that no way of interfaces joins: no patch has a corner on one and none on the other.
    return {}
