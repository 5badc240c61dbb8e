"""Registration and fit of a boundary of many curves: ``python benches/python/registration.py [curves]``.

The source's boundary is a wavy outline cut into equal cubic curves; the target is its bent image, as other curves.
Prints the median of several runs, without and with landmarks.
"""

from __future__ import annotations

import argparse
import time
from statistics import median

import numpy as np

from patchtransfer import Boundary, BSplineCurve
from patchtransfer.fitting.fit import fit_boundary
from patchtransfer.registration.register import register

KNOTS = np.array([0.0, 0, 0, 0, 1, 1, 1, 1])
RUNS = 5


def outline(t: np.ndarray) -> np.ndarray:
    """A wavy, asymmetric closed curve, t in [0, 1)."""
    a = 2 * np.pi * t
    radius = 1 + 0.2 * np.cos(3 * a + 0.4) + 0.08 * np.sin(7 * a) + 0.02 * np.cos(40 * a)
    return np.column_stack([1.5 * radius * np.cos(a), radius * np.sin(a)])


def bent(x: np.ndarray) -> np.ndarray:
    """Bend by 40 degrees over the height."""
    k = np.radians(40) / 2.5
    r = 1 / k - x[:, 0]
    return np.column_stack([1 / k - r * np.cos(k * x[:, 1]), r * np.sin(k * x[:, 1])])


def cubics(points: np.ndarray, n: int) -> list[BSplineCurve]:
    """Closed chain of Bézier cubics through every third of 3n points, close to them in between."""
    p = points.reshape(n, 3, 2)
    ends = np.roll(p[:, 0], -1, axis=0)
    curves = []
    for (a, b, c), d in zip(p, ends, strict=True):
        # The cubic through a, b, c, d at 0, 1/3, 2/3, 1.
        first = (-5 * a + 18 * b - 9 * c + 2 * d) / 6
        second = (2 * a - 9 * b + 18 * c - 5 * d) / 6
        curves.append(BSplineCurve(KNOTS, 3, np.array([a, first, second, d])))
    return curves


def main(n: int) -> None:
    """Print the times for `n` curves."""
    t = np.arange(3 * n) / (3 * n)
    source = [cubics(outline(t), n)]
    m = max(4, n * 7 // 10)
    target = Boundary([cubics(bent(outline((np.arange(3 * m) / (3 * m) + 0.37) % 1)), m)])
    rows = np.column_stack([outline(t[::3]), bent(outline(t[::3]))])
    for name, landmarks in (("no landmarks", None), ("8 landmarks", rows[:: n // 8]), ("all joints", rows)):
        seconds: dict[str, list[float]] = {"registration": [], "fit": []}
        for _ in range(RUNS):
            begin = time.perf_counter()
            registration = register(source, target, landmarks)
            middle = time.perf_counter()
            fitted = fit_boundary(registration)
            seconds["registration"].append(middle - begin)
            seconds["fit"].append(time.perf_counter() - middle)
        found = np.array([b for _, b in registration.joints])
        error = np.linalg.norm(found - rows[:, 2:], axis=1).mean() / target.diameter
        print(
            f"{n} curves, {name}: registration {median(seconds['registration']):.3f} s, fit "
            f"{median(seconds['fit']):.3f} s, correspondence error {error:.1e}, boundary error {fitted.error:.1e}"
        )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("curves", type=int, nargs="?", default=1000, help="curves of the source, 8 or more (1000)")
    main(parser.parse_args().curves)
