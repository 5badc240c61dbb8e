"""Quadrature nodes on the patches, and the geometry there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from ..errors import InputError
from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch
from ..geometry.sides import Side
from ..numeric.arrays import FloatArray
from ..numeric.dense import product
from .space import SplineSpace, Univariate

__all__ = [
    "GeometryAt",
    "PatchNodes",
    "ScalarFunction",
    "SideNodes",
    "all_nodes",
    "boundary_nodes",
    "gauss",
    "geometry_at",
    "sampled",
    "sampled_vector",
    "sides_at",
    "tables",
]

#: Arrays x, y of one shape to values of that shape (or a constant).
ScalarFunction = Callable[[FloatArray, FloatArray], Any]

#: Values, first and second derivatives.
ORDERS = 3
#: Jacobians and speeds below this part of the patch's size are rounding: no integral can be taken there.
SINGULAR = 1e-14


@lru_cache(maxsize=512)
def _tables(knots: bytes, degree: int, t: bytes) -> FloatArray:
    """Basis functions and their first two derivatives at `t`, (3, len(t), n), shared between patches."""
    basis, at = Univariate(np.frombuffer(knots), degree), np.frombuffer(t)
    out = np.stack([basis.table(at, order) for order in range(ORDERS)])
    out.flags.writeable = False
    return out


def tables(basis: Univariate, t: FloatArray) -> FloatArray:
    """Values, first and second derivatives of all functions of a basis at `t`, shape (3, len(t), n)."""
    return _tables(basis.knots.tobytes(), basis.degree, t.tobytes())


@lru_cache(maxsize=64)
def _legendre(count: int) -> tuple[FloatArray, FloatArray]:
    x, w = np.polynomial.legendre.leggauss(count)
    return x, w


def gauss(breaks: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """Gauss–Legendre nodes and weights, `count` on every span."""
    x, w = _legendre(count)
    half, middle = np.diff(breaks) / 2, (breaks[1:] + breaks[:-1]) / 2
    return (middle[:, None] + half[:, None] * x).ravel(), (half[:, None] * w).ravel()


def common_breaks(*knots: FloatArray) -> FloatArray:
    """Breaks of all knot vectors; those that differ by rounding only are one."""
    breaks = np.unique(np.concatenate(knots))
    keep = np.diff(breaks, prepend=-np.inf) > 1e-12 * (breaks[-1] - breaks[0])
    return np.asarray(breaks[keep])


@dataclass(frozen=True)
class PatchNodes:
    """Tensor-product nodes on one patch, with the basis functions of field and geometry there.

    Attributes
    ----------
    t : pair of arrays
        Parameters (m_u,), (m_v,).
    weights : pair of arrays
    field, geometry : pair of (3, m, n) arrays
        Derivatives of order 0, 1, 2 of the field's and the geometry's basis functions.
    """

    t: tuple[FloatArray, FloatArray]
    weights: tuple[FloatArray, FloatArray]
    field: tuple[FloatArray, FloatArray]
    geometry: tuple[FloatArray, FloatArray]

    @classmethod
    def gauss(cls, space: SplineSpace, patch: Patch, k: int, count: int | None = None) -> PatchNodes:
        """Gauss nodes on every common span of field and geometry: per default the larger degree plus one."""
        if count is not None and count < 1:
            raise InputError(f"quadrature = {count}: at least one node per span is needed")
        own = [Univariate(*pair) for pair in zip(patch.knots, patch.degrees, strict=True)]
        t, w = [], []
        for a, b in zip(space.bases[k], own, strict=True):
            n = max(a.degree, b.degree) + 1 if count is None else count
            nodes, weights = gauss(common_breaks(a.knots, b.knots), n)
            t.append(nodes)
            w.append(weights)
        return cls._at(space, own, k, (t[0], t[1]), (w[0], w[1]))

    @classmethod
    def uniform(cls, space: SplineSpace, patch: Patch, k: int, per_span: int) -> PatchNodes:
        """`per_span` intervals on every span of the field, its ends included; the weights are zero."""
        own = [Univariate(*pair) for pair in zip(patch.knots, patch.degrees, strict=True)]
        t = [
            np.unique(np.linspace(basis.breaks[:-1], basis.breaks[1:], per_span + 1).T.ravel())
            for basis in space.bases[k]
        ]
        return cls._at(space, own, k, (t[0], t[1]), (np.zeros_like(t[0]), np.zeros_like(t[1])))

    @classmethod
    def _at(
        cls, space: SplineSpace, own: list[Univariate], k: int, t: tuple[FloatArray, FloatArray], w: Any
    ) -> PatchNodes:
        u, v = space.bases[k]
        return cls(t, w, (tables(u, t[0]), tables(v, t[1])), (tables(own[0], t[0]), tables(own[1], t[1])))

    def value(self, coefficients: FloatArray, du: int = 0, dv: int = 0) -> FloatArray:
        """Parametric derivative of a field with coefficients (n_u, n_v) at the nodes."""
        return product(product(self.field[0][du], coefficients), self.field[1][dv].T)

    def tested(self, values: FloatArray, du: int = 0, dv: int = 0) -> FloatArray:
        """Sum of values (m_u, m_v) times every basis function's derivative, shape (n_u, n_v)."""
        return product(product(self.field[0][du].T, values), self.field[1][dv])

    def evaluate(self, patch: Patch, du: int = 0, dv: int = 0) -> FloatArray:
        """Homogeneous coordinates (2 or 3, m_u, m_v) of the geometry's derivative."""
        c = patch.control_points
        if patch.weights is not None:
            w = patch.weights[..., None]
            c = np.concatenate([c * w, w], axis=2)
        return product(product(self.geometry[0][du], np.moveaxis(c, 2, 0)), self.geometry[1][dv].T)


