"""Exact G1 rows: analysis-suitable gluing along whole interfaces (``continuity="g1"``).

After Collin, Sangalli, Takacs 2016 (*Analysis-suitable G1 multi-patch parametrizations for C1 isogeometric spaces*,
doi:10.1016/j.cagd.2016.05.009): a D_L + b D_R = c C' with a, b linear and c quadratic. The end values follow the frames
of a reference map; the middle of c is free where a : b varies, else c is linear. At regular vertices it has to close
the four twist rows, or these would force the tangents to be parallel. The derivation is in ``docs/continuity.md``.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from .continuity import ContinuityRows
from .errors import InputError
from .gluing import ControlRows
from .multipatch import MultiPatch
from .splines import FloatArray, IntArray
from .topology import Spoke, Topology

__all__ = ["check_g1_space", "g1_rows", "gluing_data"]

#: |c| (for a + b = 2) below which the reference is smooth at a regular vertex: C1 rows leave rounding only.
SMOOTH = 1e-9
#: |a_0 b_1 - a_1 b_0| (for a + b = 2) below which a : b counts as constant.
CONSTANT = 1e-5
#: Directions below this fraction of the largest are no rows.
INDEPENDENT = 1e-10


def check_g1_space(mp: MultiPatch) -> None:
    """Raise `InputError` where a model's splines have too little freedom for exact G1, naming interface and remedy.

    Along every interface the degree p must be at least 3, inner knots at most C^(p - 2), and for p = 3 there must be
    two knot spans or more: otherwise the rows lock the map.
    """
    for f in mp.interfaces:
        name = f"interface patch {f.patch_a} {f.side_a.name.lower()} - patch {f.patch_b} {f.side_b.name.lower()}"
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
) -> FloatArray:
    """Gluing data of every interface: Bernstein coefficients a_0, a_1, b_0, b_1, c_0, c_1, c_2, shape (n, 7).

    Parameters
    ----------
    topology : Topology
    control : tuple of ControlRows
    reference : (n_points, 2) array
        A map with C1 rows on exactly this boundary: its frames give the end values, and c_1 fits it best (least
        squares), changed as little as possible so that the twist rows close at regular vertices. Where a : b is
        constant, c_1 is midway between c_0 and c_2.
    linear : bool, default False
        Take c_1 midway between c_0 and c_2 instead of the best fit: iso-lines bend more, but where kinks at both ends
        of an interface fade towards its middle this asks less of the map.

    Raises
    ------
    InputError
        When the twist rows cannot be closed.
    """
    data = np.zeros((len(control), 7))
    for i, r in enumerate(control):
        data[i, [0, 2, 4]], data[i, [1, 3, 6]] = r.end_gluing(reference)
    closing = _smooth_vertices(topology, data)
    rigid = _constant_ratio(data)
    for i, r in enumerate(control):
        midway = linear or rigid[i]
        data[i, 5] = (data[i, 4] + data[i, 6]) / 2 if midway else _best_middle(r, data[i], reference)
    if closing:
        _close_twists(control, closing, data, reference, rigid)
    return data


def _smooth_vertices(topology: Topology, data: FloatArray) -> list[tuple[Spoke, ...]]:
    """Regular vertices whose frames are smooth; c is set to 0 there exactly."""
    found = []
    for vertex in topology.vertices:
        if not vertex.interior or vertex.valence != 4:
            continue
        around = topology.spokes[vertex.point]
        where = tuple(np.array([(s.interface, 6 if s.at_end else 4) for s in around]).T)
        if np.abs(data[where]).max() < SMOOTH:
            data[where] = 0.0
            found.append(around)
    return found


def _constant_ratio(data: FloatArray) -> NDArray[np.bool_]:
    """Interfaces with one a : b from end to end (of one chord, between smooth vertices): c must be linear there.

    Analysis-suitable data have c = a_L b_R - a_R b_L with linear factors, which has a quadratic part only where a : b
    varies. With constant a : b and quadratic c the derivative of a C1 field along the interface would have to be of
    one degree less and smoother by one: the fields lock, though the map itself is exact.
    """
    a, b = data[:, :2], data[:, 2:4]
    return np.asarray(np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) < CONSTANT)


def _best_middle(r: ControlRows, data: FloatArray, reference: FloatArray) -> float:
    """The c_1 with which the identity holds best on the reference (least squares)."""
    t = _nodes(r)
    value, slope = r.basis(t)
    misfit = r.functional(_evaluated(np.array([*data[:5], 0.0, data[6]]), t), value, slope) @ reference[r.columns]
    part = 2 * (t * (1 - t))[:, None] * (slope @ reference[r.curve])
    return float((misfit * part).sum() / (part**2).sum())


def _close_twists(
    control: tuple[ControlRows, ...],
    closing: list[tuple[Spoke, ...]],
    data: FloatArray,
    reference: FloatArray,
    rigid: NDArray[np.bool_],
) -> None:
    """Change the c_1 by the least, all together, so that the twist rows of every smooth regular vertex depend.

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
            rest[m] = row @ reference[r.columns]
            # c_1 enters c' at the vertex by 2 (c_1 - c_0), or 2 (c_2 - c_1).
            _, slope, _ = r.end_basis[spoke.at_end]
            change[m] = (2.0 if spoke.at_end else -2.0) * (slope @ reference[r.curve])
        y = np.linalg.svd(block)[0][:, -1]
        rhs[2 * k : 2 * k + 2] = -(y @ rest)
        for m, spoke in enumerate(around):
            matrix[2 * k : 2 * k + 2, spoke.interface] += y[m] * change[m]
    # Where c_1 matters most for the residual, relative to the speeds, it changes least.
    weight = np.array([_weight(r, reference) for r in control])
    tolerance = 1e-9 * max(float(np.abs(rhs).max()), float(np.abs(matrix).max()))
    free = ~rigid
    while True:
        moved = np.linalg.lstsq(matrix * (free / weight), rhs, rcond=1e-12)[0] * (free / weight)
        left = np.abs(matrix @ moved - rhs).reshape(-1, 2).max(axis=1) > tolerance
        if not left.any():
            break
        # Where a : b varies on one chord of a vertex only, it takes a quadratic c on the other to close the twists.
        needed = {s.interface for around, open_ in zip(closing, left, strict=True) if open_ for s in around}
        released = [i for i in needed if not free[i]]
        if not released:
            raise InputError("exact G1: the twist rows cannot be closed at the regular vertices; use continuity c1")
        free[released] = True
    data[:, 5] += moved


