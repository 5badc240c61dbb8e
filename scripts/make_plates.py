"""Regenerate the bundled frame, two-hole plate and star: ``python scripts/make_plates.py``.

Every sample is a family of outlines with a few measures. One member, with a coarse layout of quadrilaterals, becomes
the source through `patchtransfer.from_layout`; another is drawn as the target. Outlines are complex functions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import make_interp_spline

import patchtransfer as pt

FOLDER = Path(__file__).resolve().parents[1] / "python" / "patchtransfer" / "examples"

#: Degree and knot spans of every patch and direction.
DEGREE, SPANS = 3, 3
#: Sample points of a side of the source's outline.
SAMPLES = 161

Side = Callable[[np.ndarray], np.ndarray]
"""Fractions 0 to 1 to complex points."""
Sides = Mapping[str, Side]
"""A closed loop of sides by name, in order."""
Place = tuple[str, float]
"""A side and a fraction on it."""
Warp = Callable[[np.ndarray], np.ndarray]
"""Complex points to complex points."""


def xy(z: complex) -> tuple[float, float]:
    """Coordinates."""
    return float(np.real(z)), float(np.imag(z))


def point(sides: Sides, place: Place) -> complex:
    """The point at a place."""
    return complex(sides[place[0]](np.array(place[1])))


def bend(z: np.ndarray, curvature: float) -> np.ndarray:
    """Bend the real axis into an arc through 0 that keeps its length; lines across it stay straight."""
    turned = np.exp(1j * curvature * z.real)
    along = z.real if curvature == 0 else (turned - 1) / (1j * curvature)
    return along + 1j * turned * z.imag


# ------------------------------------------------------------------------------------------------ outlines


@dataclass(frozen=True)
class Frame:
    """A frame of square cells, 5 by 4 outside and 3 by 2 inside, its borders waved, one wave a cell."""

    cell: float = 0.2
    outer_wave: float = 0.03
    """Height of the waves outwards."""
    inner_wave: float = 0.0
    """Height of the waves into the hole."""
    warp: Warp = lambda z: z

    @property
    def loops(self) -> list[Sides]:
        """Outer and inner border, counter-clockwise."""
        return [self._border(5, 4, self.outer_wave, ""), self._border(3, 2, -self.inner_wave, "inner ")]

    def _border(self, columns: int, rows: int, wave: float, prefix: str) -> Sides:
        def side(cells: int, across: int, quarter: int) -> Side:
            def f(t: np.ndarray) -> np.ndarray:
                out = across / 2 * self.cell + wave * np.sin(np.pi * cells * t) ** 2
                return self.warp(1j**quarter * ((t - 0.5) * cells * self.cell - 1j * out))

            return f

        names = ("bottom", "right", "top", "left")
        sizes = ((columns, rows), (rows, columns)) * 2
        return {
            prefix + name: side(n, across, k) for k, (name, (n, across)) in enumerate(zip(names, sizes, strict=True))
        }


@dataclass(frozen=True)
class Ellipse:
    """A hole; `turn` in degrees."""

    centre: complex
    radii: tuple[float, float]
    turn: float = 0.0

    def __call__(self, t: np.ndarray) -> np.ndarray:
        """Points by fraction, counter-clockwise."""
        a, b = self.radii
        # Measured from the x axis, not from the first radius, so that equal fractions lie in about the same direction.
        angle = 2 * np.pi * t - np.radians(self.turn)
        return self.centre + np.exp(1j * np.radians(self.turn)) * (a * np.cos(angle) + 1j * b * np.sin(angle))


@dataclass(frozen=True)
class Plate:
    """A plate with a waist between two holes."""

    size: tuple[float, float] = (1.2, 0.6)
    waist: float = 0.06
    """How far either long side comes in."""
    holes: tuple[Ellipse, Ellipse] = (Ellipse(-0.3, (0.12, 0.12)), Ellipse(0.3, (0.12, 0.12)))
    warp: Warp = lambda z: z

    @property
    def loops(self) -> list[Sides]:
        """Outline and both holes, counter-clockwise."""
        w, h = self.size[0] / 2, self.size[1] / 2

        def long(sign: int) -> Side:
            def f(t: np.ndarray) -> np.ndarray:
                s = 2 * t - 1
                # Flat at the ends, so that the corners are square.
                y = h - self.waist * (1 - s**2) ** 2 * (1 + 2 * s**2)
                return self.warp(sign * (w * s - 1j * y))

            return f

        def short(sign: int) -> Side:
            return lambda t: self.warp(sign * (w + 1j * h * (2 * t - 1)))

        outline = {"bottom": long(1), "right": short(1), "top": long(-1), "left": short(-1)}
        return [outline, {"left hole": self.holes[0]}, {"right hole": self.holes[1]}]


@dataclass(frozen=True)
class Star:
    """Six arms that end in points."""

    lengths: tuple[float, ...] = (0.6,) * 6
    """Centre to tip."""
    bends: tuple[float, ...] = (0.0,) * 6
    """Turn of the arms from foot to tip, degrees."""
    valley: float = 0.4
    """Centre to the corners between the arms."""
    hollow: float = 0.15
    """How much the arms' sides sag."""

    @property
    def loops(self) -> list[Sides]:
        """The outline, counter-clockwise."""
        out: dict[str, Side] = {}
        for k in range(6):
            out[f"arm {k} right"] = self._side(k, -1)
            out[f"arm {k} left"] = self._side(k, 1)
        return [out]

    def _side(self, arm: int, side: int) -> Side:
        foot, half = self.valley * np.cos(np.pi / 6), self.valley / 2
        length = self.lengths[arm] - foot

        def f(t: np.ndarray) -> np.ndarray:
            s = t if side < 0 else 1 - t
            local = s * length + 1j * side * half * (1 - s) * (1 - self.hollow * s)
            curvature = np.radians(self.bends[arm]) / length
            # The arm's bend grows from its foot, which all six share.
            return np.exp(1j * np.pi / 3 * arm) * (foot + bend(local, curvature))

        return f


