"""Rational models moved: how many are certified, and how near boundaries come to what their knots and weights allow.

``PATCHTRANSFER_MODELS=... PYTHONPATH=python:tests/support python benches/python/rational_models.py``: all planar
rational models below ``real`` under bends to 40 degrees, bumps, articulations to 30 degrees, landmarks at joints. The
best boundary is found side by side between the same joints, by Gauss and Newton with the largest errors weighted up.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import patchtransfer as pt
import targets
from patchtransfer.fitting.fit import basis_key, sampled_basis
from patchtransfer.geometry.outline import Outline, hausdorff

BUMPS = [((0.5, 1), (0, 0.15), 0.25), ((1, 0.5), (0.15, 0.05), 0.3), ((0.2, 0.1), (-0.1, -0.12), 0.2)]
BUMPS.append(((0.5, 0.5), (0.12, 0.1), 0.3))
#: Steps of the best fit, those without weights, and what a slide along the target costs beside an error.
STEPS, PLAIN, SLIDE = 120, 6, 1e-3
#: An error is above what knots allow from this factor on.
ALLOWED = 1.3


def models(folder: Path) -> Iterator[tuple[str, pt.MultiPatch]]:
    """Planar, rational, in one part, and certified."""
    for path in sorted(path for path in folder.glob("*/*") if path.suffix in (".xml", ".txt", ".mesh")):
        try:
            mp = pt.read(path)
            if any(patch.weights is not None for patch in mp):
                pt.TransferPlan(mp, "c0")
                yield f"{path.parent.name}/{path.name}", mp
        except pt.TransferError:
            continue


def motions(mp: pt.MultiPatch) -> dict[str, targets.Deformation]:
    """Bends, bumps and articulations."""
    found = {f"bend {d}": targets.bend(mp, d) for d in (-40, -30, -20, 20, 30, 40)}
    found |= {f"bump {k}": targets.bump(mp, *bump) for k, bump in enumerate(BUMPS)}
    return found | {f"articulation {d}": targets.articulation(mp, d) for d in (-30, -20, -10, 10, 20, 30)}


def best_side(curve: pt.BSplineCurve, target: Outline) -> pt.BSplineCurve:
    """The curve nearest to the target with its ends, knots and weights."""
    values = sampled_basis(*basis_key(curve))[1]
    points, weight = np.array(curve.control_points), np.ones(len(values))
    best, least = points, np.inf
    inner = slice(1, len(points) - 1)
    for step in range(STEPS):
        at = values @ points
        feet, distance = target.nearest(at)
        if distance.max() < least:
            best, least = points, distance.max()
        if least < 1e-13 or len(points) == 2:
            break
        x, y, *along = np.moveaxis(target.evaluate(feet), 1, 0)
        along = np.column_stack(along)
        across = np.column_stack([-along[:, 1], along[:, 0]])
        if step >= PLAIN:
            weight = weight * (0.1 + distance / distance.max())
            weight /= weight.mean()
        root = np.sqrt(weight)[:, None]
        rows = [(values[:, inner, None] * d[:, None]).reshape(len(values), -1) for d in (across, along)]
        wanted = ((np.column_stack([x, y]) - at) * across).sum(axis=1) * root[:, 0]
        matrix = np.concatenate([rows[0] * root, SLIDE * rows[1]])
        change = np.linalg.lstsq(matrix, np.concatenate([wanted, 0 * wanted]), rcond=None)[0]
        points = points.copy()
        points[inner] += change.reshape(-1, 2)
    return curve.with_control_points(best)


def best(result: pt.TransferResult) -> float:
    """The least boundary error with the result's joints, knots and weights that is found, in diameters."""
    found = [
        hausdorff(Outline([best_side(side.curve, loop.target) for side in sides]), loop.target)
        for loop, sides in zip(result.registration.loops, result.fitted.loops, strict=True)
    ]
    return max(found) / result.registration.loops[0].target.diameter


def main() -> None:
    """Print a line a model, then the totals."""
    totals = np.zeros(3, int)
    for name, mp in models(Path(os.environ["PATCHTRANSFER_MODELS"]) / "real"):
        certified, factors = [], []
        for deformation in motions(mp).values():
            try:
                moved = targets.deformed(mp, deformation)
                certified.append(pt.transfer(mp, *moved, on_failure="return").certificate.injective)
            except pt.InfeasibleTargetError:
                continue
            fitted = pt.transfer(mp, *moved, "c0", on_failure="return", refine="never")
            factors.append(fitted.boundary_error / max(best(fitted), 1e-15))
        within = sum(factor <= ALLOWED for factor in factors)
        print(f"{name:40s} {sum(certified)} of {len(certified)} certified, errors {max(factors):.2f} times the best")
        totals += [sum(certified), len(certified), within]
    print(f"{totals[0]} of {totals[1]} certified; {totals[2]} at most {ALLOWED} times the best")


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    main()
