"""Regenerate the bundled rational examples, the annulus and the plate with a hole: ``python scripts/make_conics.py``.

Circles and ellipses are exact: four arcs of 90 degrees with the weights 1, sqrt(1/2), 1. Patches are ruled between two
curves with the same weights, so that all of a line across them has one weight and C1 rows hold exactly.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

import patchtransfer as pt

FOLDER = Path(__file__).resolve().parents[1] / "python" / "patchtransfer" / "examples"

KNOTS = [0.0, 0, 0, 1, 1, 1]
WEIGHTS = np.array([1, np.sqrt(0.5), 1])
#: Knot spans of every patch and direction.
SPANS = 3
#: Digits of a file's numbers: enough for circles to rounding.
COORDINATE = ".17g"

Curves = list[pt.BSplineCurve]


def turned(points: np.ndarray, degrees: float) -> np.ndarray:
    """Points turned about the origin."""
    a = np.radians(degrees)
    return points @ np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]])


def ellipse(axes: tuple[float, float], turn: float = 0.0, shift: tuple[float, float] = (0.0, 0.0)) -> Curves:
    """Four arcs from -45 degrees of the circle that it is an image of, counter-clockwise."""
    arcs = []
    for k in range(4):
        corner = turned(np.array([[1.0, -1], [2, 0], [1, 1]]) / np.sqrt(2), 90 * k)
        arcs.append(pt.BSplineCurve(KNOTS, 2, turned(corner * axes, turn) + shift, WEIGHTS))
    return arcs


def polygon(corners: list[tuple[float, float]]) -> Curves:
    """Straight lines from the lower right corner on, with the weights of arcs."""
    x = np.array([*corners, corners[0]])
    return [pt.BSplineCurve(KNOTS, 2, np.stack([a, (a + b) / 2, b]), WEIGHTS) for a, b in pairwise(x)]


def ruled(inner: Curves, outer: Curves) -> pt.MultiPatch:
    """Four patches between two loops: u runs outwards."""
    patches = []
    for a, b in zip(inner, outer, strict=True):
        net = np.stack([a.control_points, (a.control_points + b.control_points) / 2, b.control_points])
        patches.append(pt.Patch((KNOTS, KNOTS), (2, 2), net, np.ones((3, 1)) * WEIGHTS).split_spans(SPANS))
    return pt.MultiPatch(patches)


def write_example(name: str, inner: Curves, outer: Curves, onto: tuple[Curves, Curves], places: list[str]) -> None:
    """Write source, target and the landmarks, one at the start of each named curve."""
    folder = FOLDER / name
    folder.mkdir(parents=True, exist_ok=True)
    pt.write(ruled(inner, outer), folder / "source.xml")
    pt.write(pt.Boundary([onto[1], onto[0]]), folder / "target.xml")
    rows = [np.concatenate([c.start, d.start]) for c, d in zip([*inner, *outer], [*onto[0], *onto[1]], strict=True)]
    lines = ["# Corresponding places: starts of curves.", "place,xs,ys,xt,yt"]
    for place, row in zip(places, rows, strict=True):
        if place:
            lines.append(f"{place},{','.join(format(x, COORDINATE) for x in row)}")
    (folder / "landmarks.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    result = pt.transfer(*pt.examples.load(name))
    print(name, result, result.warnings, result.log)


if __name__ == "__main__":
    circles = ellipse((0.5, 0.5)), ellipse((1.0, 1.0))
    eccentric = ellipse((0.4, 0.4), 0, (0.25, 0.1)), ellipse((1.3, 1.3))
    write_example("annulus", *circles, eccentric, ["hole", "", "", "", "rim", "", "", ""])
    square = ellipse((0.6, 0.6)), polygon([(1.5, -1.5), (1.5, 1.5), (-1.5, 1.5), (-1.5, -1.5)])
    wider = ellipse((0.8, 0.55), 15, (0.15, 0.1)), polygon([(1.8, -1.5), (1.6, 1.5), (-1.6, 1.4), (-1.7, -1.5)])
    names = ["lower right of the hole", "", "upper left of the hole", "", *(f"corner {k}" for k in range(1, 5))]
    write_example("plate-with-hole", *square, wider, names)
