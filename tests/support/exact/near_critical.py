"""Models that are nearly, or just not, injective: seeded generators that walk up to the last bit.

A family takes a random generator and a `Probe`; it hands models to the probe, which may steer it. `FAMILIES` has them
by name.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

from patchtransfer import Interface, MultiPatch, Patch, Side
from shapes import identity

Rng = np.random.Generator
Place = Callable[[np.ndarray], np.ndarray]

#: Steps before the end of a bisection whose models are looked at exactly: the earlier ones are far from critical.
LAST_STEPS = 6


class Probe(Protocol):
    """What families hand their models to."""

    def status(self, model: MultiPatch) -> str:
        """The certificate's status."""

    def check(self, model: MultiPatch) -> None:
        """Compare the certificate with exact arithmetic."""


def clamped(inner: Sequence[float], degree: int) -> list[float]:
    return [0.0] * (degree + 1) + list(inner) + [1.0] * (degree + 1)


def inner_knots(rng: Rng, degree: int, most: int = 2) -> list[float]:
    """Up to `most` knots with multiplicities up to the degree."""
    breaks = np.sort(rng.choice(np.arange(1, 20), rng.integers(0, most + 1), replace=False)) / 20
    return np.repeat(breaks, rng.integers(1, degree + 1, len(breaks))).tolist()


def close_knots(rng: Rng, degree: int) -> list[float]:
    """Two or three knots with gaps from one unit in the last place to 1e-3."""
    knots = [float(rng.choice([0.3, 0.5, 0.7]))]
    for _ in range(rng.integers(1, 3)):
        gap = rng.choice([0.0, 10.0 ** rng.uniform(-15, -3)])
        knots.append(float(max(knots[-1] + gap, math.nextafter(knots[-1], 1))))
    return knots if degree > 1 or rng.random() < 0.5 else knots[:2]


def bent(rng: Rng, most: int = 4, rational: bool = False, knots: Callable = inner_knots) -> Patch:
    """A unit square with random degrees, knots and a moderate bend, mostly injective."""
    degrees = tuple(int(p) for p in rng.integers(1, most + 1, 2))
    vectors = tuple(clamped(knots(rng, p), p) for p in degrees)
    points = identity(vectors, degrees)
    a, b = rng.uniform(-0.2, 0.2, 2)
    points = points + np.stack([a * points[..., 1] ** 2, b * points[..., 0] ** 2], -1)
    points += rng.uniform(-0.04, 0.04, points.shape) / max(degrees)
    weights = None
    if rational:
        spread = rng.choice([0.3, 2.0, 6.0])
        weights = 10.0 ** rng.uniform(-spread, spread, points.shape[:2])
    return Patch(vectors, degrees, points, weights)


def placed(rng: Rng) -> Place:
    """A random affine map: offsets 1e0 to 1e15, scales 2^-1060 to 2^1000, aspect ratios up to 1e10, rotations."""
    kind = rng.choice(["none", "turn", "offset", "scale", "aspect", "mirror"])
    offset, scale, angle = np.zeros(2), np.ones(2), 0.0
    if kind == "turn" or (kind in ("offset", "aspect") and rng.random() < 0.5):
        angle = rng.uniform(0, 2 * np.pi)
    if kind == "offset":
        offset = 10.0 ** rng.integers(0, 16) * rng.choice([-1.0, 0.0, 1.0, 0.7], 2)
    if kind == "scale":
        scale = np.full(2, 2.0 ** rng.choice([-1060, -1030, -1000, -520, -300, 300, 505, 1000]))
    if kind == "aspect":
        scale = np.array([1.0, 10.0 ** rng.uniform(-10, 10)])
    if kind == "mirror" or (kind == "scale" and rng.random() < 0.3):
        scale = scale * [-1.0, 1.0]

    def place(points: np.ndarray) -> np.ndarray:
        x, y = points[..., 0] * scale[0], points[..., 1] * scale[1]
        c, s = (math.cos(angle), math.sin(angle)) if angle else (1.0, 0.0)
        return np.stack([c * x - s * y + offset[0], s * x + c * y + offset[1]], -1)

    return place


def at(place: Place, patches: Sequence[Patch], interfaces: Sequence = ()) -> MultiPatch:
    return MultiPatch([p.with_control_points(place(p.control_points)) for p in patches], interfaces)


