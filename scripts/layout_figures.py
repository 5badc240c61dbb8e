"""Draw the stages of the automatic layout on two samples' outlines: docs/images/automatic_layout/*.png."""

from __future__ import annotations

import argparse
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from PIL import Image
from scipy.spatial import cKDTree

import outlines
import patchtransfer as pt
from patchtransfer.geometry.outline import Outline
from patchtransfer.sources.auto_layout import Parameterization, parameterize
from patchtransfer.sources.auto_layout.assembly import assemble
from patchtransfer.sources.auto_layout.convex import convex_layout
from patchtransfer.sources.auto_layout.cross_field import CrossField, compute_cross_field
from patchtransfer.sources.auto_layout.geometry import filled
from patchtransfer.sources.auto_layout.mesh import LayoutMesh, corner_valences, generate_mesh, sample_simply
from patchtransfer.sources.auto_layout.prices import FEW
from patchtransfer.sources.auto_layout.quantize import MODES, quantize
from patchtransfer.sources.auto_layout.seamless_map import SeamlessMap, compute_seamless_map
from patchtransfer.sources.auto_layout.symmetric_places import symmetric_places
from patchtransfer.sources.auto_layout.symmetry import outline_symmetries
from patchtransfer.sources.auto_layout.t_mesh import TMesh, build_t_mesh

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "images" / "automatic_layout"
#: Outlines, each with the rounding of its corners that leads to its best layout.
DRAWN = {"wrench": 0.0, "rabbit": -0.2}

INK, GREY, U, V, COLLAPSED = "#1b1b1b", "#9aa1a6", "#2f8f83", "#a3549b", "#d7263d"
#: Singularities by valence.
SINGULAR = {3: "#ee8a1d", 5: "#2468b4"}
TINTS = ("#e4eef6", "#f8ece2", "#e6f3e6", "#f2e8f5", "#f6f3dc", "#fae6ea")
DOTTED = (0, (1, 1.2))
DISC = {"boxstyle": "circle,pad=0.2", "fc": "white", "ec": INK, "lw": 0.7}


@dataclass(frozen=True, eq=False)
class Stages:
    """What the stages make of one outline; lengths and patches in strict and in merging mode."""

    mesh: LayoutMesh
    field: CrossField
    map: SeamlessMap
    t_mesh: TMesh
    lengths: tuple[np.ndarray, ...]
    patches: tuple[pt.MultiPatch, ...]
    convex: pt.MultiPatch
    found: Parameterization

    @property
    def singular(self) -> np.ndarray:
        """Inner vertices of the mesh that are singular."""
        index = self.field.index.copy()
        index[: len(self.mesh.outline.points)] = 0
        return np.flatnonzero(index)


def stages(name: str, offset: float) -> Stages:
    """Run them one after the other, and then all of them again as users do."""
    boundary = outlines.NAMED[name]()
    loops = [Outline(loop) for loop in boundary.loops]
    outline = sample_simply(boundary)
    quads = corner_valences(outline, offset)
    mesh = generate_mesh(outline, quads)
    field = compute_cross_field(mesh)
    seamless = compute_seamless_map(mesh, field)
    faces = mesh.points, mesh.triangles, seamless.uv, seamless.rotation, field.index
    t_mesh = build_t_mesh(*faces, outline.next, outline.loop, quads > 0)
    lengths = tuple(quantize(t_mesh, outline, FEW[0], mode=mode).lengths for mode in MODES)
    isometries = outline_symmetries(loops)
    layouts = [symmetric_places(assemble(t_mesh, outline, x), loops, isometries) for x in lengths]
    strict, merging, convex = (
        filled(layout, boundary, loops, 3, 3, 1e-3).multipatch for layout in [*layouts, convex_layout(loops)]
    )
    found = parameterize(boundary)
    if len(found.multipatch) != len(strict):
        raise SystemExit(f"{name}: the best layout has {len(found.multipatch)} patches, the one drawn {len(strict)}")
    return Stages(mesh, field, seamless, t_mesh, lengths, (strict, merging), convex, found)


# ----------------------------------------------------------------------------------------------- contents of a panel


def outline(s: Stages, ax: Axes, width: float = 1.4) -> None:
    """The loops."""
    for nodes in s.mesh.outline.loop_nodes():
        ax.plot(*s.mesh.outline.points[np.append(nodes, nodes[0])].T, color=INK, lw=width, zorder=3)


