"""C¹ fields on a multi-patch: a sparse basis of the null space of the C¹ conditions.

Interfaces meet at vertices only, so each is solved by itself first. Of the coefficients it ties, those in the 2 x 2
blocks at its ends belong to the vertices, all others to it alone. A small dense factorization per interface gives the
fields that live on it, what its two vertices must fulfil, and how its own coefficients follow the vertices'. Then the
vertices are solved; those that an interface ties together, because it is too short, jointly.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array, csc_array, csr_array, hstack

from ..errors import InputError
from ..geometry.multipatch import MultiPatch
from ..numeric.arrays import FloatArray, IntArray
from ..numeric.components import components
from ..numeric.dense import product, svd
from .gluing import Gluing, c1_rows, gluings
from .space import SplineSpace

__all__ = ["C1Space"]

#: Singular values below it are zero. A condition as weak as that is left out: rounding would be amplified by more than
#: the kink that remains.
RANK = 1e-8


@dataclass(frozen=True)
class _Edge:
    """What the C¹ condition of one interface says, solved for its own coefficients.

    Attributes
    ----------
    own, ends : int arrays
        Coefficients of the interface alone, and those of its end vertices.
    null : (len(own), k) array
        Fields on the interface alone.
    follow : (len(own), len(ends)) array
        Own coefficients that go with given ones at the ends.
    conditions : (m, len(ends)) array
        What the ends must fulfil.
    """

    own: IntArray
    ends: IntArray
    null: FloatArray
    follow: FloatArray
    conditions: FloatArray


class C1Space:
    """Fields of a spline space that are C¹ across all interfaces of a model.

    Parameters
    ----------
    space : SplineSpace
        At least C¹ inside the patches, of degree 3 or more.
    mp : MultiPatch
        Polynomial, of analysis-suitable G1 (AS-G1) interfaces.
    gluing : {"exact", "nearest"}, default "exact"
        Whether other interfaces are refused, or glued by the nearest AS-G1 gluing data: then the fields have kinks in
        the plane, and errors do not tend to zero.

    Attributes
    ----------
    gluing : tuple of Gluing
    rows : (m, space.size) sparse array
        The C¹ conditions.
    inside : (space.size, k) sparse array
        Basis of the fields that vanish on the boundary with their normal derivatives.
    boundary : (space.size, l) sparse array
        Completes it to a basis of all C¹ fields.
    rank_gap : (float, float)
        Largest singular value taken for zero and smallest taken for positive, over all rank decisions.

    Raises
    ------
    InputError
        On rational or singular patches, on interfaces that are not AS-G1, or a space that is not C¹ inside a patch.
    """

    def __init__(self, space: SplineSpace, mp: MultiPatch, gluing: str = "exact") -> None:
        if gluing not in ("exact", "nearest"):
            raise InputError(f'gluing = {gluing!r} is not known, use "exact" or "nearest"')
        for k, pair in enumerate(space.bases):
            for basis in pair:
                _, multiplicity = np.unique(basis.knots[1:-1], return_counts=True)
                if basis.degree < 3 or (multiplicity[1:-1] > basis.degree - 1).any():
                    raise InputError(
                        f"patch {k}: C¹ fields need degree 3 and one continuous derivative at the knots inside at "
                        "least; elevate the model or choose another degree"
                    )
        self.space = space
        self.rank_gap = (0.0, np.inf)
        self.gluing: tuple[Gluing, ...] = gluings(mp)
        unsuitable = [g for g in self.gluing if not g.analysis_suitable]
        if unsuitable and gluing == "exact":
            worst = max(unsuitable, key=lambda g: g.residual)
            raise InputError(
                f"{len(unsuitable)} of {len(self.gluing)} interfaces are not analysis-suitable G1, the worst is "
                f"interface {worst.interface.name} (residual {worst.residual:.2g}); use a model with exact G1 "
                'continuity, or gluing="nearest" for fields with kinks'
            )
        blocks = [self._orthonormal(rows) for rows in c1_rows(space, self.gluing)]
        self.rows = csr_array(_stack([b for b, _ in blocks], [c for _, c in blocks], space.size))
        vertex = self._vertex_of()
        self._edges = [self._edge(b, columns, vertex) for b, columns in blocks]
        self.inside, self.boundary = self._basis(vertex)

    def __repr__(self) -> str:
        size = self.inside.shape[1] + self.boundary.shape[1]
        return f"<C1Space: {size} C¹ fields of {self.space.size} coefficients, {len(self.gluing)} interfaces>"

    @cached_property
    def basis(self) -> csc_array:
        """All C¹ fields: `inside` and `boundary` side by side."""
        return csc_array(hstack([self.inside, self.boundary]))

    @property
    def as_g1_residual(self) -> float:
        """Largest AS-G1 residual of the interfaces."""
        return max((g.residual for g in self.gluing), default=0.0)

    @cached_property
    def outer(self) -> IntArray:
        """Coefficients that determine value and normal derivative on the boundary: its two rows."""
        points = self.space.points
        rows = [side.of(points[k], row) for k, side in self.space.boundaries for row in (0, 1)]
        return np.unique(np.concatenate([np.empty(0, int), *rows]))

    def _vertex_of(self) -> IntArray:
        """Vertex of the coefficients in the patches' 2 x 2 corner blocks, -1 for all others."""
        corners = [p[np.ix_((0, -1), (0, -1))] for p in self.space.points]
        vertex = np.full(self.space.size, -1)
        for points, corner in zip(self.space.points, corners, strict=True):
            for i, rows in enumerate(((0, 1), (-1, -2))):
                for j, columns in enumerate(((0, 1), (-1, -2))):
                    vertex[points[np.ix_(rows, columns)]] = corner[i, j]
        return vertex

    def _split(self, a: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, int]:
        """Singular value decomposition (full) and the rank."""
        if 0 in a.shape:
            return np.eye(a.shape[0]), np.zeros(0), np.eye(a.shape[1]), 0
        u, sigma, vt = svd(a, full=True)
        # The rows are orthonormal or projected from such: their natural size is one.
        positive = sigma > RANK
        low, high = self.rank_gap
        self.rank_gap = (max(low, *sigma[~positive], 0.0), min(high, *sigma[positive], np.inf))
        return u, sigma, vt, int(positive.sum())

    def _null(self, a: FloatArray) -> FloatArray:
        """Orthonormal basis of the null space, as columns."""
        _, _, vt, rank = self._split(a)
        return np.asarray(vt[rank:].T)

    def _orthonormal(self, rows: csr_array) -> tuple[FloatArray, IntArray]:
        """Orthonormal rows with the same null space, on the columns that occur."""
        columns = np.unique(rows.indices)
        dense = rows[:, columns].toarray()
        _, sigma, vt = svd(dense)
        relative = sigma / sigma[0]
        positive = relative > RANK
        low, high = self.rank_gap
        self.rank_gap = (max(low, *relative[~positive], 0.0), min(high, *relative[positive]))
        return vt[positive], columns

    def _edge(self, rows: FloatArray, columns: IntArray, vertex: IntArray) -> _Edge:
        at_end = vertex[columns] >= 0
        own, ends = columns[~at_end], columns[at_end]
        u, sigma, vt, rank = self._split(rows[:, ~at_end])
        follow = product(-(vt[:rank].T / sigma[:rank]), product(u[:, :rank].T, rows[:, at_end]))
        conditions = self._localised(product(u[:, rank:].T, rows[:, at_end]), vertex[ends])
        return _Edge(own, ends, vt[rank:].T, follow, conditions)

    def _localised(self, conditions: FloatArray, vertex: IntArray) -> FloatArray:
        """The same conditions, each on one vertex only where that is possible."""
        u, _, _, rank = self._split(conditions)
        independent = product(u[:, :rank].T, conditions)
        parts = []
        for end in np.unique(vertex):
            alone = product(self._null(independent[:, vertex != end].T).T, independent)
            alone[:, vertex != end] = 0.0
            parts.append(alone)
        local = np.concatenate(parts) if parts else independent
        return local if len(local) == rank else independent

    def _basis(self, vertex: IntArray) -> tuple[csc_array, csc_array]:
        """Columns for single coefficients, interfaces and vertices; those of the boundary apart."""
        size, outer = self.space.size, np.zeros(self.space.size, bool)
        outer[self.outer] = True
        tied = np.zeros(size, bool)
        for edge in self._edges:
            tied[edge.own] = tied[edge.ends] = True
        inside, boundary = _Columns(size), _Columns(size)
        inside.units(np.flatnonzero(~tied & ~outer))
        boundary.units(np.flatnonzero(~tied & outer))
        for edge in self._edges:
            inside.add(edge.own, edge.null)
        for numbers, conditions in self._components(vertex, tied):
            on_boundary = outer[numbers]
            free = np.zeros((len(numbers), 0))
            if not on_boundary.all():
                null = self._null(conditions[:, ~on_boundary])
                free = np.zeros((len(numbers), null.shape[1]))
                free[~on_boundary] = null
            whole = self._null(conditions)
            # What is left of the null space across the fields that vanish on the boundary.
            rest = product(whole, self._null(product(free.T, whole)))
            for into, fields in ((inside, free), (boundary, rest)):
                if fields.shape[1]:
                    into.add(*self._followed(numbers, fields))
        return inside.matrix(), boundary.matrix()

    def _components(self, vertex: IntArray, tied: np.ndarray) -> list[tuple[IntArray, FloatArray]]:
        """Coefficients and conditions of vertices that are tied together."""
        at = np.flatnonzero((vertex >= 0) & tied)
        number = np.full(self.space.size, -1)
        number[at] = np.arange(len(at))
        rows = _stack([e.conditions for e in self._edges], [number[e.ends] for e in self._edges], len(at)).tocoo()
        # Vertices, and conditions between them, form a graph.
        names, which = np.unique(vertex[at], return_inverse=True)
        keep = np.abs(rows.data) > 0
        i, j = rows.row[keep] + len(names), which[rows.col[keep]]
        n = len(names) + rows.shape[0]
        label = components(n, i, j)
        dense = rows.tocsr()
        out = []
        for group in np.unique(label[: len(names)]):
            members = np.flatnonzero(label[which] == group)
            conditions = np.flatnonzero(label[len(names) :] == group)
            out.append((at[members], dense[conditions][:, members].toarray()))
        return out

    def _followed(self, numbers: IntArray, fields: FloatArray) -> tuple[IntArray, FloatArray]:
        """Fields given at vertices, with what follows on the interfaces there."""
        position = {int(n): i for i, n in enumerate(numbers)}
        all_numbers, all_fields = [numbers], [fields]
        for edge in self._edges:
            known = [i for i, n in enumerate(edge.ends) if int(n) in position]
            if known and len(edge.own):
                at = [position[int(edge.ends[i])] for i in known]
                all_numbers.append(edge.own)
                all_fields.append(product(edge.follow[:, known], fields[at]))
        return np.concatenate(all_numbers), np.concatenate(all_fields)