def bisect(build: Callable[[float], MultiPatch], good: float, bad: float, probe: Probe) -> None:
    """Check models next to where the certificate turns from proved to not, and to folded.

    `build(good)` should be injective and `build(bad)` not; else only these two are checked.
    """
    for holds in (lambda s: s in ("certified", "degenerate"), lambda s: s != "folded"):
        low, high = good, bad
        if not holds(probe.status(build(low))) or holds(probe.status(build(high))):
            probe.check(build(low))
            probe.check(build(high))
            continue
        for step in range(60):
            middle = 0.5 * (low + high)
            if not min(low, high) < middle < max(low, high):
                break
            model = build(middle)
            if step >= 60 - LAST_STEPS or abs(high - low) <= 2.0**LAST_STEPS * abs(np.spacing(high)):
                probe.check(model)
            low, high = (middle, high) if holds(probe.status(model)) else (low, middle)
        for t in (low, high):
            probe.check(build(t))


def neighbours(rng: Rng, patch: Patch, index: tuple[int, int], place: Place, probe: Probe) -> None:
    """Check the patch with one placed control point moved by a few units in the last place."""
    points = place(patch.control_points)
    for _ in range(3):
        moved = points.copy()
        for d, ulps in enumerate(rng.integers(-2, 3, 2)):
            moved[index][d] += ulps * np.spacing(moved[index][d])
        probe.check(MultiPatch([patch.with_control_points(moved)], ()))


def dragged(rng: Rng, patch: Patch, probe: Probe) -> None:
    """Drag a control point, often a corner across the diagonal, through the model."""
    place = placed(rng)
    n = patch.control_points.shape
    corner = rng.random() < 0.5
    index = (0, 0) if corner else tuple(int(rng.integers(0, n[d])) for d in range(2))
    x, y = patch.control_points[index]
    way = np.array([1.0, 1.0]) if corner else np.array([0.5 - x, 0.5 - y]) + rng.uniform(-0.3, 0.3, 2)

    def build(t: float) -> Patch:
        points = patch.control_points.copy()
        points[index] = points[index] + t * way
        return patch.with_control_points(points)

    found = [0.0]

    def model(t: float) -> MultiPatch:
        found[0] = t
        return at(place, [build(t)])

    bisect(model, 0.0, 2.0, probe)
    neighbours(rng, build(found[0]), index, place, probe)


def polynomial(rng: Rng, probe: Probe) -> None:
    dragged(rng, bent(rng, 6 if rng.random() < 0.15 else 3), probe)


def rational(rng: Rng, probe: Probe) -> None:
    dragged(rng, bent(rng, 2, rational=True), probe)


def knots_close_by(rng: Rng, probe: Probe) -> None:
    patch = bent(rng, 3, knots=close_knots)
    probe.check(MultiPatch([patch], ()))
    points = placed(rng)(identity(patch.knots, patch.degrees))
    probe.check(MultiPatch([patch.with_control_points(points)], ()))


def straight_corners(rng: Rng, probe: Probe) -> None:
    """A quad with a corner of 180 degrees, to the bit or nearly, of any degree."""
    p = int(rng.integers(1, 4))
    knots = clamped([], p)
    points = identity((knots, knots), (p, p))
    bend = points[..., 0] * points[..., 1]
    # The first corner comes to lie on the diagonal between its neighbours.
    points = points + 0.5 * ((1 - points[..., 0]) * (1 - points[..., 1]))[..., None] + 0.1 * bend[..., None]
    if rng.random() < 0.5:
        points = points @ np.array([[rng.integers(1, 9), rng.integers(0, 9)], [0, rng.integers(1, 9)]]) / 8
    patch, place = Patch((knots, knots), (p, p), points), placed(rng)
    probe.check(at(place, [patch]))
    neighbours(rng, patch, (0, 0), place, probe)