# ------------------------------------------------------------------------------------------------ layouts


@dataclass(frozen=True)
class Layout:
    """Vertices on the outline, vertices inside and counter-clockwise quads, by name."""

    on_boundary: Mapping[str, Place]
    inside: Mapping[str, complex]
    quads: list[tuple[str, str, str, str]]


def cells(columns: int, rows: int) -> dict[tuple[int, int], tuple[str, str, str, str]]:
    """The quads of a grid, by column and row."""
    return {
        (i, j): (f"{i},{j}", f"{i + 1},{j}", f"{i + 1},{j + 1}", f"{i},{j + 1}")
        for i in range(columns)
        for j in range(rows)
    }


def around(columns: int, rows: int, corner: int = 0, prefix: str = "") -> dict[str, Place]:
    """Evenly spaced places on a border with sides bottom, right, top, left, as vertices of a grid."""
    out = {}
    for i in range(columns + 1):
        out[f"{corner + i},{corner}"] = (prefix + "bottom", i / columns)
        out[f"{corner + i},{corner + rows}"] = (prefix + "top", 1 - i / columns)
    for j in range(1, rows):
        out[f"{corner + columns},{corner + j}"] = (prefix + "right", j / rows)
        out[f"{corner},{corner + j}"] = (prefix + "left", 1 - j / rows)
    return out


def frame_layout() -> Layout:
    """The cells of the frame: one patch in each outer corner, three around each inner one."""
    inner = {(i, j) for i in range(1, 4) for j in range(1, 3)}
    quads = [quad for cell, quad in cells(5, 4).items() if cell not in inner]
    return Layout(around(5, 4) | around(3, 2, 1, "inner "), {}, quads)


def plate_layout() -> Layout:
    """A grid of 5 by 3 cells; four patches around a hole fill a cell, so that its corners get valence 5."""
    x, y = (-0.6, -0.47, -0.13, 0.13, 0.47, 0.6), (-0.3, -0.15, 0.15, 0.3)
    on_boundary: dict[str, Place] = {}
    for i, a in enumerate(x):
        on_boundary[f"{i},0"], on_boundary[f"{i},3"] = ("bottom", (a + 0.6) / 1.2), ("top", (0.6 - a) / 1.2)
    for j in (1, 2):
        on_boundary[f"5,{j}"], on_boundary[f"0,{j}"] = ("right", y[j] / 0.6 + 0.5), ("left", 0.5 - y[j] / 0.6)
    quads = cells(5, 3)
    for column, hole in ((1, "left hole"), (3, "right hole")):
        ring = quads.pop((column, 1))
        points = [f"{hole} {k}" for k in range(4)]
        # The cell's corners from the lower left one, the hole's points at 225, 315, 45 and 135 degrees.
        on_boundary |= {name: (hole, (0.625 + k / 4) % 1) for k, name in enumerate(points)}
        for k in range(4):
            n = (k + 1) % 4
            quads[column, 3 + k] = (ring[k], ring[n], points[n], points[k])
    inside = {f"{i},{j}": complex(x[i], y[j]) for i in range(1, 5) for j in (1, 2)}
    return Layout(on_boundary, inside, list(quads.values()))


