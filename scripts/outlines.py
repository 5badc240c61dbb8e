"""Outlines to parameterize: named shapes and random ones, all from formulas."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import pairwise

import numpy as np
from curves import Loop, arc, bezier, ellipse, naca, polygon, rectangle, regular, smooth, unit

from patchtransfer import Boundary, examples


def c_shape() -> Boundary:
    """Three quarters of a ring."""
    outer, inner = arc(1.0, np.pi / 4, 7 * np.pi / 4), arc(0.6, 7 * np.pi / 4, np.pi / 4)
    ends = [bezier(np.array([outer.end, inner.start])), bezier(np.array([inner.end, outer.start]))]
    return Boundary([[outer, ends[0], inner, ends[1]]])


def twisted() -> Boundary:
    """A square with a square hole, turned by 30 degrees."""
    return Boundary([rectangle(2, 2), polygon(0.5 * unit(np.radians(75 + 90 * np.arange(4))))])


def six_holes() -> Boundary:
    """A plate of 3 by 2 with six holes."""
    return Boundary([rectangle(3, 2), *(ellipse(0.28, 0.28, (x, y)) for x in (-1, 0, 1) for y in (-0.5, 0.5))])


def gear(teeth: int = 10) -> Loop:
    """Straight teeth."""
    angles = 2 * np.pi * (np.arange(teeth)[:, None] + np.array([-0.28, -0.16, 0.16, 0.28])) / teeth
    return polygon(unit(angles.ravel()) * np.tile([0.78, 1.0, 1.0, 0.78], teeth)[:, None])


def airfoil() -> Boundary:
    """NACA 0012 with a closed trailing edge, in a box."""
    return Boundary([rectangle(4, 2), naca("0012")])


def blob() -> Boundary:
    """A smooth loop of three unequal bumps."""
    a = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    return Boundary([[smooth((1 + 0.25 * np.cos(3 * a) + 0.12 * np.sin(2 * a))[:, None] * unit(a), closed=True)]])


def fish() -> Boundary:
    """A round body and a forked tail."""
    upper = np.array([(0.8, 0.1), (0.3, 0.36), (-0.3, 0.46), (-0.8, 0.28)])
    body = smooth(np.concatenate([upper, [(-1.0, 0.0)], upper[::-1] * [1, -1]]), closed=False)
    tail = np.array([(0.8, -0.1), (1.3, -0.42), (1.15, 0.0), (1.3, 0.42), (0.8, 0.1)])
    return Boundary([[body, *(bezier(np.array(ends)) for ends in pairwise(tail))]])


def sample(name: str) -> Boundary:
    """Outline of a bundled sample's source."""
    return examples.load(name)[0].boundary()


#: Named outlines, the bundled samples first.
NAMED: dict[str, Callable[[], Boundary]] = {
    **{name: partial(sample, name) for name in ("wrench", "rabbit", "human", "frame", "two-hole-plate", "star")},
    "L": lambda: Boundary([polygon([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)])]),
    "C": c_shape,
    "ellipse": lambda: Boundary([ellipse(1.6, 1.0)]),
    "disk": lambda: Boundary([ellipse(1, 1)]),
    "annulus": lambda: Boundary([ellipse(1, 1), ellipse(0.45, 0.45)]),
    "square with hole": lambda: Boundary([rectangle(2, 2), ellipse(0.5, 0.5)]),
    "twisted square hole": twisted,
    "plate with six holes": six_holes,
    "gear": lambda: Boundary([gear()]),
    "gear with hole": lambda: Boundary([gear(), ellipse(0.4, 0.4)]),
    "airfoil": airfoil,
    "octagon": lambda: Boundary([regular(8)]),
    "pentagon": lambda: Boundary([regular(5)]),
    "triangle": lambda: Boundary([regular(3)]),
    "blob": blob,
    "fish": fish,
}


def random_outline(seed: int) -> Boundary:
    """In turn: star polygon, blob with up to three holes, union of cells, loop of smooth pieces between corners."""
    rng = np.random.default_rng(seed)
    return (_star_polygon, _holed_blob, _cells, _half_smooth)[seed % 4](rng)


def _star_polygon(rng: np.random.Generator) -> Boundary:
    share = rng.uniform(1, 2.5, rng.integers(4, 13))
    angles = rng.uniform(0, 2 * np.pi) + 2 * np.pi * np.cumsum(share) / share.sum()
    return Boundary([polygon(rng.uniform(0.4, 1.2, len(share))[:, None] * unit(angles))])


def _holed_blob(rng: np.random.Generator) -> Boundary:
    waves = rng.integers(2, 7)
    a = np.linspace(0, 2 * np.pi, 8 * waves, endpoint=False)
    radius = 1 + rng.uniform(0, 0.25) * np.cos(waves * a + rng.uniform(0, 2 * np.pi))
    loops = [[smooth(radius[:, None] * unit(a) * [rng.uniform(1, 1.5), 1], closed=True)]]
    for k in range(rng.integers(0, 4)):
        # Holes of radius 0.2 at most, 0.42 from the middle and 120 degrees apart, stay clear of each other and outside.
        at, size = 0.42 * unit(np.array([2 * np.pi * k / 3]))[0], rng.uniform(0.07, 0.2)
        if rng.random() < 0.5:
            loops.append(ellipse(size, size, tuple(at)))
        else:
            loops.append(polygon(at + size * unit(rng.uniform(0, 2 * np.pi) + np.pi / 2 * np.arange(4))))
    return Boundary(loops)


def _cells(rng: np.random.Generator) -> Boundary:
    while (loops := _walls(_grown(rng))) is None:
        pass
    return Boundary(loops)


def _grown(rng: np.random.Generator) -> set[tuple[int, int]]:
    """Cells of a grid, each beside one before it."""
    cells = {(0, 0)}
    for _ in range(rng.integers(2, 15)):
        i, j = sorted(cells)[rng.integers(len(cells))]
        di, dj = ((1, 0), (-1, 0), (0, 1), (0, -1))[rng.integers(4)]
        cells.add((i + di, j + dj))
    return cells


def _walls(cells: set[tuple[int, int]]) -> list[Loop] | None:
    """Loops round the cells; None where loops touch in a point."""
    following: dict[tuple[int, int], tuple[int, int]] = {}
    for i, j in cells:
        around = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
        for k, (di, dj) in enumerate([(0, -1), (1, 0), (0, 1), (-1, 0)]):
            if (i + di, j + dj) not in cells:
                if around[k] in following:
                    return None
                following[around[k]] = around[(k + 1) % 4]
    loops = []
    while following:
        corners = [min(following)]
        while (after := following.pop(corners[-1])) != corners[0]:
            corners.append(after)
        x = np.array(corners, float)
        way = np.roll(x, -1, axis=0) - x
        loops.append(polygon(x[(way != np.roll(way, 1, axis=0)).any(axis=1)]))
    return loops


def _half_smooth(rng: np.random.Generator) -> Boundary:
    corners, spans = int(rng.integers(1, 5)), 5
    radius = rng.uniform(0.8, 1.15, corners * spans)
    radius[::spans] *= rng.uniform(1, 1.4)
    x = radius[:, None] * unit(2 * np.pi * np.arange(len(radius)) / len(radius))
    x = np.append(x, x[:1], axis=0)
    return Boundary([[smooth(x[k : k + spans + 1], closed=False) for k in range(0, corners * spans, spans)]])