def _weight(r: ControlRows, reference: FloatArray) -> float:
    """Size of c_1's part of the residual relative to the cross derivatives."""
    t = _nodes(r)
    left, right, tangent = r.derivatives(reference, *r.basis(t))
    part = 2 * (t * (1 - t))[:, None] * tangent
    return float(np.linalg.norm(part) / np.hypot(np.linalg.norm(left), np.linalg.norm(right)))


def _twists(r: ControlRows, spoke: Spoke) -> tuple[int, int]:
    j = -2 if spoke.at_end else 1
    return int(r.left[j]), int(r.right[j])


def _first_order(r: ControlRows, data: FloatArray, at_end: bool) -> FloatArray:
    """Coefficients (3 n,) of `columns` in the derivative of a D_L + b D_R - c C' at an end."""
    value, slope, bend = (x[None] for x in r.end_basis[at_end])
    t = np.array([float(at_end)])
    first = r.functional(_evaluated(data, t, 1), value, slope) + r.functional(_evaluated(data, t), slope, bend)
    return np.asarray(first[0])


def _evaluated(data: FloatArray, t: FloatArray, order: int = 0) -> FloatArray:
    """a, b and c (m, 3) at the parameters t, or their derivatives."""
    if order == 0:
        linear, quadratic = np.stack([1 - t, t]), np.stack([(1 - t) ** 2, 2 * t * (1 - t), t**2])
    else:
        one = np.ones_like(t)
        linear, quadratic = np.stack([-one, one]), np.stack([-2 * (1 - t), 2 - 4 * t, 2 * t])
    return np.stack([data[:2] @ linear, data[2:4] @ linear, data[4:] @ quadratic], axis=1)


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
    data = gluing_data(topology, control, reference, linear)
    columns: list[IntArray] = []
    entries: list[FloatArray] = []
    interface: list[int] = []
    for index, r in enumerate(control):
        if index in without:
            continue
        t = _nodes(r)
        names, place = np.unique(r.columns, return_inverse=True)
        raw = np.zeros((len(t), len(names)))
        # Three points of a patch that meets itself may be one.
        np.add.at(raw.T, place, r.functional(_evaluated(data[index], t), *r.basis(t)).T)
        _, sigma, vt = np.linalg.svd(raw, full_matrices=False)
        rank = int((sigma > INDEPENDENT * sigma[0]).sum())
        columns += [names] * rank
        entries += list(vt[:rank])
        interface += [index] * rank
    pointer = np.concatenate([[0], np.cumsum([len(c) for c in columns])]).astype(np.int64)
    shape = (len(interface), topology.n_points)
    matrix = csr_array(
        (np.concatenate([[], *entries]), np.concatenate([[], *columns]).astype(np.int64), pointer), shape=shape
    )
    none = np.full(len(interface), -1)
    order = np.zeros(len(interface), np.int64)
    return ContinuityRows(matrix, none, np.array(interface, np.int64), none, order, 0, tuple(sorted(without)))
