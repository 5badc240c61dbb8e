"""Draw what the stages do to the bundled examples and a few small shapes: docs/images/stages/*.png.

White ground, as all pictures have: ink and colours are those of `patchtransfer.plot`, and stay legible on dark pages.
"""

from __future__ import annotations

import argparse
import io
from collections.abc import Callable, Sequence
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from PIL import Image
from stage_panels import BLUE, GREY, INK, RED, bent, mesh, model, named, outline, polygon, quad, row, zoom

import patchtransfer as pt
from patchtransfer import examples, iga
from patchtransfer.geometry.strips import strips
from patchtransfer.interior.optimizer import SplineOptimizer
from patchtransfer.mesh.background_mesh import TriangleMesh, source_mesh, target_mesh
from patchtransfer.mesh.harmonic import mesh_harmonic_map
from patchtransfer.paper.bounded_distortion import remove_foldovers
from patchtransfer.paper.distortion_descent import minimise_distortion
from patchtransfer.paper.reversible_harmonic import reverse_boundary, reversible_harmonic_map
from patchtransfer.plot.palette import LIGHT

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "images" / "stages"
#: Dots an inch, and colours of a file: with more, some exceed 60 kB.
DPI, COLOURS = 110, 64


@cache
def example(name: str) -> tuple[pt.MultiPatch, pt.Boundary, np.ndarray]:
    """Source, target and landmarks."""
    return examples.load(name)


@cache
def transferred(name: str, **options: object) -> pt.TransferResult:
    """Without continuity across patches, so that stages before it are seen alone."""
    return pt.transfer(*example(name), **({"continuity": "c0"} | options))


# ------------------------------------------------------------------------------------------------------------ figures


def topology() -> Figure:
    """Shared points, valences and the senses of loops."""
    source = example("wrench")[0]
    figure, (ax,) = row(1, (5.6, 2.9))
    turned = source.with_shared_points(source.topology.coordinates[:, ::-1] * [1, -1])
    pt.plot.multipatch(turned, ax, color="patch", iso_lines=1, colorbar=False)
    for vertex in turned.topology.vertices:
        if vertex.interior:
            at = turned.topology.coordinates[vertex.point]
            colour = RED if vertex.extraordinary else INK
            ax.annotate(str(vertex.valence), at, fontsize=7, color=colour, ha="center", va="center", zorder=9,
                        bbox={"boxstyle": "circle,pad=0.2", "fc": "white", "ec": colour, "lw": 0.8})  # fmt: skip
    for loop in turned.boundary().loops:
        for curve in loop:
            middle = np.mean(curve.domain)
            x, along = curve(middle), curve.derivative(middle)
            step = 1.5 * along / np.hypot(*along)
            ax.annotate("", x + step, x - step, arrowprops={"arrowstyle": "-|>", "color": INK, "lw": 1}, zorder=8)
    named(ax, "")
    return figure


def feasibility() -> Figure:
    """What a corner of one patch allows."""
    figure, axes = row(3, (7.2, 2.1))
    for ax, degrees in zip(axes, (110, 165, 200), strict=True):
        half = np.radians(degrees / 2)
        left, right = (-np.sin(half), np.cos(half)), (np.sin(half), np.cos(half))
        shape = quad(*left, 0, 0, *right, 0, 1.7)
        bound = np.sin(np.radians(degrees))
        model(ax, shape, f"{degrees}°: " + (f"at most {bound:.2f}" if bound > 0 else "no injective map"), iso_lines=10)
        ax.annotate(f"{degrees}°", (0, 0), (0, -9), textcoords="offset points", ha="center", va="top", fontsize=9)
        ax.set(ylim=(-1.35, 1.8), xlim=(-1.1, 1.1))
    return figure


