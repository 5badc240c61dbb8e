"""Gluing data of exact G1 rows: analysis-suitable gluing along whole interfaces (``continuity="g1"``).

After Collin, Sangalli, Takacs 2016 (*Analysis-suitable G1 multi-patch parametrizations for C1 isogeometric spaces*,
doi:10.1016/j.cagd.2016.05.009): a D_L + b D_R = c C' with a, b linear and c quadratic. The end values follow the frames
of a reference map; the middle of c is free where a : b varies, else c is linear. At regular vertices it has to close
the four twist rows, or these would force the tangents to be parallel. The derivation is in ``docs/continuity.md``.

Which rows the data give depends on what vanishes by *structure* (a : b constant, c linear or zero), never on how small
a number is: a boundary that changes a little gives as many rows (`patchtransfer.g1_conditions`).
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..geometry.multipatch import MultiPatch
from ..geometry.topology import Spoke, Topology
from ..numeric.arrays import FloatArray, IntArray
from ..numeric.compressed import Compressed
from ..numeric.dense import least_squares, product, svd
from .conditions import conditions, evaluated
from .interfaces import ControlRows
from .rows import ContinuityRows

__all__ = ["GluingData", "check_g1_space", "g1_rows", "gluing_data", "rows_of", "twist_closure"]

#: |c| (for a + b = 2) below which the reference is smooth at a regular vertex or on the boundary: C1 rows and the fit
#: leave rounding only (values on all models are below 1e-12 or above 1e-5).
SMOOTH_FRAME = 1e-10
#: |a_0 b_1 - a_1 b_0| (for a + b = 2) below which c is taken linear, for C1 fields would lock. It chooses data, and
#: not how many rows there are.
NEARLY_CONSTANT = 1e-5
#: Twist rows are closed when what is left of them is below this part of their largest entry, rounding on any model; of
#: their equations singular values below RANK of the largest are zero, as those of vertices that say the same.
CLOSED, RANK = 1e-9, 1e-12
#: Conditions are independent unless points of an interface coincide; singular values are above 0.04 of the largest.
DEPENDENT = 1e-10


@dataclass(frozen=True, eq=False)
class GluingData:
    """Gluing data of all interfaces, and what vanishes in them on any boundary.

    Attributes
    ----------
    coefficients : (n, 7) array
        Bernstein coefficients a_0, a_1, b_0, b_1, c_0, c_1, c_2 with a + b = 2.
    constant : (n,) bool array
        Whether a : b is constant: on interfaces between smooth vertices, where both ends have their chord's ratio.
    degree : (n,) int array
        Of c: -1 (zero), 1 or 2.
    """

    coefficients: FloatArray
    constant: NDArray[np.bool_]
    degree: IntArray

    def conditions(self, index: int, r: ControlRows) -> FloatArray:
        """Rows on `r.columns` of the interface `index`; see `patchtransfer.g1_conditions.conditions`."""
        return conditions(r, self.coefficients[index], bool(self.constant[index]), int(self.degree[index]))

    def with_coefficients(self, index: int, coefficients: FloatArray) -> GluingData:
        """The same with other coefficients (7,) of one interface."""
        changed = self.coefficients.copy()
        changed[index] = coefficients
        return replace(self, coefficients=changed)


def check_g1_space(mp: MultiPatch) -> None:
    """Raise `InputError` where a model's splines have too little freedom for exact G1, naming interface and remedy.

    Along every interface the degree p must be at least 3, inner knots at most C^(p - 2), and for p = 3 there must be
    two knot spans or more: otherwise the rows lock the map.
    """
    for f in mp.interfaces:
        name = f"interface {f.name}"
        patch, axis = mp.patches[f.patch_a], f.side_a.axis
        p = patch.degrees[axis]
        multiplicity = np.unique(patch.knots[axis][p + 1 : -p - 1], return_counts=True)[1]
        if p < 3:
            raise InputError(
                f'continuity "g1" needs degree 3 or more, {name} has {p}; raise it: MultiPatch.elevate({3 - p}), '
                f"patchtransfer refine --elevate {3 - p}"
            )
        if len(multiplicity) and multiplicity.min() < 2:
            raise InputError(
                f'continuity "g1" needs inner knots of C^{p - 2} or less, {name} has C^{p - 1}; lower it: '
                f"MultiPatch.reduce_continuity({p - 2}), patchtransfer refine --smoothness {p - 2}"
            )
        if p == 3 and not len(multiplicity):
            raise InputError(
                f'continuity "g1" needs two knot spans or more at degree 3, {name} has one; split them: '
                "MultiPatch.split_spans(2).reduce_continuity(1), patchtransfer refine --split 2 --smoothness 1"
            )


def gluing_data(
    topology: Topology, control: tuple[ControlRows, ...], reference: FloatArray, linear: bool = False
) -> GluingData:
    """Gluing data of every interface.

    Parameters
    ----------
    topology : Topology
    control : tuple of ControlRows
    reference : (n_points, 2) array
        A map with C1 rows on exactly this boundary: its frames give the end values, and c_1 fits it best (least
        squares), changed as little as possible so that the twist rows close at regular vertices. Where a : b is
        constant, or nearly, c_1 is midway between c_0 and c_2.
    linear : bool, default False
        Take c_1 midway between c_0 and c_2 instead of the best fit: iso-lines bend more, but where kinks at both ends
        of an interface fade towards its middle this asks less of the map.

    Returns
    -------
    GluingData

    Raises
    ------
    InputError
        When the twist rows cannot be closed.
    """
    data = np.zeros((len(control), 7))
    for i, r in enumerate(control):
        data[i, [0, 2, 4]], data[i, [1, 3, 6]] = r.end_gluing(reference)
    closing = _smooth_vertices(topology, data)
    smooth = np.zeros((len(control), 2), bool)
    for spoke in (s for around in closing for s in around):
        smooth[spoke.interface, int(spoke.at_end)] = True
    constant = _one_ratio(data, smooth)
    on_boundary = set(topology.boundary_points.tolist())
    for i, r in enumerate(control):
        for end, place in ((0, 4), (1, 6)):
            if abs(data[i, place]) < SMOOTH_FRAME and int(r.curve[-end]) in on_boundary:
                data[i, place], smooth[i, end] = 0.0, True
    near = np.zeros(len(control), bool)
    near[[s.interface for around in closing for s in around]] = True
    free = _free_middles(closing, near & ~constant)
    # Between smooth ends c is zero unless the twists of one of them need it.
    zero = smooth.all(axis=1) & ~free
    spread = np.abs(data[:, 0] * data[:, 3] - data[:, 1] * data[:, 2])
    midway = zero | (spread < NEARLY_CONSTANT) | linear
    for i, r in enumerate(control):
        data[i, 5] = (data[i, 4] + data[i, 6]) / 2 if midway[i] else _best_middle(r, data[i], reference)
    if closing:
        free = _close_twists(control, closing, data, reference, free, near)
    degree = np.where(free | ~midway, 2, np.where(zero, -1, 1))
    return GluingData(data, constant, degree)


def _smooth_vertices(topology: Topology, data: FloatArray) -> list[tuple[Spoke, ...]]:
    """Regular vertices whose frames are smooth; c is set to 0 there exactly."""
    found = []
    for vertex in topology.vertices:
        if not vertex.interior or vertex.valence != 4:
            continue
        around = topology.spokes[vertex.point]
        where = tuple(np.array([(s.interface, 6 if s.at_end else 4) for s in around]).T)
        if np.abs(data[where]).max() < SMOOTH_FRAME:
            data[where] = 0.0
            found.append(around)
    return found


def _one_ratio(data: FloatArray, smooth: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Interfaces with one a : b from end to end, for both ends are smooth vertices of one chord; made so exactly.

    c must be linear there. Analysis-suitable data have c = a_L b_R - a_R b_L with linear factors, which has a quadratic
    part only where a : b varies. With constant a : b and quadratic c the derivative of a C1 field along the interface
    would have to be of one degree less and smoother by one: the fields lock, though the map itself is exact.
    """
    constant = smooth.all(axis=1) & (np.abs(data[:, 0] - data[:, 1]) < SMOOTH_FRAME)
    data[constant, :2] = data[constant, :2].mean(axis=1, keepdims=True)
    data[constant, 2:4] = 2 - data[constant, :2]
    return np.asarray(constant)


