"""Targets that are mirror images: told by shape, and reached by the source's own mirror image.

Not the target is mirrored but the source, x -> -x, which is exact in floats: the patches keep their u, v, labels and
interfaces and become left-handed.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..errors import TransferError
from ..geometry.boundary import Boundary
from ..geometry.curve import BSplineCurve
from ..geometry.multipatch import MultiPatch
from ..geometry.outline import Outline
from ..geometry.patch import Patch
from ..geometry.topology import Topology
from ..numeric.arrays import FloatArray
from ..registration.lacking_joints import LackingJoint
from ..registration.landmarks import read_landmark_rows
from ..registration.register import Registration, register
from ..registration.sampled_boundary import BoundaryShape
from .result import MIRROR_IMAGE, TransferResult, functions_of_place

__all__ = ["MIRROR_IMAGE", "POOR", "Reflection", "mirrored_rows", "of_own_sides", "reflected", "told"]

#: A target is a mirror image where that lowers the score by more than this factor. Of 210 directions between drawings
#: of the same thing none is below 0.86, and symmetric ones are at 1; of mirrored ones most are below 0.13, J and a key
#: of another style at 0.5 and 0.7.
BETTER = 0.8
#: Shapes that fit with a lower score fit well enough as they are: there symmetric ones differ by rounding and sampling.
GOOD = 1e-3
#: A score above this is worth a look in the mirror although nothing failed: half of drawings of one thing are above it
#: in another style, and hardly any in the same.
POOR = 0.1


class Reflection:
    """The outlines of a source's mirror image, which tell whether a target is one.

    Parameters
    ----------
    outlines : sequence of Outline
        Of the source.
    """

    def __init__(self, outlines: Sequence[Outline]) -> None:
        self._plain = outlines
        self._outlines = [_image(outline) for outline in outlines]

    @cached_property
    def _sampled(self) -> BoundaryShape:
        return BoundaryShape.sample(self._outlines)

    def fits(self, target: Boundary, landmarks: ArrayLike | None, plain: Registration | None) -> bool:
        """Whether the mirror image fits a target clearly better, or landmarks are in its order.

        `plain` is the registration of the source as it is, if that is known.
        """
        try:
            mirrored = register(self._outlines, target, mirrored_rows(landmarks), sampled=lambda: self._sampled)
        except TransferError:
            return False
        try:
            plain = plain or register(self._plain, target, landmarks)
        except TransferError:
            return True
        # The outer loop's score is that of the whole.
        score = plain.loops[0].score
        return score > GOOD and mirrored.loops[0].score < BETTER * score


def _image(outline: Outline) -> Outline:
    curves = [
        BSplineCurve(curve.knots, curve.degree, _reflected(curve.control_points), curve.weights).reversed()
        for curve in reversed(outline.curves)
    ]
    return Outline(curves)


def _reflected(points: FloatArray) -> FloatArray:
    return np.asarray(points * np.array([-1.0, 1.0]))


def reflected(patches: Iterable[Patch]) -> list[Patch]:
    """Mirror images of patches, x -> -x."""
    return [patch.with_control_points(_reflected(patch.control_points)) for patch in patches]


def mirrored_rows(landmarks: ArrayLike | None) -> FloatArray | None:
    """Landmarks of a source as those of its mirror image."""
    if landmarks is None:
        return None
    return np.asarray(read_landmark_rows(landmarks) * np.array([-1.0, 1.0, 1.0, 1.0]))


def of_own_sides(corners: Iterable[LackingJoint], image: Topology, own: Topology) -> list[LackingJoint]:
    """Corners on sides of a source's mirror image as those on the source's own, which its loops pass the other way."""
    place = {(side.patch, side.side): (k, i) for k, loop in enumerate(own.loops) for i, side in enumerate(loop)}
    found = []
    for corner in corners:
        side = image.loops[corner.loop][corner.side]
        loop, number = place[side.patch, side.side]
        parameter = corner.parameter
        if side.reversed != own.loops[loop][number].reversed:
            low, high = own.patches[side.patch].knots[side.side.axis][[0, -1]].tolist()
            parameter = low + high - parameter
        found.append(corner._replace(loop=loop, side=number, parameter=parameter))
    return found


def told(result: TransferResult, source: MultiPatch) -> TransferResult:
    """The result of a source's mirror image as that of the source, with a warning."""
    notes = [
        "the target is a mirror image of the source: the source was mirrored (x -> -x), so that patches that were "
        "right-handed are left-handed"
    ]
    moved = functions_of_place(source)
    notes += [note for note in moved if note not in result.warnings]
    registration = replace(result.registration, mirrored=True)
    return replace(result.with_warnings(notes), registration=registration, mirrored=True)