def star_layout() -> Layout:
    """An arm a patch, all six at the centre."""
    on_boundary: dict[str, Place] = {}
    for k in range(6):
        on_boundary |= {f"valley {k}": (f"arm {k} right", 0.0), f"tip {k}": (f"arm {k} left", 0.0)}
    quads = [("centre", f"valley {k}", f"tip {k}", f"valley {(k + 1) % 6}") for k in range(6)]
    return Layout(on_boundary, {"centre": 0j}, quads)


# ------------------------------------------------------------------------------------------------ files


def curve(side: Side) -> pt.BSplineCurve:
    """The side as a fine interpolating cubic."""
    t = np.linspace(0, 1, SAMPLES)
    z = side(t)
    spline = make_interp_spline(t, np.column_stack([z.real, z.imag]), k=3)
    return pt.BSplineCurve(spline.t, 3, spline.c)


def closed(curves: list[pt.BSplineCurve]) -> list[pt.BSplineCurve]:
    """Curves that end exactly where the next one begins."""
    out = []
    for k, c in enumerate(curves):
        points = c.control_points.copy()
        points[-1] = curves[(k + 1) % len(curves)].start
        out.append(pt.BSplineCurve(c.knots, c.degree, points))
    return out


def make_source(loops: list[Sides], layout: Layout) -> pt.MultiPatch:
    """Carry the layout onto the outline."""
    sides = {name: side for loop in loops for name, side in loop.items()}
    at = {name: point(sides, place) for name, place in layout.on_boundary.items()} | dict(layout.inside)
    number = {name: k for k, name in enumerate(at)}
    result = pt.from_layout(
        [xy(z) for z in at.values()],
        [[number[name] for name in quad] for quad in layout.quads],
        pt.Boundary([closed([curve(side) for side in loop.values()]) for loop in loops]),
        DEGREE,
        SPANS,
    )
    if result.warnings:
        raise SystemExit("\n".join(result.warnings))
    return result.multipatch


def path(loop: Sides, start: Place, pieces: int) -> str:
    """Path data of the loop, clockwise from a place inside a side, every side in cubic pieces of unequal length."""

    def number(z: complex) -> str:
        # Drawings have y down.
        return f"{z.real:.5f},{0.0 - z.imag:.5f}"

    def step(side: Side, a: float, b: float) -> str:
        h = 1e-5
        ends = np.array([a, b])
        inward = np.clip(ends, h, 1 - h)
        speed = (side(inward + h) - side(inward - h)) / (2 * h) * (b - a) / 3
        p, q = side(ends)
        return f"C {number(p + speed[0])} {number(q - speed[1])} {number(q)}"

    names = list(loop)
    first = names.index(start[0])
    commands = [f"M {number(point(loop, start))}"]
    for k in range(len(names) + 1):
        name = names[(first - k) % len(names)]
        u = np.linspace(0, 1, pieces + 1)
        breaks = u + 0.35 / pieces * np.sin(2 * np.pi * u)
        if k == 0:
            breaks = np.append(breaks[breaks < start[1] - 1e-2], start[1])
        elif k == len(names):
            breaks = np.append(start[1], breaks[breaks > start[1] + 1e-2])
        commands += [step(loop[name], b, a) for a, b in zip(breaks[-2::-1], breaks[:0:-1], strict=True)]
    return "\n       ".join([*commands, "Z"])


SVG = """<?xml version="1.0" encoding="UTF-8"?>
<svg xmlns="http://www.w3.org/2000/svg" width="{width:g}mm" height="{height:g}mm" viewBox="{box}">
  <title>{title}</title>
  <g id="{name}" style="fill:#d9dee2;fill-rule:evenodd;stroke:#1c1c1c;stroke-width:0.004">
{shapes}
  </g>
</svg>
"""


