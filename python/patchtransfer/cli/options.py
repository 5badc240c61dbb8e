"""Command line: options that several commands have."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import click

from .streams import QUIET, VOLUME

__all__ = [
    "continuity_option",
    "html_option",
    "json_option",
    "keep_uncertified_option",
    "outline_options",
    "polish_option",
    "polynomial_option",
    "volume_options",
]

json_option = click.option("--json", "json_path", metavar="R.json", help='JSON report; "-" for standard output.')

html_option = click.option(
    "--html", "html_path", metavar="R.html", help="Report as one web page: pictures, certificate, quality, continuity."
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


def outline_options(command: Callable[..., None]) -> Callable[..., None]:
    """How an outline is read: keywords of `read_boundary`."""
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
        command = option(command)
    return command


keep_uncertified_option = click.option(
    "--keep-uncertified", is_flag=True, help="Write the best map even without a certificate."
)
