"""What the page draws of a session, as plain data."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..geometry.boundary import Boundary
from ..geometry.multipatch import MultiPatch
from ..measure.quality import quality
from ..web.figure import layers
from ..web.picture import Frame, by_class, frame, iso_lines, loops, sampled
from .editing import control_points
from .session import Session

__all__ = ["View"]

#: Room around a target for what it is dragged to, in parts of its size.
ROOM = 0.2
#: Iso-lines inside a patch and direction while one looks on: drawing must not take longer than mapping.
LIVE_LINES = 5


class View:
    """Frames of a session's pictures, which stay while it is edited, and its state in them.

    Parameters
    ----------
    session : Session
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self.source_frame = frame(control_points(session.source.boundary()))
        self.reframe()

    def reframe(self) -> None:
        """Make the target's picture as large as the target is now."""
        on = control_points(self._session.edited.target)
        room = ROOM * np.ptp(on, axis=0).max()
        self.target_frame = frame(np.concatenate([on - room, on + room]))

    @property
    def contains_target(self) -> bool:
        """Whether all of the target is inside of its picture."""
        shown = self.target_frame(control_points(self._session.edited.target))
        return bool(((shown >= 0) & (shown <= [self.target_frame.width, self.target_frame.height])).all())

    def source(self) -> dict[str, Any]:
        """The source's picture, which does not change."""
        return _model(self._session.source, self.source_frame)

    def state(self) -> dict[str, Any]:
        """The target with its handles, landmarks and the result, in units of the pictures."""
        session, shown = self._session, self._session.shown
        target = session.edited.target
        undo, redo = session.can_undo
        return {
            "frame": _frame(self.target_frame),
            "source_frame": _frame(self.source_frame),
            "result": None if shown.model is None else _model(shown.model, self.target_frame),
            "stale": shown.error is not None and shown.certificate is None,
            "outline": loops(target, self.target_frame),
            "handles": self._handles(target),
            "landmarks": [
                [*self._units(self.source_frame, pair.source), *self._units(self.target_frame, pair.target)]
                for pair in session.edited.landmarks
            ],
            "vertices": [
                [*vertex, *self._units(self.target_frame, place), int(vertex in session.edited.places)]
                for vertex, place in session.vertices.items()
            ],
            "places": [self._units(self.target_frame, place) for place in shown.places],
            "status": "no map" if shown.certificate is None else shown.certificate.status,
            "ok": shown.error is None,
            "live": shown.live,
            "words": self._words(),
            "milliseconds": round(1000 * shown.seconds, 1),
            "undo": undo,
            "redo": redo,
        }

    def _handles(self, target: Boundary) -> list[list[int]]:
        """Rows (loop, curve, point, x, y) of control points, each joint once."""
        rows = []
        for k, loop in enumerate(target.loops):
            for i, curve in enumerate(loop):
                rows += [[k, i, j] for j in range(len(curve.control_points) - 1)]
        points = [curve.control_points[:-1] for loop in target.loops for curve in loop]
        units = self.target_frame(np.concatenate(points)).tolist()
        return [[*row, *at] for row, at in zip(rows, units, strict=True)]

    def _words(self) -> str:
        """One line: the numbers of a map, or what is wrong."""
        shown, result = self._session.shown, self._session.result
        if shown.error is not None:
            return shown.error
        assert shown.model is not None
        if shown.live or result is None:
            metrics = quality(shown.model, samples=4).scaled_jacobian
            return f"scaled Jacobian min {metrics.min:.3f}, mean {metrics.mean:.3f} of samples"
        proved = result.quality.proved
        least = "" if proved is None else f"{str(proved).partition(';')[0]}; "
        mean = result.quality.scaled_jacobian.mean
        sure = f"; confidence {result.registration.confidence:.2f}"
        return f"{least}mean {mean:.3f}; boundary error {result.boundary_error:.1e} of the diameter{sure}"

    @staticmethod
    def _units(in_frame: Frame, point: tuple[float, float]) -> list[int]:
        x, y = in_frame(np.array(point)).tolist()
        return [x, y]


def _frame(of: Frame) -> dict[str, Any]:
    """What a page needs to tell the plane's coordinates."""
    (left, top), (right, _) = (of.inverse(np.array(p, float)).tolist() for p in ((0, 0), (1, 0)))
    return {"view_box": of.view_box, "left": left, "top": top, "unit": right - left}


def _model(mp: MultiPatch, in_frame: Frame) -> dict[str, Any]:
    drawn = sampled(mp, LIVE_LINES)
    return layers(drawn, in_frame) | {"iso": by_class(iso_lines(drawn), in_frame)}
