"""Optimisation under continuity rows: from the best map without them to one that satisfies them.

The rows follow a reference map (its speeds and frames), so that one is found first. Rows that make a corner at the
boundary collapse are released; where no certified map satisfies the rest, interfaces lose theirs, which the report
says. A certified reference therefore never turns into an uncertified result.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from ..continuity.null_space import RowSpace, nearest, row_space
from ..continuity.rows import ContinuityRows
from ..geometry.multipatch import MultiPatch
from ..geometry.straight_corners import corner_triangles
from ..geometry.topology import Spoke, Topology
from ..numeric.arrays import FloatArray, among, distinct
from ..progress import Budget, Progress
from ..proof.certificate import Certificate
from .optimizer import Certify, SplineOptimizer, optimize_with_ladder
from .spoilt import SPOILT

__all__ = ["ActiveRows", "LooserRows", "MakeRows", "Solve", "best_under_rows", "optimize_under_rows", "rows_summary"]

#: A corner collapses when its scaled Jacobian falls below this fraction of the reference's.
COLLAPSED = 0.8
#: Rows whose residual is below this fraction of the diameter are kept.
KEPT = 1e-10
#: Rows whose map has so many times the energy of the reference cost too much: exact G1 takes 1.03 at most on 24
#: transfers but for one with 1.12, whose smallest scaled Jacobian fell from 0.29 to 0.07.
DEAR = 1.05
#: Rounds of taking rows from interfaces.
ROW_ROUNDS = 3


@dataclass(frozen=True)
class ActiveRows:
    """Which continuity rows a result satisfies, and how well.

    Attributes
    ----------
    active : int
        Number of rows that are satisfied.
    residual : float
        Their largest residual, relative to the diameter.
    left_out : int
        C1 rows that are left out: at extraordinary vertices, where vertex rows stand in for them, on interfaces
        between these that are too short for them, at the boundary, where they were released, and on interfaces
        without rows.
    released : tuple of (interface, (x, y))
        Boundary vertices where the row j = 1 was left out as well, because a corner collapsed under it.
    without : tuple of int
        Interfaces that got no rows: no certified map was found with them, or the degree is below 2.
    contradictory : tuple of (interface, vertex)
        Rows that the boundary contradicts, or leaves no freedom for at a vertex of even valence; not active. Vertex
        -1: not at a vertex.
    collapsed : int
        Interface ends at the boundary where a corner is nearly flat under the rows: no certified map was found with
        fewer rows there.
    space : RowSpace or None
        The rows themselves and the maps that satisfy them; None in a result that comes from another process.
    """

    active: int
    residual: float
    left_out: int
    released: tuple[tuple[int, tuple[float, float]], ...] = ()
    without: tuple[int, ...] = ()
    contradictory: tuple[tuple[int, int], ...] = ()
    collapsed: int = 0
    space: RowSpace | None = field(default=None, compare=False)

    def __getstate__(self) -> dict[str, Any]:
        # As large as the rest of a result, and of use where the plan is.
        return {name: value for name, value in self.__dict__.items() if name != "space"}

    def __repr__(self) -> str:
        return f"<ActiveRows: {self.active} active, residual {self.residual:.1e}, {self.left_out} left out>"

    def moved(self, centre: FloatArray, diameter: float) -> ActiveRows:
        """The same of a map moved by `centre`; the residual is not measured there, rounding of coordinates is added."""
        rounding = float(np.spacing(np.abs(centre).max())) / diameter
        released = tuple((i, (x + float(centre[0]), y + float(centre[1]))) for i, (x, y) in self.released)
        return replace(self, residual=self.residual + 2 * rounding, released=released)

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "active": self.active,
            "residual": self.residual,
            "left_out": self.left_out,
            "released": [{"interface": i, "at": list(at)} for i, at in self.released],
            "interfaces_without": list(self.without),
            "contradictory": [{"interface": i, "vertex": v} for i, v in self.contradictory],
            "collapsed": self.collapsed,
        }

    def warnings(self, mp: MultiPatch) -> list[str]:
        """What a user should know: interfaces without rows, rows that contradict the boundary."""
        found = []
        if self.without:
            found.append(
                f"{len(self.without)} of {len(mp.interfaces)} interfaces are C0 only (no certified map keeps the rows "
                f"there, the degree is 1, or weights allow none): {_names(mp, self.without)}"
            )
        if self.residual > KEPT:
            found.append(
                f"continuity rows hold to {self.residual:.1e} of the diameter only (rounding in near-singular rows)"
            )
        if self.collapsed:
            found.append(
                f"corners are nearly flat under continuity rows at {self.collapsed} interface ends on the boundary: "
                "no certified map was found with fewer rows there"
            )
        if self.contradictory:
            found.append(
                f"{len(self.contradictory)} continuity rows are not kept, for the boundary contradicts them or leaves "
                f"no freedom: {_names(mp, sorted({i for i, _ in self.contradictory}))}"
            )
        return found


def _names(mp: MultiPatch, interfaces: Collection[int]) -> str:
    names = [mp.interfaces[i].name for i in interfaces]
    return ", ".join(names[:5]) + (", ..." if len(names) > 5 else "")


#: ``make_rows(released, without)`` gives the rows without those named.
MakeRows = Callable[[Collection[Spoke], Collection[int]], ContinuityRows]
#: ``solve(space, start)`` gives points, certificate and log.
Solve = Callable[[RowSpace, FloatArray], tuple[FloatArray, Certificate, list[str]]]
Outcome = tuple[FloatArray, Certificate, list[str], ActiveRows]
#: ``looser(tried, points, rows)`` gives a further choice, if there is one, where the map found under the last of those
#: `tried` costs too much.
LooserRows = Callable[[int, FloatArray, ActiveRows], MakeRows | None]


def best_under_rows(
    topology: Topology,
    choices: Sequence[MakeRows],
    make: Callable[..., SplineOptimizer],
    reference: FloatArray,
    certify: Certify,
    progress: Progress | None = None,
    *,
    looser: LooserRows | None = None,
    release: bool = True,
    rounds: int = ROW_ROUNDS,
    budget: Budget | None = None,
) -> Outcome:
    """Optimise the spline under the first choice of rows, and under the next where that costs too much.

    That is where interfaces lost their rows, the smallest determinant fell below half of the reference's, or the energy
    rose by a twentieth. Among the choices tried the one with most interfaces, then with least distortion, is kept.
    `looser` is asked for more after the last. Parameters as of `optimize_under_rows`;
    ``make(null_space=..., nodes_per_degree=..., extra_nodes=...)`` gives an optimizer.
    """
    budget = budget or Budget()
    solve = _ladder(topology, make, certify, progress, budget)
    tried: list[tuple[tuple[int, float], Outcome]] = []
    log: list[str] = []
    plain, waiting = make(), list(choices)
    of_reference = plain.minimise(reference, max_steps=0).energy
    while waiting:
        found = optimize_under_rows(
            topology, waiting.pop(0), solve, reference, certify, release=release, rounds=rounds, budget=budget
        )
        log += found[2]
        missing = len(found[3].without) + len(found[3].contradictory)
        energy = plain.minimise(found[0], max_steps=0).energy
        tried.append(((missing, energy), found))
        least = [plain.minimum_determinant(points) for points in (found[0], reference)]
        dear = least[0] < SPOILT * least[1] or energy > DEAR * of_reference
        if budget.expired() or not (missing or dear):
            break
        if not waiting and looser is not None and (further := looser(len(tried), found[0], found[3])):
            waiting.append(further)
    points, certificate, _, rows = min(tried, key=lambda entry: entry[0])[1]
    if len(tried) > 1:
        log.append(f"{len(tried)} choices of rows were tried, the one of least distortion is kept")
    return points, certificate, log, rows


def optimize_under_rows(
    topology: Topology,
    make_rows: MakeRows,
    solve: Solve,
    reference: FloatArray,
    certify: Certify,
    *,
    release: bool = True,
    rounds: int = ROW_ROUNDS,
    budget: Budget | None = None,
) -> Outcome:
    """Find a certified map under continuity rows, starting from one without them.

    Parameters
    ----------
    topology : Topology
    make_rows : callable
        ``make_rows(released, without)``, a `ContinuityRows`.
    solve : callable
        ``solve(space, start)`` gives points, certificate and log of a map under the rows of a `RowSpace`.
    reference : (n_points, 2) array
        The certified map, on the target boundary.
    certify : callable
        Shared control points to certificate.
    release : bool, default True
        Whether rows are released at boundary corners that collapse.
    rounds : int, default 3
        Attempts at most; after each that fails, interfaces lose their rows.
    budget : Budget, optional
        No further attempt is made when its time is over; what `solve` spends is renewed where it gives a certified
        map. Default unlimited.

    Returns
    -------
    points, certificate, log, ActiveRows
        Certified in any case if the reference is: with all rows, with fewer, or the reference with none. If it is not,
        a certified map whose corners collapse may be the best there is.
    """
    log: list[str] = []
    budget = budget or Budget()
    without, released = frozenset[int](), frozenset[Spoke]()
    near, failures, corners = reference, 0, _Corners(topology)
    spare: Outcome | None = None
    while failures < rounds and not budget.expired():
        space, start, released = _start(topology, corners, make_rows, reference, near, released, without, release)
        points, certificate, tried = solve(space, start)
        log += [f"under {len(space.rows)} rows, {entry}" for entry in tried]
        collapsed = corners.collapsed(reference, points) - released if release else frozenset[Spoke]()
        if collapsed:
            released |= collapsed
            near = points if certificate.injective else reference
            if certificate.injective:
                budget.renew()
                rows = replace(rows_summary(topology, space, points, released - collapsed), collapsed=len(collapsed))
                spare = points, certificate, log, rows
            log.append(f"corners collapse: the second rows of {len(collapsed)} interface ends are released")
        elif certificate.injective:
            return points, certificate, log, rows_summary(topology, space, points, released)
        else:
            without |= _around(topology, certificate)
            near, failures = reference, failures + 1
            log.append(f"no certified map satisfies these rows: {len(without)} interfaces lose theirs")
    everything = frozenset(range(len(topology.interfaces)))
    space = row_space(make_rows((), everything), topology.interior_points, reference)
    certificate = certify(reference)
    if spare is not None and not certificate.injective:
        return spare
    return reference, certificate, log, rows_summary(topology, space, reference)


def _ladder(
    topology: Topology,
    make: Callable[..., SplineOptimizer],
    certify: Certify,
    progress: Progress | None,
    budget: Budget,
) -> Solve:
    """The spline optimiser's ladder as a solver under rows."""

    def solve(space: RowSpace, start: FloatArray) -> tuple[FloatArray, Certificate, list[str]]:
        plain = make(null_space=space.columns)
        start = start if plain.minimum_determinant(start) > 0 else plain.harmonic(start)
        found, certificate, log = optimize_with_ladder(
            lambda **options: make(null_space=space.columns, **options) if options else plain,
            start,
            certify,
            source=topology.coordinates,
            boundary=topology.boundary_points,
            progress=None if progress is None else partial(_renamed, progress),
            project=space.project,
            budget=budget,
        )
        return found.points, certificate, log

    return solve


