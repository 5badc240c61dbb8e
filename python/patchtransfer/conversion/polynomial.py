"""`to_polynomial`: the domain of a rational model, but for a tolerance, by polynomial patches.

Every side that weights bend is fitted to its own shape (`arcs`), on the fewest functions that its strip needs
(`spaces`); patches follow their sides (`inside`), and the outcome is proved injective as any other model.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InputError
from ..geometry.multipatch import MultiPatch
from ..geometry.outline import Outline
from ..geometry.sides import Side
from ..geometry.strips import Strip, strips
from ..geometry.topology import BoundarySide
from ..proof.certificate import Certificate, certify
from ..proof.source_corners import certify_straight
from .inside import is_polynomial, polynomial_patch
from .spaces import Edge, Fitted, Space, edge_of, from_space, least_space, space_of

__all__ = ["Converted", "to_polynomial"]

#: Units of roundoff of the largest coordinate below which no tolerance can be kept.
ROUNDING = 64.0
#: How often knots are inserted where the proof fails.
ROUNDS = 4


@dataclass(frozen=True, repr=False)
class Converted:
    """Outcome of `to_polynomial`.

    Attributes
    ----------
    multipatch : MultiPatch
        Polynomial, with the patches' numbers, interfaces, identifiers, labels and other blocks.
    loss : float
        Largest distance of the boundary from what it was, either way, in units of the domain's diameter.
    inside : float
        The same of the interfaces.
    certificate : Certificate
        Of the outcome: injective.
    notes : tuple of str
        What was done to which strip of patches.
    """

    multipatch: MultiPatch
    loss: float
    inside: float
    certificate: Certificate
    notes: tuple[str, ...]

    def __repr__(self) -> str:
        points = self.multipatch.topology.n_points
        return f"<Converted: {points} control points, loss {self.loss:.1e} of the diameter, {self.certificate.status}>"

    def __str__(self) -> str:
        inside = f" (interfaces {self.inside:.1e})" if self.inside > self.loss else ""
        points = self.multipatch.topology.n_points
        return f"made polynomial: {points} control points, boundary off by {self.loss:.1e} of the diameter{inside}"

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON: loss, inside, certificate, notes."""
        return {
            "loss": self.loss,
            "inside": self.inside,
            "certificate": self.certificate.to_dict(),
            "notes": list(self.notes),
        }


def to_polynomial(multipatch: MultiPatch, tolerance: float = 1e-6) -> Converted:
    """Make a rational (NURBS) model polynomial: the same domain but for a tolerance, certified injective.

    Shapes are fitted, not parameters: a side that weights bend gets the polynomial nearest to its shape, with the same
    ends and tangents, of degree 3 or 4 and with more knots where that is not enough, in whole strips of patches. All
    else stays as it is: sides that are polynomial already or straight, polynomial patches (on more functions, where
    their strip needs them), corners, interfaces to the bit, identifiers, labels and blocks. Inside a rational patch
    the map is that of the source by least squares, moved along with its sides.

    Parameters
    ----------
    multipatch : MultiPatch
        Certified injective; polynomial patches among the others are welcome.
    tolerance : float, default 1e-6
        Largest distance of boundary and interfaces from what they were, in units of the diameter (the diagonal of the
        outer boundary's bounding box).

    Returns
    -------
    Converted

    Raises
    ------
    InputError
        On a tolerance that is not positive or within rounding; on a model that is not certified; where the tolerance
        is not reached, saying what is reached, and where.

    Examples
    --------
    >>> from patchtransfer import MultiPatch, Patch, to_polynomial
    >>> knots, w = [0, 0, 0, 1, 1, 1], 0.5**0.5
    >>> arc = [[1, 0], [1, 1], [0, 1]]
    >>> ring = [[[x, y], [2 * x, 2 * y]] for x, y in arc][::-1]
    >>> quarter = Patch((knots, [0, 0, 1, 1]), (2, 1), ring, [[1, 1], [w, w], [1, 1]])
    >>> made = to_polynomial(MultiPatch([quarter]))
    >>> made.multipatch[0].degrees, made.loss < 1e-6
    ((4, 1), True)
    """
    if not 0 < tolerance < np.inf:
        raise InputError(f"to_polynomial: the tolerance is a part of the diameter above 0, not {tolerance!r}")
    if not multipatch.is_rational:
        return Converted(multipatch, 0.0, 0.0, certify(multipatch), ())
    source, certificate, notes = certify_straight(multipatch.with_shared_points(multipatch.topology.coordinates))
    if not certificate.injective:
        raise InputError(
            f"to_polynomial: the model is not an injective parameterization: {'; '.join(certificate.reasons)}"
        )
    diameter = Outline(source.boundary().loops[0]).diameter
    rounding = ROUNDING * float(np.spacing(max(np.abs(p.control_points).max() for p in source)))
    if tolerance * diameter < rounding:
        raise InputError(
            f"to_polynomial: a tolerance of {tolerance:g} of the diameter is within the rounding of the coordinates; "
            f"take at least {rounding / diameter:.1e}"
        )
    conversion = _Conversion(source, tolerance, diameter)
    made, certificate, moved = conversion.certified()
    loss, inside = conversion.losses()
    return Converted(made, loss, inside, certificate, (*notes, *conversion.notes(), *moved))


