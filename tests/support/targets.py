"""Targets with known correspondence: a model's boundary deformed, then cut into other curves."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.interpolate import make_interp_spline

from patchtransfer import Boundary, BSplineCurve, MultiPatch

#: Points (n, 2) to points.
Deformation = Callable[[np.ndarray], np.ndarray]

#: Samples a source curve.
SAMPLES = 80


def box(mp: MultiPatch) -> tuple[np.ndarray, np.ndarray]:
    points = mp.topology.coordinates
    return points.min(axis=0), points.max(axis=0)


def bend(mp: MultiPatch, degrees: float) -> Deformation:
    """Bend the vertical midline into a circular arc of the same length."""
    low, high = box(mp)
    curvature, middle = np.radians(degrees) / (high[1] - low[1]), (low[0] + high[0]) / 2

    def f(x: np.ndarray) -> np.ndarray:
        radius, angle = 1 / curvature - (x[:, 0] - middle), curvature * (x[:, 1] - low[1])
        return np.column_stack([middle + 1 / curvature - radius * np.cos(angle), low[1] + radius * np.sin(angle)])

    return f


def bump(mp: MultiPatch, centre, push, width: float) -> Deformation:
    """Push a Gaussian neighbourhood; all in units of the box (centre) and of its shorter side."""
    low, high = box(mp)
    unit = (high - low).min()
    at, push = low + np.asarray(centre) * (high - low), np.asarray(push) * unit

    def f(x: np.ndarray) -> np.ndarray:
        weight = np.exp(-((x - at) ** 2).sum(axis=1) / (2 * (width * unit) ** 2))
        return x + weight[:, None] * push

    return f


def articulation(mp: MultiPatch, degrees: float, at: float = 0.45, blend: float = 0.3) -> Deformation:
    """Rotate the part above a height, with a smooth transition."""
    low, high = box(mp)
    height = high[1] - low[1]
    joint = np.array([(low[0] + high[0]) / 2, low[1] + at * height])

    def f(x: np.ndarray) -> np.ndarray:
        s = np.clip((x[:, 1] - joint[1]) / (blend * height) + 0.5, 0, 1)
        angle = np.radians(degrees) * s**3 * (10 - 15 * s + 6 * s**2)
        d = x - joint
        cosine, sine = np.cos(angle), np.sin(angle)
        return joint + np.column_stack([cosine * d[:, 0] - sine * d[:, 1], sine * d[:, 0] + cosine * d[:, 1]])

    return f


def limb(neck, direction, degrees: float, blend: float, inside: Callable[[np.ndarray], np.ndarray]) -> Deformation:
    """Rotate what lies beyond a neck, such as an arm or an ear, with a smooth transition.

    `neck` is the point turned about, `direction` the limb's, `blend` the length of the transition along it (all in the
    model's unit); `inside` says which points (n, 2) can belong to the limb, so that a second one stays.
    """
    neck, axis = np.asarray(neck, float), np.asarray(direction, float) / np.linalg.norm(direction)

    def f(x: np.ndarray) -> np.ndarray:
        d = x - neck
        s = np.clip(d @ axis / blend + 0.5, 0, 1) * inside(x)
        angle = np.radians(degrees) * s**3 * (10 - 15 * s + 6 * s**2)
        cosine, sine = np.cos(angle), np.sin(angle)
        return neck + np.column_stack([cosine * d[:, 0] - sine * d[:, 1], sine * d[:, 0] + cosine * d[:, 1]])

    return f


def waves(mp: MultiPatch, size: float, seed: int) -> Deformation:
    """Add a few random long waves, `size` of the box's diagonal at most."""
    low, high = box(mp)
    diagonal = float(np.linalg.norm(high - low))
    rng = np.random.default_rng(seed)
    frequency = rng.normal(size=(4, 2)) * 4 / diagonal
    phase, push = rng.uniform(0, 2 * np.pi, 4), rng.normal(size=(4, 2))
    push *= size * diagonal / np.linalg.norm(push, axis=1).sum()
    return lambda x: x + np.sin(x @ frequency.T + phase) @ push


