"""What a reader of outlines is asked for."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["DEFAULT", "BoundaryOptions"]


@dataclass(frozen=True)
class BoundaryOptions:
    """Options of `patchtransfer.read_boundary`, for all formats; a reader uses those that concern it.

    Attributes
    ----------
    clean : bool
        Mend slips, with notes.
    smooth : bool or None
        Whether points are samples of smooth curves; None decides.
    layers : tuple of str or None
        Layers of a drawing to read.
    """

    clean: bool = True
    smooth: bool | None = None
    layers: tuple[str, ...] | None = None


DEFAULT = BoundaryOptions()