class _Conversion:
    """The strips of a source with their sides, and the spaces found for them."""

    def __init__(self, source: MultiPatch, tolerance: float, diameter: float) -> None:
        self.source, self.tolerance, self.diameter = source, tolerance, diameter
        self.limit = tolerance * diameter
        self.polynomial = [is_polynomial(patch) for patch in source]
        # Of the two sides of an interface the first is fitted.
        self.twin = {(f.patch_b, f.side_b): f for f in source.interfaces}
        self.strips = strips(source.topology)
        self.strip_of = {member: i for i, strip in enumerate(self.strips) for member in strip.members}
        self.own = [self._own(strip) for strip in self.strips]
        self.sides = [self._sides(strip) for strip in self.strips]
        self.edges = [
            [self._edge(k, side, strip.members[k, side.axis]) for k, side in sides]
            for strip, sides in zip(self.strips, self.sides, strict=True)
        ]
        self.found = [self._least(i) for i in range(len(self.strips))]

    def _own(self, strip: Strip) -> Space:
        k, axis = next(iter(strip.members))
        return space_of(self.source[k].knots[axis], self.source[k].degrees[axis])

    def _sides(self, strip: Strip) -> list[tuple[int, Side]]:
        sides = [(k, side) for k, axis in strip.members for side in Side if side.axis == axis]
        return [side for side in sides if side not in self.twin]

    def _edge(self, k: int, side: Side, against: bool) -> Edge:
        return edge_of(BoundarySide(k, side, False).curve(self.source.patches), against)

    def _least(self, i: int) -> Fitted:
        polynomial = any(self.polynomial[k] for k, _ in self.strips[i].members)
        return self._near(i, least_space(self.own[i], self.edges[i], polynomial, self.limit))

    def _near(self, i: int, found: Fitted) -> Fitted:
        """The sides of a strip, if they are near enough."""
        if found.worst > self.limit:
            j = int(np.argmax([d.max() for d in found.distances]))
            k, side = self.sides[i][j]
            raise InputError(
                f"to_polynomial: {side.name.lower()} of patch {k} comes no nearer than "
                f"{found.worst / self.diameter:.1e} of the diameter with degree {found.space.degree} and "
                f"{found.space.spans} spans (tolerance {self.tolerance:g}); take a larger tolerance"
            )
        return found

    def certified(self) -> tuple[MultiPatch, Certificate, list[str]]:
        """The polynomial model with its proof; knots are inserted where that fails."""
        for _ in range(ROUNDS):
            made, certificate, notes = certify_straight(self._made())
            if certificate.injective:
                return made, certificate, notes
            self._refine({cell.patch for cell in certificate.cells if cell.kind != "degenerate"})
        raise InputError(
            f"to_polynomial: no injective model within {self.tolerance:g} of the diameter is found, "
            f"{made.topology.n_points} control points were tried: {'; '.join(certificate.reasons)}; take a smaller "
            "tolerance, or insert knots there"
        )

    def _refine(self, patches: Collection[int]) -> None:
        """Halve all spans of the strips through patches; without any, halve the limit."""
        if not patches:
            self.limit /= 2
            self.found = [self._least(i) for i in range(len(self.strips))]
        for i in {self.strip_of[k, axis] for k in patches for axis in (0, 1)}:
            space = self.found[i].space
            finer = space.halved(range(space.spans))
            self.found[i] = self._near(i, from_space(self.own[i], finer, self.edges[i], self.limit))

    def _made(self) -> MultiPatch:
        points = {
            side: given
            for sides, found in zip(self.sides, self.found, strict=True)
            for side, given in zip(sides, found.points, strict=True)
        }
        for place, f in self.twin.items():
            other = points[f.patch_a, f.side_a]
            points[place] = other[::-1] if f.reversed else other
        source = self.source
        patches = [
            polynomial_patch(
                patch,
                (self._space(k, 0, found=True), self._space(k, 1, found=True)),
                (self._space(k, 0), self._space(k, 1)),
                {side: points[k, side] for side in Side},
            )
            for k, patch in enumerate(source)
        ]
        return MultiPatch(patches, source.interfaces, source.ids, source.sides, source.blocks)

    def _space(self, k: int, axis: int, found: bool = False) -> Space:
        """The space of a patch in one direction, its own or what was found for it."""
        i = self.strip_of[k, axis]
        space = self.found[i].space if found else self.own[i]
        return space.turned() if self.strips[i].members[k, axis] else space

    def losses(self) -> tuple[float, float]:
        """Largest distance of boundary sides, and of interfaces, from what they were, in diameters."""
        glued = {(f.patch_a, f.side_a) for f in self.source.interfaces}
        worst = {True: 0.0, False: 0.0}
        for sides, found in zip(self.sides, self.found, strict=True):
            for side, distance in zip(sides, found.distances, strict=True):
                worst[side in glued] = max(worst[side in glued], float(distance.max()) / self.diameter)
        return worst[False], worst[True]

    def notes(self) -> list[str]:
        """What was done to which strip."""
        notes = []
        for strip, own, found in zip(self.strips, self.own, self.found, strict=True):
            space = found.space
            if space != own:
                (k, axis), more = next(iter(strip.members)), len(strip.members) - 1
                name = f"patch {k}, direction {'uv'[axis]}" + (f", and {more} more" if more else "")
                notes.append(
                    f"{name}: degree {own.degree} -> {space.degree}, {own.spans} -> {space.spans} spans, "
                    f"{own.count} -> {space.count} control points"
                )
        return notes