def certificate() -> Figure:
    """Bernstein coefficients of det J, before and after a patch is halved."""
    # Two of its coefficients are negative, and det J is positive.
    knots = [0, 0, 0, 1, 1, 1]
    points = [[[0, 0], [0.5, 1.1], [0, 2]], [[0.7, -0.4], [0.4, 1.6], [1.3, 1.5]], [[2, 0], [2, 1.3], [2, 2]]]
    whole = pt.Patch((knots, knots), (2, 2), np.array(points, float))
    halves = whole.insert_knots(0, [0.5, 0.5]).insert_knots(1, [0.5, 0.5])
    figure, axes = row(2, (6.4, 3.0))
    for ax, cuts in zip(axes, ((0, 1), (0, 0.5, 1)), strict=True):
        model(ax, pt.MultiPatch([whole], []), "", color=None, iso_lines=8)
        negative = 0
        for u0, u1 in pairwise(cuts):
            for v0, v1 in pairwise(cuts):
                t = np.linspace(0, 1, 4)
                u, v = np.meshgrid(u0 + (u1 - u0) * t, v0 + (v1 - v0) * t, indexing="ij")
                determinants = np.linalg.det(whole.jacobian(u, v))
                d = solved(solved(determinants).T).T
                # Where the coefficients belong, a little towards the middle of the piece.
                s = 0.06 + 0.88 * t
                at = whole((u0 + (u1 - u0) * s)[:, None], v0 + (v1 - v0) * s).reshape(-1, 2)
                bad = (d <= 0).ravel()
                negative += int(bad.sum())
                ax.scatter(*at[~bad].T, s=22, c=BLUE, zorder=6, lw=0)
                ax.scatter(*at[bad].T, s=34, c=RED, zorder=7, lw=0, marker="X")
        for cut in cuts[1:-1]:
            t = np.linspace(0, 1, 40)
            ax.plot(*whole(cut, t).T, color=INK, lw=1.4)
            ax.plot(*whole(t, cut).T, color=INK, lw=1.4)
        pieces = (len(cuts) - 1) ** 2
        word = f"{negative} of 16 not positive: open" if negative else "all positive: proved"
        named(ax, f"{pieces} piece{'s' * (pieces > 1)}: {word}")
    assert pt.certify(pt.MultiPatch([halves], [])).injective
    return figure


def solved(values: np.ndarray) -> np.ndarray:
    """Bernstein coefficients of cubics by their values at thirds, along the first axis."""
    t = np.linspace(0, 1, 4)[:, None]
    bernstein = np.array([1, 3, 3, 1]) * t ** np.arange(4) * (1 - t) ** (3 - np.arange(4))
    return np.linalg.solve(bernstein, values)


def quality() -> Figure:
    """The two measures on one model."""
    figure, axes = row(2, (7.2, 3.4))
    mp = transferred("two-hole-plate").multipatch
    for ax, color in zip(axes, ("scaled_jacobian", "condition"), strict=True):
        pt.plot.multipatch(mp, ax, color=color)
        named(ax, "")
    return figure


def registration() -> Figure:
    """Joints and matched points in like colours."""
    source, target, _ = example("rabbit")
    result = pt.transfer(source, target, continuity="c0")
    figure = pt.plot.registration(
        source.boundary(), result.multipatch.boundary(), [[*a, *b] for a, b in result.registration.joints], target,
        matched=result.registration.pairs(120), confidence=result.registration.confidence,
    )  # fmt: skip
    figure.set_size_inches(6.4, 3.8)
    return figure


def expectation() -> Figure:
    """What was expected of the examples, and what came."""
    figure = Figure(figsize=(6.2, 2.5), layout="constrained")
    ax = figure.subplots()
    names = [name for name in examples.EXAMPLES if name not in examples.RATIONAL]
    for k, name in enumerate(names):
        source, target, _ = example(name)
        result = pt.transfer(source, target, continuity="c0")
        low, median, high = result.registration.expected.min_scaled_jacobian
        ax.plot([low, high], [k, k], color=LIGHT.anchors[6], lw=7, solid_capstyle="butt", alpha=0.5)
        ax.plot([median, median], [k - 0.25, k + 0.25], color=LIGHT.anchors[6], lw=2)
        ax.plot(result.quality.scaled_jacobian.min, k, "o", color=LIGHT.anchors[8], ms=6)
    ax.set_yticks(range(len(names)), names, fontsize=8.5)
    ax.set(xlim=(0, 1), xlabel="least scaled Jacobian: 10 % to 90 % expected, median; dots: what came")
    ax.invert_yaxis()
    ax.xaxis.label.set_fontsize(8.5)
    ax.tick_params(axis="x", labelsize=8)
    ax.spines[["top", "right"]].set_visible(False)
    return figure


def fitting() -> Figure:
    """Fitted curves with their control points, over the target."""
    target, result = example("wrench")[1], transferred("wrench")
    figure, axes = row(2, (6.6, 3.6))
    for ax in axes:
        for loop in target.loops:
            for curve in loop:
                ax.plot(*curve(np.linspace(*curve.domain, 80)).T, color=GREY, lw=4, solid_capstyle="round")
        for loop in result.fitted.loops:
            for side in loop:
                ax.plot(*side.curve(np.linspace(*side.curve.domain, 80)).T, color=LIGHT.anchors[8], lw=1.3, zorder=6)
                ax.plot(*side.curve.control_points.T, "o-", color=LIGHT.anchors[3], ms=3, lw=0.7, zorder=7)
                ax.plot(*side.curve.control_points[[0, -1]].T, "o", color=INK, ms=5, zorder=8)
    named(axes[0], "target (grey), fit (blue)")
    named(axes[1], "control points; joints of sides black")
    zoom(axes[1], result.fitted.loops[1][0].curve.control_points[0], 0.14 * target.diameter)
    return figure