def swirl(mp: MultiPatch, centre, degrees: float, width: float) -> Deformation:
    """Rotate a Gaussian neighbourhood; units as of `bump`."""
    low, high = box(mp)
    at, width = low + np.asarray(centre) * (high - low), width * (high - low).min()

    def f(x: np.ndarray) -> np.ndarray:
        d = x - at
        angle = np.radians(degrees) * np.exp(-(d**2).sum(axis=1) / (2 * width**2))
        cosine, sine = np.cos(angle), np.sin(angle)
        return at + np.column_stack([cosine * d[:, 0] - sine * d[:, 1], sine * d[:, 0] + cosine * d[:, 1]])

    return f


def stretch(factor: float, degrees: float) -> Deformation:
    """Scale by a factor in one direction and by its inverse across."""
    axis = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    along = np.outer(axis, axis)
    matrix = factor * along + (np.eye(2) - along) / factor
    return lambda x: x @ matrix


def similarity(degrees: float, scale: float, shift=(0.0, 0.0)) -> Deformation:
    """Rotate, scale and move."""
    angle = np.radians(degrees)
    matrix = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return lambda x: x @ matrix.T + np.asarray(shift)


def _is_corner(before: BSplineCurve, after: BSplineCurve, f: Deformation) -> bool:
    h = 1e-4
    a, b = before.domain, after.domain
    ends = f(np.stack([before(a[1] - h * (a[1] - a[0])), before.end, after(b[0] + h * (b[1] - b[0]))]))
    u, v = np.diff(ends, axis=0)
    return bool(abs(np.arctan2(u[0] * v[1] - u[1] * v[0], u @ v)) > np.radians(1.0))


def deformed(
    mp: MultiPatch,
    f: Deformation,
    *,
    seed: int = 0,
    degree: int = 3,
    reverse: bool = True,
    same_cuts: bool = False,
) -> tuple[Boundary, np.ndarray]:
    """The deformed boundary as other curves, and landmarks (r, 4) with the true images of all joints.

    The loops come in another order, start elsewhere, run backwards (`reverse`), have curves of `degree` that begin
    and end at other places: at all corners, and at random in between where there are none (`same_cuts`: at the
    source's joints).
    """
    rng = np.random.default_rng(seed)
    loops, landmarks = [], []
    for loop in mp.boundary().loops:
        samples, corners = [], []
        for i, curve in enumerate(loop):
            samples.append(f(curve(np.linspace(*curve.domain, SAMPLES + 1)[:-1])))
            landmarks.append(np.concatenate([curve.start, f(curve.start[None])[0]]))
            if same_cuts or _is_corner(loop[i - 1], curve, f):
                corners.append(SAMPLES * i)
        points = np.concatenate(samples)
        n = len(points)
        cuts = corners
        if len(cuts) < 3:
            offset, pieces = int(rng.integers(n)), int(rng.integers(3, 6))
            random = [(offset + n * j // pieces) % n for j in range(pieces)]
            # Next to a corner a cut leaves too few samples for a curve.
            cuts = sorted(corners + [c for c in random if all(abs(c - d) > 10 for d in corners)])
        curves = [
            through(points[np.arange(a, b + 1) % n], degree)
            for a, b in zip(cuts, [*cuts[1:], cuts[0] + n], strict=True)
        ]
        turn = int(rng.integers(len(curves)))
        curves = curves[turn:] + curves[:turn]
        loops.append([c.reversed() for c in reversed(curves)] if reverse else curves)
    return Boundary([loops[k] for k in rng.permutation(len(loops))]), np.array(landmarks)


def given_boundary(mp: MultiPatch, f: Deformation) -> tuple[Boundary, np.ndarray]:
    """The target that the source's knots can represent exactly, with a landmark at every joint."""
    moved = mp.with_shared_points(f(mp.topology.coordinates))
    pairs = [(side.curve(mp.patches), side.curve(moved.patches)) for loop in mp.topology.loops for side in loop]
    loops = [[side.curve(moved.patches) for side in loop] for loop in mp.topology.loops]
    return Boundary(loops), np.array([[*a.start, *b.start] for a, b in pairs])


def through(points: np.ndarray, degree: int) -> BSplineCurve:
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    spline = make_interp_spline(length / length[-1], points, k=degree)
    # The interpolant meets its end points up to rounding only.
    control = spline.c.copy()
    control[0], control[-1] = points[0], points[-1]
    return BSplineCurve(spline.t, degree, control)
