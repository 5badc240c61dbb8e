"""Regenerate the bundled example: ``python scripts/make_example.py``.

Draws a wrench twice, straight and with a turned jaw and a bent, slimmer handle. The straight one gets a coarse
layout of quadrilaterals, which the package itself carries onto the smooth outline (every joint of the layout a
landmark): that is the example's source. The bent one is written as a drawing: the example's target.
"""

from __future__ import annotations

import cmath
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import patchtransfer as pt
from patchtransfer import examples

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "python" / "patchtransfer" / "examples" / "wrench"
PICTURE = ROOT / "docs" / "images" / "wrench.png"

#: Degree and knot spans of every patch and direction.
DEGREE, SPANS = 3, 3


def polar(radius: float, degrees: float) -> complex:
    """Complex number by modulus and angle."""
    return cmath.rect(radius, np.radians(degrees))


@dataclass(frozen=True)
class Arc:
    """Circular arc by start and end angle in degrees; counter-clockwise when the angle grows."""

    centre: complex
    radius: float
    begin: float
    end: float

    def __call__(self, t: float) -> complex:
        """Point at a fraction of the angle."""
        return self.centre + polar(self.radius, self.begin + t * (self.end - self.begin))

    def split(self, t: float) -> tuple[Arc, Arc]:
        """Cut at a fraction of the angle."""
        middle = self.begin + t * (self.end - self.begin)
        return Arc(self.centre, self.radius, self.begin, middle), Arc(self.centre, self.radius, middle, self.end)


@dataclass(frozen=True)
class Bezier:
    """Line or cubic by its control points."""

    points: tuple[complex, ...]

    def __call__(self, t: float) -> complex:
        """Point at a fraction of the parameter."""
        return self.split(t)[0].points[-1]

    def split(self, t: float) -> tuple[Bezier, Bezier]:
        """Cut at a fraction of the parameter (de Casteljau)."""
        rows = [list(self.points)]
        while len(rows[-1]) > 1:
            rows.append([(1 - t) * a + t * b for a, b in zip(rows[-1], rows[-1][1:], strict=False)])
        return Bezier(tuple(row[0] for row in rows)), Bezier(tuple(row[-1] for row in reversed(rows)))


Segment = Arc | Bezier


def line(a: complex, b: complex) -> Bezier:
    """Straight segment."""
    return Bezier((a, b))


def hermite(a: complex, along_a: complex, b: complex, along_b: complex, tension: float = 0.37) -> Bezier:
    """Cubic from `a` to `b` with the given directions; control legs are `tension` of the chord."""
    leg = tension * abs(b - a)
    return Bezier((a, a + leg * along_a / abs(along_a), b - leg * along_b / abs(along_b), b))


