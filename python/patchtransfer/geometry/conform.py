"""`conform`: a multi-patch made to conform, with what was done and what was left."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from .conformity.coincidences import coincidences
from .conformity.welds import gaps
from .mending import gap_in_words
from .multipatch import MultiPatch
from .tolerances import exact

__all__ = ["Conformed", "conform"]


@dataclass(frozen=True, repr=False)
class Conformed:
    """Outcome of `conform`.

    Attributes
    ----------
    multipatch : MultiPatch
    notes : tuple of str
        What was done, each with its size: sides glued, patches split, degrees raised, knots inserted, gaps closed.
    left : tuple of str
        What could not be done, or was not asked for, and why: larger gaps, and sides that run along each other at
        different speeds.
    moved : float
        How far the control point that moved most did, in the model's unit; 0 if only splines changed.
    origins : tuple of int
        Of every patch the number of the one it is, or was cut from.
    """

    multipatch: MultiPatch
    notes: tuple[str, ...]
    left: tuple[str, ...]
    moved: float
    origins: tuple[int, ...]

    def __repr__(self) -> str:
        return f"<Conformed: {len(self.multipatch)} patches, {len(self.notes)} changes, {len(self.left)} left>"

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON: notes, left, moved, origins."""
        return {"notes": list(self.notes), "left": list(self.left), "moved": self.moved, "origins": list(self.origins)}


def conform(multipatch: MultiPatch, *, weld: float = 0.0) -> Conformed:
    """Make the patches agree exactly along all sides that coincide, and tell what was done.

    As `MultiPatch.conform`, which says how.

    Parameters
    ----------
    multipatch : MultiPatch
    weld : float, default 0
        Length up to which gaps are closed, in the model's unit.

    Returns
    -------
    Conformed

    Raises
    ------
    InputError
        When `weld` is negative or not finite, or splits go round in a spiral without end.

    Examples
    --------
    >>> from patchtransfer import MultiPatch, Patch, conform
    >>> knots = ([0, 0, 1, 1], [0, 0, 1, 1])
    >>> left = Patch(knots, (1, 1), [[[0, 0], [0, 1]], [[1, 0], [1, 1]]])
    >>> right = Patch(knots, (1, 1), [[[1.00003, 0], [1.00003, 1]], [[2, 0], [2, 1]]])
    >>> conform(MultiPatch([left, right])).left
    ('patch 0 east and patch 1 west are 3e-5 apart (gap); run `patchtransfer refine --conform --weld 3e-5`',)
    >>> mended = conform(MultiPatch([left, right]), weld=3e-5)
    >>> mended.notes[1]
    'interface patch 0 east - patch 1 west: gap of 3e-5 closed, both sides moved by at most 1.5e-5'
    """
    mended, made, lost = multipatch._conformed(weld)
    rounding = exact(mended.patches)
    open_gaps = [
        f"interface {f.name}: {gap_in_words(gap)}"
        for f, gap in zip(mended.interfaces, gaps(mended.patches, mended.interfaces), strict=True)
        if gap > rounding
    ]
    left = [*lost, *open_gaps, *(c.text for c in coincidences(mended.patches, mended.interfaces))]
    return Conformed(mended, tuple(made.notes), tuple(left), made.moved, tuple(made.origins))
