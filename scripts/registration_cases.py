"""Deformed copies of models whose true boundary correspondence is known, family by family."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))
import targets
from models import bilinear, build
from patchtransfer import Boundary, MultiPatch, examples, read

#: One limb of a model: point of the neck, direction, length of the transition, points that can belong to it.
LIMBS = {
    "turtle": ((0.28, 0.12), (0.3, 1), 0.15, lambda x: (x[:, 0] > 0.15) & (x[:, 1] > 0.02)),
    "human": ((0.25, 0.65), (1, -0.5), 0.12, lambda x: (x[:, 0] > 0.16) & (x[:, 1] > 0.4)),
    "rabbit": ((0.12, 0.62), (0.25, 1), 0.2, lambda x: (x[:, 0] > 0) & (x[:, 1] > 0.45)),
    "wrench": ((9, 58), (0, 1), 10, lambda x: (x[:, 0] > 0) & (x[:, 1] > 45)),
    "star": ((0.38, 0), (1, 0), 0.15, lambda x: x[:, 0] > 0.25),
}


@dataclass(frozen=True)
class Case:
    """A model, its deformed boundary, and the true images of all joints as landmark rows."""

    model: str
    family: str
    label: str
    source: MultiPatch
    target: Boundary
    truth: np.ndarray


def models() -> dict[str, MultiPatch]:
    """Our examples, a grid of squares, and the models of PATCHTRANSFER_MODELS if it is set."""
    folder = os.environ.get("PATCHTRANSFER_MODELS")
    found = {path.stem: read(path) for path in sorted(Path(folder).glob("*.xml"))} if folder else {}
    return found | {name: examples.load(name)[0] for name in examples.EXAMPLES} | {"squares": squares(3)}


def squares(n: int) -> MultiPatch:
    """A grid of n x n squares, whose sides have no features."""
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    return build([bilinear(*(corners + np.array((i, j)))) for j in range(n) for i in range(n)], 2, 2, None)


def deformations(name: str, mp: MultiPatch, seed: int) -> Iterator[tuple[str, str, targets.Deformation]]:
    """Family, label and map of every deformation; those that fold the plane near the model are left out."""
    rng = np.random.default_rng(seed)
    yield "rigid", "turned", targets.similarity(rng.uniform(-30, 30), rng.uniform(0.2, 5), rng.uniform(-9, 9, 2))
    yield "rigid", "moved", targets.similarity(rng.uniform(-10, 10), rng.uniform(0.2, 5), rng.uniform(-9, 9, 2))
    for degrees in (20, -40, 60):
        yield "bend", f"{degrees}°", targets.bend(mp, degrees * rng.choice([-1, 1]))
    for degrees in (20, -40):
        for at in (0.3, 0.65):
            yield "articulation", f"{degrees}° at {at}", targets.articulation(mp, degrees * rng.choice([-1, 1]), at)
    if name in LIMBS:
        neck, direction, blend, inside = LIMBS[name]
        for degrees in (20, -20, 40, -40):
            yield "limb", f"{degrees}°", targets.limb(neck, direction, degrees, blend, inside)
    low, high = targets.box(mp)
    unit = np.linalg.norm(high - low) / (high - low).min()
    for size in (0.05, 0.1):
        for _ in range(2):
            angle = rng.uniform(0, 2 * np.pi)
            push = size * unit * np.array([np.cos(angle), np.sin(angle)])
            yield "bump", f"{size:.0%}", targets.bump(mp, rng.uniform(0, 1, 2), push, 0.3 * unit / 1.5)
    for size in (0.05, 0.1):
        yield "waves", f"{size:.0%}", targets.waves(mp, size, int(rng.integers(1000)))
    for degrees in (40, -40):
        yield "swirl", f"{degrees}°", targets.swirl(mp, rng.uniform(0.3, 0.7, 2), degrees, rng.uniform(0.3, 0.6))
    for _ in range(2):
        factor, angle = rng.uniform(1.1, 1.4), rng.uniform(0, 180)
        yield "stretch", f"{factor:.2f} at {angle:.0f}°", targets.stretch(factor, angle)


def _folds(mp: MultiPatch, f: targets.Deformation) -> bool:
    """Whether the map turns small triangles over at the model's control points."""
    x = mp.topology.coordinates
    h = 1e-5 * np.linalg.norm(np.ptp(x, axis=0))
    a, b = (f(x + h * e) - f(x) for e in np.eye(2))
    return bool((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] <= 0.15 * h * h).any())


def cases(seed: int = 0, names: list[str] | None = None) -> Iterator[Case]:
    """All cases; the seed chooses places, signs, degrees, starts and senses."""
    for name, mp in models().items():
        if names and name not in names:
            continue
        rng = np.random.default_rng(seed + 100)
        for family, label, f in deformations(name, mp, seed):
            options = {
                "seed": int(rng.integers(1000)),
                "degree": int(rng.choice([2, 3])),
                "reverse": bool(rng.integers(2)),
            }
            if not _folds(mp, f):
                target, truth = targets.deformed(mp, f, **options)
                yield Case(name, family, label, mp, target, truth)


def correspondence_error(case: Case, joints: list[tuple[np.ndarray, np.ndarray]]) -> float:
    """Mean distance of the joints' images from the true ones, relative to the diagonal of the target's box."""
    found = np.array([b for _, b in joints])
    return float(np.linalg.norm(found - case.truth[:, 2:], axis=1).mean() / case.target.diameter)