@dataclass(frozen=True)
class Wrench:
    """Measures in millimetres; the handle runs from the ring up to the jaw."""

    head: complex = 62j
    head_radius: float = 16.0
    gap: float = 15.0
    jaw_turn: float = 0.0
    """Jaw axis against the handle, degrees, counter-clockwise positive."""
    handle_at_head: float = 90.0
    """Direction of the handle at the head, degrees."""
    ring_radius: float = 13.0
    hole_radius: float = 8.0
    handle_at_ring: float = 90.0
    widths: tuple[float, float] = (10.0, 11.6)
    """Handle width at the ring and at the head."""
    segments: dict[str, Segment] = field(init=False)
    """The outline, counter-clockwise, by name."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "segments", self._draw())

    def from_head(self, z: complex) -> complex:
        """Point of the head's frame, whose +y is the jaw's axis."""
        return self.head + z * polar(1.0, self.handle_at_head + self.jaw_turn - 90)

    def _draw(self) -> dict[str, Segment]:
        turned = polar(1.0, self.handle_at_head + self.jaw_turn - 90)
        base = self.handle_at_head + 180
        ring_frame, neck_frame = polar(1.0, self.handle_at_ring - 90), polar(1.0, self.handle_at_head - 90)
        g = self.gap / 2
        out: dict[str, Segment] = {}
        ring_end = {side: self.handle_at_ring - 41 * side for side in (1, -1)}
        belly = {1: self.handle_at_head + self.jaw_turn - 98, -1: self.handle_at_head + self.jaw_turn + 98}
        neck = {1: base + 46, -1: base - 46}

        foot = {side: ring_frame * complex(side * self.widths[0] / 2, 19.5) for side in (1, -1)}
        top = {side: self.head + neck_frame * complex(side * self.widths[1] / 2, -24.0) for side in (1, -1)}
        handle = {}
        for side in (1, -1):
            chord = top[side] - foot[side]
            bend = polar(1.0, (self.handle_at_head - self.handle_at_ring) / 2)
            handle[side] = (
                line(foot[side], top[side])
                if bend == 1
                else hermite(foot[side], chord / bend, top[side], chord * bend, 1 / 3)
            )
        ways = {side: (h.points[1] - h.points[0], h.points[-1] - h.points[-2]) for side, h in handle.items()}

        def around(angle: float) -> complex:
            return polar(1.0, angle + 90)

        ring_point = {side: polar(self.ring_radius, ring_end[side]) for side in (1, -1)}
        neck_point = {side: self.head + polar(self.head_radius, neck[side]) for side in (1, -1)}
        tip_outer = {side: self.from_head(complex(side * 12.2, 10.8)) for side in (1, -1)}
        tip_inner = {side: self.from_head(complex(side * g, 10.8)) for side in (1, -1)}
        lean = {side: turned * complex(side * -0.42, 0.907) for side in (1, -1)}
        side_point = {side: self.head + polar(self.head_radius, belly[side]) for side in (1, -1)}
        throat = self.from_head(-0.5j)

        out["ring"] = Arc(0j, self.ring_radius, ring_end[-1], ring_end[1] + 360)
        out["ring fillet right"] = hermite(ring_point[1], around(ring_end[1]), foot[1], ways[1][0])
        out["handle right"] = handle[1]
        out["neck right"] = hermite(top[1], ways[1][1], neck_point[1], around(neck[1]))
        out["head right"] = Arc(self.head, self.head_radius, neck[1], belly[1] + 360)
        out["cheek right"] = hermite(side_point[1], around(belly[1]), tip_outer[1], lean[1], 1 / 3)
        out["tip right"] = line(tip_outer[1], tip_inner[1])
        out["flat right"] = line(tip_inner[1], throat + turned * g)
        axis = self.handle_at_head + self.jaw_turn
        out["throat"] = Arc(throat, g, axis - 90, axis - 270)
        out["flat left"] = line(throat - turned * g, tip_inner[-1])
        out["tip left"] = line(tip_inner[-1], tip_outer[-1])
        out["cheek left"] = hermite(tip_outer[-1], -lean[-1], side_point[-1], around(belly[-1]), 1 / 3)
        out["head left"] = Arc(self.head, self.head_radius, belly[-1], neck[-1])
        out["neck left"] = hermite(neck_point[-1], around(neck[-1]), top[-1], -ways[-1][1])
        out["handle left"] = Bezier(handle[-1].points[::-1])
        out["ring fillet left"] = hermite(foot[-1], -ways[-1][0], ring_point[-1], around(ring_end[-1]))
        return out

    @property
    def hole(self) -> Arc:
        """The ring's hole, from the top, clockwise."""
        return Arc(0j, self.hole_radius, 90, -270)

    def __call__(self, name: str, t: float) -> complex:
        """Point of a segment of the outline, or of the hole, at a fraction of its parameter."""
        return (self.hole if name == "hole" else self.segments[name])(t)


# ------------------------------------------------------------------------------------------------ source

#: Vertices of the layout on the boundary: segment and fraction.
ON_BOUNDARY = {
    "r0": ("ring fillet right", 0.3),
    "r1": ("ring", 0.755),
    "r2": ("ring", 0.5),
    "r3": ("ring", 0.245),
    "r4": ("ring fillet left", 0.7),
    "n0": ("neck right", 0.05),
    "n3": ("neck left", 0.95),
    "f0": ("head right", 0.12),
    "f1": ("head left", 0.88),
    "to0": ("tip right", 0.0),
    "tm0": ("tip right", 0.5),
    "ti0": ("flat right", 0.0),
    "a0": ("throat", 0.27),
    "a1": ("throat", 0.73),
    "ti1": ("flat left", 1.0),
    "tm1": ("tip left", 0.5),
    "to1": ("cheek left", 0.0),
    # The hole from the top, clockwise.
    "h0": ("hole", 33 / 360),
    "h1": ("hole", 112 / 360),
    "h2": ("hole", 0.5),
    "h3": ("hole", 248 / 360),
    "h4": ("hole", 327 / 360),
    "h5": ("hole", 349 / 360),
    "h6": ("hole", 11 / 360),
}

