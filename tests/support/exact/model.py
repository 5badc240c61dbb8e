"""An exact opinion on a whole multi-patch, and where a certificate contradicts it."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from exact import jacobian
from exact.loops import LoopsVerdict, examine_loops
from patchtransfer import BSplineCurve, Certificate, MultiPatch, Patch, Side
from patchtransfer.geometry.sides import Interface
from patchtransfer.proof.certificate import Cell

#: Where the sides start and end: corners (i, j) numbered 2 i + j.
ENDS = {Side.WEST: (0, 1), Side.EAST: (2, 3), Side.SOUTH: (0, 2), Side.NORTH: (1, 3)}
#: Sides that a right-handed patch has on their left when run forwards.
FORWARDS = (Side.SOUTH, Side.EAST)


def along(array: np.ndarray, side: Side) -> np.ndarray:
    return {Side.WEST: array[0], Side.EAST: array[-1], Side.SOUTH: array[:, 0], Side.NORTH: array[:, -1]}[side]


def side_curve(patch: Patch, side: Side, backwards: bool) -> BSplineCurve:
    axis = 1 if side in (Side.WEST, Side.EAST) else 0
    weights = None if patch.weights is None else along(patch.weights, side)
    curve = BSplineCurve(patch.knots[axis], patch.degrees[axis], along(patch.control_points, side), weights)
    return Backwards(curve) if backwards else curve


class Backwards:
    """A curve run from its end, with exact knots."""

    def __init__(self, curve: BSplineCurve) -> None:
        self.degree = curve.degree
        self.control_points = curve.control_points[::-1]
        self.weights = None if curve.weights is None else curve.weights[::-1]
        self.knots = np.array([-Fraction(x) for x in curve.knots[::-1].tolist()], dtype=object)


def welded(model: MultiPatch) -> MultiPatch:
    """The model with the means of both sides' inner control points where they differ, rounded once."""
    points = [patch.control_points.copy() for patch in model.patches]
    for f in model.interfaces:
        a, b = along(points[f.patch_a], f.side_a), along(points[f.patch_b], f.side_b)
        b = b[::-1] if f.reversed else b
        for i, d in zip(*np.nonzero(a != b), strict=True):
            a[i, d] = b[i, d] = float((Fraction(float(a[i, d])) + Fraction(float(b[i, d]))) / 2)
    return model.with_control_points(points)


@dataclass(frozen=True)
class Opinion:
    """Exact answers: of every patch, of the interfaces that fold over, of the loops (None where they do not chain)."""

    patches: tuple[jacobian.Verdict, ...]
    folded_over: tuple[int, ...]
    loops: LoopsVerdict | None

    @property
    def injective(self) -> bool | None:
        kinds = {v.kind for v in self.patches}
        simple = self.loops and self.loops.simple
        if "mixed" in kinds or self.folded_over or simple is False:
            return False
        return True if kinds <= {"one sign", "corners"} and simple else None


def opinion(model: MultiPatch) -> Opinion:
    """Examine a model whose interfaces agree to the bit."""
    verdicts = tuple(jacobian.examine(patch) for patch in model.patches)
    if not all(v.sign for v in verdicts):
        return Opinion(verdicts, (), None)
    signs = [v.sign for v in verdicts]

    def backwards(patch: int, side: Side) -> bool:
        return (side in FORWARDS) != (signs[patch] > 0)

    over = tuple(
        i
        for i, f in enumerate(model.interfaces)
        if (backwards(f.patch_a, f.side_a) != f.reversed) == backwards(f.patch_b, f.side_b)
    )
    chains = [] if over else chained(model, backwards)
    if not chains:
        return Opinion(verdicts, over, None)
    loops = [[side_curve(model.patches[k], s, backwards(k, s)) for k, s in chain] for chain in chains]
    return Opinion(verdicts, over, examine_loops(loops))


def chained(model: MultiPatch, backwards) -> list[list[tuple[int, Side]]]:
    """Free sides, each followed by the one that starts at its end; empty if they do not chain into loops."""
    vertex = list(range(4 * len(model.patches)))

    def found(i: int) -> int:
        while vertex[i] != i:
            i = vertex[i]
        return i

    glued = set()
    for f in model.interfaces:
        glued |= {(f.patch_a, f.side_a), (f.patch_b, f.side_b)}
        for a, b in zip(ENDS[f.side_a], ENDS[f.side_b][:: -1 if f.reversed else 1], strict=True):
            vertex[found(4 * f.patch_a + a)] = found(4 * f.patch_b + b)
    starts: dict[int, tuple[tuple[int, Side], int]] = {}
    for k in range(len(model.patches)):
        for side in Side:
            if (k, side) in glued:
                continue
            first, last = (found(4 * k + c) for c in ENDS[side][:: -1 if backwards(k, side) else 1])
            if first in starts:
                return []
            starts[first] = ((k, side), last)
    chains = []
    while starts:
        first = at = next(iter(starts))
        chain = []
        while at in starts:
            side, at = starts.pop(at)
            chain.append(side)
        if at != first:
            return []
        chains.append(chain)
    return chains


