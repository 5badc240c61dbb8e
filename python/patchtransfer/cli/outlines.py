"""Command line: how outlines are read."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import TYPE_CHECKING, Any, NamedTuple

import click

if TYPE_CHECKING:
    from ..geometry.boundary import Boundary

__all__ = ["Outlines", "outline_options"]


class Outlines(NamedTuple):
    """How outlines are read: keywords of `read_boundary`."""

    clean: bool
    smooth: bool | None
    layers: tuple[str, ...] | None

    def read(self, path: str) -> Boundary:
        """The outline in a file."""
        from .. import io

        return io.read_boundary(path, **self.keywords())

    def keywords(self) -> dict[str, Any]:
        """For what reads outlines on its own."""
        return self._asdict()


def outline_options(command: Callable[..., None]) -> Callable[..., None]:
    """Options for how outlines are read; the command is handed them as one `Outlines`, `outlines`."""

    @wraps(command)
    def with_outlines(
        *given: Any, clean: bool, smooth: bool | None, layers: tuple[str, ...] | None, **options: Any
    ) -> None:
        command(*given, outlines=Outlines(clean, smooth, layers), **options)

    for option in (
        click.option(
            "--layer",
            "layers",
            multiple=True,
            callback=lambda context, parameter, value: value or None,
            metavar="NAME",
            help="Layer of the drawing to read, or GeoJSON polygon; repeatable (default: all that are visible).",
        ),
        click.option(
            "--no-clean",
            "clean",
            is_flag=True,
            default=True,
            flag_value=False,
            help="Do not mend slips of the outline.",
        ),
        click.option(
            "--smooth/--polygon",
            default=None,
            help="Points are samples of smooth curves, or corners of polygons (default: all turns decide).",
        ),
    ):
        with_outlines = option(with_outlines)
    return with_outlines
