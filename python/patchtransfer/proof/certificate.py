"""Stage 9: a proof that a multi-patch is injective, or the places where it fails.

**Theorem.** Let every patch, multiplied by the sign of its orientation, have det J > 0 (except at isolated
points); let glued sides carry the same control points and knots and be traversed in opposite directions, each
patch on its left; and let the loops that remain be simple, pairwise disjoint and nested such that those
inside an even number of others run counter-clockwise and the others clockwise. Then the map of the glued
domain is injective.

*Proof.* A generic point y has, in a patch with det J > 0, as many preimages as the image of the patch's
boundary winds around y (degree of a map). Summed over the patches the glued sides cancel, so y has as many
preimages as the boundary loops wind around it: by their nesting 1 or 0. Two different points x, x' with the
same image, one of them inside the domain, would give generic points near that image two preimages; on the
boundary the loops are simple and disjoint. The knots' lines of low continuity do no harm, since the argument
is applied to each Bézier piece. ∎

All hypotheses are decided in floating point with bounds on the rounding error: what is called proved is
proved for the numbers as they are stored (``docs/rounding.md``), or, where the sides of an interface differ by
rounding, for the common ones that the notes name (`welding`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

from .._core import MAX_DEGREE, certify_loops, certify_patches
from ..errors import InputError
from ..files import finite_or_none
from ..geometry.conformity.weighting import with_common_weights
from ..geometry.conformity.welds import gaps
from ..geometry.curve import BSplineCurve
from ..geometry.mending import OTHER_CURVE, conform_command
from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch
from ..geometry.sides import Interface, Side
from ..geometry.tolerances import exact
from .unglued import unglued
from .welding import Welded, in_own_knots, weld

if TYPE_CHECKING:
    from .._core import CurveTuple

    Chains = list[list[CurveTuple]]

__all__ = ["BoundaryReport", "Cell", "Certificate", "Meeting", "certify", "check_boundary"]

#: Precedence of the outcomes.
STATUSES = ("certified", "degenerate", "undecided", "folded")
#: Reasons listed for patches and loops before the rest is only counted.
MAX_REASONS = 20


@dataclass(frozen=True)
class Cell:
    """A place where det J > 0 is not proved.

    Attributes
    ----------
    patch : int
    kind : str
        "folded" (det J < 0 at `point`, proved), "undecided", or "degenerate" (det J >= 0, zero within the rounding
        of the coordinates at the patch corner `point` and positive elsewhere in the cell, proved).
    bounds : tuple of float
        (u0, u1, v0, v1).
    point : tuple of float
        The corner (u, v) of the cell with the smallest det J; at a knot, its limit from inside the cell.
    value : float
        det J at `point` relative to the patch's mean det J; NaN where numbers overflow.
    within_rounding : bool
        Of an undecided cell: det J < 0 at the patch corner `point`, but by no more than the rounding of the
        coordinates, as of a straight angle that was written down.
    """

    patch: int
    kind: str
    bounds: tuple[float, float, float, float]
    point: tuple[float, float]
    value: float
    within_rounding: bool = False

    def __repr__(self) -> str:
        u, v = self.point
        return f"<Cell: patch {self.patch}, {self.kind} at ({u:.6g}, {v:.6g}), det J = {self.value:.3g} of its mean>"

    @property
    def corner(self) -> int:
        """Which corner of the cell `point` is, numbered like a patch's: (0,0), (1,0), (0,1), (1,1)."""
        return int(self.point[0] == self.bounds[1]) + 2 * int(self.point[1] == self.bounds[3])


