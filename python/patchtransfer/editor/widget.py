"""The studio as a widget of notebooks. To import it needs anywidget; `notebook` says so where it is missing."""

from __future__ import annotations

import json
from typing import Any

import anywidget
import numpy as np
import traitlets

from ..geometry.boundary import Boundary
from ..numeric.arrays import FloatArray
from ..pipeline.result import TransferResult
from ..registration.landmarks import read_landmark_rows
from ..web.report import render
from .messages import answer
from .session import Session
from .view import View

__all__ = ["StudioWidget"]


class LandmarkRows(traitlets.TraitType):
    """Landmarks as `transfer` takes them, kept as a tuple of rows (xs, ys, xt, yt), which cannot be changed unheard."""

    default_value = ()

    def validate(self, _: Any, value: Any) -> tuple[tuple[float, ...], ...]:
        """The rows; `InputError` where there are none in it."""
        return tuple(tuple(row) for row in read_landmark_rows(value).tolist())


class StudioWidget(anywidget.AnyWidget):
    """What `patchtransfer.studio` makes.

    Traits can be observed; `target` and `landmarks` can be set, which is undone by the cell's button like a drag. They
    tell what there is when no point is held.

    Parameters
    ----------
    session : Session

    Attributes
    ----------
    target : Boundary
    landmarks : tuple of tuples (xs, ys, xt, yt)
        As for `transfer`.
    result : TransferResult or None
        Of this target and these landmarks; None where there is none.
    error : str
        Why there is no result, or what is wrong with it; empty where it is certified.
    """

    _esm = render("studio_widget.js.j2", title=None, files=[])

    target = traitlets.Instance(Boundary)
    landmarks = LandmarkRows()
    result = traitlets.Instance(TransferResult, allow_none=True, read_only=True)
    error = traitlets.Unicode(read_only=True)

    def __init__(self, session: Session) -> None:
        self._session, self._view = session, View(session)
        super().__init__()
        self._tell()
        self.observe(self._edit, ["target", "landmarks"])
        self.on_msg(self._heed)

    def _heed(self, _: StudioWidget, message: Any, __: list[Any]) -> None:
        """Do what a cell asks for, and show all of them what came of it."""
        first = message == {"do": "open"}
        said = answer(self._session, self._view, None if first else json.dumps(message))
        if not self._session.held:
            if not self._view.contains_target:
                self._view.reframe()
                said |= self._view.state()
            self._tell()
        self.send(said)

    def _edit(self, _: Any) -> None:
        """Do what is asked for in Python, unless it is only told what was done in a cell."""
        if (self.target, self.landmarks) == (self._session.edited.target, self._rows()):
            return
        rows: FloatArray | None = np.array(self.landmarks) if self.landmarks else None
        self._session.edit(self.target, rows)
        self._view.reframe()
        self._tell()
        self.send(self._view.state())

    def _tell(self) -> None:
        """Let the traits say what the session has, all at once."""
        session = self._session
        with self.hold_trait_notifications():
            self.set_trait("target", session.edited.target)
            self.set_trait("landmarks", self._rows())
            self.set_trait("result", session.result)
            self.set_trait("error", session.shown.error or "")

    def _rows(self) -> tuple[tuple[float, ...], ...]:
        return tuple((*pair.source, *pair.target) for pair in self._session.edited.landmarks)
