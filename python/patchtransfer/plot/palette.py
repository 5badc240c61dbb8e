"""The colours of all pictures, those that matplotlib draws and those of pages.

One scale from the worst to the best, dark red over ochre to dark blue: neighbours differ in lightness or in blue
against yellow, which the colour-blind tell apart, and most of it is spent above 0.7, where most maps are. `DARK` is for
dark grounds.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

__all__ = ["CLASSES", "DARK", "LIGHT", "Palette", "colours_of_patches", "mixed", "style"]

#: Scaled Jacobians between which lines of a page have one colour; finer towards 1, where most maps are.
CLASSES = (0.0, 0.2, 0.4, 0.6, 0.7, 0.8, 0.9, 0.95)


class Palette(NamedTuple):
    """Colours on one ground.

    Attributes
    ----------
    anchors : tuple of str
        Of the scale, at the bounds of `CLASSES` and at 1.
    folded : str
        Of what is not positive.
    patches : tuple of str
        Tints of patches, of which neighbours have different ones.
    """

    anchors: tuple[str, ...]
    folded: str
    patches: tuple[str, ...]

    def classes(self) -> list[str]:
        """Colours of classes: what is folded first, then those of `CLASSES` from the worst to the best."""
        return [self.folded, *(mixed(low, high, 0.5) for low, high in pairwise(self.anchors))]

    def levels(self, parts: int) -> list[str]:
        """Colours of so many equal parts of every class, from the worst to the best."""
        return [mixed(a, b, (k + 0.5) / parts) for a, b in pairwise(self.anchors) for k in range(parts)]


LIGHT = Palette(
    ("#2b0618", "#5e0f2c", "#98203a", "#c8451c", "#d0800a", "#8c9070", "#569a84", "#2878c8", "#16308c"),
    "#d0006f",
    ("#d3e1f3", "#f6e3bd", "#cfe8d5", "#f3d5e2", "#ded6f2", "#e4e6c8"),
)
DARK = Palette(
    ("#fff6b8", "#ffe07a", "#ffb84e", "#f08a40", "#c9694c", "#9a7c80", "#7390b4", "#62b0ee", "#b9e0ff"),
    "#ff5fc0",
    ("#1f2d40", "#362f1c", "#1f3426", "#38232f", "#2b2547", "#2d301c"),
)


def mixed(a: str, b: str, part: float) -> str:
    """The colour so far on the way from one to another.

    Examples
    --------
    >>> mixed("#000000", "#ffffff", 0.5)
    '#808080'
    """
    channels = [(int(a[k : k + 2], 16), int(b[k : k + 2], 16)) for k in (1, 3, 5)]
    return "#" + "".join(f"{round(x + (y - x) * part):02x}" for x, y in channels)


def style(palette: Palette) -> str:
    """Custom properties of a style sheet: q0, q1, ... of classes, p0, p1, ... of patches."""
    named = [("q", palette.classes()), ("p", palette.patches)]
    return "".join(f"--{kind}{k}:{colour};" for kind, colours in named for k, colour in enumerate(colours))


def colours_of_patches(count: int, pairs: Sequence[tuple[int, int]]) -> list[int]:
    """The number of a tint for each of `count` patches, other than its neighbours' where these leave one.

    Examples
    --------
    >>> colours_of_patches(3, [(0, 1), (1, 2)])
    [0, 1, 2]
    """
    near: list[set[int]] = [set() for _ in range(count)]
    for a, b in pairs:
        near[a].add(b)
        near[b].add(a)
    chosen: list[int] = []
    for k in range(count):
        taken = {chosen[n] for n in near[k] if n < k}
        free = [c for c in range(len(LIGHT.patches)) if c not in taken] or list(range(len(LIGHT.patches)))
        chosen.append(min(free, key=chosen.count))
    return chosen
