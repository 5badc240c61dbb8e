"""Parameterize many outlines automatically: writes docs/layouts.md and the picture docs/images/layouts.png.

Names for --only are those of the table, "glyphs" and "random".
"""

from __future__ import annotations

import argparse
import io
import string
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from glyphs import glyph
from matplotlib.figure import Figure
from PIL import Image

import outlines
import patchtransfer as pt
from patchtransfer import MultiPatch, examples
from patchtransfer.sources.auto_layout import parameterize

ROOT = Path(__file__).resolve().parents[1]
FONTS = ("DejaVuSans", "DejaVuSerif")

HEADER = """# Layouts found

Written by `scripts/layout_table.py`{options}. `parameterize` is given nothing but an outline, with default options. By
hand: patches and scaled Jacobian (min / mean) of the bundled sample the outline is taken from. Corner bound: the most
that the boundary's corners allow as smallest scaled Jacobian. Boundary error: relative to the diameter. Candidates:
layouts tried. CPU: processor time of the whole call, in seconds, on a machine busy with other work.

"""

TABLE = """| outline | patches | by hand | min | mean | corner bound | boundary error | status | candidates | CPU |
|---|---:|---|---:|---:|---:|---:|---|---:|---:|
"""

PICTURE = """
![The patches found, coloured by scaled Jacobian](images/{name})
"""

CROWDS = """
## Glyphs and random outlines

Glyphs: letters and digits of one component. Random outlines, seeds from 0, in turn: star polygons, smooth loops with up
to three holes, unions of grid cells, loops of smooth pieces between corners (`scripts/outlines.py`). Main route: the
best layout comes from the cross field; otherwise from convex pieces, the last resort. Refused: outlines that cross or
touch themselves. Patches, CPU: median / 95 %. min, mean: medians of the scaled Jacobians.

| outlines | number | refused | certified | main route | convex pieces | patches | min | mean | CPU |
|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|
"""

GMSH = """
## Beside gmsh

Measured once, gmsh 4.15 with algorithm 11 (quasi-structured), blocks of the base complex at element sizes of 1/30 and
1/60 of the diameter: wrench 130 and 151, rabbit 95 and 984, human 81 and 191, two-hole-plate 147 and 561.
"""


@dataclass(frozen=True)
class Outcome:
    """What is told of one outline; without patches where it was refused."""

    name: str
    status: str
    seconds: float
    mp: MultiPatch | None = None
    least: float = np.nan
    mean: float = np.nan
    corner_bound: float = np.nan
    boundary_error: float = np.nan
    candidates: int = 0
    convex: bool = False


def run(name: str, boundary: pt.Boundary) -> Outcome:
    """Parameterize one outline."""
    begin = time.process_time()
    try:
        r = parameterize(boundary, on_failure="return")
    except pt.TransferError as error:
        return Outcome(name, type(error).__name__, time.process_time() - begin)
    seconds, jacobian = time.process_time() - begin, r.quality.scaled_jacobian
    return Outcome(
        name,
        r.certificate.status,
        seconds,
        r.multipatch,
        jacobian.min,
        jacobian.mean,
        r.corner_bound,
        r.boundary_error,
        len(r.candidates),
        bool(r.candidates) and r.candidates[0].origin == "convex pieces",
    )


def row(o: Outcome) -> str:
    """One line of the table."""
    by_hand = ""
    if o.name in examples.EXAMPLES:
        source = examples.load(o.name)[0]
        jacobian = pt.quality(source).scaled_jacobian
        by_hand = f"{len(source)}, {jacobian.min:.3f} / {jacobian.mean:.3f}"
    if o.mp is None:
        return f"| {o.name} | – | {by_hand} | – | – | – | – | {o.status} | – | {o.seconds:.1f} |\n"
    status = o.status + ", convex pieces" * o.convex
    cells = [o.name, str(len(o.mp)), by_hand, f"{o.least:.3f}", f"{o.mean:.3f}", f"{o.corner_bound:.3f}"]
    cells += [f"{o.boundary_error:.1e}", status, str(o.candidates), f"{o.seconds:.1f}"]
    return f"| {' | '.join(cells)} |\n"