#: Vertices inside.
INSIDE = {
    "i0": 2.1 + 14.2j,
    "i1": -2.1 + 14.2j,
    "n1": 1.95 + 38j,
    "n2": -1.95 + 38j,
    "p0": 7.3 + 52.3j,
    "p1": -7.3 + 52.3j,
}

#: Counter-clockwise.
QUADS = [
    # ring
    ("h6", "h0", "r0", "i0"),
    ("h5", "h6", "i0", "i1"),
    ("h4", "h5", "i1", "r4"),
    ("h0", "h1", "r1", "r0"),
    ("h1", "h2", "r2", "r1"),
    ("h2", "h3", "r3", "r2"),
    ("h3", "h4", "r4", "r3"),
    # handle
    ("i0", "r0", "n0", "n1"),
    ("i1", "i0", "n1", "n2"),
    ("r4", "i1", "n2", "n3"),
    # head, around the two vertices of valence 5
    ("n1", "n0", "f0", "p0"),
    ("n2", "n1", "p0", "p1"),
    ("n3", "n2", "p1", "f1"),
    ("p1", "p0", "a0", "a1"),
    ("p0", "f0", "to0", "tm0"),
    ("a0", "p0", "tm0", "ti0"),
    ("f1", "p1", "tm1", "to1"),
    ("p1", "a1", "ti1", "tm1"),
]


def xy(z: complex) -> tuple[float, float]:
    """Coordinates."""
    return z.real, z.imag


def to_curve(segment: Segment) -> pt.BSplineCurve:
    """The segment as a B-spline; arcs as fine interpolating cubics."""
    if isinstance(segment, Bezier):
        p = len(segment.points) - 1
        return pt.BSplineCurve([0] * (p + 1) + [1] * (p + 1), p, [xy(z) for z in segment.points])
    pieces = int(np.ceil(abs(segment.end - segment.begin) / 15))
    step = np.radians((segment.end - segment.begin) / pieces)
    leg = 4 / 3 * np.tan(step / 4) * segment.radius
    points = [segment(0.0)]
    for k in range(pieces):
        a, b = (segment((k + d) / pieces) for d in (0, 1))
        normals = [(z - segment.centre) / segment.radius for z in (a, b)]
        points += [a + 1j * leg * normals[0], b - 1j * leg * normals[1], b]
    inner = np.repeat(np.arange(1, pieces) / pieces, 3)
    return pt.BSplineCurve([0] * 4 + inner.tolist() + [1] * 4, 3, [xy(z) for z in points])


def make_source(wrench: Wrench) -> pt.MultiPatch:
    """Carry the layout onto the outline."""
    at = {name: wrench(*place) for name, place in ON_BOUNDARY.items()} | INSIDE
    number = {name: k for k, name in enumerate(at)}
    outline = pt.Boundary([[to_curve(s) for s in wrench.segments.values()], [to_curve(wrench.hole)]])
    quads = [[number[name] for name in quad] for quad in QUADS]
    result = pt.from_layout([xy(z) for z in at.values()], quads, outline, DEGREE, SPANS)
    if result.warnings:
        raise SystemExit("\n".join(result.warnings))
    return result.multipatch


# ------------------------------------------------------------------------------------------------ target

#: Corresponding places that one would click on.
LANDMARKS = {
    "right tip, outside": ("tip right", 0.0),
    "right tip, inside": ("flat right", 0.0),
    "throat, right": ("throat", 0.0),
    "throat, left": ("throat", 1.0),
    "left tip, inside": ("flat left", 1.0),
    "left tip, outside": ("cheek left", 0.0),
    "head, left": ("neck left", 0.0),
    "handle, top left": ("handle left", 0.0),
    "handle, bottom left": ("handle left", 1.0),
    "ring, left": ("ring", 0.0),
    "ring, bottom": ("ring", 0.5),
    "ring, right": ("ring", 1.0),
    "handle, bottom right": ("handle right", 0.0),
    "handle, top right": ("handle right", 1.0),
    "head, right": ("neck right", 1.0),
    "hole, top": ("hole", 0.0),
    "hole, bottom": ("hole", 0.5),
}

SVG = """<?xml version="1.0" encoding="UTF-8"?>
<svg xmlns="http://www.w3.org/2000/svg" width="{width:g}mm" height="{height:g}mm" viewBox="0 0 {width:g} {height:g}">
  <title>Wrench with a turned jaw</title>
  <g id="wrench" transform="translate({x:g} {y:g})" style="fill:#d9dee2;stroke:#1c1c1c;stroke-width:0.3">
    <path id="outline"
      d="{outline}"/>
    <circle id="ring-hole" cx="{cx:g}" cy="{cy:g}" r="{r:g}" style="fill:#ffffff"/>
  </g>
</svg>
"""

