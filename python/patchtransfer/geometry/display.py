"""How models, boundaries and results are shown: hooks that the package fills, since drawing is a floor above."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

__all__ = ["as_html", "as_page", "as_png", "draw_with"]

_png: Callable[[Any], bytes] | None = None
_html: Callable[[Any], str] | None = None
_page: Callable[[Any], str] | None = None


def draw_with(png: Callable[[Any], bytes], html: Callable[[Any], str], page: Callable[[Any], str]) -> None:
    """Set what draws."""
    global _png, _html, _page
    _png, _html, _page = png, html, page


def as_png(shown: object) -> bytes | None:
    """PNG picture, None if nothing draws."""
    return None if _png is None else _png(shown)


def as_html(shown: object) -> str | None:
    """HTML description, None if nothing draws."""
    return None if _html is None else _html(shown)


def as_page(shown: object) -> str:
    """A whole HTML document."""
    assert _page is not None, "the package sets what draws when it is imported"
    return _page(shown)
