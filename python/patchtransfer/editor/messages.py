"""Messages from the page: what they may say, checked before anything is done."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from typing import Any

from ..errors import InputError, TransferError
from .editing import PointAddress
from .session import Session
from .vertices import VertexAddress
from .view import View

__all__ = ["LARGEST_MESSAGE", "answer", "obey"]

#: Bytes of a message: those of the page have about a hundred.
LARGEST_MESSAGE = 4096
#: Coordinates that a drag can mean; squares of larger ones overflow soon.
FAR = 1e100
#: All of a loop is half of its length away at most.
MOST_REACH = 0.5


def answer(session: Session, view: View, text: str | None) -> dict[str, Any]:
    """What is shown after a message, with what was done or why it was refused; for None, the first time, everything."""
    said: dict[str, Any] = {"source": view.source()} if text is None else {}
    try:
        said["done"] = "open" if text is None else obey(session, text)
    except TransferError as error:
        said["refused"] = str(error)
    return said | view.state()


def obey(session: Session, text: str) -> str:
    """Do what a message of the page says.

    Parameters
    ----------
    session : Session
    text : str
        JSON with a key ``do``: "refresh", "grab" (loop, curve, point, reach) or "take" (patch, corner), "drag" (x, y),
        "drop", "release" (patch, corner), "add" (sx, sy, tx, ty), "move" (landmark, on, x, y), "remove" (landmark),
        "undo" or "redo".

    Returns
    -------
    str
        What was done.

    Raises
    ------
    InputError
        On anything else; nothing has changed then.
    """
    try:
        message = json.loads(text)
    except (ValueError, RecursionError):
        raise InputError("a message is not JSON") from None
    if not isinstance(message, dict):
        raise InputError("a message is no object")
    name = message.get("do")
    does = _DOES.get(name) if isinstance(name, str) else None
    if does is None:
        raise InputError(f"a message asks for {str(name)[:40]!r}, which the studio cannot do")
    does(session, message)
    return str(name)


def _number(message: dict[str, Any], key: str) -> float:
    value = message.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"a message has no number {key}")
    # Integers of any size come through JSON.
    if not abs(value) <= FAR or not math.isfinite(value):
        raise InputError(f"a message's {key} is not finite, or too large")
    return float(value)


def _index(message: dict[str, Any], key: str) -> int:
    value = message.get(key)
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < 2**31:
        raise InputError(f"a message has no index {key}")
    return value


def _point(message: dict[str, Any], x: str = "x", y: str = "y") -> tuple[float, float]:
    return _number(message, x), _number(message, y)


def _grab(session: Session, message: dict[str, Any]) -> None:
    reach = _number(message, "reach") if "reach" in message else 0.0
    if not 0 <= reach <= MOST_REACH:
        raise InputError(f"a reach is a part of the loop's length, from 0 to {MOST_REACH}")
    session.grab(PointAddress(*(_index(message, key) for key in ("loop", "curve", "point"))), reach)


def _vertex(message: dict[str, Any]) -> VertexAddress:
    return VertexAddress(_index(message, "patch"), _index(message, "corner"))


def _move(session: Session, message: dict[str, Any]) -> None:
    on = message.get("on")
    if on not in ("source", "target"):
        raise InputError("a landmark is moved on the source or on the target")
    session.move_landmark(_index(message, "landmark"), on, _point(message))


_DOES: dict[str, Callable[[Session, dict[str, Any]], None]] = {
    "refresh": lambda session, _: session.refresh(),
    "grab": _grab,
    "take": lambda session, message: session.take(_vertex(message)),
    "release": lambda session, message: session.release(_vertex(message)),
    "drag": lambda session, message: session.drag(_point(message)),
    "drop": lambda session, _: session.drop(),
    "add": lambda session, message: session.add_landmark(_point(message, "sx", "sy"), _point(message, "tx", "ty")),
    "move": _move,
    "remove": lambda session, message: session.remove_landmark(_index(message, "landmark")),
    "undo": lambda session, _: session.undo(),
    "redo": lambda session, _: session.redo(),
}
