"""Command line: the options of a transfer, which several commands have."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

from ..errors import InputError
from ..pipeline.options import CHOICES, Options
from .options import keep_uncertified_option, polish_option

if TYPE_CHECKING:
    from ..paper.options import PaperOptions

__all__ = ["chosen", "fit_tolerance_option", "transfer_options"]

fit_tolerance_option = click.option(
    "--fit-tolerance",
    type=float,
    default=Options.fit_tolerance,
    show_default=True,
    metavar="X",
    help="Boundary error.",
)


def _paper_options(context: click.Context, parameter: click.Parameter, text: str | None) -> PaperOptions | None:
    if text is None:
        return None
    from ..paper.options import PaperOptions

    try:
        return PaperOptions.parse(text)
    except InputError as error:
        raise click.BadParameter(str(error)) from error


def _choice(name: str, told: str | None = None) -> Callable[[Any], Any]:
    """An option with the choices and the default that `Options` has."""
    kind, default = click.Choice(CHOICES[name]), getattr(Options, name)
    return click.option(f"--{name}", type=kind, default=default, show_default=True, help=told)


def transfer_options(command: Callable[..., None]) -> Callable[..., None]:
    """The options of a transfer, for `chosen`."""
    for option in reversed(
        (
            _choice("method"),
            _choice(
                "refine",
                "auto: insert knots into the source where it misses the target by 5 times the fit tolerance; "
                "refine it if no certified map is found. tolerance: wherever it misses by more than the tolerance.",
            ),
            _choice(
                "split",
                "auto: split the source's patches, in whole strips, where the target has corners that no joint "
                "of the source takes.",
            ),
            _choice(
                "mirror",
                "auto: mirror the source where the target is clearly its mirror image, or landmarks say so.",
            ),
            fit_tolerance_option,
            click.option(
                "--c1-share",
                type=float,
                metavar="X",
                help="Insert knots until this part of the interfaces' length is C1 (default: none).",
            ),
            click.option(
                "--ratios",
                type=click.Choice(CHOICES["ratios"]),
                default="target",
                show_default=True,
                help="Speeds and frames that continuity rows follow: the map's, or the source's, as for all targets.",
            ),
            polish_option(
                CHOICES["polish"],
                "none",
                "Make the worst place better, proved: the smallest scaled Jacobian, or the largest dilatation of the "
                "map from the source.",
            ),
            click.option(
                "--fixed-correspondence/--sliding-joints",
                default=None,
                help="Keep all joints where registration puts them, or let those that are neither corners nor "
                "landmarks slide to lower the distortion (default, but for the paper's method).",
            ),
            _choice(
                "correspondence",
                "Of those found without landmarks: the best, or the second best.",
            ),
            click.option(
                "--paper-options",
                callback=_paper_options,
                metavar="KEY=VALUE,...",
                help="Of --method paper: initial=reversible|dirichlet, boundary_samples=source|uniform, "
                "freeze_interfaces, literal_rows, snap_corners (true|false), max_iterations and boundary_weight.",
            ),
            keep_uncertified_option,
            click.option(
                "--time-limit",
                type=float,
                metavar="S",
                help="Seconds for a target, after which the search ends with the best map so far (default: none).",
            ),
        )
    ):
        command = option(command)
    return command


def chosen(options: dict[str, Any]) -> Options:
    """What the user chose of `transfer_options`."""
    given = dict(options)
    return Options(on_failure="return" if given.pop("keep_uncertified") else "raise", **given)
