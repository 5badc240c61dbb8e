"""Models in other forms: a hook that the package fills, since what makes them is on floors above the geometry."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

__all__ = ["call", "find_with"]

#: Function of a name, such as "to_nutils".
_find: Callable[[str], Callable[..., Any]]


def find_with(find: Callable[[str], Callable[..., Any]]) -> None:
    """Set what finds the functions."""
    global _find
    _find = find


def call(name: str, *arguments: object, **options: object) -> Any:
    """Call a function of `patchtransfer.interop` or `patchtransfer.conversion`, whose module is loaded then."""
    return _find(name)(*arguments, **options)
