"""Sequences of objects of other libraries."""

from __future__ import annotations

from typing import Any

from ..errors import InputError

__all__ = ["listed"]


def listed(objects: Any, what: str) -> list[Any]:
    """Objects of a sequence; `InputError` if it is none."""
    try:
        return list(objects)
    except TypeError:
        raise InputError(f"{str(objects)[:40]} is neither {what} nor a sequence of them") from None
