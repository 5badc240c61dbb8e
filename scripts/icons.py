"""Icons by formula, in variants that different people could have drawn: keys, puzzle pieces, houses, bottles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from curves import Loop, bulged, ellipse, rectangle

Vertex = tuple[float, float, float]


def key(bow: float, eye: float, shaft: float, length: float, teeth: Sequence[Vertex], tip: float = 0.0) -> list[Loop]:
    """Radii of bow and eye, half width and end of the shaft; place, width, depth of every tooth; length of the tip."""
    neck = float(np.sqrt(bow**2 - shaft**2))
    outline = [(neck, shaft, float(np.tan((2 * np.pi - 2 * np.arcsin(shaft / bow)) / 4))), (neck, -shaft, 0.0)]
    for at, width, depth in teeth:
        low = -shaft - depth
        outline += [(at, -shaft, 0.0), (at, low, 0.0), (at + width, low, 0.0), (at + width, -shaft, 0.0)]
    outline += [(length, -shaft, 0.0), *([(length + tip, 0.0, 0.0)] if tip else []), (length, shaft, 0.0)]
    return [bulged(outline), ellipse(eye, eye, (-0.1 * bow, 0.0))]


def puzzle(sides: Sequence[int], neck: float, head: float, middle: float = 0.5, height: float = 1.0) -> list[Loop]:
    """Tab (1), blank (-1) or nothing (0) on each side; width of necks, radius of heads, their place on the side."""
    corners = np.array([(0, 0), (1, 0), (1, height), (0, height)], float)
    bulge = float(np.tan((2 * np.pi - 2 * np.arcsin(neck / 2 / head)) / 4))
    outline: list[Vertex] = []
    for kind, a, b in zip(sides, corners, np.roll(corners, -1, axis=0), strict=True):
        outline.append((*a.tolist(), 0.0))
        if kind:
            way = (b - a) / np.linalg.norm(b - a)
            at = a + middle * (b - a)
            outline += [(*(at - neck / 2 * way).tolist(), kind * bulge), (*(at + neck / 2 * way).tolist(), 0.0)]
    return [bulged(outline)]


def house(
    width: float,
    wall: float,
    roof: float,
    eaves: float = 0.0,
    door: tuple[float, float] | None = None,
    chimney: tuple[float, float, float] | None = None,
    window: float = 0.0,
) -> list[Loop]:
    """Half width, heights of wall and roof, overhang; width and height of a door; place, width, height of a chimney."""
    slope = roof / (width + eaves)
    outline = [(-width, 0.0)]
    if door:
        half, top = door[0] / 2, door[1]
        outline += [(-half, 0.0), (-half, top), (half, top), (half, 0.0)]
    outline += [(width, 0.0), (width, wall)]
    if eaves:
        outline.append((width + eaves, wall))
    ridge = wall + roof
    if chimney:
        left, breadth, top = chimney
        right = left + breadth
        outline += [(right, ridge - slope * right), (right, ridge + top)]
        outline += [(left, ridge + top), (left, ridge - slope * left)]
    outline.append((0.0, ridge))
    outline += [(-width - eaves, wall), (-width, wall)] if eaves else [(-width, wall)]
    loops = [bulged([(x, y, 0.0) for x, y in outline])]
    if window:
        opening = rectangle(window, window)
        loops.append([c.with_control_points(c.control_points + np.array([0.0, wall])) for c in opening])
    return loops


def bottle(
    body: float,
    wall: float,
    neck: float,
    rise: float,
    height: float,
    shoulder: float,
    foot: float = 0.0,
    lip: float = 0.0,
) -> list[Loop]:
    """Half widths of body and neck; heights of wall, shoulder and all; bulge of the shoulder; rounding and overhang."""
    # The tangent of an eighth of a turn rounds a right angle.
    right = [(body - foot, 0.0, float(np.tan(np.pi / 8))), (body, foot, 0.0)] if foot else [(body, 0.0, 0.0)]
    right += [(body, wall, shoulder), (neck, wall + rise, 0.0)]
    if lip:
        rim = height - 2 * lip
        right += [(neck, rim, 0.0), (neck + lip, rim, 0.0), (neck + lip, height, 0.0)]
    else:
        right.append((neck, height, 0.0))
    # Going down again an arc's bulge stands at its other end.
    bulges = [0.0, *(bulge for _, _, bulge in reversed(right[:-1]))]
    left = [(-x, y, bulge) for (x, y, _), bulge in zip(reversed(right), [*bulges[1:], 0.0], strict=True)]
    return [bulged(right + left)]


#: Kinds of icons, each with its variants; neighbours in a list are pairs.
ICONS: dict[str, list[list[Loop]]] = {
    "key": [
        key(1.0, 0.45, 0.25, 4.0, [(2.6, 0.3, 0.5), (3.4, 0.3, 0.7)], 0.3),
        key(1.3, 0.7, 0.2, 3.6, [(2.4, 0.25, 0.4), (3.0, 0.35, 0.5)], 0.2),
        key(0.9, 0.3, 0.3, 3.2, [(1.8, 0.3, 0.35), (2.4, 0.3, 0.35)]),
        key(1.1, 0.5, 0.22, 4.2, [(2.2, 0.3, 0.5), (2.9, 0.3, 0.4), (3.6, 0.3, 0.6)], 0.25),
    ],
    "puzzle": [
        puzzle((-1, 1, 0, 0), 0.2, 0.15),
        puzzle((-1, 1, 0, 0), 0.26, 0.17, 0.42, 0.9),
        puzzle((-1, 1, -1, 1), 0.2, 0.14),
        puzzle((-1, 1, -1, 1), 0.24, 0.16, 0.55, 1.15),
    ],
    "house": [
        house(1.0, 1.0, 0.9, door=(0.5, 0.7)),
        house(1.2, 0.8, 0.7, door=(0.4, 0.6)),
        house(1.0, 1.1, 1.0, 0.25, door=(0.6, 0.8)),
        house(1.0, 1.0, 0.8, 0.2, (0.5, 0.6), (0.45, 0.25, -0.05)),
        house(1.1, 1.0, 0.9, 0.0, None, None, 0.7),
        house(1.0, 1.2, 0.6, 0.0, None, None, 0.5),
    ],
    "bottle": [
        bottle(1.0, 2.6, 0.35, 0.7, 4.4, 0.35),
        bottle(0.8, 2.8, 0.3, 0.5, 4.6, 0.41),
        bottle(1.0, 2.4, 0.3, 0.7, 4.4, 0.3, 0.15),
        bottle(0.9, 2.6, 0.3, 0.8, 4.6, 0.3, 0.2, 0.12),
    ],
}
