"""T-mesh -> integer arc lengths: an integer program with cuts that are added where they are broken."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from ...errors import InputError
from ...numeric.arrays import IntArray
from .gluing import glue
from .places import arc_length_at
from .prices import CollapsePrice, arc_prices, edge_prices
from .program import STAGE, Cut, Program
from .reasons import NoLayoutError
from .rules import Rules
from .sampling import SampledOutline
from .t_mesh import TMesh

__all__ = ["Quantization", "arcs_between", "quantize"]

#: Rounds of adding cuts. Typical are 2 to 6; each forbids what the last solution did.
ROUNDS = 100
MODES = ("strict", "merging")


@dataclass(frozen=True, eq=False)
class Quantization:
    """Integer arc lengths of a T-mesh.

    Attributes
    ----------
    lengths : (a,) array of int
        Edges of the layout along every arc.
    cuts : int
        Cuts that were needed.
    rounds : int
        Solutions of the integer program.
    cost : float
        Price in edges.
    mode : str
        ``"strict"`` or ``"merging"``.
    steep : int, default 0
        Lines of the layout turned by more than the price's steepest angle because nothing else was left.
    """

    lengths: IntArray
    cuts: int
    rounds: int
    cost: float
    mode: str
    steep: int = 0


def quantize(
    t_mesh: TMesh,
    outline: SampledOutline,
    price: CollapsePrice,
    *,
    mode: str = "strict",
    max_patches: int | None = None,
    ties: Iterable[tuple[int, int]] = (),
    at_least: Mapping[Collection[int], int] | None = None,
) -> Quantization:
    """The cheapest integer arc lengths from which a valid layout can be assembled.

    Parameters
    ----------
    t_mesh : TMesh
    outline : SampledOutline
        The outline that the T-mesh was made on.
    price : CollapsePrice
    mode : str, default "strict"
        ``"strict"`` keeps all singularities apart from each other and from the boundary; ``"merging"`` lets them
        cancel and merge into the boundary where the angles there remain good.
    max_patches : int, optional
        Most quads of the layout.
    ties : pairs of arcs, optional
        Arcs of equal length, as images of each other under a symmetry.
    at_least : mapping of a set of arcs to int, optional
        Fewest edges on the arcs together; see `arcs_between`.

    Raises
    ------
    NoLayoutError
        Where no lengths obey all demands.
    InputError
        On an unknown mode, arcs that are not there, or fewer than one patch.
    """
    _check(t_mesh, mode, max_patches, ties := tuple(ties), at_least := dict(at_least or {}))
    rules = Rules(t_mesh, outline, mode == "merging", price.steepest, price.turn)
    program = Program(t_mesh, edge_prices(t_mesh, outline), arc_prices(t_mesh, outline, price), ties, max_patches)
    program.cuts = [Cut(tuple((int(arc), 1) for arc in sorted(arcs)), n, "demanded") for arcs, n in at_least.items()]
    demanded = len(program.cuts)
    for rounds in range(1, ROUNDS + 1):
        lengths, cost = program.solve()
        gluing = glue(t_mesh, lengths)
        new = [cut for cut in rules.broken(gluing) if cut not in program.cuts]
        program.cuts += new
        if not new and not _limited(program, gluing.grids, max_patches):
            steep = sum(cut.soft and cut.value(lengths) < cut.least for cut in program.cuts)
            found = np.array(lengths, dtype=np.int64)
            found.flags.writeable = False
            return Quantization(found, len(program.cuts) - demanded, rounds, cost, mode, steep)
    raise NoLayoutError(
        STAGE, f"after {ROUNDS} rounds and {len(program.cuts)} cuts still: {new[0].why if new else '?'}"
    )


def arcs_between(t_mesh: TMesh, outline: SampledOutline, loop: int, s0: float, s1: float) -> frozenset[int]:
    """Arcs of the outline between two arc lengths of a loop, as `at_least` of `quantize` takes them.

    Parameters
    ----------
    t_mesh : TMesh
    outline : SampledOutline
    loop : int
    s0, s1 : float
        On the user's outline, in its sense from `s0` to `s1`.

    Raises
    ------
    InputError
        If there is no such loop.
    """
    if not 0 <= loop < len(outline.outlines):
        raise InputError(f"the outline has {len(outline.outlines)} loops, no loop {loop}")
    length = outline.outlines[loop].length
    # The ends of arcs and stretches that touch do not overlap.
    touch = 1e-9 * length
    out = []
    for arc in np.flatnonzero(t_mesh.arc_loop == loop).tolist():
        start, end = t_mesh.arc_interval[arc].tolist()
        places = arc_length_at(outline, loop, np.array([start, (start + end) / 2, end]))
        # In the user's sense, which may be the other one.
        if (places[1] - places[0]) % length > (places[1] - places[2]) % length:
            places = places[::-1]
        reach = (places[1] - places[0]) % length + (places[2] - places[1]) % length
        if (places[0] - s0) % length < (s1 - s0) % length - touch or (s0 - places[0]) % length < reach - touch:
            out.append(arc)
    return frozenset(out)


def _check(
    t_mesh: TMesh,
    mode: str,
    max_patches: int | None,
    ties: tuple[tuple[int, int], ...],
    at_least: dict[Collection[int], int],
) -> None:
    if mode not in MODES:
        raise InputError(f'mode must be "strict" or "merging", got {mode!r}')
    if max_patches is not None and max_patches < 1:
        raise InputError(f"max_patches must be at least 1, got {max_patches}")
    count = len(t_mesh.arc_nodes)
    for what, arcs in [*(("ties", pair) for pair in ties), *(("at_least", arcs) for arcs in at_least)]:
        wrong = [arc for arc in arcs if not 0 <= arc < count]
        if wrong:
            raise InputError(f"{what} names arc {wrong[0]} of {count}")
        if not len(arcs):
            raise InputError(f"{what} names no arcs")


def _limited(program: Program, grids: list[tuple[int, IntArray]], max_patches: int | None) -> bool:
    """Whether there are more quads than allowed and a new bound of the faces' quads was found against it."""
    sizes = [(face, points.shape[0] - 1, points.shape[1] - 1) for face, points in grids]
    if max_patches is None or sum(w * h for _, w, h in sizes) <= max_patches:
        return False
    # All of them: a face that is not bounded now would be the next to grow.
    return sum(program.limit(*size) for size in sizes if size[1] * size[2] > 1) > 0
