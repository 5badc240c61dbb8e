"""Cuts that keep points of a T-mesh apart."""

from __future__ import annotations

from collections.abc import Collection

from .gluing import Gluing
from .program import STAGE, Cut
from .reasons import NoLayoutError
from .walks import Displacement, Walks

__all__ = ["separating_cut", "steep_cut"]

#: Displacements this much smaller than along the other axis are none: their sign is rounding. Maps are seamless to
#: 1e-12 of their size.
ALIGNED = 1e-7


def separating_cut(walks: Walks, gluing: Gluing, a: int, b: int, why: str, walls: tuple[int, int] = (-1, -1)) -> Cut:
    """A cut that keeps apart two points which are glued.

    The displacement between them is unrolled along a path through what glues them, where it is zero now; of its two
    parts, with the signs that they have in the map, one at least must become positive. Along an arc that a point lies
    inside, the displacement says nothing and is left out.

    Parameters
    ----------
    walks : Walks
    gluing : Gluing
    a, b : int
        Points as numbered in `gluing`.
    why : str
    walls : pair of int
        A half-arc of the outline from each point that lies on a straight piece of it: points that part along such a
        wall leave others behind in their places, so that this is left out too.

    Raises
    ------
    NoLayoutError
        Where the points have no displacement in the map either.
    """
    path = gluing.path(a, b, walks.singular)
    if path is None:
        # Around a singularity, displacements have two values: it must leave itself.
        a, path = _last_stretch(walks, gluing, a, b)
        walls = (-1, walls[1])
    start, end = ((wall, wall ^ 1) if wall >= 0 else () for wall in walls)
    displacement = walks.displacement([*start, *path, *end])
    said_nothing = [gluing.arc_of(a) >= 0 or walls[0] >= 0, gluing.arc_of(b) >= 0 or walls[1] >= 0]
    free = {axis for axis, nothing in zip((0, displacement.last_axis), said_nothing, strict=True) if nothing}
    if len(free) == 2:
        # Walls at a right angle.
        free = set()
    axes = [axis for axis in (0, 1) if axis not in free]
    largest = max((abs(displacement.real[axis]) for axis in axes), default=0.0)
    terms: dict[int, int] = {}
    for axis in axes:
        if abs(displacement.real[axis]) > ALIGNED * largest:
            _add(terms, displacement, axis)
    cut = Cut(_tuple(terms), 1, why)
    if not cut.terms or cut.value(gluing.lengths) >= 1:
        raise NoLayoutError(STAGE, f"{why}: points {a} and {b} of the T-mesh are glued, and nothing keeps them apart")
    return cut


def steep_cut(
    walks: Walks, gluing: Gluing, arcs: Collection[int], a: int, b: int, edges: int, steepest: float
) -> Cut | None:
    """A soft cut where two nodes on one line of the layout lie in directions that differ from it by more than allowed.

    Parameters
    ----------
    arcs
        Arcs of the faces along the line: the path goes over them.
    edges : int
        Edges of the line.
    steepest
        Tangent of the largest angle.
    """
    path = walks.shortest(a, b, lambda arc: arc in arcs)
    if not path:
        return None
    displacement = walks.displacement(path)
    ahead = [displacement.integer(axis, gluing.lengths) for axis in (0, 1)]
    if sorted(map(abs, ahead)) != [0, edges]:
        # Around a singularity: not the line's own displacement.
        return None
    across = 1 if ahead[0] else 0
    if abs(displacement.real[across]) <= steepest * abs(displacement.real[1 - across]):
        return None
    terms: dict[int, int] = {}
    _add(terms, displacement, across)
    return Cut(_tuple(terms), 1, "a line is sheared", soft=True)


def _last_stretch(walks: Walks, gluing: Gluing, a: int, b: int) -> tuple[int, list[int]]:
    """The singularity from which the other point is reached past no more of them, and the path."""
    for node in sorted(walks.singular):
        if node != a and gluing.label[node] == gluing.label[b]:
            path = gluing.path(node, b, walks.singular)
            if path is not None:
                return node, path
    raise NoLayoutError(STAGE, f"points {a} and {b} of the T-mesh are glued by nothing")


def _add(terms: dict[int, int], displacement: Displacement, axis: int) -> None:
    sign = 1 if displacement.real[axis] > 0 else -1
    for arc, count in displacement.arcs[axis].items():
        terms[arc] = terms.get(arc, 0) + sign * count


def _tuple(terms: dict[int, int]) -> tuple[tuple[int, int], ...]:
    return tuple((arc, count) for arc, count in sorted(terms.items()) if count)
