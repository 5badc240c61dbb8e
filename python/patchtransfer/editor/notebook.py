"""The studio in a notebook's cell."""

from __future__ import annotations

from typing import TYPE_CHECKING, Unpack

from numpy.typing import ArrayLike

from ..geometry.boundary import Boundary
from ..geometry.multipatch import MultiPatch
from ..libraries import library
from ..pipeline.options import TransferOptions
from ..registration.landmarks import read_landmark_rows
from .session import Session

if TYPE_CHECKING:
    from .widget import StudioWidget

__all__ = ["studio"]


def studio(
    source: MultiPatch | Boundary,
    target: Boundary | None = None,
    landmarks: ArrayLike | None = None,
    continuity: str = "c1",
    **options: Unpack[TransferOptions],
) -> StudioWidget:
    """Show a target in a notebook's cell, where it is dragged and the certified result follows.

    Parameters
    ----------
    source : MultiPatch or Boundary
        An outline alone is parameterized first.
    target : Boundary, optional
        Default the source's own boundary.
    landmarks : (r, 4) array, optional
        As for `transfer`.
    continuity : {"c0", "c1", "g1"}, default "c1"
    **options
        Of `transfer`. A transfer may take ten seconds unless ``time_limit`` says otherwise.

    Returns
    -------
    StudioWidget
        An `anywidget <https://anywidget.dev>`_ with traits that can be observed: ``target`` (a `Boundary`) and
        ``landmarks`` (a tuple of rows), which can also be set, ``result`` (a `TransferResult`, or None where there is
        none) and ``error`` (why there is none, or what is wrong with it). While a point is held they stay as they were.

    Raises
    ------
    InputError
        Without anywidget: ``pip install 'patchtransfer[notebook]'``.

    Examples
    --------
    >>> import patchtransfer as pt
    >>> source, target, landmarks = pt.examples.load("star")
    >>> page = pt.studio(source, target)  # the last line of a cell shows it
    >>> page.result.certificate.injective
    True
    >>> page.landmarks = landmarks  # or added and dragged by hand
    >>> page.result.multipatch == pt.transfer(source, target, landmarks).multipatch
    True
    """
    library("anywidget", "notebook", "pt.studio")
    from .widget import StudioWidget

    rows = None if landmarks is None else read_landmark_rows(landmarks)
    if isinstance(source, Boundary):
        return StudioWidget(Session.of_outline(source, target, rows, continuity, **options))
    return StudioWidget(Session(source, source.boundary() if target is None else target, rows, continuity, **options))
