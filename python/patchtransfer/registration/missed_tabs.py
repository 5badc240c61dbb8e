"""Tabs of the target where the source's boundary is straight: no side reaches into them, and none can be made to."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from ..geometry.outline import Outline
from ..numeric.arrays import FloatArray, IntArray
from .sampled_boundary import image_of

__all__ = ["MissedTab", "missed_tabs", "tab_text"]

#: Sides longer than their chord by this factor are not straight.
STRAIGHT = 1.02
#: Arc of the target over its chord: a half-circle's. Of 210 directions between drawings of the same kind only tabs and
#: serifs, whose corners splitting serves, are above on straight sides and come back as well.
DEEP = 1.5
#: Angle by which the target turns there and turns back. A tab with parallel sides has 360 degrees; a bend, a bulge or a
#: limb has none, for it only turns; a step or a serif, which goes on beside the side, has 180.
BACK = np.radians(270.0)
#: Chords shorter than this part of a loop are none: a loop of one side has its ends in one place.
NO_CHORD = 1e-9
#: Samples of an arc that is looked at, one of them in its middle.
SAMPLES = 201


@dataclass(frozen=True)
class MissedTab:
    """A tab of the target, or a notch, that is matched to a straight part of the source's boundary.

    Attributes
    ----------
    x, y : float
        Its tip, in the target's unit.
    loop : int
        Boundary loop of the source, the outer one first.
    stretch : float
        Length of the target's boundary there over the distance of its ends; of the source's boundary it is 1.
    """

    x: float
    y: float
    loop: int
    stretch: float

    def to_dict(self) -> dict[str, float]:
        """All of it, ready for JSON."""
        return asdict(self)


def missed_tabs(
    source: Outline, target: Outline, anchors: FloatArray, k: int, cornered: Collection[int]
) -> list[MissedTab]:
    """Tabs of a target loop on straight sides of the source, or on two in a line.

    Parameters
    ----------
    source, target : Outline
    anchors : (m + 1, 2) array
        Of their registration.
    k : int
        Number of the loop.
    cornered : collection of int
        Sides with corners of the target inside: splitting the source makes joints there.

    Returns
    -------
    list of MissedTab
        The deepest ones first, none on a side of another.
    """
    n = len(source.curves)
    joints = np.concatenate([source.joints, source.length + source.joints[1:]])
    images = image_of(anchors, source.joints)
    images = np.concatenate([images, target.length + images[1:]])
    places, at = source.point(joints % source.length), target.point(images % target.length)
    deep: list[tuple[float, tuple[int, ...]]] = []
    for count in (1, 2) if n > 2 else (1,):
        first, last = np.arange(n), np.arange(n) + count
        straight = joints[last] - joints[first] <= STRAIGHT * _distance(places, first, last)
        chord = np.maximum(_distance(at, first, last), NO_CHORD * target.length)
        stretch = (images[last] - images[first]) / chord
        for i in np.flatnonzero(straight & (stretch >= DEEP)).tolist():
            sides = tuple((i + j) % n for j in range(count))
            if not any(side in cornered for side in sides) and _turns_back(target, images[i], images[i + count]):
                deep.append((float(stretch[i]), sides))
    found, taken = [], set[int]()
    for stretch_of, sides in sorted(deep, reverse=True):
        if taken.isdisjoint(sides):
            taken.update(sides)
            x, y = _tip(target, images[sides[0]], images[sides[0] + len(sides)])
            found.append(MissedTab(x, y, k, stretch_of))
    return found


def _distance(points: FloatArray, first: IntArray, last: IntArray) -> FloatArray:
    return np.asarray(np.hypot(*(points[last] - points[first]).T))


def _turns_back(target: Outline, start: float, end: float) -> bool:
    """Whether the target turns to one side and back again between two arc lengths, by as much as at a tab."""
    tangent = target.tangent(start + (np.arange(SAMPLES) + 0.5) / SAMPLES * (end - start))
    angle = np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0]))
    return bool(abs(np.diff(angle)).sum() - abs(angle[-1] - angle[0]) >= BACK)


def _tip(target: Outline, start: float, end: float) -> tuple[float, float]:
    """The point between two arc lengths that is farthest from the chord."""
    points = target.point(np.linspace(start, end, SAMPLES) % target.length)
    chord = points[-1] - points[0]
    off = points - points[0]
    x, y = points[abs(chord[0] * off[:, 1] - chord[1] * off[:, 0]).argmax()].tolist()
    return x, y


def tab_text(tabs: Sequence[MissedTab]) -> str:
    """What to tell the user about tabs: the deepest one, and what to do."""
    tab = max(tabs, key=lambda tab: tab.stretch)
    more = f", and {len(tabs) - 1} more like it," if len(tabs) > 1 else ""
    return (
        f"the target has a tab at ({tab.x:.4g}, {tab.y:.4g}){more} that no side of the source reaches: its outline is "
        f"{tab.stretch:.2g} times as long there as the way across, where the source is straight; take a source with "
        "such a part, as parameterize makes one from the target itself, or give landmarks that bring joints to it"
    )
