"""What else a boundary is made of (polygons, masks): hooks that the package fills, for readers are a floor above."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .boundary import Boundary

__all__ = ["make", "make_with"]

_makers: dict[str, Callable[..., Boundary]] = {}


def make_with(makers: Mapping[str, Callable[..., Boundary]]) -> None:
    """Set what makes a boundary, by the kind of what it is made of."""
    _makers.update(makers)


def make(kind: str, origin: Any, **options: Any) -> Boundary:
    """The boundary that `origin` describes."""
    return _makers[kind](origin, **options)