def refinement() -> Figure:
    """A knot goes through a whole strip."""
    source = example("two-hole-plate")[0]
    strip = max(strips(source.topology), key=lambda s: len(s.members) if len(s.members) < 9 else 0)
    figure, axes = row(2, (7.0, 3.2))
    for ax, title in zip(axes, ("a strip: patches that share knots", "a knot in one is a knot in all"), strict=True):
        pt.plot.multipatch(source, ax, color=None, iso_lines=1, colorbar=False)
        named(ax, title)
        for k, axis in strip.members:
            patch = source.patches[k]
            corners = np.concatenate(rim(patch))
            ax.fill(*corners.T, color=LIGHT.patches[1], zorder=0)
            if ax is axes[1]:
                (u0, u1), t = patch.domain[axis], np.linspace(*patch.domain[1 - axis], 30)
                cut = np.full(30, u0 + 0.5 * (u1 - u0))
                ax.plot(*(patch(cut, t) if axis == 0 else patch(t, cut)).T, color=RED, lw=1.6)
    return figure


def rim(patch: pt.Patch) -> list[np.ndarray]:
    """The sides, counter-clockwise in the parameters."""
    (u0, u1), (v0, v1) = patch.domain
    u, v = np.linspace(u0, u1, 30), np.linspace(v0, v1, 30)
    full = np.ones(30)
    return [patch(u, v0 * full), patch(u1 * full, v), patch(u[::-1], v1 * full), patch(u0 * full, v[::-1])]


def splitting() -> Figure:
    """A tab that the source has no joint for."""
    source = pt.parameterize(polygon((0, 0), (4, 0), (4, 1), (0, 1))).multipatch
    target = polygon((0, 0), (4, 0), (4, 1), (2.6, 1), (2.7, 1.5), (1.3, 1.5), (1.4, 1), (0, 1))
    figure, axes = row(3, (9.0, 2.2))
    model(axes[0], source, "source", color="patch")
    for ax, split in zip(axes[1:], ("never", "auto"), strict=True):
        result = pt.transfer(source, target, continuity="c0", split=split, refine="auto", on_failure="return")
        model(ax, result.multipatch, f'"{split}": missed by {result.boundary_error:.0e}')
        for loop in target.loops:
            for curve in loop:
                ax.plot(*curve(np.linspace(*curve.domain, 2)).T, color=RED, lw=0.8, zorder=9)
    return figure


def smooth_places() -> Figure:
    """A square of one patch on a disc."""
    source = pt.parameterize(polygon((0, 0), (2, 0), (2, 2), (0, 2))).multipatch
    t = np.linspace(0, 2 * np.pi, 120, endpoint=False)
    target = pt.Boundary.from_points(np.column_stack([1.1 * np.cos(t), np.sin(t)]), smooth=True)
    result = pt.transfer(source, target, continuity="c0", split="auto")
    figure, axes = row(3, (7.2, 2.5))
    model(axes[0], source, "source: four corners")
    outline(axes[1], target, "target: no corner")
    model(axes[2], result.multipatch, f'split="auto": {len(result.multipatch)} patches, {result.certificate.status}')
    return figure


def mirror_images() -> Figure:
    """A target that is the source's mirror image."""
    corners = np.array([(0, 0), (2.2, 0), (2.2, 0.8), (0.8, 0.8), (0.8, 3), (0, 3)], float)
    source = pt.parameterize(polygon(*corners)).multipatch
    tilted = (corners * [-1, 1])[::-1] @ np.array([[1, 0.15], [-0.25, 1]])
    target = polygon(*tilted)
    result = pt.transfer(source, target, continuity="c0", mirror="auto")
    assert result.mirrored
    figure, axes = row(3, (6.4, 2.6))
    model(axes[0], source, "source", color="patch", ids=True)
    outline(axes[1], target, "target")
    model(axes[2], result.multipatch, 'mirror="auto"', color="patch", ids=True)
    return figure


def continuity() -> Figure:
    """Iso-lines across interfaces, with and without rows."""
    figure = pt.plot.kinks({kind: transferred("wrench", continuity=kind).multipatch for kind in ("c0", "c1")}, 1)
    figure.set_size_inches(7.0, figure.get_size_inches()[1] * 7.0 / figure.get_size_inches()[0])
    return figure


