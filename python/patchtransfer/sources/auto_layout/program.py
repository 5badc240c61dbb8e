"""The integer program of the arc lengths."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...numeric.arrays import FloatArray, IntArray
from .reasons import NoLayoutError
from .t_mesh import TMesh

__all__ = ["STAGE", "Cut", "Program"]

STAGE = "quantization"
#: No arc needs more edges: a loop of n arcs has at least 3, and cuts add one at a time.
LONGEST = 40
#: Price in edges of a soft cut that does not hold: more than any collapse that is wanted.
SOFT = 64.0
#: Nodes of the branch-and-bound tree, some seconds' worth; counted, not timed, so that answers do not depend on the
#: machine. Usual programs need one to a hundred.
NODES = 20_000
#: Objectives are multiplied by it, so that the solver's absolute gap (1e-6) is below all differences that matter.
SCALE = 1024.0


@dataclass(frozen=True)
class Cut:
    """A lower bound of a combination of arc lengths.

    Attributes
    ----------
    terms : tuple of (arc, coefficient)
    least : int
    why : str
    soft : bool, default False
        May be broken at a high price.
    """

    terms: tuple[tuple[int, int], ...]
    least: int
    why: str
    soft: bool = False

    def value(self, lengths: Sequence[int]) -> int:
        """The combination for integer arc lengths."""
        return sum(c * lengths[arc] for arc, c in self.terms)


@dataclass
class _Rows:
    """Rows of a sparse matrix with their bounds."""

    row: list[int] = field(default_factory=list)
    column: list[int] = field(default_factory=list)
    value: list[float] = field(default_factory=list)
    low: list[float] = field(default_factory=list)
    high: list[float] = field(default_factory=list)

    def add(self, terms: Iterable[tuple[int, float]], low: float, high: float = np.inf) -> None:
        for column, value in terms:
            self.row.append(len(self.low))
            self.column.append(column)
            self.value.append(value)
        self.low.append(low)
        self.high.append(high)


class Program:
    """Least price of the arc lengths of a T-mesh under cuts.

    Variables are a length and a sign of being longer than zero for each arc, then one for each soft cut, then, with
    a limit on the patches, those of the faces' numbers of quads.

    Parameters
    ----------
    t_mesh : TMesh
    edges, collapses : (a,) array
        Price of an edge on each arc, and of collapsing it.
    ties : sequence of pairs of arcs
        Arcs of equal lengths.
    max_patches : int, optional
        Largest number of quads. The number of a face is the product of its sides, w h, which is not convex. It is
        bounded from below exactly at the sides that a solution has: ``q >= k h - k H [w < k]`` is true for every
        integer k, and tight at w = k. Such levels are added where a solution breaks the limit, so that few are
        needed, and none is approximate; raising the price of edges instead would miss layouts and would not end.
    """

    def __init__(
        self,
        t_mesh: TMesh,
        edges: FloatArray,
        collapses: FloatArray,
        ties: Sequence[tuple[int, int]] = (),
        max_patches: int | None = None,
    ) -> None:
        self.edges, self.collapses = edges, collapses
        self.arcs = len(edges)
        self.ties = [(int(a), int(b)) for a, b in ties]
        self.max_patches = max_patches
        self.cuts: list[Cut] = []
        self.levels: list[tuple[int, int, int]] = []
        self.sides = [[_counts(side) for side in face] for face in t_mesh.faces]
        if max_patches is not None:
            self.levels = [(face, side, 1) for face in range(len(self.sides)) for side in (0, 1)]

    @property
    def longest(self) -> int:
        """Upper bound of every arc length."""
        return LONGEST if self.max_patches is None else max(3, min(LONGEST, self.max_patches))

    def limit(self, face: int, width: int, height: int) -> bool:
        """Bound a face's quads exactly at its present sides; whether that is new."""
        new = [level for level in ((face, 0, width), (face, 1, height)) if level not in self.levels]
        self.levels += new
        return bool(new)

    def solve(self) -> tuple[list[int], float]:
        """Arc lengths of least price, and the price in edges.

        Raises
        ------
        NoLayoutError
            Where no lengths obey all, or the search does not end.
        """
        # Takes a tenth of a second, and is not needed to import the package.
        from scipy.optimize import Bounds, LinearConstraint, milp
        from scipy.sparse import csr_array

        n, soft = self.arcs, sum(cut.soft for cut in self.cuts)
        faces = len(self.sides) if self.max_patches is not None else 0
        columns = 2 * n + soft + faces + (len(self.levels) if faces else 0)
        rows = self._rows()
        matrix = csr_array((rows.value, (rows.row, rows.column)), shape=(len(rows.low), columns))
        cost = np.zeros(columns)
        cost[:n], cost[n : 2 * n], cost[2 * n : 2 * n + soft] = self.edges, -self.collapses, SOFT
        upper = np.ones(columns)
        upper[:n], upper[2 * n + soft : 2 * n + soft + faces] = self.longest, np.inf
        found = milp(
            SCALE * cost,
            constraints=LinearConstraint(matrix, rows.low, rows.high),
            integrality=np.ones(columns),
            bounds=Bounds(0, upper),
            options={"mip_rel_gap": 0.0, "node_limit": NODES},
        )
        if found.x is None:
            raise NoLayoutError(STAGE, self._reason(found))
        lengths: IntArray = np.round(found.x[:n]).astype(np.int64)
        return lengths.tolist(), float(self.collapses.sum() + found.fun / SCALE)

    def _reason(self, found: Any) -> str:
        what = f"{len(self.cuts)} cuts on {self.arcs} arcs"
        if found.status == 2:
            limit = "" if self.max_patches is None else f" and at most {self.max_patches} patches"
            return f"no arc lengths obey {what}{limit}; allow more patches or drop demands"
        return f"{NODES} nodes of the search bring no arc lengths that obey {what}"

    def _rows(self) -> _Rows:
        rows, n = _Rows(), self.arcs
        for face in self.sides:
            for side, opposite in ((0, 2), (1, 3)):
                terms = dict(face[side])
                for arc, count in face[opposite].items():
                    terms[arc] = terms.get(arc, 0) - count
                rows.add(((arc, count) for arc, count in terms.items() if count), 0, 0)
        for arc in range(n):
            rows.add(((arc, 1), (n + arc, -1)), 0)
        for a, b in self.ties:
            if a != b:
                rows.add(((a, 1), (b, -1)), 0, 0)
        slack = 2 * n
        for cut in self.cuts:
            # Signed sums of lengths have a bound of their own below: a broken soft cut is no cut at all.
            missing = cut.least + self.longest * sum(-c for _, c in cut.terms if c < 0)
            rows.add([*cut.terms, *([(slack, missing)] if cut.soft else [])], cut.least)
            slack += cut.soft
        if self.max_patches is not None:
            self._patch_rows(rows, slack, self.max_patches)
        return rows

    def _patch_rows(self, rows: _Rows, first: int, most: int) -> None:
        rows.add(((first + face, 1) for face in range(len(self.sides))), -np.inf, most)
        flag = first + len(self.sides)
        for face, side, level in self.levels:
            width, height = self.sides[face][side], self.sides[face][1 - side]
            widest, highest = (self.longest * sum(counts.values()) for counts in (width, height))
            # flag = 1 where the width is at least the level; then the face has at least level * height quads.
            rows.add([(flag, widest), *((arc, -c) for arc, c in width.items())], 1 - level)
            rows.add(
                [(first + face, 1), (flag, -level * highest), *((arc, -level * c) for arc, c in height.items())],
                -level * highest,
            )
            flag += 1


def _counts(side: IntArray) -> dict[int, int]:
    counts: dict[int, int] = {}
    for half in side.tolist():
        counts[half // 2] = counts.get(half // 2, 0) + 1
    return counts