def collapsed(rng: Rng, probe: Probe) -> None:
    """Control points next to a corner that coincide with it, or nearly."""
    patch = bent(rng, 4)
    points = patch.control_points.copy()
    count = int(rng.integers(1, max(2, points.shape[0] - 1)))
    size = rng.choice([0.0, 1e-17, 1e-300, 5e-324])
    for i in range(1, count + 1):
        points[i, 0] = points[0, 0] + size * rng.uniform(-9, 9, 2)
    if rng.random() < 0.5:
        points -= points[0, 0]
        points[1 : count + 1, 0] += size * rng.uniform(-9, 9, (count, 2))
    probe.check(MultiPatch([patch.with_control_points(points)], ()))


def two_bodies(rng: Rng, probe: Probe) -> None:
    """Two patches that are not glued, one moved until they touch, or one moved out of the other."""
    place = placed(rng)
    most = int(rng.integers(1, 3))
    first, second = bent(rng, most), bent(rng, most, rational=rng.random() < 0.15)
    shrink = rng.choice([1.0, 0.3])
    way = np.array([math.cos(a := rng.uniform(0, 7)), math.sin(a)])
    middle = np.array([0.5, 0.5])
    if rng.random() < 0.3:
        way = np.array([1.0, 0.0])
    points = middle + shrink * (second.control_points - middle)

    def build(t: float) -> MultiPatch:
        return at(place, [first, second.with_control_points(points + t * way)])

    bisect(build, 3.0, 0.75, probe)
    probe.check(build(0.0))


def spirals(rng: Rng, probe: Probe) -> None:
    """A strip that winds around more than once; it overlaps itself when its pitch is less than its width."""
    p = int(rng.integers(1, 3))
    n = int(rng.integers(8, 14))
    angle = np.linspace(0, 2 * np.pi * rng.uniform(1.05, 1.4), n)
    knots = clamped(np.linspace(0, 1, n - p + 1)[1:-1], p)
    place, width = placed(rng), rng.uniform(0.2, 0.6)

    def build(pitch: float) -> MultiPatch:
        radius = 2.0 + pitch * angle / (2 * np.pi)
        ring = np.stack([np.cos(angle), np.sin(angle)], -1)
        points = np.stack([ring * (radius + width)[:, None], ring * radius[:, None]], 1)
        return at(place, [Patch((knots, [0.0, 0.0, 1.0, 1.0]), (p, 1), points)])

    bisect(build, 2.0, 0.05, probe)


def spikes(rng: Rng, probe: Probe) -> None:
    """A side with a spike of less and less width, where the boundary comes to turn back on itself."""
    p = int(rng.integers(1, 3))
    knots = (clamped(np.repeat([0.4, 0.5, 0.6], p), p), [0.0, 0.0, 1.0, 1.0])
    place, lean = placed(rng), rng.uniform(-0.2, 0.2)
    bulge = rng.uniform(-0.03, 0.03, (4, 2)) * rng.choice([0.0, 1.0])

    def side(corners: np.ndarray, bulge: np.ndarray) -> np.ndarray:
        if p == 1:
            return corners
        middles = 0.5 * (corners[:-1] + corners[1:]) + bulge
        return np.insert(corners, range(1, len(corners)), middles, axis=0)

    upper = side(np.array([[0, 1], [0.4, 1], [0.5, 1], [0.6, 1], [1, 1.0]]), 0.0 * bulge)

    def build(width: float) -> MultiPatch:
        tip = [0.5 + lean * width, -0.9]
        lower = side(np.array([[0, 0], [0.5 - width, 0], tip, [0.5 + width, 0], [1, 0]]), width * bulge)
        return at(place, [Patch(knots, (p, 1), np.stack([lower, upper], 1))])

    for width in (0.0, 5e-324, 1e-16, 1e-13, 1e-8):
        probe.check(build(width))
        probe.check(build(-width))
    bisect(build, 0.1, -0.1, probe)