@cache
def turned(degrees: float = 90) -> np.ndarray:
    """The plate's shared points, its holes turned round their middles; the inside stays, and counts for nothing."""
    shape = example("two-hole-plate")[0].topology
    points, angle = shape.coordinates.copy(), np.radians(degrees)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    for loop in shape.loops[1:]:
        on = np.unique(np.concatenate([side.side.of(shape.points[side.patch]).ravel() for side in loop]))
        middle = points[on].mean(axis=0)
        points[on] = (points[on] - middle) @ turn + middle
    return points


def meshes() -> tuple[TriangleMesh, np.ndarray, np.ndarray]:
    """The wrench's mesh, its boundary points, and all points with a boundary that is bent."""
    shape = example("wrench")[0].topology
    return source_mesh(shape)[0], shape.boundary_points, bent(shape.coordinates, 100)


def other_mesh() -> TriangleMesh:
    """Of the bent boundary."""
    source, _, moved = meshes()
    area = abs(TriangleMesh(moved, source.triangles, ()).areas().sum())
    return target_mesh([moved[loop] for loop in source.loops], max_area=float(area) / len(source.triangles))


def background_mesh() -> Figure:
    """The two triangulations."""
    source, _, _ = meshes()
    other = other_mesh()
    figure, axes = row(2, (5.4, 3.8))
    mesh(axes[0], source.points, source.triangles, "of the source's control points")
    mesh(axes[1], other.points, other.triangles, "of the target's boundary")
    return figure


def reversible_harmonic() -> Figure:
    """The first map, and what the reversed one adds."""
    source, boundary, moved = meshes()
    other = other_mesh()
    first = mesh_harmonic_map(source, boundary, moved[boundary])
    found = reversible_harmonic_map(source, other, boundary, moved[boundary], first, reverse_boundary(source, other))
    figure, axes = row(3, (7.4, 3.6))
    mesh(axes[0], source.points, source.triangles, "the source's mesh")
    mesh(axes[1], first, source.triangles, "one Dirichlet solve")
    mesh(axes[2], found.points, source.triangles, f"reversible, {len(found.steps)} iterations")
    return figure


@cache
def unfolded() -> tuple[TriangleMesh, np.ndarray, np.ndarray, int]:
    """The plate's mesh, a folded map of it, one that is not, and the number of steps from the former."""
    shape = example("two-hole-plate")[0].topology
    source = source_mesh(shape)[0]
    folded = mesh_harmonic_map(source, shape.boundary_points, turned()[shape.boundary_points])
    found = remove_foldovers(source, folded, shape.boundary_points)
    return source, folded, found.points, found.iterations


def bounded_distortion() -> Figure:
    """Flipped faces, and none."""
    source, folded, found, steps = unfolded()
    figure, axes = row(2, (8.0, 3.0))
    flips = int((TriangleMesh(folded, source.triangles, ()).areas() <= 0).sum())
    mesh(axes[0], folded, source.triangles, f"harmonic: {flips} flipped faces")
    left = int((TriangleMesh(found, source.triangles, ()).areas() <= 0).sum())
    mesh(axes[1], found, source.triangles, f"after {steps} steps: {left}")
    return figure


def distortion_descent() -> Figure:
    """Conformal distortion of every face before and after."""
    source, _, before, _ = unfolded()
    descent = minimise_distortion(source, before, example("two-hole-plate")[0].topology.boundary_points, None)
    figure, axes = row(2, (8.0, 3.0))
    corners = source.points[source.triangles]
    for ax, points, energy in zip(axes, (before, descent.points), (descent.energy[0], descent.energy[-1]), strict=True):
        there = points[source.triangles]
        a = np.linalg.solve((corners[:, 1:] - corners[:, :1]), (there[:, 1:] - there[:, :1]))
        share = (a**2).sum(axis=(1, 2)) / np.linalg.det(a)
        levels = [LIGHT.anchors[k] for k in (8, 7, 6, 5, 4, 3, 2)]
        which = np.clip(np.searchsorted([2.05, 2.2, 2.5, 3, 4, 6], share), 0, 6)
        ax.add_collection(PolyCollection(there, fc=[levels[k] for k in which], ec="white", lw=0.15))
        ax.autoscale_view()
        named(ax, f"mean distortion {energy:.3f}")
    return figure


def optimisation() -> Figure:
    """The harmonic start folds; the optimiser ends certified."""
    plan = pt.TransferPlan(example("two-hole-plate")[0], "c0")
    start = SplineOptimizer(plan.source.topology).harmonic(turned())
    result = plan.refill(turned())
    figure, axes = row(2, (8.0, 3.0))
    folded = plan.source.with_shared_points(start)
    model(axes[0], folded, f"harmonic start: {pt.certify(folded).status}")
    model(axes[1], result.multipatch, f"optimised: {result.certificate.status}")
    return figure


