"""Gluing data of interfaces, and the C¹ condition of a field in terms of them.

Across an interface with cross derivatives D_a, D_b of the geometry, pointing into the two patches, and its tangent C'
there are functions with α D_a + β D_b = γ C'. A continuous field is C¹ in the plane exactly if its pull-backs fulfil
the same relation. The interface is analysis-suitable G1 (AS-G1) if α, β may be linear and γ quadratic (Collin,
Sangalli, Takacs 2016, *Analysis-suitable G1 multi-patch parametrizations for C1 isogeometric spaces*,
doi:10.1016/j.cagd.2016.05.009). Otherwise the relation holds with determinants of higher degree only, and too few
splines fulfil it (C¹ locking).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import factorial

import numpy as np
from scipy.sparse import coo_array, csr_array

from ..continuity.conditions import discontinuities, evaluated
from ..continuity.interfaces import ControlRows, frames
from ..errors import InputError
from ..geometry.basis import collocation_matrix, greville
from ..geometry.multipatch import MultiPatch
from ..geometry.sides import Interface
from ..measure.best_gluing import OF_VECTOR, factors, nearest_to_one
from ..numeric.arrays import FloatArray
from ..numeric.dense import svd
from .nodes import gauss
from .space import SplineSpace

__all__ = ["Gluing", "c1_rows", "gluings"]

#: Residual up to which an interface counts as analysis-suitable.
ANALYSIS_SUITABLE = 1e-9
#: Conditions with a factor below this are void. Gluing data are no more exact than what counts as suitable.
VOID = 10 * ANALYSIS_SUITABLE
#: Parameters of both ends of an interface.
ENDS = np.array([0.0, 1.0])


@dataclass(frozen=True)
class Gluing:
    """Gluing data of an interface over s in [0, 1], in the sense of its first side.

    Attributes
    ----------
    interface : Interface
    residual : float
        Smallest over largest singular value of the system for linear α, β and quadratic γ: 0 up to rounding on AS-G1
        geometries.
    coefficients : (7,) array
        α(0), α(1), β(0), β(1) and the Bernstein coefficients of γ. On other geometries they hold at the two ends, and
        in between as nearly as can be.
    """

    interface: Interface
    residual: float
    coefficients: FloatArray

    @property
    def analysis_suitable(self) -> bool:
        """Whether α D_a + β D_b = γ C' on the whole interface."""
        return self.residual <= ANALYSIS_SUITABLE


def gluings(mp: MultiPatch) -> tuple[Gluing, ...]:
    """Gluing data of all interfaces of a polynomial model.

    Raises
    ------
    InputError
        On rational patches, and where the two sides do not lie on different sides of the interface (a fold).
    """
    bases = [tuple(zip(patch.knots, patch.degrees, strict=True)) for patch in mp.patches]
    found = []
    for f in mp.interfaces:
        if any(mp.patches[k].weights is not None for k in (f.patch_a, f.patch_b)):
            raise InputError(
                f"patch {f.patch_a} or {f.patch_b} is rational: C¹ fields are built on polynomial patches only"
            )
        found.append(_gluing(f, ControlRows.of(f, mp.topology.points, bases), mp.topology.coordinates))
    return tuple(found)


def _gluing(f: Interface, r: ControlRows, points: FloatArray) -> Gluing:
    s, w = gauss(r.breaks, r.degree + 4)
    vectors = r.derivatives(points, *r.basis(s))
    scales = [max(float(np.hypot(*v.T).max()), 1e-300) for v in vectors]
    scaled = np.stack([v / scale for v, scale in zip(vectors, scales, strict=True)], axis=2)
    system = scaled[..., OF_VECTOR] * factors(s)[:, None]
    _, sigma, vt = svd((system * np.sqrt(w)[:, None, None]).reshape(-1, 7))
    residual = float(sigma[-1] / sigma[0])
    if residual <= ANALYSIS_SUITABLE:
        x = nearest_to_one(sigma, vt, ANALYSIS_SUITABLE)
    else:
        x = _between_frames(r.derivatives(points, *r.basis(ENDS)), scales)
        # The middle coefficient of γ by least squares.
        known = (system * x).sum(axis=2)
        x[5] -= (system[..., 5] * known * w[:, None]).sum() / (system[..., 5] ** 2 * w[:, None]).sum()
    if not x[:4].min() > 0:
        raise InputError(
            f"interface {f.name}: the patches do not lie on different sides of it, or their cross derivatives vanish; "
            "C¹ fields need a regular model"
        )
    # Back from scaled vectors, and of unit size.
    x = x / np.repeat(scales, [2, 2, 3])
    return Gluing(f, residual, x / np.abs(x).max())


