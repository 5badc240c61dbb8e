"""Command line: options that several commands have."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING

import click

from .streams import QUIET, VOLUME

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

__all__ = [
    "FILE",
    "FOLDER",
    "completed",
    "continuity_option",
    "html_option",
    "json_option",
    "keep_uncertified_option",
    "polish_option",
    "polynomial_option",
    "threads_option",
    "volume_options",
]

#: A file that is written; whether it can be is looked at when all options are known.
FILE = click.Path(readable=False)


class _Folder(click.Path):
    """A folder, which may not exist; shells complete folders only."""

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        from click.shell_completion import CompletionItem

        return [CompletionItem(incomplete, type="dir")]


FOLDER = _Folder(readable=False)


def completed(
    names: Iterable[str],
) -> Callable[[click.Context, click.Parameter, str], list[str]]:
    """Completion of a text that is one of these names, or something else."""
    return lambda context, parameter, incomplete: [name for name in names if name.startswith(incomplete)]


threads_option = click.option(
    "--threads", type=click.IntRange(1, 1024), metavar="N", help="Threads of the core (default: all)."
)

json_option = click.option(
    "--json", "json_path", type=FILE, metavar="R.json", help='JSON report; "-" for standard output.'
)

html_option = click.option(
    "--html",
    "html_path",
    type=FILE,
    metavar="R.html",
    help="Report as one web page: pictures, certificate, quality, continuity.",
)


def _loudness(context: click.Context, parameter: click.Parameter, value: int) -> None:
    if value:
        if VOLUME in context.meta:
            raise click.UsageError("--verbose and --quiet exclude each other")
        context.meta[VOLUME] = QUIET if parameter.name == "quiet" else value


def volume_options(command: Callable[..., None]) -> Callable[..., None]:
    """How much a command tells of itself, for `streams.volume`; all commands have them."""
    for option in (
        click.option("-q", "--quiet", is_flag=True, expose_value=False, callback=_loudness, help="Print errors only."),
        click.option(
            "-v",
            "--verbose",
            count=True,
            expose_value=False,
            callback=_loudness,
            help="A line on standard error for every stage: its seconds, what it came to. -vv: what was decided, too.",
        ),
    ):
        command = option(command)
    return command


def continuity_option(default: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """The option for continuity across patches."""
    return click.option(
        "--continuity",
        type=click.Choice(["c0", "c1", "g1"]),
        default=default,
        show_default=True,
        help="Across patches.",
    )


def polynomial_option(text: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """The option that makes a rational model polynomial, with its help."""
    return click.option("--polynomial", type=float, metavar="TOL", help=text)


def polish_option(
    goals: Sequence[str], default: str, text: str
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """The option for a polish, with its help; "none" is None."""
    return click.option(
        "--polish",
        type=click.Choice([*goals, "none"]),
        default=default,
        show_default=True,
        callback=lambda context, parameter, value: None if value == "none" else value,
        help=text,
    )


keep_uncertified_option = click.option(
    "--keep-uncertified", is_flag=True, help="Write the best map even without a certificate."
)
