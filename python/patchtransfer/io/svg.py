"""SVG: every closed outline that is drawn is a boundary loop.

The y axis is flipped, so that pictures are upright. Which shapes are drawn, and where, is found in `svg_tree`, their
curves in `svg_paths`. Outlines may come in pieces, as programs for CAD write them, a path an edge: pieces whose ends
meet are chained. A filled path is closed by its filling, with a straight line; a path that is only stroked is an
outline if nothing is filled, and decoration if something is.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from ..geometry.boundary import Boundary
from ..geometry.curve import BSplineCurve
from ..limits import MAX_CURVES, MAX_LOOPS, at_most
from ..numeric.components import components
from ..numeric.dense import svd
from .cleaning import NEGLIGIBLE, cleaned, mended
from .loops import TOLERANCE, chain, close_loop, vertices
from .options import DEFAULT, BoundaryOptions
from .safe_xml import local_name, parse_xml
from .svg_paths import Segment
from .svg_tree import Drawing

__all__ = ["read_boundary"]

#: Lengths (relative to the diameter) that rounding can leave over.
ROUNDING = 1e-12

STROKED = "only stroked, beside what is filled"


@dataclass(frozen=True)
class _Outline:
    """Curves in a row, closed or a piece; `number` is the place in the document."""

    name: str
    curves: list[BSplineCurve]
    filled: bool
    number: int

    @property
    def flat(self) -> bool:
        """Whether a line would close it to nothing."""
        points = np.concatenate([c.control_points for c in self.curves])
        size = float(np.linalg.norm(np.ptp(points, axis=0)))
        return bool(svd(points - points[0])[1][1] <= TOLERANCE * size)


def read_boundary(data: bytes, options: BoundaryOptions = DEFAULT) -> Boundary:
    """Boundary of an SVG picture; see `patchtransfer.read_boundary`."""
    root = parse_xml(data)
    if local_name(root) != "svg":
        raise InputError(f"the root element is <{local_name(root)}>, not <svg>; save the picture as plain SVG")
    drawing = Drawing(root, options.layers)
    notes: list[str] = []
    found: list[tuple[str, list[Segment], bool, bool]] = []
    count = 0
    for shape in drawing.shapes():
        for k, run in enumerate(shape.subpaths):
            name = shape.name if k == 0 else f"{shape.name}, subpath {k + 1}"
            found.append((name, run.segments, run.closed, shape.filled))
            count += len(run.segments)
            at_most(count, MAX_CURVES, "path segments", "simplify the paths")
            at_most(len(found), MAX_LOOPS, "subpaths and shapes", "keep those of the domain")
    if not found:
        raise _nothing(drawing)
    points = np.concatenate([c for _, segments, _, _ in found for _, _, c in segments])
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    closed: list[_Outline] = []
    pieces: list[_Outline] = []
    for number, (name, segments, ends, filled) in enumerate(found):
        outline = _Outline(name, _curves(name, segments, size, notes), filled, number)
        if not outline.curves:
            if not options.clean:
                raise InputError(f"{name} has no length; delete it")
            notes.append(f"{name} has no length and is left out")
            continue
        meet = np.linalg.norm(outline.curves[-1].end - outline.curves[0].start) <= TOLERANCE * size
        (closed if ends or meet else pieces).append(outline)
    joined = _loops(closed, pieces, size, drawing, notes, options.clean)
    if not joined:
        raise _nothing(drawing)
    loops = [close_loop(loop.curves) for loop in sorted(joined, key=lambda loop: loop.number)]
    if options.clean:
        loops = cleaned(loops, notes)
    return Boundary(loops, [*notes, *drawing.notes()])


def _nothing(drawing: Drawing) -> InputError:
    why = "; ".join(drawing.notes())
    return InputError(f"holds no closed path; draw the outline as <path> or a shape{f' ({why})' if why else ''}")


def _curves(name: str, segments: list[Segment], size: float, notes: list[str]) -> list[BSplineCurve]:
    """Curves of segments that have a length; a note tells of the others."""
    lengths = np.array([np.linalg.norm(np.ptp(c, axis=0)) for _, _, c in segments])
    try:
        curves = [
            BSplineCurve(*segment)
            for segment, length in zip(segments, lengths, strict=True)
            if not length <= NEGLIGIBLE * size
        ]
    except InputError as error:
        raise InputError(f"{name}: {error}") from None
    # A closing command leaves over what rounding made of the last point; that was not drawn.
    drawn = lengths[:-1] if lengths[-1] <= ROUNDING * size else lengths
    short = drawn[drawn <= NEGLIGIBLE * size]
    if curves and len(short):
        notes.append(
            f"left out {len(short)} segments of {name}, the longest of {short.max():.3g}: they are shorter than "
            f"{NEGLIGIBLE:g} of the diameter"
        )
    return curves


def _loops(
    closed: list[_Outline], pieces: list[_Outline], size: float, drawing: Drawing, notes: list[str], clean: bool
) -> list[_Outline]:
    """Closed outlines: those that are, those chained of pieces, and those that their filling closes."""
    if clean:
        pieces = _mended(pieces, notes)
    chained, rest = _chained(pieces, TOLERANCE * size, notes)
    # Lines that touch filled pieces do not keep these from closing.
    lines = [piece for piece in rest if not piece.filled or piece.flat]
    filled, rest = _chained([piece for piece in rest if piece.filled and not piece.flat], TOLERANCE * size, notes)
    loops = closed + chained + filled
    for group in _touching(rest, TOLERANCE * size):
        if len(group) > 1:
            _refuse(group, TOLERANCE * size)
        (piece,) = group
        last, first = piece.curves[-1].end, piece.curves[0].start
        line = BSplineCurve([0.0, 0.0, 1.0, 1.0], 1, [last, first])
        notes.append(f"closed {piece.name} by a line of {np.linalg.norm(last - first):.3g}, as its filling is")
        loops.append(replace(piece, curves=[*piece.curves, line]))
    if lines and not loops:
        _refuse(lines, TOLERANCE * size)
    for piece in lines:
        drawing.leave_out(piece.name, "open, a line beside the outlines")
    if any(loop.filled for loop in loops):
        for loop in loops:
            if not loop.filled:
                drawing.leave_out(loop.name, STROKED)
        loops = [loop for loop in loops if loop.filled]
    return loops


def _mended(pieces: list[_Outline], notes: list[str]) -> list[_Outline]:
    """Pieces with small gaps between their ends closed."""
    if not pieces:
        return []
    _, flat = mended(*_flat(pieces), notes)
    rest = iter(flat)
    return [replace(piece, curves=[next(rest) for _ in piece.curves]) for piece in pieces]


def _flat(pieces: list[_Outline]) -> tuple[list[str], list[BSplineCurve]]:
    return [piece.name for piece in pieces for _ in piece.curves], [c for piece in pieces for c in piece.curves]


def _touching(pieces: list[_Outline], tolerance: float) -> list[list[_Outline]]:
    """Groups of pieces with common end points, in the order of their first ones."""
    if not pieces:
        return []
    ends = vertices([_chord(piece) for piece in pieces], tolerance)
    first: dict[int, int] = {}
    pairs = [(i, first.setdefault(v, i)) for i, pair in enumerate(ends) for v in pair]
    label = components(len(pieces), *np.array(pairs).T).tolist()
    groups: dict[int, list[_Outline]] = defaultdict(list)
    for piece, group in zip(pieces, label, strict=True):
        groups[group].append(piece)
    return list(groups.values())


def _chord(piece: _Outline) -> BSplineCurve:
    return BSplineCurve([0.0, 0.0, 1.0, 1.0], 1, [piece.curves[0].start, piece.curves[-1].end])


def _chained(pieces: list[_Outline], tolerance: float, notes: list[str]) -> tuple[list[_Outline], list[_Outline]]:
    """Loops of pieces at whose every end two meet, and the other pieces."""
    loops, rest = [], []
    for group in _touching(pieces, tolerance):
        meeting = Counter(v for pair in vertices([_chord(p) for p in group], tolerance) for v in pair)
        if set(meeting.values()) != {2}:
            rest += group
            continue
        (curves,) = chain(*_flat(group), tolerance)
        filled, first = any(piece.filled for piece in group), group[0]
        loops.append(_Outline(first.name, curves, filled, first.number))
        if len(group) > 1:
            notes.append(f"joined {len(group)} pieces to a loop: {first.name} to {group[-1].name}")
    return loops, rest


def _refuse(pieces: list[_Outline], tolerance: float) -> None:
    """Raise the error of pieces that do not close."""
    if len(pieces) == 1:
        (piece,) = pieces
        gap = float(np.linalg.norm(piece.curves[-1].end - piece.curves[0].start))
        why = "" if piece.filled else " and only stroked"
        raise InputError(f"{piece.name} is open{why}, its ends are {gap:.3g} apart; close the path or join its pieces")
    chain(*_flat(pieces), tolerance)
    raise AssertionError("pieces that do not close were chained")