def polish() -> Figure:
    """The worst place before and after."""
    figure, axes = row(2, (7.2, 3.2))
    for ax, kind, word in zip(axes, (None, "scaled_jacobian"), ("without", 'polish="scaled_jacobian"'), strict=True):
        result = transferred("rabbit", **({"polish": kind} if kind else {}))
        proved = pt.quality(result.multipatch, proved=True).proved.min_scaled_jacobian
        model(ax, result.multipatch, f"{word}: at least {proved.lower:.3f}")
        ax.plot(*result.multipatch.patches[proved.at[0]](*proved.at[1:]), "o", ms=13, mfc="none", mec=RED, mew=1.6)
    return figure


def layout() -> Figure:
    """Four quads around a hole."""
    corners = [(10, 10), (110, 10), (110, 70), (10, 70)]
    around = [(60 + 9.9 * x, 46 + 9.9 * y) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    quads = [[k, (k + 1) % 4, 4 + (k + 1) % 4, 4 + k] for k in range(4)]
    t = np.linspace(0, np.pi, 30)
    x = 60 - 50 * np.cos(t)
    low = np.column_stack([x, 10 + 6 * np.sin(t)])
    high = np.column_stack([x[::-1], 70 + 12 * np.sin(t)])
    a = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    hole = np.column_stack([60 + 14 * np.cos(a), 46 + 14 * np.sin(a)])
    target = pt.Boundary.from_points([np.vstack([low, high]), hole], smooth=True)
    result = pt.from_layout([*corners, *around], quads, target, degree=3, spans=4)
    figure, axes = row(2, (6.4, 2.9))
    vertices = np.array([*corners, *around], float)
    axes[0].add_collection(PolyCollection(vertices[np.array(quads)], fc=list(LIGHT.patches[:4]), ec=INK, lw=1.4))
    axes[0].plot(*vertices.T, "o", color=INK, ms=4)
    for loop in target.loops:
        for curve in loop:
            axes[0].plot(*curve(np.linspace(*curve.domain, 60)).T, color=LIGHT.anchors[3], lw=1.2)
    named(axes[0], "layout of four quads, outline")
    model(axes[1], result.multipatch, f"source: {result.certificate.status}")
    return figure


def morph() -> Figure:
    """Between two wrenches."""
    source = example("wrench")[0]
    result = transferred("wrench")
    found = pt.morph(source, result.multipatch, 5)
    figure, axes = row(5, (8.0, 3.4))
    for k, (ax, frame) in enumerate(zip(axes, found.frames, strict=True)):
        model(ax, frame.multipatch, f"{k / 4:g}")
    return figure


def analysis() -> Figure:
    """A plate that is heated at its holes."""
    mp = transferred("two-hole-plate").multipatch
    loops = mp.topology.loops
    holes = [(side.patch, side.side) for loop in loops[1:] for side in loop]
    rim = [(side.patch, side.side) for side in loops[0]]
    solution = iga.poisson(
        mp.with_labels({"holes": holes, "rim": rim}), 0.0, {"holes": 80.0}, points=10, degree=3,
        robin={"rim": (1.0, 20.0)},
    )  # fmt: skip
    figure = pt.plot.solution(solution)
    figure.set_size_inches(5.2, 3.2)
    return figure


FIGURES: dict[str, Callable[[], Figure]] = {
    draw.__name__: draw
    for draw in (
        topology, feasibility, certificate, quality, registration, expectation, fitting, refinement, splitting,
        smooth_places, mirror_images, continuity, background_mesh, reversible_harmonic, bounded_distortion,
        distortion_descent, optimisation, polish, layout, morph, analysis,
    )
}  # fmt: skip


def write(figure: Figure, path: Path) -> None:
    """A file of few colours."""
    picture = io.BytesIO()
    figure.savefig(picture, dpi=DPI, facecolor="white", bbox_inches="tight", pad_inches=0.08)
    few = Image.open(picture).convert("RGB").quantize(COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    few.save(path, optimize=True)


def main(folder: Path, names: Sequence[str]) -> None:
    """Write the pictures."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in names or FIGURES:
        write(FIGURES[name](), folder / f"{name}.png")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="Which ones; all by default.")
    parser.add_argument("-o", "--output", type=Path, default=FOLDER, metavar="FOLDER")
    given = parser.parse_args()
    main(given.output, given.names)