class GeometryAt:
    """The map of one patch at nodes.

    Attributes
    ----------
    x : (2, m_u, m_v) array
        Points of the plane.
    inverse : (2, 2, m_u, m_v) array
        Inverse Jacobian [[u_x, u_y], [v_x, v_y]]; unchecked until `dx` is asked for.
    """

    def __init__(self, nodes: PatchNodes, patch: Patch, index: int, orientation: int) -> None:
        self.nodes, self.patch, self.index, self.orientation = nodes, patch, index, orientation
        h = nodes.evaluate(patch)
        self.x = h if patch.weights is None else h[:2] / h[2]
        self._weight = None if patch.weights is None else h[2]

    @cached_property
    def jacobian(self) -> FloatArray:
        """Jacobian [[x_u, x_v], [y_u, y_v]], (2, 2, m_u, m_v)."""
        slopes = [self.nodes.evaluate(self.patch, 1, 0), self.nodes.evaluate(self.patch, 0, 1)]
        if self._weight is not None:
            slopes = [(d[:2] - d[2] * self.x) / self._weight for d in slopes]
        return np.stack(slopes, axis=1)

    @cached_property
    def determinant(self) -> FloatArray:
        """Determinant of J, positive on patches of either orientation; `InputError` where they are folded."""
        (a, b), (c, d) = self.jacobian
        det = self.orientation * (a * d - b * c)
        smallest = det.min()
        if not smallest > SINGULAR * det.max():
            i, j = np.unravel_index(int(det.argmin()), det.shape)
            u, v = self.nodes.t[0][i], self.nodes.t[1][j]
            raise InputError(
                f"patch {self.index} is folded or singular at (u, v) = ({u:.6g}, {v:.6g}): det J = {smallest:.3g}; "
                "solve on an injective model only (`patchtransfer check` says where it fails)"
            )
        return np.asarray(det)

    @cached_property
    def inverse(self) -> FloatArray:
        """Inverse Jacobian."""
        (a, b), (c, d) = self.jacobian
        return np.array([[d, -b], [-c, a]]) / (self.orientation * self.determinant)

    @cached_property
    def dx(self) -> FloatArray:
        """Quadrature weights times |det J|, (m_u, m_v)."""
        return self.determinant * np.multiply.outer(*self.nodes.weights)

    @cached_property
    def curvature(self) -> FloatArray:
        """Second derivatives x_uu, x_uv, x_vv of a polynomial patch, (3, 2, m_u, m_v)."""
        if self.patch.weights is not None:
            raise InputError(
                f"patch {self.index} is rational: fourth-order equations are solved on polynomial patches only"
            )
        return np.stack([self.nodes.evaluate(self.patch, *order) for order in ((2, 0), (1, 1), (0, 2))])

    def gradient(self, coefficients: FloatArray) -> FloatArray:
        """Physical gradient (2, m_u, m_v) of a field with coefficients (n_u, n_v)."""
        slopes = np.stack([self.nodes.value(coefficients, 1, 0), self.nodes.value(coefficients, 0, 1)])
        return np.asarray(np.einsum("kcuv,kuv->cuv", self.inverse, slopes))

    def hessian(self, coefficients: FloatArray) -> FloatArray:
        """Physical second derivatives [[xx, xy], [yx, yy]], (2, 2, m_u, m_v)."""
        gradient = self.gradient(coefficients)
        value = self.nodes.value
        second = np.stack([value(coefficients, *order) for order in ((2, 0), (1, 1), (0, 2))])
        # The chain rule's part that comes from the curvature of the map.
        second = second - np.einsum("oc...,c...->o...", self.curvature, gradient)
        parametric = second[np.array([[0, 1], [1, 2]])]
        return np.asarray(np.einsum("ka...,kl...,lb...->ab...", self.inverse, parametric, self.inverse))