def _renamed(progress: Progress, stage: str, step: int, energy: float, least: float) -> None:
    progress(f"under continuity rows: {stage}", step, energy, least)


def _start(
    topology: Topology,
    corners: _Corners,
    make_rows: MakeRows,
    reference: FloatArray,
    near: FloatArray,
    released: frozenset[Spoke],
    without: Collection[int],
    release: bool,
) -> tuple[RowSpace, FloatArray, frozenset[Spoke]]:
    """The nearest map that satisfies the rows, without those at corners that collapse in it.

    These corners nearly always collapse in the optimum too, and projecting costs much less. Even less costs it to
    move every corner on its own first, so that rows are seldom eliminated twice.
    """
    rows = make_rows(released, without)
    if release:
        alone = corners.collapsed(reference, corners.with_rows(rows, near)) - released
        if alone:
            released |= alone
            rows = make_rows(released, without)
    while True:
        space = row_space(rows, topology.interior_points, reference)
        start = space.project(near)
        more = corners.collapsed(reference, start) - released if release else frozenset[Spoke]()
        if not more:
            return space, start, released
        released |= more
        rows = make_rows(released, without)


class _Corners:
    """Patch corners at boundary vertices of two patches or more, where rows may collapse a corner."""

    def __init__(self, topology: Topology) -> None:
        self._spokes: list[tuple[Spoke, ...]] = []
        corners: list[tuple[int, int]] = []
        for vertex in topology.vertices:
            if vertex.interior or vertex.valence < 2:
                continue
            for patch, corner in vertex.corners:
                corners.append((patch, corner))
                self._spokes.append(topology.spokes.get(vertex.point, ()))
        rows, self._turn = corner_triangles(topology, corners)
        self._apex, self._u, self._v = rows.T
        # The first points of the interfaces that end at these vertices.
        first = distinct(np.concatenate([self._u, self._v]))
        self._first = np.intersect1d(first, topology.interior_points, assume_unique=True)
        self._interior = topology.interior_points

    def collapsed(self, before: FloatArray, after: FloatArray) -> frozenset[Spoke]:
        """Interface ends at the vertices where a corner of a patch collapsed."""
        fell = np.flatnonzero(self._jacobians(after) < COLLAPSED * self._jacobians(before))
        return frozenset(spoke for k in fell for spoke in self._spokes[k])

    def with_rows(self, rows: ContinuityRows, points: FloatArray) -> FloatArray:
        """The nearest points that satisfy the C1 rows of the first points of interfaces, all other rows aside."""
        chosen = np.flatnonzero(among(rows.slave, self._first))
        return nearest(rows, chosen, self._interior, points) if len(chosen) else points

    def _jacobians(self, points: FloatArray) -> FloatArray:
        """Scaled Jacobians: the sines of the angles between the sides of patches."""
        u, v = (points[side] - points[self._apex] for side in (self._u, self._v))
        lengths = np.hypot(*u.T) * np.hypot(*v.T)
        sines = self._turn * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
        return np.asarray(np.divide(sines, lengths, out=np.zeros(len(lengths)), where=lengths > 0))


def _around(topology: Topology, certificate: Certificate) -> frozenset[int]:
    """Interfaces of the patches where the proof fails; all when it names none."""
    patches = {cell.patch for cell in certificate.cells}
    near = {i for i, f in enumerate(topology.interfaces) if patches & {f.patch_a, f.patch_b}}
    return frozenset(near or range(len(topology.interfaces)))


def rows_summary(
    topology: Topology, space: RowSpace, points: FloatArray, released: Collection[Spoke] = ()
) -> ActiveRows:
    """What the rows of a space are and how well a map satisfies them."""
    diameter = float(np.linalg.norm(np.ptp(points, axis=0)))
    ends = []
    for spoke in sorted(released, key=lambda s: (s.interface, s.at_end)):
        directed = topology.directed_interfaces[spoke.interface]
        along = directed.points(topology.points[directed.patch])
        x, y = points[along[-1 if spoke.at_end else 0]].tolist()
        ends.append((spoke.interface, (x, y)))
    return ActiveRows(
        active=len(space.rows),
        residual=space.residual(points) / diameter,
        left_out=space.rows.left_out,
        released=tuple(ends),
        without=space.rows.without,
        contradictory=tuple(sorted(space.contradictory)),
        space=space,
    )