@dataclass(frozen=True)
class Disagreement:
    """A claim of the certificate that is refuted: "injective", "folded", "degenerate", "boundary" or "bound"."""

    claim: str
    text: str


def disagreements(model: MultiPatch, certificate: Certificate) -> list[Disagreement]:
    """What a certificate claims and exact arithmetic refutes; empty if nothing."""
    model = welded(model) if certificate.notes else model
    truth = opinion(model)
    wrong = []
    status = certificate.status
    kinds = [v.kind for v in truth.patches]
    if certificate.injective and truth.injective is False:
        loops = truth.loops.reason if truth.loops else "loops not examined"
        claim = "injective" if status == "certified" else "degenerate"
        text = f"{status}, but patches are {kinds}, interfaces {truth.folded_over} fold over; {loops}"
        wrong.append(Disagreement(claim, text))
    if certificate.injective and "zero" in kinds:
        wrong.append(Disagreement("injective", f"{status}, but det J = 0 off the patch corners: {kinds}"))
    if status == "certified" and "corners" in kinds:
        wrong.append(Disagreement("injective", f"certified, but det J = 0 at a corner: {kinds}"))
    if status == "folded" and truth.injective:
        wrong.append(Disagreement("folded", f"folded, but injective: {certificate.reasons[0]}"))
    simple = certificate.boundary.simple
    if simple is not None and truth.loops is not None and truth.loops.simple is (not simple):
        wrong.append(Disagreement("boundary", f"boundary simple: {simple}, but {truth.loops}"))
    for cell in certificate.cells:
        wrong += refuted(cell, model.patches[cell.patch], truth.patches[cell.patch])
    return wrong + bounds(certificate, truth)


def refuted(cell: Cell, patch: Patch, verdict: jacobian.Verdict) -> list[Disagreement]:
    """What is wrong with a cell."""
    place = f"patch {cell.patch} {cell.kind} at {cell.point}"
    if cell.kind == "folded" and verdict.kind in ("one sign", "corners"):
        return [Disagreement("folded", f"{place}, but det J is not negative ({verdict.kind})")]
    if cell.kind != "degenerate":
        return []
    if verdict.kind == "mixed" and negative_in(cell, patch):
        return [Disagreement("degenerate", f"{place}, but det J has both signs in the cell")]
    return []


def negative_in(cell: Cell, patch: Patch) -> bool:
    """Whether det J has both signs in a cell, by its exact coefficients there."""
    u0, u1, v0, v1 = map(Fraction, cell.bounds)
    queue = [p for p in jacobian.det_pieces(patch) if _overlap(p.bounds, (u0, u1, v0, v1))]
    signs = {1 if x > 0 else -1 for x in jacobian.values_at(patch, *cell.point) if x}
    # The cell's own corner mostly shows one sign, and a few cuts the other.
    for _ in range(12):
        for piece in queue:
            for c in range(4):
                u, v = piece.point(c)
                if u0 <= u <= u1 and v0 <= v <= v1 and piece.corner(c):
                    signs.add(1 if piece.corner(c) > 0 else -1)
        if len(signs) == 2:
            return True
        queue = [q for p in queue for q in p.halves() if _overlap(q.bounds, (u0, u1, v0, v1))][:64]
    return False


def _overlap(a: tuple[Fraction, ...], b: tuple[Fraction, ...]) -> bool:
    return a[0] < b[1] and b[0] < a[1] and a[2] < b[3] and b[2] < a[3]


def bounds(certificate: Certificate, truth: Opinion) -> list[Disagreement]:
    """Where the lower bound of det J claims too much."""
    wrong = []
    low = certificate.lower_bound
    for k, verdict in enumerate(truth.patches):
        if low > 0 and verdict.kind in ("mixed", "zero", "corners"):
            wrong.append(Disagreement("bound", f"det J >= {low:.3g} of its mean, but patch {k} is {verdict.kind}"))
        if verdict.mean and verdict.kind == "one sign" and certificate.injective and low > verdict.least / verdict.mean:
            least = float(verdict.least / verdict.mean)
            wrong.append(Disagreement("bound", f"det J >= {low!r} of its mean, but {least!r} in patch {k}"))
    return wrong


def reproducer(model: MultiPatch) -> str:
    """Lines that make the model again, to the bit."""

    def patch(p: Patch) -> str:
        weights = "" if p.weights is None else f", {p.weights.tolist()}"
        return f"Patch({[k.tolist() for k in p.knots]}, {p.degrees}, {p.control_points.tolist()}{weights})"

    def interface(f: Interface) -> str:
        return f"Interface({f.patch_a}, Side({int(f.side_a)}), {f.patch_b}, Side({int(f.side_b)}), {f.reversed})"

    patches = ", ".join(map(patch, model.patches))
    return f"MultiPatch([{patches}], [{', '.join(map(interface, model.interfaces))}])"