@dataclass(frozen=True)
class SideNodes:
    """Gauss nodes on a boundary side, with points, line element and outer unit normal.

    Attributes
    ----------
    patch : int
    side : Side
    nodes : PatchNodes
        The nodes as a grid with one row, so that a patch's tables and maps can be used.
    ds : (m,) array
        Weights times the speed of the side.
    """

    patch: int
    side: Side
    nodes: PatchNodes
    geometry: GeometryAt
    ds: FloatArray

    @classmethod
    def at(cls, nodes: PatchNodes, mp: MultiPatch, k: int, side: Side) -> SideNodes:
        """The nodes of :func:`boundary_nodes` on the side of a model."""
        patch, along = mp.patches[k], side.axis
        geometry = GeometryAt(nodes, patch, k, int(mp.topology.orientation[k]))
        speed = np.hypot(*geometry.jacobian[:, along]).ravel()
        if not speed.min() > SINGULAR * mp.diameter / np.ptp(patch.knots[along]):
            raise InputError(f"{side.name.lower()} side of patch {k} is degenerate: it has no length at some point")
        return cls(k, side, nodes, geometry, speed * nodes.weights[along])

    @property
    def name(self) -> str:
        """Name for messages."""
        return f"{self.side.name.lower()} side of patch {self.patch}"

    @property
    def x(self) -> FloatArray:
        """Points (2, m)."""
        return self.geometry.x.reshape(2, -1)

    @property
    def tangent(self) -> FloatArray:
        """Unit tangent (2, m) in the sense of the side's parameter."""
        along = self.geometry.jacobian[:, self.side.axis].reshape(2, -1)
        return np.asarray(along / np.hypot(*along))

    @property
    def normal(self) -> FloatArray:
        """Outer unit normal (2, m)."""
        # The gradient of the parameter across points along the normal, inwards at its start.
        outwards = self.geometry.inverse[1 - self.side.axis].reshape(2, -1) * (1 if self.side.at_end else -1)
        return np.asarray(outwards / np.hypot(*outwards))


def sampled(f: ScalarFunction, x: FloatArray, what: str, place: str) -> FloatArray:
    """Values of a callable at points x (2, ...); `InputError` that names what and where if it fails there."""
    try:
        raw = np.asarray(f(x[0], x[1]))
        if np.iscomplexobj(raw):
            raise TypeError("complex numbers")
        values = raw.astype(np.float64)
    except InputError:
        raise
    except Exception as error:
        raise InputError(f"{what} on {place}: the callable raised {type(error).__name__}: {error}") from error
    if values.shape not in ((), x.shape[1:]):
        raise InputError(
            f"{what} on {place}: the callable returned shape {values.shape} for points of shape {x.shape[1:]}; "
            "it must return that shape or a constant"
        )
    if not np.isfinite(values).all():
        at = int(np.argmin(np.isfinite(values)))
        first = x.reshape(2, -1)[:, at]
        raise InputError(f"{what} on {place}: NaN or infinity, first at (x, y) = ({first[0]:.6g}, {first[1]:.6g})")
    return np.broadcast_to(values, x.shape[1:])


def sampled_vector(f: Callable[..., Any], x: FloatArray, count: int, what: str, place: str) -> FloatArray:
    """Values (count, ...) of a callable that returns `count` components."""
    try:
        raw = f(x[0], x[1])
        parts = [raw[i] for i in range(count)] if len(raw) == count else None
    except InputError:
        raise
    except Exception as error:
        raise InputError(f"{what} on {place}: the callable raised {type(error).__name__}: {error}") from error
    if parts is None:
        raise InputError(f"{what} on {place}: the callable must return {count} components, got {len(raw)}")
    return np.stack([sampled(lambda *_, part=part: part, x, what, place) for part in parts])


def all_nodes(space: SplineSpace, mp: MultiPatch, count: int | None = None) -> list[PatchNodes]:
    """Gauss nodes of every patch."""
    return [PatchNodes.gauss(space, patch, k, count) for k, patch in enumerate(mp.patches)]


def boundary_nodes(space: SplineSpace, mp: MultiPatch, count: int | None = None) -> list[PatchNodes]:
    """Gauss nodes on every boundary side, as grids of one row: per span the larger degree plus one per default."""
    out = []
    for k, side in space.boundaries:
        patch, along = mp.patches[k], side.axis
        full = PatchNodes.gauss(space, patch, k, count)
        own = [Univariate(*pair) for pair in zip(patch.knots, patch.degrees, strict=True)]
        end = patch.knots[1 - along][-1 if side.at_end else 0]
        t, w = [np.array([end])] * 2, [np.ones(1)] * 2
        t[along], w[along] = full.t[along], full.weights[along]
        out.append(PatchNodes._at(space, own, k, (t[0], t[1]), (w[0], w[1])))
    return out


def sides_at(space: SplineSpace, mp: MultiPatch, nodes: list[PatchNodes]) -> list[SideNodes]:
    """The boundary sides of a model at nodes of :func:`boundary_nodes`."""
    return [SideNodes.at(n, mp, k, side) for n, (k, side) in zip(nodes, space.boundaries, strict=True)]


def geometry_at(mp: MultiPatch, nodes: list[PatchNodes]) -> list[GeometryAt]:
    """The maps of all patches at their nodes."""
    orientation = mp.topology.orientation
    return [
        GeometryAt(n, patch, k, int(orientation[k])) for k, (n, patch) in enumerate(zip(nodes, mp.patches, strict=True))
    ]
