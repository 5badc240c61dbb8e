r"""Boundary corners that one patch fills, opened for a second one.

A corner of one patch cannot lie on a smooth place of an outline: the patch's tangents would have to make an angle of
180°. Other patterns of patches have two that meet there: for one corner, A, for two beside each other, A and B, and for
any of the four::

    D---cd-----C        D---d1--c1---C        D-----------C
    |   |  Q3  |        |   |    |   |        | \   Q4  / |
    |Q2 M------bc       |Q1 | Q2 | Q3|        |  m4---m3  |
    |  /   Q1  |        |  m1---m2   |        |Q1| Q5  |Q3|
    A----------B        | /   Q4   \ |        |  m1---m2  |
                        A------------B        | /   Q2  \ |
                                              A-----------B

The outline stays as it is, and so does every point of the neighbours, which are cut through their strips where the
pattern has joints on a side (cd, bc, d1, c1). The last pattern cuts none, but has a patch more at all four corners.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from .conformity.common_splines import with_common_splines
from .conformity.cutting import Pieces
from .conformity.strip_cuts import along_strips
from .multipatch import MultiPatch
from .patch import Patch
from .sides import Interface, Side
from .splitting import Cuts, Origin, SplitModel, origins
from .strips import strips_of
from .templates import Template, filled_in

__all__ = ["open_corners"]

#: Patterns keep this part of the shorter direction of a patch between A and M, d1 and m1 from their sides, but ...
PART = 0.4
#: ... no less than this one of the longer, where neighbours are cut there.
LEAST = 0.15
#: Places are whole multiples of this, so that x and 1 - x are exact numbers.
GRID = 2.0**-10
#: Samples of a side whose length is measured.
SAMPLES = 33


def open_corners(
    multipatch: MultiPatch, patch: int, corners: Collection[int], *, cutting: bool = True
) -> SplitModel | None:
    """The model with boundary corners of one patch opened; None where the patch's strips leave no room for it.

    Parameters
    ----------
    multipatch : MultiPatch
        Polynomial.
    patch : int
    corners : collection of int
        Corners that this patch fills alone.
    cutting : bool, default True
        Whether neighbours may be cut; else the last pattern is taken.

    Returns
    -------
    SplitModel or None
        The first of the new patches keeps number and identifier. Their origins are the smallest ranges that they lie
        in. None where a strip that is to be cut comes back to the patch.
    """
    own = multipatch.patches[patch]
    template = _template(own, sorted(corners), cutting)
    cuts = _cuts_outside(multipatch, patch, template)
    if cuts is None:
        return None
    pieces = Pieces(multipatch.patches, cuts)
    made = filled_in(own, template)
    numbers = [patch, *range(len(pieces.patches), len(pieces.patches) + len(made.patches) - 1)]
    patches = [*pieces.patches, *made.patches[1:]]
    patches[patch] = made.patches[0]
    parts = {(k, side): pieces.on((k, side)) for k in range(len(multipatch)) for side in Side}
    parts |= {(patch, side): [(numbers[i], side) for i, _, _ in template.on(side)] for side in Side}
    interfaces = pieces.glued([f for f in multipatch.interfaces if patch not in (f.patch_a, f.patch_b)])
    for f in multipatch.interfaces:
        if patch in (f.patch_a, f.patch_b):
            a, b = parts[f.patch_a, f.side_a], parts[f.patch_b, f.side_b]
            pairs = zip(a, b[::-1] if f.reversed else b, strict=True)
            interfaces += [Interface(*one, *other, f.reversed) for one, other in pairs]
    interfaces += [
        Interface(numbers[f.patch_a], f.side_a, numbers[f.patch_b], f.side_b, f.reversed) for f in made.interfaces
    ]
    patches, _ = with_common_splines(patches, interfaces)
    opened, lost = multipatch._in_pieces(patches, interfaces, parts)
    opened = opened.with_shared_points(opened.topology.coordinates)
    found = [*origins(multipatch.patches, cuts, pieces), *[Origin(patch, (0, 1), (0, 1))] * (len(numbers) - 1)]
    for number, (x, y) in zip(numbers, made.ranges, strict=True):
        found[number] = Origin(patch, _in_domain(own, 0, x), _in_domain(own, 1, y))
    return SplitModel(opened, tuple(found), parts, lost)


def _template(patch: Patch, corners: list[int], cutting: bool) -> Template:
    """The pattern for some corners of a patch."""
    x, y = _distances(patch)
    if cutting and len(corners) == 1:
        x, y = max(x, LEAST), max(y, LEAST)
        middle, joint, other = (x, y), (1.0, y), (x, 1.0)
        quads = (
            ((0.0, 0.0), (1.0, 0.0), joint, middle),
            ((0.0, 0.0), middle, other, (0.0, 1.0)),
            (middle, joint, (1.0, 1.0), other),
        )
        return Template(quads).flipped(bool(corners[0] & 1), bool(corners[0] & 2))
    if cutting and len(corners) == 2 and sum(corners) != 3:
        # Drawn with A = (0, 0) and B = (1, 0); the two differ in one direction.
        swap = corners[1] - corners[0] == 2
        if swap:
            x, y = y, x
        x = max(x, LEAST)
        four = (
            ((0.0, 0.0), (x, y), (x, 1.0), (0.0, 1.0)),
            ((x, y), (1 - x, y), (1 - x, 1.0), (x, 1.0)),
            ((1 - x, y), (1.0, 0.0), (1.0, 1.0), (1 - x, 1.0)),
            ((0.0, 0.0), (1.0, 0.0), (1 - x, y), (x, y)),
        )
        template = Template(four)
        if swap:
            return template.swapped().flipped(corners[0] == 1, False)
        return template.flipped(False, corners[0] == 2)
    a, b, c, d = (x, y), (1 - x, y), (1 - x, 1 - y), (x, 1 - y)
    return Template(
        (
            ((0.0, 0.0), a, d, (0.0, 1.0)),
            ((0.0, 0.0), (1.0, 0.0), b, a),
            (b, (1.0, 0.0), (1.0, 1.0), c),
            (d, c, (1.0, 1.0), (0.0, 1.0)),
            (a, b, c, d),
        )
    )


def _distances(patch: Patch) -> tuple[float, float]:
    """How far patterns keep from the sides, in parts of u and v: equal lengths, where sides are long and short."""
    lengths = []
    for axis in (0, 1):
        t, middle = np.linspace(*patch.domain[axis], SAMPLES), float(np.mean(patch.domain[1 - axis]))
        points = patch(t, middle) if axis == 0 else patch(middle, t)
        lengths.append(float(np.hypot(*np.diff(points, axis=0).T).sum()))
    x, y = (max(round(PART * min(lengths) / own / GRID), 1) * GRID for own in lengths)
    return x, y


def _cuts_outside(multipatch: MultiPatch, patch: int, template: Template) -> Cuts | None:
    """Cuts through the strips of the neighbours; None where one of them comes back to the patch."""
    beside: list[tuple[int, int]] = []
    wanted: dict[tuple[int, int], list[tuple[None, float]]] = {}
    for f in multipatch.interfaces:
        for own, side, other, there in (
            (f.patch_a, f.side_a, f.patch_b, f.side_b),
            (f.patch_b, f.side_b, f.patch_a, f.side_a),
        ):
            if own == patch:
                places = template.cuts(side)
                if other == patch and places:
                    return None
                beside.append((other, there.axis))
                if places:
                    wanted[other, there.axis] = [(None, 1 - x if f.reversed else x) for x in places]
    if not wanted:
        return {}
    apart = [f for f in multipatch.interfaces if patch not in (f.patch_a, f.patch_b)]
    for strip in strips_of(len(multipatch), apart):
        if strip.members.keys() & wanted and (sum(at in strip.members for at in beside) > 1 or strip.twisted):
            return None
    return along_strips(multipatch.patches, apart, wanted, lambda own, _knots: [place for _, place in own])


def _in_domain(patch: Patch, axis: int, part: tuple[float, float]) -> tuple[float, float]:
    """A range of the unit interval as one of the patch's parameters."""
    first, last = patch.domain[axis]
    a, b = (first + x * (last - first) if 0 < x < 1 else (first, last)[int(x)] for x in part)
    return a, b
