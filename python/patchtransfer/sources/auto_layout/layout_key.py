"""When two layouts are the same."""

from __future__ import annotations

from collections import deque

import numpy as np

from .assembly import AbstractLayout

__all__ = ["LayoutKey", "layout_key"]

#: Boundary vertices that are nearer to each other than this part of the diameter are usually the same.
RESOLUTION = 1e-3

#: Numbered quads, and where the vertices on the outline are.
LayoutKey = tuple[tuple[int, ...], tuple[tuple[int, int], ...]]


def layout_key(layout: AbstractLayout, *, places: bool = True) -> LayoutKey:
    """A key that is equal for layouts which differ only in the order of loops, vertices and quads and in their starts.

    The quads are numbered anew from an edge of the boundary outwards, which fixes all numbers; the edge is the one
    that gives the smallest key.

    Parameters
    ----------
    layout : AbstractLayout
    places : bool, default True
        Whether the places of the boundary vertices count (to 0.1 % of the diameter), or the combinatorics only: that
        key is the same for a rotated or scaled outline too.

    Examples
    --------
    >>> import numpy as np
    >>> def square(first):
    ...     ring = np.arange(4)
    ...     return AbstractLayout(
    ...         np.array([ring]), ring, ring * 0, ring * 1.0, ring >= 0,
    ...         np.roll([[0.0, 0], [1, 0], [1, 1], [0, 1]], first, axis=0), ring * 0 + 1
    ...     )
    >>> layout_key(square(0)) == layout_key(square(2))
    True
    """
    quads = layout.quads.tolist()
    quad_of = {(quad[i], quad[(i + 1) % 4]): (q, i) for q, quad in enumerate(quads) for i in range(4)}
    size = float(np.ptp(layout.points, axis=0).max()) * RESOLUTION
    rounded = [(int(x), int(y)) for x, y in np.round(layout.points / size)]
    on_boundary = set(layout.boundary_vertices.tolist())
    keys = []
    for (a, b), (q, i) in quad_of.items():
        if (b, a) not in quad_of:
            code, order = _numbered(quads, quad_of, q, i)
            keys.append((code, tuple(rounded[v] for v in order if v in on_boundary) if places else ()))
    return min(keys)


def _numbered(
    quads: list[list[int]], quad_of: dict[tuple[int, int], tuple[int, int]], q: int, i: int
) -> tuple[tuple[int, ...], list[int]]:
    """The quads with vertices numbered as a walk from the i-th edge of quad q meets them, and their order."""
    number: dict[int, int] = {}
    code: list[int] = []
    queue, seen = deque([(q, i)]), {q}
    while queue:
        q, i = queue.popleft()
        corners = quads[q][i:] + quads[q][:i]
        code += [number.setdefault(v, len(number)) for v in corners]
        for k in range(4):
            beyond = quad_of.get((corners[(k + 1) % 4], corners[k]))
            if beyond is not None and beyond[0] not in seen:
                seen.add(beyond[0])
                queue.append(beyond)
    return tuple(code), list(number)
