"""What else a boundary is made of (polygons, masks): hooks that the package fills, for readers are a floor above."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

__all__ = ["make", "make_with"]

_makers: dict[str, Callable[..., Any]] = {}


def make_with(makers: Mapping[str, Callable[..., Any]]) -> None:
    """Set what makes a boundary, by the kind of what it is made of."""
    _makers.update(makers)


def make(kind: str, origin: Any, **options: Any) -> Any:
    """The boundary that `origin` describes."""
    return _makers[kind](origin, **options)