def corners(s: Stages, ax: Axes) -> None:
    """Corners of the outline, and outside of them how many quads shall meet there."""
    points, following = s.mesh.outline.points, s.mesh.outline.next
    before = np.argsort(following)
    for node in np.flatnonzero(s.mesh.corner_valence):
        sides = points[node] - points[before[node]], points[following[node]] - points[node]
        # The domain is on the left of both sides.
        away = sum(np.array([y, -x]) / np.hypot(x, y) for x, y in sides)
        ax.plot(*points[node], "s", ms=3.6, color=INK, zorder=7)
        _number(ax, s.mesh.corner_valence[node], points[node], 8 * away / np.hypot(*away))


def crosses(s: Stages, ax: Axes, across: int = 36) -> None:
    """Crosses of the triangles nearest to the points of a grid, those that would stick out left out."""
    middle = s.mesh.points[s.mesh.triangles].mean(axis=1)
    step = np.ptp(middle[:, 1]) / across
    grid = np.round((middle - middle.mean(axis=0)) / step)
    order = np.argsort(np.hypot(*(middle - middle.mean(axis=0) - grid * step).T))
    nearest = order[np.unique(grid[order], axis=0, return_index=True)[1]]
    inside = cKDTree(s.mesh.outline.points).query(middle[nearest])[0] > 0.4 * step
    arms(s, ax, nearest[inside], 0.4 * step)
    outline(s, ax)
    singularities(ax, s.mesh.points[s.singular], s.field.index[s.singular])
    corners(s, ax)


def triangles(s: Stages, ax: Axes) -> None:
    """Triangles, a cross in each; those at corners of the outline in colour."""
    at_corner = np.isin(s.mesh.triangles, np.flatnonzero(s.mesh.corner_valence)).any(axis=1)
    places = s.mesh.points[s.mesh.triangles]
    ax.add_collection(PolyCollection(places[at_corner], facecolors="#f3e3f1", zorder=0))
    ax.add_collection(LineCollection(s.mesh.points[s.mesh.edges], colors=GREY, linewidths=0.5, zorder=1))
    # As long as fits into a triangle with these sides.
    arms(s, ax, np.arange(len(places)), 0.25 * np.sqrt(triangle_areas(places)))
    outline(s, ax)
    singularities(ax, s.mesh.points[s.singular], s.field.index[s.singular])
    corners(s, ax)


def arms(s: Stages, ax: Axes, which: np.ndarray, length: np.ndarray | float) -> None:
    """Crosses of triangles, given half their size."""
    middle = s.mesh.points[s.mesh.triangles[which]].mean(axis=1)
    for turn in (0.0, np.pi / 2):
        angle = s.field.theta[which] + turn
        arm = np.column_stack([length * np.cos(angle), length * np.sin(angle)])
        lines = np.stack([middle - arm, middle + arm], axis=1)
        ax.add_collection(LineCollection(lines, colors="#4a7896", linewidths=0.9, zorder=2))


def triangle_areas(places: np.ndarray) -> np.ndarray:
    """Areas (m,) of triangles (m, 3, 2)."""
    (a, b), (c, d) = (places[:, 1] - places[:, 0]).T, (places[:, 2] - places[:, 0]).T
    return (a * d - b * c) / 2


def iso_lines(s: Stages, ax: Axes, places: np.ndarray | None = None, across: int = 36) -> None:
    """Lines of constant u and v, a side of the image over `across` apart, and the cut; in the domain by default."""
    places = s.mesh.points[s.mesh.triangles] if places is None else places
    for k, colour in enumerate((U, V)):
        # Half a step in from the image's side, where the outline runs.
        values = 0.5 + (s.map.uv[..., k] - s.map.uv[..., k].min()) * across / np.ptp(s.map.uv, axis=(0, 1)).max()
        ax.add_collection(LineCollection(level_lines(places, values), colors=colour, linewidths=0.8, zorder=1))
    sides = np.stack([np.roll(places, -1, axis=1), np.roll(places, -2, axis=1)], axis=2)
    ax.add_collection(LineCollection(sides[s.map.seam], colors=INK, linewidths=1.3, linestyles=DOTTED, zorder=4))
    pairs = np.stack([np.roll(s.mesh.triangles, -1, axis=1), np.roll(s.mesh.triangles, -2, axis=1)], axis=2)
    on_outline = set(enumerate(s.mesh.outline.next.tolist()))
    rim = np.array([[tuple(pair) in on_outline for pair in three] for three in pairs.tolist()])
    ax.add_collection(LineCollection(sides[rim], colors=INK, linewidths=1.4, zorder=3, capstyle="round"))
    singular = np.isin(s.mesh.triangles, s.singular)
    singularities(ax, places[singular], s.field.index[s.mesh.triangles[singular]], 5.5)


