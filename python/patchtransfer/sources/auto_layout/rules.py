"""What integer arc lengths must not bring about, and the cuts against it."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from ...numeric.arrays import FloatArray, IntArray
from .gluing import Gluing, RingPoint, boundary_rings
from .program import Cut
from .sampling import SampledOutline
from .separation import separating_cut, steep_cut
from .t_mesh import TMesh
from .walks import Walks

__all__ = ["Rules"]

#: Angle a patch where singularities merge into the boundary (radians): outside, the corner of the patch is worse than
#: the singularity. In particular no patch has a straight angle there.
SMALLEST_ANGLE, LARGEST_ANGLE = np.radians(40.0), np.radians(130.0)
#: A closed loop of fewer edges is not a loop of quads that meet in one edge or vertex at most; without corners, three
#: edges would turn by 120 degrees each where four turn by 90.
FEWEST_EDGES, FEWEST_SMOOTH_EDGES = 3, 4
CORNERS = "corners merge"


class Rules:
    """The rules for layouts from one T-mesh.

    Parameters
    ----------
    t_mesh : TMesh
    outline : SampledOutline
    merging : bool
        Whether singularities may merge with each other and into the boundary.
    steepest : float
        Largest angle (degrees) between a line of the layout and the direction between the critical points on it.
    turn : float
        Most that the outline turns along one edge of the layout (degrees): cubic sides with three spans follow that.
    """

    def __init__(self, t_mesh: TMesh, outline: SampledOutline, merging: bool, steepest: float, turn: float) -> None:
        self.t_mesh, self.merging = t_mesh, merging
        self.most_turn = np.radians(turn)
        self.steepest = float(np.tan(np.radians(steepest))) if steepest < 90 else np.inf
        self.walks = Walks(t_mesh)
        self.index = t_mesh.node_index.tolist()
        on_outline = t_mesh.node_loop >= 0
        self.fixed = np.flatnonzero(t_mesh.node_critical & on_outline).tolist()
        self.singular = sorted(self.walks.singular)
        self.angle = {node: _angle(outline, int(t_mesh.node_vertex[node])) for node in self.fixed}
        self.turns = [_turns(outline, np.flatnonzero(outline.loop == k)) for k in range(int(outline.loop.max()) + 1)]

    def broken(self, gluing: Gluing) -> list[Cut]:
        """Cuts against what is wrong; empty where nothing is."""
        rings = boundary_rings(self.t_mesh, gluing)
        cuts = self._merged(gluing, rings)
        for loop, ring in enumerate(rings):
            cuts += self._turning(gluing, loop, ring)
        return cuts or self._steep(gluing)

    def _merged(self, gluing: Gluing, rings: list[list[RingPoint]]) -> list[Cut]:
        """Against critical points in one class that must not be, and boundary points from different places."""
        cuts = []
        at_boundary: dict[int, list[RingPoint]] = defaultdict(list)
        for ring in rings:
            for point in ring:
                at_boundary[point.label].append(point)
        classes: dict[int, tuple[list[int], list[int]]] = defaultdict(lambda: ([], []))
        for which, nodes in enumerate((self.fixed, self.singular)):
            for node in nodes:
                classes[int(gluing.label[node])][which].append(node)
        for label, (fixed, singular) in classes.items():
            cuts += self._unwanted(gluing, fixed, singular, at_boundary.get(label, []))
        if cuts:
            # Pinches are mostly the fault of these.
            return cuts
        for label, points in at_boundary.items():
            apart = _pinched(rings, label, points)
            if apart:
                walls = (self._wall(apart[0]), self._wall(apart[1]))
                ends = apart[0].point, apart[1].point
                cuts.append(separating_cut(self.walks, gluing, *ends, "the boundary is pinched", walls))
        return cuts

    def _wall(self, point: RingPoint) -> int:
        """The half-arc of the outline from a node at which it goes straight on, or -1."""
        is_node = point.point < len(self.index)
        return 2 * point.arc if is_node and not self.walks.critical[point.point] else -1

    def _unwanted(self, gluing: Gluing, fixed: list[int], singular: list[int], boundary: list[RingPoint]) -> list[Cut]:
        """Against one class."""
        if len(fixed) > 1:
            # What else is in the class may be right once they are apart.
            return self._apart(gluing, pairwise(fixed), CORNERS)
        total = sum(self.index[node] for node in singular)
        if not singular:
            return []
        if not boundary:
            # What merges inside has valence 4 - total.
            if self.merging and abs(total) <= 1:
                return []
            return self._apart(gluing, pairwise(singular), "singularities merge")
        if self.merging:
            quads = (self.index[fixed[0]] if fixed else 2) - total
            angle = self.angle[fixed[0]] if fixed else np.pi
            if quads >= 1 and SMALLEST_ANGLE <= angle / quads <= LARGEST_ANGLE:
                return []
        # Nodes come before inner points of arcs.
        place = fixed[0] if fixed else min(point.point for point in boundary)
        return self._apart(gluing, ((node, place) for node in singular), "a singularity meets the boundary")

    def _apart(self, gluing: Gluing, pairs: Iterable[tuple[int, int]], why: str) -> list[Cut]:
        """Cuts that keep all pairs apart; where singularities may merge, one that keeps some pair apart."""
        cuts = [separating_cut(self.walks, gluing, a, b, why) for a, b in pairs]
        if not self.merging or why == CORNERS or len(cuts) < 2:
            return cuts
        terms: Counter[int] = Counter()
        for cut in cuts:
            terms.update(dict(cut.terms))
        together = tuple((arc, count) for arc, count in sorted(terms.items()) if count)
        return [Cut(together, 1, why)] if together else cuts

    def _turning(self, gluing: Gluing, loop: int, ring: list[RingPoint]) -> list[Cut]:
        """Against loops of too few edges, and edges along which the boundary turns too far."""
        arcs = [int(arc) for arc in np.flatnonzero(self.t_mesh.arc_loop == loop)]
        cornered = any(self.t_mesh.node_loop[node] == loop for node in self.fixed)
        fewest = FEWEST_EDGES if cornered else FEWEST_SMOOTH_EDGES
        if sum(gluing.lengths[arc] for arc in arcs) < fewest:
            return [Cut(tuple((arc, 1) for arc in arcs), fewest, "a loop has too few edges")]
        cuts = []
        count = len(self.turns[loop])
        ends = [point for i, point in enumerate(ring) if point.label != ring[i - 1].label]
        for i, point in enumerate(ends):
            start, end = point.position, ends[(i + 1) % len(ends)].position
            if end <= start:
                end += count
            if self._turn(loop, start, end) > self.most_turn:
                cuts.append(self._split(gluing, loop, start, end))
        return cuts

    def _turn(self, loop: int, start: float, end: float) -> float:
        """Range of the directions of a loop between two positions, corners left out."""
        ranks = np.arange(np.floor(start) + 1, np.ceil(end)).astype(int) % len(self.turns[loop])
        return float(np.ptp(np.concatenate([[0.0], np.cumsum(self.turns[loop][ranks])])))

    def _split(self, gluing: Gluing, loop: int, start: float, end: float) -> Cut:
        """Against the edge between two positions.

        The arc that it lies on has more edges or, if the edge turns beside it, something that is collapsed there is
        not. That the arc could have none instead is left out: it slows the solver down and hardly ever gains.
        """
        overlaps = self._overlaps(loop, start, end)
        on, low, high = next(part for part in overlaps if gluing.lengths[part[0]])
        more = gluing.lengths[on] + 1
        terms = {on: 1}
        if self._turn(loop, low, high) <= self.most_turn:
            terms.update({arc: more for arc, _, _ in overlaps if not gluing.lengths[arc]})
        return Cut(tuple(sorted(terms.items())), more, "the boundary turns too far on an edge")

    def _overlaps(self, loop: int, start: float, end: float) -> list[tuple[int, float, float]]:
        """Arcs that reach into a stretch of a loop, and the stretch's part on each."""
        parts = []
        count = len(self.turns[loop])
        for arc in np.flatnonzero(self.t_mesh.arc_loop == loop).tolist():
            for shift in (0, count, -count):
                low, high = self.t_mesh.arc_interval[arc] + shift
                if low < end - 1e-9 and high > start + 1e-9:
                    parts.append((arc, max(float(low), start), min(float(high), end)))
        return parts

    def _steep(self, gluing: Gluing) -> list[Cut]:
        """Against lines between critical points that are turned too far."""
        if not self.steepest < np.inf:
            return []
        critical = self._critical_classes(gluing)
        collapsing: dict[int, set[int]] = defaultdict(set)
        for point, links in gluing.links.items():
            collapsing[int(gluing.label[point])].update(half // 2 for link in links for half in link.path)
        faces = [{int(half) // 2 for side in face for half in side} for face in self.t_mesh.faces]
        cuts = []
        for line, along in _lines(gluing, critical):
            arcs = set().union(*(faces[face] for face in along), *(collapsing.get(label, set()) for label in line))
            ends = critical[line[0]], critical[line[-1]]
            cut = steep_cut(self.walks, gluing, arcs, *ends, len(line) - 1, self.steepest)
            if cut and cut not in cuts:
                cuts.append(cut)
        return cuts

    def _critical_classes(self, gluing: Gluing) -> dict[int, int]:
        """A critical node for each class that lines of the layout should aim at: singularities that cancel do not."""
        nodes: dict[int, list[int]] = defaultdict(list)
        for node in self.fixed + self.singular:
            nodes[int(gluing.label[node])].append(node)
        return {
            label: members[0]
            for label, members in nodes.items()
            if members[0] in self.angle or sum(self.index[node] for node in members)
        }


def _lines(gluing: Gluing, critical: dict[int, int]) -> list[tuple[list[int], set[int]]]:
    """Straight lines of edges between critical points: their points, and the faces beside them."""
    quads, face = gluing.quads.tolist(), gluing.quad_face.tolist()
    ahead: dict[tuple[int, int], tuple[int, int]] = {}
    for q, corners in enumerate(quads):
        for i in range(4):
            ahead[corners[i], corners[(i + 1) % 4]] = (corners[(i + 2) % 4], face[q])
    lines = []
    for start, second in ahead:
        if start not in critical:
            continue
        a, b, line, beside = start, second, [start, second], set()
        while True:
            side, left = ahead[a, b]
            beside.add(left)
            if (b, a) in ahead:
                beside.add(ahead[b, a][1])
            if b in critical or (side, b) not in ahead or len(line) > len(ahead):
                break
            a, b = b, ahead[side, b][0]
            line.append(b)
        if b in critical and line[0] < line[-1]:
            lines.append((line, beside))
    return lines


def _pinched(rings: list[list[RingPoint]], label: int, points: list[RingPoint]) -> tuple[RingPoint, RingPoint] | None:
    """Two points of a class that is more than one stretch of one loop."""
    if len(points) == 1:
        return None
    firsts = [
        point
        for ring in rings
        for i, point in enumerate(ring)
        if point.label == label and (ring[i - 1].label != label or len(ring) == 1)
    ]
    return (firsts[0], firsts[1]) if len(firsts) > 1 else None


def _angle(outline: SampledOutline, vertex: int) -> float:
    angle = float(outline.corner_angle[vertex]) if 0 <= vertex < len(outline.points) else np.nan
    return np.pi if np.isnan(angle) else angle


def _turns(outline: SampledOutline, nodes: IntArray) -> FloatArray:
    """Turn of the polygon at each node of a loop, none at corners."""
    points = outline.points[nodes]
    out = np.roll(points, -1, axis=0) - points
    angle = np.arctan2(out[:, 1], out[:, 0])
    turn = (angle - np.roll(angle, 1) + np.pi) % (2 * np.pi) - np.pi
    return np.where(np.isnan(outline.corner_angle[nodes]), turn, 0.0)
