"""How models, boundaries and results are shown: hooks that the package fills, since drawing is a floor above."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

__all__ = ["Shown", "as_page", "draw_with"]

_svg: Callable[[Any], str] | None = None
_html: Callable[[Any, str], str] | None = None
_page: Callable[[Any], str] | None = None


def draw_with(svg: Callable[[Any], str], html: Callable[[Any, str], str], page: Callable[[Any], str]) -> None:
    """Set what draws: a picture, a table beside a picture, and a page."""
    global _svg, _html, _page
    _svg, _html, _page = svg, html, page


class Shown:
    """What notebooks show as a picture, drawn once: values do not change."""

    @cached_property
    def _picture(self) -> str | None:
        return None if _svg is None else _svg(self)

    def _repr_svg_(self) -> str | None:
        return self._picture

    def _repr_html_(self) -> str | None:
        return None if _html is None or self._picture is None else _html(self, self._picture)


def as_page(shown: object) -> str:
    """A whole HTML document."""
    assert _page is not None, "the package sets what draws when it is imported"
    return _page(shown)
