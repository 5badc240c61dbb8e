"""Drawing the sample models: tables of outline points, smooth curves through them, bends, and files.

Points are complex numbers. Names of points on the right half end up on the left half with a prime; names that end
with ``*`` in a table of outline points are corners, all others are passed smoothly.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

import patchtransfer as pt

EXAMPLES = Path(__file__).resolve().parents[1] / "python" / "patchtransfer" / "examples"

Points = dict[str, complex]

SVG = """<?xml version="1.0" encoding="UTF-8"?>
<svg xmlns="http://www.w3.org/2000/svg" viewBox="{box}">
  <title>{title}</title>
  <path style="fill:#d9dee2;stroke:#1c1c1c;stroke-width:0.005"
    d="{path}"/>
</svg>
"""


def xy(z: complex) -> tuple[float, float]:
    """Coordinates."""
    return z.real, z.imag


def other(name: str) -> str:
    """Name of the mirror image."""
    return name[:-1] if name.endswith("'") else name + "'"


def mirrored(right: Points) -> Points:
    """Right half and its mirror image, in the order of a closed outline."""
    left = {other(name.rstrip("*")) + "*" * name.endswith("*"): -z.conjugate() for name, z in right.items()}
    return right | dict(reversed(left.items()))


def quads(right: str, middle: str) -> list[list[str]]:
    """Quads of both halves and of the middle, counter-clockwise, from one line a quad."""
    half = [line.split() for line in right.strip().splitlines()]
    return (
        half + [[other(n) for n in reversed(q)] for q in half] + [line.split() for line in middle.strip().splitlines()]
    )


def bend(z: complex, joint: complex, direction: complex, length: float, degrees: float) -> complex:
    """Bend a limb: its axis leaves the joint straight on and turns by the angle, on a circle, within the length."""
    unit = direction / abs(direction)
    along, across = xy((z - joint) / unit)
    rate = 1j * np.radians(degrees) / length
    on_arc = min(max(along, 0.0), length)
    turned = complex(np.exp(rate * on_arc))
    return joint + unit * ((turned - 1) / rate + (along - on_arc + 1j * across) * turned)


@dataclass(frozen=True)
class Drawing:
    """Closed outline through the points, counter-clockwise, from a corner to itself."""

    outline: Points

    @property
    def places(self) -> Points:
        """Points by name, without the marks."""
        return {name.rstrip("*"): z for name, z in self.outline.items()}

    def pieces(self) -> list[BSpline]:
        """Smooth cubics between corners, each parameterized by the square roots of its chords."""
        names, points = list(self.outline), np.array([xy(z) for z in self.outline.values()])
        corners = [k for k, name in enumerate(names) if name.endswith("*")]
        pieces = []
        for a, b in zip(corners, [*corners[1:], corners[0] + len(names)], strict=True):
            through = points[np.arange(a, b + 1) % len(names)]
            t = np.concatenate([[0.0], np.cumsum(np.sqrt(np.linalg.norm(np.diff(through, axis=0), axis=1)))])
            pieces.append(make_interp_spline(t, through, k=3, bc_type="natural"))
        return pieces

    def boundary(self) -> pt.Boundary:
        """One B-spline curve from corner to corner."""
        return pt.Boundary([[pt.BSplineCurve.from_scipy(piece) for piece in self.pieces()]])

    def svg(self, title: str, start: int) -> str:
        """The outline as a path of cubics of its own: cut evenly, clockwise, from the middle of piece `start`."""
        cubics: list[list[complex]] = []
        first = 0
        for k, piece in enumerate(self.pieces()):
            a, b = piece.t[0], piece.t[-1]
            # Odd, so that no cut falls on the middle of a piece, where symmetric pieces have a vertex.
            number = (len(piece.c) - 1) | 1
            if k == start:
                first = len(cubics) + number // 2
            cuts = np.linspace(a, b, number + 1)
            z, dz = (piece(cuts, nu) @ [1, 1j] for nu in (0, 1))
            leg = (b - a) / number / 3
            cubics += [[p, p + leg * dp, q - leg * dq, q] for p, dp, q, dq in zip(z, dz, z[1:], dz[1:], strict=False)]
        cubics = [c[::-1] for c in reversed(cubics[first:] + cubics[:first])]
        # Drawings have y down.
        text = [[f"{z.real:.5f},{-z.imag:.5f}" for z in cubic] for cubic in cubics]
        lines = [f"M {text[0][0]}", *("C " + " ".join(cubic[1:]) for cubic in text), "Z"]
        z = np.array(list(self.outline.values()))
        low, size = [z.real.min() - 0.05, -z.imag.max() - 0.05], [np.ptp(z.real) + 0.1, np.ptp(z.imag) + 0.1]
        return SVG.format(box=" ".join(f"{x:.2f}" for x in low + size), title=title, path="\n       ".join(lines))


def write_sample(
    name: str,
    title: str,
    source: Drawing,
    target: Drawing,
    inside: Points,
    layout: list[list[str]],
    landmarks: dict[str, str],
    start: int,
) -> None:
    """Build the source from the layout and write source, target and landmarks."""
    vertices = source.places | inside
    used = sorted({n for quad in layout for n in quad})
    index = {n: k for k, n in enumerate(used)}
    built = pt.from_layout(
        [xy(vertices[n]) for n in used], [[index[n] for n in quad] for quad in layout], source.boundary(), spans=3
    )
    folder = EXAMPLES / name
    folder.mkdir(parents=True, exist_ok=True)
    pt.write(built.multipatch, folder / "source.xml")
    (folder / "target.svg").write_text(target.svg(title, start))
    rows = ["# Corresponding places, y up: in the drawing target.svg y is -yt.", "place,xs,ys,xt,yt"]
    for place, n in landmarks.items():
        numbers = (*xy(source.places[n]), *xy(target.places[n]))
        rows.append(f"{place},{','.join(f'{x:.5f}' for x in numbers)}")
    (folder / "landmarks.csv").write_text("\n".join(rows) + "\n")
    valences = sorted(v.valence for v in built.multipatch.vertices if v.extraordinary)
    print(built.multipatch, built.quality.scaled_jacobian, "extraordinary:", valences)