def crowd_row(name: str, crowd: list[Outcome]) -> str:
    """One line of the summary."""
    done = [o for o in crowd if o.mp is not None]
    refused = sum(o.status == "InfeasibleTargetError" for o in crowd)
    certified = [o for o in done if o.status == "certified"]
    convex = sum(o.convex for o in done)
    patches = [len(o.mp) for o in done if o.mp is not None]
    cells = [name, len(crowd), refused, len(certified), len(done) - convex, convex]
    cells += [f"{np.median(patches):.0f} / {np.percentile(patches, 95):.0f}"]
    cells += [f"{np.median([o.least for o in done]):.3f}", f"{np.median([o.mean for o in done]):.3f}"]
    seconds = [o.seconds for o in done]
    cells += [f"{np.median(seconds):.1f} / {np.percentile(seconds, 95):.1f}"]
    return f"| {' | '.join(map(str, cells))} |\n"


def exceptions(crowds: dict[str, list[Outcome]]) -> str:
    """What was not certified, by name."""
    lines = [
        f"- {name}, {o.name}: {o.status}\n" for name, crowd in crowds.items() for o in crowd if o.status != "certified"
    ]
    return "\nNot certified:\n\n" + "".join(lines) if lines else ""


def draw(outcomes: list[Outcome], path: Path, columns: int = 6) -> None:
    """A grid of the patches, in 256 colours to keep the file small."""
    drawn = [o for o in outcomes if o.mp is not None]
    rows = -(-len(drawn) // columns)
    figure = Figure(figsize=(12, 2.1 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for ax in axes[len(drawn) :]:
        ax.set_axis_off()
    for ax, o in zip(axes, drawn, strict=False):
        assert o.mp is not None
        pt.plot.multipatch(o.mp, ax, iso_lines=1, colorbar=False)
        if legend := ax.get_legend():
            legend.remove()
        ax.set_axis_off()
        ax.set_title(f"{o.name}: {len(o.mp)}", fontsize=9)
    picture = io.BytesIO()
    figure.savefig(picture, dpi=90)
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.open(picture).convert("RGB").quantize(256).save(path, optimize=True)


def crowds_asked(number: int) -> Iterator[tuple[str, list[tuple[str, pt.Boundary]]]]:
    """Random outlines and glyphs, each with its name."""
    yield "random", [(f"seed {seed}", outlines.random_outline(seed)) for seed in range(number)]
    for font in FONTS:
        found = [(c, glyph(c, font)) for c in string.ascii_letters + string.digits]
        yield font, [(c, boundary) for c, boundary in found if boundary is not None]


def main(output: Path, only: list[str], number: int, jobs: int, options: str) -> None:
    """Run everything; the page is written anew after every group."""
    text, crowds = HEADER.format(options=options), {}
    with ProcessPoolExecutor(jobs) as pool:

        def outcomes(asked: list[tuple[str, pt.Boundary]]) -> list[Outcome]:
            found = []
            for o in pool.map(run, *zip(*asked, strict=True)):
                print(row(o), end="", flush=True)
                found.append(o)
            return found

        names = [name for name in outlines.NAMED if not only or name in only]
        if names:
            named = outcomes([(name, outlines.NAMED[name]()) for name in names])
            picture = output.parent / "images" / f"{output.stem}.png"
            draw(named, picture)
            text += TABLE + "".join(map(row, named)) + PICTURE.format(name=picture.name)
            output.write_text(text + GMSH)
        for name, asked in crowds_asked(number):
            if asked and (not only or ("random" if name == "random" else "glyphs") in only):
                crowds[name] = outcomes(asked)
                lines = "".join(crowd_row(*item) for item in crowds.items())
                output.write_text(text + CROWDS + lines + exceptions(crowds) + GMSH)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", choices=[*outlines.NAMED, "glyphs", "random"])
    parser.add_argument("--random", type=int, default=40, metavar="N", help="random outlines (default: 40)")
    parser.add_argument("--jobs", type=int, default=1, help="processes (default: 1; more disturb each other's times)")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs" / "layouts.md", metavar="OUT.md")
    a = parser.parse_args()
    options = f" with `--only {' '.join(a.only)}`" if a.only else ""
    main(a.output, a.only, a.random, a.jobs, options)