def image(s: Stages, ax: Axes) -> None:
    """The domain in the plane of u and v, cut open, and turned so that up is up: maps are the same but for that."""
    height = s.mesh.points[s.mesh.triangles][..., 1]
    plane = s.map.uv @ np.array([1, 1j])
    turned = [(plane - plane.mean()) * 1j**quarter for quarter in range(4)]
    upright = max(turned, key=lambda z: float((z.imag * height).sum()))
    places = np.stack([upright.real, upright.imag], axis=-1)
    ax.add_collection(PolyCollection(places, facecolors="#edf0f2", edgecolors="#edf0f2", linewidths=0.5, zorder=0))
    iso_lines(s, ax, places)


def level_lines(places: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Segments (k, 2, 2) in triangles (m, 3, 2) on which linear functions, values (m, 3), are whole numbers."""
    found = []
    first = np.ceil(values.min(axis=1))
    for step in range(int((values.max(axis=1) - first).max()) + 1):
        rest = values - (first + step)[:, None]
        after = np.roll(rest, -1, axis=1)
        crossed = (rest >= 0) != (after >= 0)
        share = rest / np.where(crossed, rest - after, 1.0)
        points = places + share[..., None] * (np.roll(places, -1, axis=1) - places)
        passed = crossed.any(axis=1)
        found.append(points[passed][crossed[passed]].reshape(-1, 2, 2))
    return np.concatenate(found)


def t_mesh(s: Stages, ax: Axes) -> None:
    """Faces in pale colours, traces, junctions, critical points."""
    t = s.t_mesh
    faces = [rim(t, face) for face in range(len(t.faces))]
    ax.add_collection(PolyCollection(faces, facecolors=[TINTS[k] for k in face_colours(t)], zorder=0))
    for line, loop in zip(t.arc_points, t.arc_loop, strict=True):
        ax.plot(*line.T, color=INK, lw=1.5 if loop >= 0 else 0.9, zorder=3)
    on_outline = t.node_loop >= 0
    ax.plot(*t.node_point[~t.node_critical].T, "o", ms=2.8, color=INK, zorder=5)
    ax.plot(*t.node_point[t.node_critical & on_outline].T, "s", ms=4.2, color=INK, zorder=6)
    singularities(ax, t.node_point[~on_outline], t.node_index[~on_outline])


def face_colours(t: TMesh) -> list[int]:
    """Small numbers, other ones for neighbours."""
    arcs = [set((np.concatenate(face) // 2).tolist()) for face in t.faces]
    colours: list[int] = []
    for k, mine in enumerate(arcs):
        taken = {colours[other] for other in range(k) if mine & arcs[other]}
        colours.append(min(set(range(len(TINTS))) - taken, key=colours.count))
    return colours


def rim(t: TMesh, face: int) -> np.ndarray:
    """Polygon of a face."""
    halves = np.concatenate(t.faces[face]).tolist()
    lines = [t.arc_points[half // 2][:: -1 if half % 2 else 1] for half in halves]
    return np.concatenate([line[:-1] for line in lines])


def collapsed(s: Stages, ax: Axes, which: int = 0) -> None:
    """Arcs and faces that integer lengths collapse, in colour, and lengths beyond 1."""
    t, lengths = s.t_mesh, s.lengths[which]
    gone = [k for k, face in enumerate(t.faces) if min(lengths[side // 2].sum() for side in face[:2]) == 0]
    ax.add_collection(PolyCollection([rim(t, k) for k in gone], facecolors="#fbdcdc", zorder=0))
    for line, length, loop in zip(t.arc_points, lengths, t.arc_loop, strict=True):
        style = {"color": INK, "lw": 1.5 if loop >= 0 else 0.9, "zorder": 3}
        ax.plot(*line.T, **(style if length else {"color": COLLAPSED, "lw": 1.6, "zorder": 4}))
        if length > 1 and loop >= 0:
            _number(ax, length, line[len(line) // 2], bbox=DISC)
    inside = t.node_loop < 0
    singularities(ax, t.node_point[inside], t.node_index[inside], 5.5)


def quads(s: Stages, ax: Axes, which: int = 0) -> None:
    """Edges of patches, and valences: of inner vertices other than 4, of the outline's more than 2."""
    patches = s.patches[which]
    for patch in patches.patches:
        grid = patch.grid(*(np.linspace(knots[0], knots[-1], 40) for knots in patch.knots))
        for line in (grid[0], grid[-1], grid[:, 0], grid[:, -1]):
            ax.plot(*line.T, color=INK, lw=0.9, zorder=2)
    outline(s, ax)
    for vertex in patches.vertices:
        point = patches.topology.coordinates[vertex.point]
        if vertex.extraordinary:
            ax.plot(*point, "o", ms=9, mfc=SINGULAR[vertex.valence], mec="white", mew=0.9, zorder=8)
            _number(ax, vertex.valence, point, color="white")
        elif vertex.valence > 2 and not vertex.interior:
            _number(ax, vertex.valence, point, bbox=DISC)
        else:
            ax.plot(*point, "o", ms=2.8, color=INK, zorder=5)


def scaled_jacobian(patches: pt.MultiPatch, ax: Axes) -> None:
    """Finished patches."""
    pt.plot.multipatch(patches, ax, iso_lines=2, colorbar=False)
    if legend := ax.get_legend():
        legend.remove()


def singularities(ax: Axes, points: np.ndarray, index: np.ndarray, size: float = 6.5) -> None:
    """Discs in the colours of valences."""
    for valence, colour in SINGULAR.items():
        ax.plot(*points[index == 4 - valence].T, "o", ms=size, mfc=colour, mec="white", mew=0.9, zorder=8)


def _number(ax: Axes, number: int, at: np.ndarray, offset: Sequence[float] = (0, 0), **style: object) -> None:
    ax.annotate(
        str(number), at, offset, textcoords="offset points", ha="center", va="center_baseline", fontsize=7.5,
        zorder=9, **style
    )  # fmt: skip


# ----------------------------------------------------------------------------------------------------------- figures


@dataclass(frozen=True)
class Panel:
    """A drawing with its title, and which part of it is shown: left, bottom, width, height; all of it by default."""

    title: str
    draw: Callable[[Axes], None]
    window: tuple[float, float, float, float] | None = None


def of(
    s: Stages, title: str, draw: Callable[..., None], *zooms: tuple[float, float, float, float], **options: object
) -> Panel:
    """A panel of a domain, a little more than its outline; frames show what other panels enlarge."""

    def framed(ax: Axes) -> None:
        draw(s, ax, **options)
        for x, y, w, h in zooms:
            ax.add_patch(Rectangle((x, y), w, h, fc="none", ec=GREY, lw=0.8, zorder=10))

    return Panel(title, framed, window(s.mesh.outline.points))


def window(points: np.ndarray) -> tuple[float, float, float, float]:
    """The box round points, with room for numbers outside."""
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    room = 0.05 * size.max()
    return (*(low - room).tolist(), *(size + 2 * room).tolist())


def stacked(rows: Sequence[Sequence[Panel]], heights: Sequence[float], gap: float = 0.15) -> Figure:
    """Rows of panels, each of its height in inches and as wide as what it shows."""
    figure = Figure()
    axes = [[figure.add_axes((0, 0, 1, 1), label=f"{i} {k}") for k in range(len(row))] for i, row in enumerate(rows)]
    widths = [
        [_fill(*item) * height for item in zip(spots, row, strict=True)]
        for spots, row, height in zip(axes, rows, heights, strict=True)
    ]
    titles = [0.16 * (1.6 + max(panel.title.count("\n") for panel in row)) for row in rows]
    wide, high = max(sum(w) + gap * (len(w) - 1) for w in widths), sum(heights) + sum(titles)
    figure.set_size_inches(wide, high)
    bottom = high
    for spots, row, height, title in zip(axes, widths, heights, titles, strict=True):
        bottom -= height + title
        # Even gaps, so that short rows are as wide as the longest one.
        space = (wide - sum(row)) / max(len(row) - 1, 1)
        left = 0.0 if len(row) > 1 else space / 2
        for ax, width in zip(spots, row, strict=True):
            ax.set_position((left / wide, bottom / high, width / wide, height / high))
            left += width + space
    return figure


def _fill(ax: Axes, panel: Panel) -> float:
    """Draw a panel; width over height."""
    panel.draw(ax)
    ax.set_title(panel.title, fontsize=9.5, color=INK, pad=3)
    ax.set_axis_off()
    ax.set_aspect("equal")
    if panel.window:
        x, y, w, h = panel.window
        ax.set(xlim=(x, x + w), ylim=(y, y + h))
    else:
        ax.margins(0.04)
        ax.autoscale_view()
    (x0, x1), (y0, y1) = ax.get_xlim(), ax.get_ylim()
    return float((x1 - x0) / (y1 - y0))


def overview(wrench: Stages, rabbit: Stages) -> Figure:
    """All stages of one outline."""
    best = rabbit.found.multipatch
    return stacked(
        [
            [
                of(rabbit, "corners", lambda s, ax: (outline(s, ax), corners(s, ax))),
                of(rabbit, "cross field", crosses, across=24),
                of(rabbit, "seamless map", iso_lines, across=24),
                of(rabbit, "T-mesh", t_mesh),
                of(rabbit, "layout", quads),
                of(rabbit, "patches", lambda s, ax: scaled_jacobian(best, ax)),
            ]
        ],
        [2.4],
    )


def cross_field(wrench: Stages, rabbit: Stages) -> Figure:
    """Crosses, and the triangles at the tip of an ear."""
    x, y = rabbit.mesh.outline.points.max(axis=0)
    tip = (x - 0.105, y - 0.17, 0.12, 0.18)
    panels = [of(wrench, "cross field", crosses), of(rabbit, "cross field", crosses, tip)]
    return stacked([[*panels, Panel("tip of the ear", partial(triangles, rabbit), tip)]], [4])


def seamless_map(wrench: Stages, rabbit: Stages) -> Figure:
    """Iso-lines on the domain and in the plane of the map."""
    panels = []
    for s in (wrench, rabbit):
        panels += [of(s, "on the domain", iso_lines), Panel("in the plane", partial(image, s))]
    return stacked([panels], [4])


def traces(wrench: Stages, rabbit: Stages) -> Figure:
    """T-meshes, and where lines are close."""
    jaw, root = zoom(wrench, 5, 0.13), zoom(rabbit, 5, 0.13)
    return stacked(
        [
            [
                of(wrench, "T-mesh", t_mesh, jaw),
                Panel("enlarged", partial(t_mesh, wrench), jaw),
                of(rabbit, "T-mesh", t_mesh, root),
                Panel("enlarged", partial(t_mesh, rabbit), root),
            ]
        ],
        [4],
    )


def zoom(s: Stages, valence: int, share: float) -> tuple[float, float, float, float]:
    """A window round the highest, leftmost singularity of a valence, a share of the domain's height wide."""
    points = s.mesh.points[s.singular[s.field.index[s.singular] == 4 - valence]]
    x, y = points[np.argmax(points[:, 1] - 0.5 * points[:, 0])]
    size = share * np.ptp(s.mesh.points[:, 1])
    return (x - size / 2, y - size, size, 2 * size)


def quantization(wrench: Stages, rabbit: Stages) -> Figure:
    """What collapses, and the layouts."""
    panels = []
    for s, which in ((wrench, 0), (wrench, 1), (rabbit, 0)):
        panels.append(of(s, MODES[which], collapsed, which=which))
        panels.append(of(s, f"{len(s.patches[which])} quads", quads, which=which))
    return stacked([panels], [3.4])


def portfolio(wrench: Stages, rabbit: Stages) -> Figure:
    """The best candidates and the last resort."""
    rows = []
    for s in (wrench, rabbit):
        shown = [(f"score {c.score:.3f}", c.result.multipatch) for c in s.found.candidates[:4] if c.result]
        rows.append([_judged(s, *item) for item in [*shown, ("convex pieces", s.convex)]])
    return stacked(rows, [2.4, 2.4])


def _judged(s: Stages, title: str, patches: pt.MultiPatch) -> Panel:
    jacobian = pt.quality(patches).scaled_jacobian
    title = f"{title}\n{len(patches)} patches\n{jacobian.min:.2f} / {jacobian.mean:.3f}"
    return of(s, title, lambda s, ax: scaled_jacobian(patches, ax))


FIGURES = {
    "overview": overview,
    "cross_field": cross_field,
    "seamless_map": seamless_map,
    "t_mesh": traces,
    "quantization": quantization,
    "portfolio": portfolio,
}


def main(folder: Path) -> None:
    """Write all pictures, in 256 colours to keep the files small."""
    folder.mkdir(parents=True, exist_ok=True)
    drawn = {name: stages(name, offset) for name, offset in DRAWN.items()}
    for name, draw in FIGURES.items():
        picture = io.BytesIO()
        draw(**drawn).savefig(picture, dpi=150)
        # Small discs keep their colours: those that cover much are not preferred.
        few = Image.open(picture).convert("RGB").quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
        few.save(folder / f"{name}.png", optimize=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=FOLDER, metavar="FOLDER")
    main(parser.parse_args().output)