@dataclass(frozen=True)
class Meeting:
    """Two places of the boundary that cross, or that could not be proved apart.

    Attributes
    ----------
    kind : str
        "crossing" (proved), "near" (they touch, or nearly so), "cusp" (the boundary turns back on itself, or nearly
        so) or "unfinished" (the search took too many steps and ended here).
    a, b : tuple
        (loop, curve in the loop, parameter on the curve).
    point : tuple of float
        Where, in the plane.
    """

    kind: str
    a: tuple[int, int, float]
    b: tuple[int, int, float]
    point: tuple[float, float]

    def __repr__(self) -> str:
        (k, i, _), (m, j, _), (x, y) = self.a, self.b, self.point
        return f"<Meeting: {self.kind}, loop {k} curve {i} and loop {m} curve {j} at ({x:.6g}, {y:.6g})>"

    def __str__(self) -> str:
        x, y = self.point
        (k, i, s), (m, j, t) = self.a, self.b
        where = f"at ({x:.6g}, {y:.6g}): curve {i} at t={s:.6g}, curve {j} at t={t:.6g}"
        if self.kind == "cusp":
            return f"boundary loop {k} turns back on itself, or nearly so, {where}"
        if self.kind == "unfinished":
            return f"the proof that the boundary is simple takes too many steps; it ended {where}"
        crossing = self.kind == "crossing"
        if k == m:
            return f"boundary loop {k} {'crosses' if crossing else 'touches or nearly touches'} itself {where}"
        return f"boundary loops {k} and {m} {'cross' if crossing else 'touch or nearly touch'} {where}"


@dataclass(frozen=True)
class BoundaryReport:
    """What is proved about the boundary loops.

    Attributes
    ----------
    simple : bool or None
        True: all loops simple, disjoint and rightly nested; False: disproved; None: undecided.
    crossings : tuple of Meeting
        Proved crossings first, then places that could not be decided. After 32 crossings no more are looked for.
    orientation : tuple of int
        Of each loop, +1 counter-clockwise, -1 clockwise, 0 undecided.
    around : tuple of (tuple of int or None)
        Of each loop, the loops that wind around it; None if undecided.
    reasons : tuple of str
    """

    simple: bool | None
    crossings: tuple[Meeting, ...]
    orientation: tuple[int, ...]
    around: tuple[tuple[int, ...] | None, ...]
    reasons: tuple[str, ...]
    _chains: Chains | None = field(default=None, repr=False, compare=False)

    def __repr__(self) -> str:
        loops, places = len(self.orientation), len(self.crossings)
        said = {True: "simple", False: "not simple", None: "undecided"}[self.simple]
        where = f", {places} place{'' if places == 1 else 's'} where it is not" if places else ""
        return f"<BoundaryReport: {said}, {loops} loop{'' if loops == 1 else 's'}{where}>"

    def _is_of(self, chains: Chains) -> bool:
        """Whether it is known to be about these curves, bit by bit."""
        return self._chains is not None and _bits(self._chains) == _bits(chains)

    def __getstate__(self) -> dict[str, Any]:
        # The curves are the model's own, and are not sent twice.
        return self.__dict__ | {"_chains": None}


def _bits(chains: Chains) -> list[list[tuple[bytes, int, bytes, bytes | None]]]:
    return [[(k.tobytes(), p, x.tobytes(), None if w is None else w.tobytes()) for k, p, x, w in c] for c in chains]


