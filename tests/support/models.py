"""Sample multi-patches built in code: grids, holes, extraordinary vertices, corners; any degree and knots."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from patchtransfer import MultiPatch, Patch, examples
from patchtransfer.geometry.basis import collocation_matrix, greville
from shapes import turned

#: (u, v) in [0, 1]² to the plane, arrays in, (..., 2) out.
Map = Callable[[np.ndarray, np.ndarray], np.ndarray]


#: Bundled examples without weights.
EXAMPLES = [name for name in examples.EXAMPLES if name not in examples.RATIONAL]


def uniform_knots(degree: int, spans: int) -> np.ndarray:
    return np.concatenate([np.zeros(degree), np.linspace(0, 1, spans + 1), np.ones(degree)])


def interpolated(f: Map, degree: int, spans: int) -> Patch:
    """The spline that agrees with `f` at the Greville points."""
    knots = uniform_knots(degree, spans)
    t = greville(knots, degree)
    inverse = np.linalg.inv(collocation_matrix(knots, degree, t))
    values = f(*np.meshgrid(t, t, indexing="ij"))
    points = np.einsum("ai,bj,ijk->abk", inverse, inverse, values)
    return Patch((knots, knots), (degree, degree), points)


def welded(mp: MultiPatch) -> MultiPatch:
    """Interface points equal to the bit."""
    t = mp.topology
    return mp.with_control_points([t.coordinates[p] for p in t.points])


def build(maps: Sequence[Map], degree: int, spans: int, seed: int | None = 1) -> MultiPatch:
    """Interpolate the maps, turn the patches' parameter directions at random and glue what coincides."""
    patches = [interpolated(f, degree, spans) for f in maps]
    if seed is not None:
        rng = np.random.default_rng(seed)
        patches = [turned(p, *(bool(b) for b in rng.integers(0, 2, 3))) for p in patches]
    return welded(MultiPatch(patches))


def bilinear(a, b, c, d) -> Map:
    """Quadrilateral with corners a (0,0), b (1,0), c (1,1), d (0,1)."""
    a, b, c, d = (np.asarray(x, float) for x in (a, b, c, d))

    def f(u, v):
        u, v = u[..., None], v[..., None]
        return (1 - u) * (1 - v) * a + u * (1 - v) * b + u * v * c + (1 - u) * v * d

    return f


def after(f: Map, warp: Callable[[np.ndarray], np.ndarray]) -> Map:
    return lambda u, v: warp(f(u, v))


def wave(x: np.ndarray) -> np.ndarray:
    """A mild diffeomorphism of the plane, so that no model is made of straight lines only."""
    return x + 0.08 * np.stack([np.sin(1.3 * x[..., 1] + 0.4), np.cos(1.1 * x[..., 0])], axis=-1)


def grid(columns: int = 2, rows: int = 2, degree: int = 2, spans: int = 2, seed: int | None = 1) -> MultiPatch:
    """Bent rectangle of unit cells."""

    def cell(a: int, b: int) -> Map:
        return after(bilinear((a, b), (a + 1, b), (a + 1, b + 1), (a, b + 1)), wave)

    return build([cell(a, b) for a in range(columns) for b in range(rows)], degree, spans, seed)


def plate_with_hole(degree: int = 2, spans: int = 2, seed: int | None = 1) -> MultiPatch:
    """Square with a round hole: eight patches around it, the square's corners at every second joint."""

    def sector(k: int) -> Map:
        def f(u, v):
            angle = np.pi / 4 * (k + u)
            ray = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
            square = ray / np.abs(ray).max(axis=-1, keepdims=True)
            return (1 - v[..., None]) * 0.4 * ray + v[..., None] * square

        return f

    return build([sector(k) for k in range(8)], degree, spans, seed)


def annulus(patches: int = 4, degree: int = 3, spans: int = 2, seed: int | None = 1) -> MultiPatch:
    """Ring between two ellipses, no corners anywhere; one patch glued to itself is possible."""

    def sector(k: int) -> Map:
        def f(u, v):
            angle = 2 * np.pi * (k + u) / patches
            inner = np.stack([0.5 * np.cos(angle), 0.4 * np.sin(angle)], axis=-1)
            outer = np.stack([1.6 * np.cos(angle), np.sin(angle)], axis=-1)
            return (1 - v[..., None]) * inner + v[..., None] * outer

        return f

    return build([sector(k) for k in range(patches)], degree, spans, seed)