def draw(name: str, title: str, loops: Mapping[str, Sides], start: Place, pieces: int) -> str:
    """The outlines as a drawing, holes on top and ellipses as such; all are cut and begin away from the sides' ends."""
    shapes = []
    z = np.concatenate([side(np.linspace(0, 1, 50)) for loop in loops.values() for side in loop.values()])
    outline, *holes = loops
    for ident in (outline, *reversed(holes)):
        loop = loops[ident]
        only = next(iter(loop.values()))
        fill = "" if ident == outline else ' style="fill:#ffffff"'
        if isinstance(only, Ellipse):
            x, y = only.centre.real, -only.centre.imag
            turn = f"translate({x:g} {y:g}) rotate({-only.turn:g})"
            shapes.append(
                f'    <ellipse id="{ident}" rx="{only.radii[0]:g}" ry="{only.radii[1]:g}" transform="{turn}"{fill}/>'
            )
        else:
            begin = start if start[0] in loop else (next(iter(loop)), 0.37)
            shapes.append(f'    <path id="{ident}"{fill}\n      d="{path(loop, begin, pieces)}"/>')
    margin = 0.05
    left, top = z.real.min() - margin, -z.imag.max() - margin
    width, height = np.ptp(z.real) + 2 * margin, np.ptp(z.imag) + 2 * margin
    return SVG.format(
        width=round(100 * width),
        height=round(100 * height),
        box=f"{left:.3f} {top:.3f} {width:.3f} {height:.3f}",
        title=title,
        name=name,
        shapes="\n".join(shapes),
    )


def landmarks(source: list[Sides], target: list[Sides], places: Mapping[str, Place]) -> str:
    """Table of corresponding places."""
    rows = ["# Corresponding places, y up: in the drawing target.svg y is -yt.", "place,xs,ys,xt,yt"]
    loops = [{name: side for loop in loops for name, side in loop.items()} for loops in (source, target)]
    for name, place in places.items():
        numbers = (c for sides in loops for c in xy(point(sides, place)))
        rows.append(f"{name},{','.join(f'{x:.5f}' for x in numbers)}")
    return "\n".join(rows) + "\n"


CORNERS: dict[str, Place] = {
    "lower left corner": ("bottom", 0.0),
    "lower right corner": ("right", 0.0),
    "upper right corner": ("top", 0.0),
    "upper left corner": ("left", 0.0),
}


@dataclass(frozen=True)
class Sample:
    """What is drawn as what; `start` and `pieces` cut the drawing."""

    title: str
    source: list[Sides]
    layout: Layout
    target: list[Sides]
    ids: tuple[str, ...]
    places: Mapping[str, Place]
    start: Place
    pieces: int

    def write(self, name: str) -> None:
        """Make the three files."""
        folder = FOLDER / name
        folder.mkdir(parents=True, exist_ok=True)
        pt.write(make_source(self.source, self.layout), folder / "source.xml")
        loops = dict(zip(self.ids, self.target, strict=True))
        (folder / "target.svg").write_text(draw(name, self.title, loops, self.start, self.pieces))
        (folder / "landmarks.csv").write_text(landmarks(self.source, self.target, self.places))


def trapezoid(z: np.ndarray) -> np.ndarray:
    """Narrower at the top, then bent."""
    return bend(z.real * (1 - 0.45 * z.imag) + 1j * z.imag, -0.5)


PLATES = {
    "frame": Sample(
        "Trapezoidal frame, bent, with waves on both borders",
        Frame().loops,
        frame_layout(),
        Frame(cell=0.21, outer_wave=-0.025, inner_wave=0.015, warp=trapezoid).loops,
        ("outline", "opening"),
        {
            f"{side} at {t:.2f}": (side, t)
            for side, t in (*around(5, 4).values(), *around(3, 2, prefix="inner ").values())
        },
        ("right", 0.63),
        17,
    ),
    "two-hole-plate": Sample(
        "Bent plate with two oblique holes",
        Plate().loops,
        plate_layout(),
        Plate(
            size=(1.25, 0.58),
            waist=0.03,
            holes=(Ellipse(-0.34 - 0.06j, (0.15, 0.1), 30), Ellipse(0.27 - 0.03j, (0.1, 0.13), 10)),
            warp=lambda z: bend(z, -0.7),
        ).loops,
        ("outline", "left-hole", "right-hole"),
        CORNERS
        | {"bottom middle": ("bottom", 0.5), "top middle": ("top", 0.5)}
        | {f"{side} hole {k} quarter": (f"{side} hole", k / 4) for side in ("left", "right") for k in range(4)},
        ("top", 0.3),
        6,
    ),
    "star": Sample(
        "Star with bent arms of unequal lengths",
        Star().loops,
        star_layout(),
        Star(
            lengths=(0.7, 0.56, 0.66, 0.6, 0.74, 0.58),
            bends=(35, 10, -20, 25, 30, -15),
            valley=0.38,
            hollow=0.1,
        ).loops,
        ("outline",),
        {f"tip {k}": (f"arm {k} left", 0.0) for k in range(6)}
        | {f"valley {k}": (f"arm {k} right", 0.0) for k in range(6)},
        ("arm 2 left", 0.45),
        3,
    ),
}

if __name__ == "__main__":
    for name, sample in PLATES.items():
        sample.write(name)