#: Page and where the ring's centre lies on it, millimetres.
PAGE, ORIGIN = (56.0, 108.0), (28.0, 88.0)


def svg_number(z: complex) -> str:
    """Drawings have y down."""
    return f"{z.real:.4f},{-z.imag:.4f}"


def svg_command(segment: Segment) -> str:
    """Path command that continues to the segment's end."""
    if isinstance(segment, Arc):
        turn = segment.end - segment.begin
        flags = f"{int(abs(turn) > 180)} {int(turn < 0)}"
        return f"A {segment.radius:g},{segment.radius:g} 0 {flags} {svg_number(segment(1.0))}"
    return f"{'LC'[len(segment.points) > 2]} " + " ".join(svg_number(z) for z in segment.points[1:])


def draw(wrench: Wrench) -> str:
    """The outline as a drawing, cut at other places than the source's sides."""
    cuts = {"ring": (0.31, 0.5), "throat": (0.4,), "head right": (0.5,), "handle right": (0.35,)}
    segments: list[Segment] = []
    for name, segment in wrench.segments.items():
        for t in cuts.get(name, ()):
            before, segment = segment.split(t)
            segments.append(before)
        segments.append(segment)
    first, last = segments.index(wrench.segments["cheek left"]), segments.index(wrench.segments["handle left"])
    head, tail = segments[first].split(0.6)
    segments = [tail, *segments[first + 1 : last], *segments[last:], *segments[:first], head]
    commands = [f"M {svg_number(tail.points[0])}", *map(svg_command, segments), "Z"]
    return SVG.format(
        width=PAGE[0],
        height=PAGE[1],
        x=ORIGIN[0],
        y=ORIGIN[1],
        outline="\n         ".join(commands),
        cx=wrench.hole.centre.real,
        cy=0.0 - wrench.hole.centre.imag,
        r=wrench.hole_radius,
    )


def landmarks(source: Wrench, target: Wrench) -> str:
    """Table of corresponding places."""
    page = complex(ORIGIN[0], -ORIGIN[1])
    rows = [
        "# Corresponding places in millimetres, y up: in the drawing target.svg y is -yt.",
        "place,xs,ys,xt,yt",
    ]
    for name, place in LANDMARKS.items():
        numbers = (*xy(source(*place)), *xy(target(*place) + page))
        rows.append(f"{name.replace(',', '')},{','.join(f'{x:.4f}' for x in numbers)}")
    return "\n".join(rows) + "\n"


def illustrate() -> None:
    """Picture of the README."""
    source, target, places = examples.load("wrench")
    result = pt.transfer(source, target, places, continuity="c0")
    metrics = result.quality.scaled_jacobian
    caption = (
        f"{result.certificate.status}; scaled Jacobian at least {metrics.min:.2f}, mean {metrics.mean:.2f}; "
        f"boundary error {result.boundary_error:.0e} of the diameter"
    )
    figure = pt.plot.transfer(source, target, result.multipatch, caption=caption)
    pt.plot.savefig(figure, PICTURE, dpi=110)


STRAIGHT = Wrench()
TURNED = Wrench(
    head=-7.5 + 62j,
    head_radius=16.5,
    gap=15.5,
    jaw_turn=-22.0,
    handle_at_head=101.0,
    ring_radius=12.0,
    hole_radius=7.4,
    handle_at_ring=88.0,
    widths=(8.0, 9.6),
)

#: The same wrench with its jaws moved down in equal steps (as Fig. 12 of the paper).
STEPS = [Wrench(jaw_turn=-8.0 * (k + 1)) for k in range(4)]

if __name__ == "__main__":
    FOLDER.mkdir(parents=True, exist_ok=True)
    source = make_source(STRAIGHT)
    pt.write(source, FOLDER / "source.xml")
    (FOLDER / "target.svg").write_text(draw(TURNED))
    (FOLDER / "landmarks.csv").write_text(landmarks(STRAIGHT, TURNED))
    for k, step in enumerate(STEPS, 1):
        (FOLDER / f"target-step{k}.svg").write_text(draw(step))
        (FOLDER / f"landmarks-step{k}.csv").write_text(landmarks(STRAIGHT, step))
    print(source, pt.quality(source).scaled_jacobian)
    illustrate()