class _Columns:
    """Collects sparse columns."""

    def __init__(self, size: int) -> None:
        self.size, self.count = size, 0
        self.parts: list[tuple[FloatArray, IntArray, IntArray]] = []

    def units(self, numbers: IntArray) -> None:
        """One column for every coefficient."""
        self.parts.append((np.ones(len(numbers)), numbers, self.count + np.arange(len(numbers))))
        self.count += len(numbers)

    def add(self, numbers: IntArray, fields: FloatArray) -> None:
        """The columns of a block (len(numbers), k)."""
        i, j = np.nonzero(np.abs(fields) > 1e-15)
        self.parts.append((fields[i, j], numbers[i], self.count + j))
        self.count += fields.shape[1]

    def matrix(self) -> csc_array:
        """All of them, (size, count)."""
        data, i, j = (np.concatenate(x) for x in zip(*self.parts, strict=True))
        return csc_array(coo_array((data, (i, j)), shape=(self.size, self.count)))


def _stack(blocks: list[FloatArray], columns: list[IntArray], width: int) -> csr_array:
    """Dense blocks, each on its own columns, on top of one another."""
    data, rows, where, count = [np.empty(0)], [np.empty(0, int)], [np.empty(0, int)], 0
    for block, numbers in zip(blocks, columns, strict=True):
        data.append(block.ravel())
        rows.append(count + np.repeat(np.arange(block.shape[0]), block.shape[1]))
        where.append(np.tile(numbers, block.shape[0]))
        count += block.shape[0]
    index = (np.concatenate(rows), np.concatenate(where))
    return csr_array(coo_array((np.concatenate(data), index), shape=(count, width)))