@dataclass(frozen=True)
class Certificate:
    """Outcome of `certify`.

    Attributes
    ----------
    injective : bool
        Status "certified" or "degenerate": proved injective.
    status : str
        "certified"; "degenerate": injective, but det J, which is proved not to be negative, is zero within the
        rounding of the coordinates at named patch corners; "folded": proved not to be injective; "undecided".
    lower_bound : float
        Proved lower bound of det J relative to the patch's mean det J (|area| / parametric area), the minimum
        over the patches; for a rational patch the mean is a quadrature. Positive when all patches are
        proved, even if something else keeps the status from "certified".
    cells : tuple of Cell
        Failing or degenerate places, at most 32 of a kind and patch, worst first.
    reasons : tuple of str
        Why the status is not "certified", one line each.
    notes : tuple of str
        What the outcome is for where that is not the stored numbers: interfaces whose sides differ by rounding.
    boundary : BoundaryReport
    subdivisions : int
        Number of cells examined beyond the patches' Bézier pieces.
    """

    injective: bool
    status: str
    lower_bound: float
    cells: tuple[Cell, ...]
    reasons: tuple[str, ...]
    notes: tuple[str, ...]
    boundary: BoundaryReport
    subdivisions: int

    def __repr__(self) -> str:
        cells = f", {len(self.cells)} cell{'' if len(self.cells) == 1 else 's'} without" if self.cells else ""
        return f"<Certificate: {self.status}, det J >= {self.lower_bound:.3g} of its mean{cells}>"

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON: injective, status, lower_bound, cells, reasons."""
        return {
            "injective": self.injective,
            "status": self.status,
            "lower_bound": finite_or_none(self.lower_bound),
            "cells": [
                asdict(cell)
                | {"bounds": list(cell.bounds), "point": list(cell.point)}
                | {"value": finite_or_none(cell.value)}
                for cell in self.cells
            ],
            "reasons": list(self.reasons),
            "notes": list(self.notes),
        }

    def __str__(self) -> str:
        if self.status == "certified":
            welded = " (sides that differ by rounding made one)" if self.notes else ""
            return f"certified injective: det J >= {self.lower_bound:.3g} of its mean on every patch{welded}"
        head = "injective, degenerate" if self.injective else f"not certified ({self.status})"
        more = f" (and {len(self.reasons) - 1} more)" if len(self.reasons) > 1 else ""
        return f"{head}: {self.reasons[0]}{more}"


def certify(multipatch: MultiPatch, *, max_depth: int = 20, boundary: BoundaryReport | None = None) -> Certificate:
    """Prove that a multi-patch is injective, or name the places where it is not.

    Every patch's det J is positive if all its Bernstein coefficients are, on Bézier pieces halved as far as
    needed; a negative corner coefficient is a value of det J and disproves it. The boundary loops are proved
    simple and disjoint by separating hulls. Together with conforming interfaces this proves global
    injectivity: a generic point has as many preimages as the boundary winds around it, 1 inside and 0 outside
    (theorem and proof in the module's docstring).

    Parameters
    ----------
    multipatch : MultiPatch
    max_depth : int, default 20
        Halvings of a Bézier piece before it counts as undecided.
    boundary : BoundaryReport, optional
        Known of the boundary, as of another certificate; where it is of other loops they are proved anew.

    Returns
    -------
    Certificate
        Folded takes precedence over undecided, undecided over degenerate, degenerate over certified.

    Raises
    ------
    InputError
        On degrees above 19 or a negative `max_depth`.

    Examples
    --------
    >>> from patchtransfer import MultiPatch, Patch
    >>> knots = ([0, 0, 1, 1], [0, 0, 1, 1])
    >>> certify(MultiPatch([Patch(knots, (1, 1), [[[0, 0], [0, 1]], [[1, 0], [2, 2]]])])).status
    'certified'
    >>> print(certify(MultiPatch([Patch(knots, (1, 1), [[[0, 0], [0, 1]], [[1, 0], [0.3, 0.3]]])])))
    not certified (folded): patch 0 folds at (u, v) = (1, 1): det J = -1.33 of its mean
    """
    if max_depth < 0:
        raise InputError(f"max_depth must not be negative, got {max_depth}")
    for k, patch in enumerate(multipatch.patches):
        if max(patch.degrees) > MAX_DEGREE:
            raise InputError(f"patch {k}: degrees {patch.degrees} exceed {MAX_DEGREE}, the largest certified")
    given, welded = multipatch, weld(multipatch)
    multipatch, notes = welded.multipatch, welded.notes
    topology = multipatch.topology
    proofs = certify_patches(
        [patch.to_core() for patch in welded.patches],
        [float(s) for s in topology.orientation],
        max_depth,
    )
    cells: list[Cell] = []
    findings: list[tuple[str, str]] = []
    positive = []
    for k, (_, sign_agrees, _, found) in enumerate(proofs):
        here = [_cell(k, given.patches[k], welded.patches[k], *cell) for cell in found]
        cells += here
        findings += [(here[0].kind, _patch_reason(here, given.patches[k]))] if here else []
        positive.append(sign_agrees and all(cell.kind == "degenerate" for cell in here))
        if not sign_agrees:
            findings.append(
                (
                    "undecided",
                    f"patch {k}: area and control polygon differ in sign; insert knots on its sides",
                )
            )
    findings += _gluing(welded, positive)
    boundary, verdicts = _boundary(welded, boundary)
    findings += verdicts
    status = max((kind for kind, _ in findings), key=STATUSES.index, default="certified")
    ordered = sorted(findings, key=lambda f: -STATUSES.index(f[0]))
    return Certificate(
        injective=status in ("certified", "degenerate"),
        status=status,
        lower_bound=min(proof[0] for proof in proofs),
        cells=tuple(cells),
        reasons=_shorten([text for _, text in ordered]),
        notes=tuple(notes),
        boundary=boundary,
        subdivisions=sum(proof[2] for proof in proofs),
    )


def _cell(
    k: int,
    given: Patch,
    welded: Patch,
    kind: str,
    bounds: tuple[float, float, float, float],
    point: tuple[float, float],
    value: float,
) -> Cell:
    """A cell of the core in the patch's own parameters."""
    u0, u, u1 = in_own_knots([bounds[0], point[0], bounds[1]], given.knots[0], welded.knots[0])
    v0, v, v1 = in_own_knots([bounds[2], point[1], bounds[3]], given.knots[1], welded.knots[1])
    below = kind == "below rounding"
    return Cell(k, "undecided" if below else kind, (u0, u1, v0, v1), (u, v), value, below)


def _shorten(reasons: list[str]) -> tuple[str, ...]:
    if len(reasons) > MAX_REASONS:
        reasons = [*reasons[:MAX_REASONS], f"... and {len(reasons) - MAX_REASONS} more"]
    return tuple(reasons)


def _patch_reason(cells: Sequence[Cell], patch: Patch) -> str:
    """One line on a patch's worst cell."""
    worst = cells[0]
    u, v = worst.point
    where = f"at (u, v) = ({u:.6g}, {v:.6g})"
    if worst.kind == "folded":
        return f"patch {worst.patch} folds {where}: det J = {worst.value:.3g} of its mean"
    if worst.kind == "degenerate":
        places = ", ".join(f"({c.point[0]:.6g}, {c.point[1]:.6g})" for c in cells)
        return f"patch {worst.patch} is degenerate at its corner (u, v) = {places}: det J = 0 within rounding"
    if worst.within_rounding:
        return (
            f"patch {worst.patch} is undecided {where}: det J = {worst.value:.3g} of its mean there, negative within "
            "the rounding of the coordinates; `patchtransfer refine` moves the control points beside such corners by "
            "an ulp, and so does a transfer with its source"
        )
    collapsed = [s.name.lower() for s in Side if (s.of(patch.control_points) == s.of(patch.control_points)[0]).all()]
    if collapsed:
        return (
            f"patch {worst.patch} is undecided {where}: its {collapsed[0]} side is a single point, so det J = 0 all "
            "along it, and neither sign is proved around it; lay the patches out anew so that no side is a point"
        )
    return (
        f"patch {worst.patch} is undecided {where}: det J = {worst.value:.3g} of its mean there, and neither "
        "sign is proved around it; raise max_depth, or move the control points there"
    )


def _gluing(welded: Welded, positive: Sequence[bool]) -> list[tuple[str, str]]:
    """Collect what speaks against the interfaces; `positive` says where det J > 0 is proved."""
    multipatch = welded.multipatch
    folded_over, findings = multipatch.topology.folded_over, []
    sides = zip(multipatch.interfaces, welded.point_gaps, welded.weight_gaps, welded.knot_gaps, strict=True)
    for i, (f, *sizes) in enumerate(sides):
        if i in folded_over:
            kind = "folded" if positive[f.patch_a] and positive[f.patch_b] else "undecided"
            text = "the patches lie on the same side of it, one folds back on the other"
            findings.append((kind, f"interface {f.name}: {text}"))
        differing = zip(("control points", "weights", "knots"), sizes, strict=True)
        differences = [f"{what} of the two sides differ by {size:.3g}" for what, size in differing if size != 0.0]
        if differences:
            findings.append(
                ("undecided", f"interface {f.name}: {' and '.join(differences)}; {_mend(multipatch.patches, f)}")
            )
    return findings


def _mend(patches: Sequence[Patch], f: Interface) -> str:
    """How to make the sides of an interface agree."""
    (gap,) = gaps(with_common_weights(patches, [f])[0], [f])
    if gap == math.inf:
        return OTHER_CURVE
    return f"run `{conform_command(gap if gap > exact(patches) else 0.0)}`"


def check_boundary(loops: Iterable[Iterable[BSplineCurve]], known: BoundaryReport | None = None) -> BoundaryReport:
    """Prove closed loops simple, disjoint and rightly nested, or say where not.

    Parameters
    ----------
    loops : iterable of iterables of BSplineCurve
        Closed chains; where a curve ends off the next one's start, the latter is taken for both. Loops inside
        an even number of others have the domain on their left when they run counter-clockwise.
    known : BoundaryReport, optional
        Returned as it is if it was made, in this process, of loops that are these to the bit; else it does not count.

    Returns
    -------
    BoundaryReport
    """
    chains = [[(c.knots, c.degree, c.control_points, c.weights) for c in loop] for loop in loops]
    return known if known is not None and known._is_of(chains) else _prove(chains)


def _prove(chains: Chains) -> BoundaryReport:
    meetings, orientation, around, _, _ = certify_loops(chains)
    crossings = tuple(Meeting(kind, a, b, (*point,)) for kind, a, b, point in meetings)
    crossings = tuple(sorted(crossings, key=lambda m: m.kind != "crossing"))
    reasons = [str(meeting) for meeting in crossings]
    wrong = False
    for k, (sense, outer) in enumerate(zip(orientation, around, strict=True)):
        if crossings:
            break  # orientation and nesting are meaningful for simple loops only
        if sense == 0 or outer is None:
            reasons.append(f"boundary loop {k}: its sense or nesting could not be decided")
        elif sense != (1 if len(outer) % 2 == 0 else -1):
            wrong = True
            which = f"inside loop{'s' if len(outer) > 1 else ''} {', '.join(map(str, outer))}" if outer else "outside"
            sense_name = "counter-clockwise" if sense > 0 else "clockwise"
            reasons.append(f"boundary loop {k} lies {which} but runs {sense_name}: the map covers itself")
    simple: bool | None = None if reasons else True
    if wrong or any(m.kind == "crossing" for m in crossings):
        simple = False
    nested = tuple(None if x is None else tuple(x) for x in around)
    return BoundaryReport(simple, crossings, tuple(orientation), nested, _shorten(reasons), chains)


def _boundary(welded: Welded, known: BoundaryReport | None) -> tuple[BoundaryReport, list[tuple[str, str]]]:
    try:
        loops = welded.multipatch.loops
    except InputError as error:
        report = BoundaryReport(None, (), (), (), (str(error),))
        return report, [("undecided", reason) for reason in (*unglued(welded.multipatch, [])[0], str(error))]
    report = check_boundary(([side.curve(welded.patches) for side in loop] for loop in loops), known)
    if report.simple:
        return report, []
    kind = "folded" if report.simple is False else "undecided"
    sides = [[(side.patch, side.side) for side in loop] for loop in loops]
    meetings = [(sides[m.a[0]][m.a[1]], sides[m.b[0]][m.b[1]], m.point) for m in report.crossings]
    named, explained = unglued(welded.multipatch, meetings)
    if not explained:
        return report, [(kind, reason) for reason in (*named, *report.reasons)]
    # What sides have to do with each other says more than all the places where they touch.
    first, *between = (str(report.crossings[i]) for i in sorted(explained))
    others = [str(m) for i, m in enumerate(report.crossings) if i not in explained]
    more = f" (and {len(between)} places more between these sides)" if between else ""
    return report, [(kind, reason) for reason in (*named, *others, first + more)]