def _free_middles(closing: list[tuple[Spoke, ...]], free: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Interfaces whose c_1 may change to close the twists: of constant a : b only where it has to.

    a : b that varies on one chord of a vertex asks for a c on the other one.
    """
    free = free.copy()
    varying = free.copy()
    for around in closing:
        pairs = [[s.interface for s in around[k::2]] for k in (0, 1)]
        for one, other in (pairs, pairs[::-1]):
            if varying[other].any() and not varying[one].any():
                free[one] = True
    return free


def _best_middle(r: ControlRows, data: FloatArray, reference: FloatArray) -> float:
    """The c_1 with which the identity holds best on the reference (least squares)."""
    t = _nodes(r)
    value, slope = r.basis(t)
    rows = r.functional(evaluated(np.array([*data[:5], 0.0, data[6]]), t), value, slope)
    misfit = product(rows, reference[r.columns])
    part = 2 * (t * (1 - t))[:, None] * product(slope, reference[r.curve])
    return float((misfit * part).sum() / (part**2).sum())


def _close_twists(
    control: tuple[ControlRows, ...],
    closing: list[tuple[Spoke, ...]],
    data: FloatArray,
    reference: FloatArray,
    free: NDArray[np.bool_],
    near: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """Change the c_1 that are `free` by the least, all together, so that the twist rows of every smooth vertex depend.

    Returns those that were free; all that end at these vertices (`near`) where that takes more.
    """
    matrix, rhs = _closing_equations(control, closing, data, reference)
    # Where c_1 matters most for the residual, relative to the speeds, it changes least.
    weight = np.array([_weight(r, reference) for r in control])
    tolerance = CLOSED * max(float(np.abs(rhs).max()), float(np.abs(matrix).max()))
    for chosen in (free, near):
        moved = least_squares(matrix * (chosen / weight), rhs, RANK) * (chosen / weight)
        if np.abs(product(matrix, moved) - rhs).max() <= tolerance:
            data[:, 5] += moved
            return chosen
    raise InputError("exact G1: the twist rows cannot be closed at the regular vertices; use continuity c1")


def twist_closure(
    topology: Topology, control: tuple[ControlRows, ...], data: GluingData, points: FloatArray
) -> FloatArray:
    """Equations (m, n): changes of all c_1 that they map to zero leave the twist rows of every smooth vertex closed."""
    coefficients = data.coefficients.copy()
    return _closing_equations(control, _smooth_vertices(topology, coefficients), coefficients, points)[0]


def _closing_equations(
    control: tuple[ControlRows, ...], closing: list[tuple[Spoke, ...]], data: FloatArray, reference: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Equations for changes of c_1 that close the twist rows: a matrix (m, n) and right-hand sides (m,).

    The first-order rows of the four interfaces read T w + q = 0 with the four twists w and a singular T. With y T = 0
    they are solvable, and add nothing, if y q = 0, which is linear in the c_1.
    """
    matrix, rhs = np.zeros((2 * len(closing), len(control))), np.zeros(2 * len(closing))
    for k, around in enumerate(closing):
        twists = [int(p) for s in around for p in _twists(control[s.interface], s)]
        names = sorted(set(twists))
        block, rest, change = np.zeros((4, len(names))), np.zeros((4, 2)), np.zeros((4, 2))
        for m, spoke in enumerate(around):
            r = control[spoke.interface]
            row = _first_order(r, data[spoke.interface], spoke.at_end)
            for column, coefficient in zip(r.columns, row, strict=True):
                if int(column) in names:
                    block[m, names.index(int(column))] += coefficient
            rest[m] = (row[:, None] * reference[r.columns]).sum(axis=0)
            # c_1 enters c' at the vertex by 2 (c_1 - c_0), or 2 (c_2 - c_1).
            _, slope, _ = r.end_basis[spoke.at_end]
            change[m] = (2.0 if spoke.at_end else -2.0) * (slope[:, None] * reference[r.curve]).sum(axis=0)
        y = svd(block, full=True)[0][:, -1]
        rhs[2 * k : 2 * k + 2] = -(y @ rest)
        for m, spoke in enumerate(around):
            matrix[2 * k : 2 * k + 2, spoke.interface] += y[m] * change[m]
    return matrix, rhs


def _weight(r: ControlRows, reference: FloatArray) -> float:
    """Size of c_1's part of the residual relative to the cross derivatives."""
    t = _nodes(r)
    left, right, tangent = r.derivatives(reference, *r.basis(t))
    part = 2 * (t * (1 - t))[:, None] * tangent
    return float(np.sqrt((part**2).sum() / ((left**2).sum() + (right**2).sum())))


def _twists(r: ControlRows, spoke: Spoke) -> tuple[int, int]:
    j = -2 if spoke.at_end else 1
    return int(r.left[j]), int(r.right[j])


def _first_order(r: ControlRows, data: FloatArray, at_end: bool) -> FloatArray:
    """Coefficients (3 n,) of `columns` in the derivative of a D_L + b D_R - c C' at an end."""
    value, slope, bend = (x[None] for x in r.end_basis[at_end])
    t = np.array([float(at_end)])
    first = r.functional(evaluated(data, t, 1), value, slope) + r.functional(evaluated(data, t), slope, bend)
    return np.asarray(first[0])


def _nodes(r: ControlRows) -> FloatArray:
    """Chebyshev nodes, p + 2 in every span: they determine the residual, of degree p + 1 there."""
    m = r.degree + 2
    x = (1 - np.cos(np.pi * (np.arange(m) + 0.5) / m)) / 2
    return np.asarray((r.breaks[:-1, None] + np.diff(r.breaks)[:, None] * x).ravel())


def g1_rows(
    topology: Topology,
    control: tuple[ControlRows, ...],
    reference: FloatArray,
    without: Collection[int] = (),
    linear: bool = False,
) -> ContinuityRows:
    """Rows a D_L + b D_R - c C' = 0 along every interface, orthonormal.

    Parameters
    ----------
    topology : Topology
    control : tuple of ControlRows
    reference : (n_points, 2) array
        As in `gluing_data`.
    without : collection of int
        Interfaces that get no rows.
    linear : bool, default False
        As in `gluing_data`.

    Returns
    -------
    ContinuityRows
    """
    return rows_of(topology, control, gluing_data(topology, control, reference, linear), without)


def rows_of(
    topology: Topology,
    control: tuple[ControlRows, ...],
    data: GluingData,
    without: Collection[int] = (),
    rates: Mapping[int, FloatArray] | None = None,
) -> ContinuityRows:
    """Rows of given data; see `g1_rows`.

    `rates` adds parameters, each as two points after all others: by an interface's index, what its conditions (m, 2)
    change by as its parameter grows.
    """
    parameters = {} if rates is None else {i: topology.n_points + 2 * k for k, i in enumerate(rates)}
    columns: list[IntArray] = []
    entries: list[FloatArray] = []
    interface: list[int] = []
    for index, r in enumerate(control):
        if index in without:
            continue
        names, place = np.unique(r.columns, return_inverse=True)
        stated = data.conditions(index, r)
        raw = np.zeros((len(stated), len(names)))
        # Three points of a patch that meets itself may be one.
        np.add.at(raw.T, place, stated.T)
        u, sigma, vt = svd(raw)
        rank = int((sigma > DEPENDENT * sigma[0]).sum())
        rows = vt[:rank]
        if rates is not None and index in rates:
            names = np.append(names, [parameters[index], parameters[index] + 1])
            rows = np.column_stack([rows, product(u[:, :rank].T, rates[index]) / sigma[:rank, None]])
        columns += [names] * rank
        entries += list(rows)
        interface += [index] * rank
    pointer = np.concatenate([[0], np.cumsum([len(c) for c in columns])]).astype(np.int64)
    indices = np.concatenate([[], *columns]).astype(np.int64)
    shape = (len(interface), topology.n_points + 2 * len(parameters))
    matrix = Compressed(pointer, indices, np.concatenate([[], *entries]), shape)
    none = np.full(len(interface), -1)
    order = np.zeros(len(interface), np.int64)
    return ContinuityRows(matrix, none, np.array(interface, np.int64), none, order, 0, tuple(sorted(without)))