def o_grid(degree: int = 3, spans: int = 2, seed: int | None = 1) -> MultiPatch:
    """Ellipse-like disc: an inner quadrilateral and four patches around it, four vertices of valence 3."""
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * [0.6, 0.45]

    def outer(k: int) -> Map:
        def f(u, v):
            inside = (1 - u[..., None]) * corners[k] + u[..., None] * corners[(k + 1) % 4]
            angle = np.pi / 2 * (k + 0.5 + u)
            arc = np.stack([1.5 * np.cos(angle), 1.2 * np.sin(angle)], axis=-1)
            return (1 - v[..., None]) * inside + v[..., None] * arc

        return f

    maps = [bilinear(*corners), *(outer(k) for k in range(4))]
    return build([after(f, wave) for f in maps], degree, spans, seed)


def star(valence: int = 5, degree: int = 3, spans: int = 2, seed: int | None = 1) -> MultiPatch:
    """Regular polygon split into quadrilaterals around a vertex of the given valence."""
    angle = 2 * np.pi * np.arange(2 * valence) / (2 * valence)
    radius = np.where(np.arange(2 * valence) % 2 == 0, 1.0, np.cos(np.pi / valence))
    ring = radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    n = 2 * valence
    maps = [bilinear((0.05, -0.03), ring[2 * k - 1], ring[2 * k], ring[(2 * k + 1) % n]) for k in range(valence)]
    return build([after(f, wave) for f in maps], degree, spans, seed)


def l_shape(degree: int = 2, spans: int = 2, seed: int | None = 1) -> MultiPatch:
    """Three cells around a re-entrant corner."""
    cells = [(0, 0), (1, 0), (0, 1)]
    maps = [bilinear((a, b), (a + 1, b), (a + 1, b + 1), (a, b + 1)) for a, b in cells]
    return build([after(f, wave) for f in maps], degree, spans, seed)


def strip(patches: int, degree: int, spans: int) -> MultiPatch:
    """Unit squares in a row."""
    cells = [bilinear((a, 0), (a + 1, 0), (a + 1, 1), (a, 1)) for a in range(patches)]
    return build(cells, degree, spans, None)


def ring_of_two_layers(patches: int = 5) -> MultiPatch:
    """Two concentric rings of patches: a chord that closes, with regular vertices only."""

    def sector(k: int, layer: int) -> Map:
        def f(u, v):
            angle, radius = 2 * np.pi * (k + u) / patches, 1 + 0.5 * (layer + v)
            return np.stack([1.2 * radius * np.cos(angle), radius * np.sin(angle)], axis=-1)

        return f

    return build([after(sector(k, i), wave) for k in range(patches) for i in (0, 1)], 3, 2)


def jiggled(mp: MultiPatch, seed: int, size: float = 0.02) -> MultiPatch:
    """All interior points moved at random: no smoothness is left."""
    points = mp.topology.coordinates.copy()
    interior = mp.topology.interior_points
    points[interior] += size * mp.diameter * np.random.default_rng(seed).uniform(-1, 1, (len(interior), 2))
    return mp.with_shared_points(points)


def with_freedom(mp: MultiPatch) -> MultiPatch:
    """Degree 3, inner knots of C1."""
    return (mp.elevate(3 - mp.patches[0].degrees[0]) if mp.patches[0].degrees[0] < 3 else mp).reduce_continuity(1)


#: Every model by name, in degrees 2 and 3 with several knot spans.
ALL: dict[str, Callable[[], MultiPatch]] = {
    "grid p2": lambda: grid(2, 2, 2, 3),
    "grid p3": lambda: grid(2, 2, 3, 2),
    "plate with hole p2": lambda: plate_with_hole(2, 3),
    "plate with hole p3": lambda: plate_with_hole(3, 2),
    "annulus p3": lambda: annulus(4, 3, 2),
    "o-grid p2": lambda: o_grid(2, 3),
    "o-grid p3": lambda: o_grid(3, 3),
    "star of valence 5, p3": lambda: star(5, 3, 2),
    "l-shape p2": lambda: l_shape(2, 3),
    "l-shape p3": lambda: l_shape(3, 2),
}

#: Models whose knots leave exact G1 rows some freedom, by name.
SPACES: dict[str, Callable[[], MultiPatch]] = {
    name: (lambda make=make: with_freedom(make())) for name, make in ALL.items()
} | {
    "closed chord": lambda: with_freedom(ring_of_two_layers()),
    "nine cells": lambda: with_freedom(grid(3, 3, 3, 2)),
    "star of valence 6": lambda: with_freedom(star(6, 3, 2)),
    "quartic, C2": lambda: grid(3, 2, 3, 3).elevate(1).reduce_continuity(2),
    "quartic, one span": lambda: o_grid(3, 1).elevate(1),
}
