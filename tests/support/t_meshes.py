"""T-meshes made by hand: of rectangles, and of quads that are unit squares in the map."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from patchtransfer import BSplineCurve
from patchtransfer.geometry.outline import CORNER, Outline
from patchtransfer.sources.auto_layout.sampling import SampledOutline
from patchtransfer.sources.auto_layout.t_mesh import TMesh

Side = Sequence[int]
Point = tuple[float, float]


def t_mesh_of(
    points, faces: Sequence[Sequence[Side]], length: Callable[[int, int], float], smooth: bool = False
) -> tuple[TMesh, SampledOutline]:
    """From faces with four sides, each a chain of nodes, counter-clockwise; `smooth`: the outline has no corners."""
    points = np.asarray(points, dtype=float)
    arcs: dict[tuple[int, int], int] = {}
    halves: list[list[list[int]]] = []
    for face in faces:
        halves.append([[_half(arcs, a, b) for a, b in pairwise(side)] for side in face])
    used = {h for face in halves for side in face for h in side}
    nodes = [key for key, _ in sorted(arcs.items(), key=lambda item: item[1])]
    following, quarters = np.full(2 * len(arcs), -1), np.zeros(2 * len(arcs), dtype=np.int64)
    for face in halves:
        around = [(h, i == len(side) - 1) for side in face for i, h in enumerate(side)]
        for (h, corner), (after, _) in zip(around, [*around[1:], around[0]], strict=True):
            following[after], quarters[after] = h ^ 1, 1 if corner else 2
    ends = [node for key in nodes for node in key]
    outward = {ends[h]: h for h in used if h ^ 1 not in used}
    for h in outward.values():
        following[h ^ 1] = outward[ends[h ^ 1]]
    loops = _loops(outward, ends)
    return _values(points, halves, nodes, ends, outward, loops, following, quarters, length, smooth)


def _half(arcs: dict[tuple[int, int], int], a: int, b: int) -> int:
    if (b, a) in arcs:
        return 2 * arcs[b, a] + 1
    return 2 * arcs.setdefault((a, b), len(arcs))


def _loops(outward: dict[int, int], ends: list[int]) -> list[list[int]]:
    loops, left = [], set(outward)
    while left:
        loop = [min(left)]
        while (after := ends[outward[loop[-1]] ^ 1]) != loop[0]:
            loop.append(after)
        loops.append(loop)
        left -= set(loop)
    return loops


def _values(points, halves, nodes, ends, outward, loops, following, quarters, length, smooth):
    count, n_arcs = len(points), len(nodes)
    polygon = [v for loop in loops for v in loop]
    rank = {v: i for loop in loops for i, v in enumerate(loop)}
    place = {v: i for i, v in enumerate(polygon)}
    loop_of = {v: k for k, loop in enumerate(loops) for v in loop}
    quads, total = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
    for h in range(2 * n_arcs):
        total[ends[h]] += quarters[h]
    quads[:] = total
    angle = np.full(len(polygon), np.nan)
    for loop in loops:
        for i, v in enumerate(loop):
            into, out = points[v] - points[loop[i - 1]], points[loop[(i + 1) % len(loop)]] - points[v]
            turn = np.arctan2(into[0] * out[1] - into[1] * out[0], into @ out)
            if not smooth and abs(turn) > CORNER:
                angle[place[v]] = np.pi - turn
    on = np.array([v in loop_of for v in range(count)])
    is_corner = np.array([on[v] and not np.isnan(angle[place[v]]) for v in range(count)])
    index = np.where(on, quads, 4 - quads)
    interval = np.full((n_arcs, 2), -1.0)
    arc_loop = np.full(n_arcs, -1)
    for v, h in outward.items():
        arc = h // 2
        assert h % 2 == 0, "an outline's arc starts where its domain is on the left"
        arc_loop[arc], interval[arc] = loop_of[v], (rank[v], rank[v] + 1)
    lines = tuple(points[list(key)] for key in nodes)
    lengths = np.array([length(*key) for key in nodes])
    t_mesh = TMesh(
        node_kind=np.where(on, 0, 1),
        node_vertex=np.array([place.get(v, -1) for v in range(count)]),
        node_critical=np.where(on, is_corner | (index != 2), index != 0),
        node_index=index,
        node_loop=np.array([loop_of.get(v, -1) for v in range(count)]),
        node_position=np.array([rank.get(v, -1.0) for v in range(count)], dtype=float),
        node_point=points,
        arc_nodes=np.array(nodes),
        arc_length=lengths,
        arc_size=np.array([np.linalg.norm(line[1] - line[0]) for line in lines]),
        arc_loop=arc_loop,
        arc_interval=interval,
        arc_points=lines,
        arc_places=tuple(np.array([0.0, value]) for value in lengths),
        faces=tuple(tuple(np.array(side) for side in face) for face in halves),
        sector_next=following,
        sector_quarters=quarters,
    )
    outlines = tuple(_outline(points[loop]) for loop in loops)
    s = np.concatenate([_arc_lengths(points[loop]) for loop in loops])
    following_node = np.concatenate([np.roll(np.arange(len(loop)), -1) + place[loop[0]] for loop in loops])
    loop_numbers = np.array([loop_of[v] for v in polygon])
    return t_mesh, SampledOutline(points[polygon], loop_numbers, s, following_node, angle, 1.0, outlines)


def _outline(points) -> Outline:
    pairs = zip(points, np.roll(points, -1, axis=0), strict=True)
    return Outline([BSplineCurve([0, 0, 1, 1], 1, [a, b]) for a, b in pairs])


def _arc_lengths(points):
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def rectangles(boxes: Sequence[tuple[int, int, int, int]], xs=None, ys=None) -> tuple[TMesh, SampledOutline]:
    """From rectangles x0, y0, x1, y1 that fill a rectilinear domain, on lattice lines `xs`, `ys` (default integers)."""
    corners = sorted({(x, y) for a, b, c, d in boxes for x in (a, c) for y in (b, d)})
    number = {corner: i for i, corner in enumerate(corners)}
    x = np.arange(64.0) if xs is None else np.asarray(xs, dtype=float)
    y = np.arange(64.0) if ys is None else np.asarray(ys, dtype=float)
    points = np.array([(x[i], y[j]) for i, j in corners])

    def chain(start: tuple[int, int], end: tuple[int, int]) -> list[int]:
        (a, b), (c, d) = start, end
        on = [p for p in corners if min(a, c) <= p[0] <= max(a, c) and min(b, d) <= p[1] <= max(b, d)]
        return [number[p] for p in sorted(on, reverse=start > end)]

    faces = []
    for a, b, c, d in boxes:
        ring = [(a, b), (c, b), (c, d), (a, d)]
        faces.append([chain(p, q) for p, q in zip(ring, [*ring[1:], ring[0]], strict=True)])
    return t_mesh_of(points, faces, lambda a, b: float(np.abs(points[a] - points[b]).sum()))


def squares(points, quads: Sequence[Sequence[int]], smooth: bool = False) -> tuple[TMesh, SampledOutline]:
    """From quads that are unit squares in the map; corners are where the polygon turns, unless `smooth`."""
    faces = [[[quad[i], quad[(i + 1) % 4]] for i in range(4)] for quad in quads]
    return t_mesh_of(points, faces, lambda a, b: 1.0, smooth)