def subnormal_axes(rng: Rng, probe: Probe) -> None:
    """Hull points that differ by subnormal numbers, next to a second patch that overlaps, or nearly."""
    # Weighted means of two equal numbers of this size may differ from them by a few of the smallest subnormals.
    tiny = 1e-307 * rng.uniform(1, 2, 2) * [1, -1]
    inner = [float(rng.uniform(0.3, 0.45)), float(rng.uniform(0.55, 0.7))]
    x, half, short = 0.15, 0.005, 0.84
    if rng.random() < 0.4:
        tiny = 10.0 ** rng.uniform(-320, -290) * rng.uniform(-1, 1, 2)
        inner = np.sort(rng.uniform(0.2, 0.8, 2)).tolist()
        x, half, short = rng.uniform(0.1, 0.2), rng.uniform(0.003, 0.006), rng.uniform(0.8, 0.9)
    lower = np.array([[-1, -1], [-0.9, -0.9], tiny, tiny, [0.9, 0.9], [1, 1.0]])
    upper = np.array([[-1, 1], [-0.8, 0.95], [-0.6, 0.95], [-0.3, 0.95], [0, 0.95], [0.5, 1.0]])
    bow = Patch((clamped(inner, 3), [0.0, 0.0, 1.0, 1.0]), (3, 1), np.stack([lower, upper], 1))
    # A thin bar across the lower side, or beyond it.
    bar = np.array([[[x - half, -half], [x * short, 0.0]], [[x + half, half], [0.0, x * short]]])
    for shift in (0.0, 0.01 * x, -0.01 * x, 1.5 * x):
        second = Patch(([0.0, 0.0, 1.0, 1.0],) * 2, (1, 1), bar + shift * np.array([1.0, -1.0]))
        probe.check(MultiPatch([bow, second], ()))


def unequal_sides(rng: Rng, probe: Probe) -> None:
    """Two glued patches whose sides differ by rounding, in control points and knots."""
    left = bent(rng, 3)
    p = left.degrees[1]
    other = clamped(inner_knots(rng, 2, 1), 2)
    points = identity((other, left.knots[1]), (2, p))
    edge = left.control_points[-1]
    points = points * rng.choice([0.3, 1.0]) + (edge - points[0])[None]
    points[0] = edge
    place, ulps = placed(rng), int(rng.integers(0, 5))
    points = place(points)
    points[0, 1:-1] += rng.integers(-ulps, ulps + 1, points[0, 1:-1].shape) * np.spacing(points[0, 1:-1])
    knots = left.knots[1].copy()
    inner = np.s_[p + 1 : -p - 1]
    knots[inner] += rng.integers(-1, 2) * np.spacing(knots[inner])
    a, b = left.with_control_points(place(left.control_points)), Patch((other, knots), (2, p), points)
    probe.check(MultiPatch([a, b], (Interface(0, Side.EAST, 1, Side.WEST, False),)))


def rings(rng: Rng, probe: Probe) -> None:
    """Four glued patches around a hole, a fifth one in it, moved until it touches; or a hole turned inside out."""
    p = int(rng.integers(1, 3))
    knots = clamped([], p)
    s = np.linspace(0, 1, p + 1)
    place = placed(rng)
    outer = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]]) + rng.uniform(-0.2, 0.2, (4, 2))
    hole = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1.0]]) * 0.5 + rng.uniform(-0.1, 0.1, (4, 2))
    bow = rng.uniform(-0.1, 0.1, (4, 2))

    def strip(k: int, inside: np.ndarray) -> Patch:
        rows = []
        for ring in (inside, outer):
            a, b = ring[k], ring[(k + 1) % 4]
            row = a + s[:, None] * (b - a)
            row[-1] = b
            if p > 1:
                row[1] += bow[k]
            rows.append(row)
        return Patch(([0.0, 0.0, 1.0, 1.0], knots), (1, p), rows)

    whole = MultiPatch([strip(k, hole) for k in range(4)])
    small = bent(rng, 2)
    points = 0.3 * (small.control_points - 0.5)
    way = rng.uniform(-1, 1, 2)

    def build(t: float) -> MultiPatch:
        return at(place, [*whole.patches, small.with_control_points(points + t * way)], whole.interfaces)

    bisect(build, 0.0, 1.0, probe)

    def pushed(t: float) -> MultiPatch:
        inside = hole.copy()
        inside[0] = inside[0] + t * (outer[0] - inside[0])
        return at(place, [strip(k, inside) for k in range(4)], whole.interfaces)

    bisect(pushed, 0.0, 1.5, probe)


FAMILIES: dict[str, Callable[[Rng, Probe], None]] = {
    f.__name__: f
    for f in (
        polynomial,
        rational,
        knots_close_by,
        straight_corners,
        collapsed,
        two_bodies,
        spirals,
        spikes,
        subnormal_axes,
        unequal_sides,
        rings,
    )
}