def _between_frames(at_ends: Sequence[FloatArray], scales: list[float]) -> FloatArray:
    """α, β, γ that hold at both ends, where they are determined by D_a, D_b and C' up to a factor: α + β = 2."""
    alpha, beta, gamma = frames(*(v / scale for v, scale in zip(at_ends, scales, strict=True))).T
    return np.array([*alpha, *beta, gamma[0], 0.0, gamma[1]])


def c1_rows(space: SplineSpace, gluings: Iterable[Gluing]) -> list[csr_array]:
    """Rows of every interface whose null space are the fields that are C¹ across it, (m, space.size), of unit size.

    g = α D_a w + β D_b w − γ w' is a spline of degree p + 1 and smoothness r - 1 where w is one of degree p and
    smoothness r. It vanishes if it does so at the n Greville abscissae, with the jumps of its r-th derivative at the
    inner knots, and with its polynomial pieces where α + β = 0. The jumps are -γ times those of w's derivative of order
    r + 1, the pieces are there α (D_a w - D_b w) - γ w'. Each condition is divided by its factor, or left out where
    that is void: singular values of the undivided ones tell nothing, for they are as small as the factors.
    """
    bases = [[(basis.knots, basis.degree) for basis in pair] for pair in space.bases]
    return [_rows(ControlRows.of(g.interface, space.points, bases), g, space.size) for g in gluings]


def _rows(r: ControlRows, gluing: Gluing, width: int) -> csr_array:
    s = np.clip(greville(r.knots, r.degree), 0.0, 1.0)
    data = gluing.coefficients
    values = evaluated(data, s)
    parts = [r.functional(values, *r.basis(s))]
    # Sizes of the terms: those of D_a w and D_b w, and the factor that makes γ w' one.
    size = float(np.abs(values[:, :2] * [r.left_scale, r.right_scale]).max())
    along = r.degree / float(np.diff(r.breaks).min())
    knots, jumps = discontinuities(r.knots, r.degree)
    there = np.abs(evaluated(data, knots)[:, 2]) * along > VOID * size
    parts.append(np.hstack([np.zeros((len(jumps), 2 * len(s))), jumps])[there])
    slope, bend, across, tangent = _at_root(data, r)
    steepest = float(np.abs(slope).max()) * max(r.left_scale, r.right_scale)
    if max(steepest, float(np.abs(bend).max()) * along) > VOID * size:
        left, right = r.left_scale * slope * across, -r.right_scale * slope * across
        parts.append(np.hstack([left, right, -left - right - bend * tangent]))
    table = np.concatenate(parts)
    table = table / np.linalg.norm(table, axis=1, keepdims=True)
    columns = np.tile(r.columns, len(table))
    rows = np.repeat(np.arange(len(table)), table.shape[1])
    return csr_array(coo_array((table.ravel(), (rows, columns)), shape=(len(table), width)))


def _at_root(x: FloatArray, r: ControlRows) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Factors of D_a w - D_b w and of w', and their pieces on all spans, continued to the root of α + β.

    In terms of v = 1 / (root - middle of the span), by whose powers all is multiplied: v = 0 are the coefficients of
    the highest powers, for constant α + β.
    """
    p, middle = r.degree, (r.breaks[:-1] + r.breaks[1:]) / 2
    total = x[:2] + x[2:4]
    v = (total[0] - total[1]) / (total[0] + (total[1] - total[0]) * middle)
    alpha, _, gamma = evaluated(x, middle).T
    slope = alpha * v + x[1] - x[0]
    bend = gamma * v**2 + evaluated(x, middle, 1)[:, 2] * v + x[4] - 2 * x[5] + x[6]
    tables = [collocation_matrix(r.knots, p, middle, k) for k in range(p + 1)]
    across = sum(tables[k] * (v ** (p - k) / factorial(k))[:, None] for k in range(p + 1))
    tangent = sum(tables[k] * (v ** (p - k) / factorial(k - 1))[:, None] for k in range(1, p + 1))
    return slope[:, None], bend[:, None], np.asarray(across), np.asarray(tangent)
