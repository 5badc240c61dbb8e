"""Command line: ``patchtransfer library DIR TARGET -o OUT.xml``."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import click

from ..progress import Clock
from .delivery import deliver, draw_patches, leave
from .options import FILE, FOLDER, continuity_option, html_option, json_option, threads_option, volume_options
from .outlines import Outlines, outline_options
from .streams import say, warn
from .support import Report, all_or_nothing, check_outputs, failures, keep_inputs, set_threads
from .transfer_options import chosen, transfer_options
from .watch import watched

__all__ = ["library"]


@click.command()
@click.argument("folder", type=FOLDER, metavar="DIR")
@click.argument("target", type=click.Path())
@click.option(
    "-o", "--output", type=FILE, metavar="OUT.xml", help="Multi-patch of the best; without it DIR is only ranked."
)
@click.option("--tries", type=click.IntRange(1), default=3, show_default=True, help="Models that are transferred.")
@click.option("--keep", type=click.IntRange(1), default=12, show_default=True, help="Models that are registered.")
@click.option(
    "--parameterize/--no-parameterize",
    default=True,
    show_default=True,
    help="Where no model fits well, try a layout of the target's own.",
)
@click.option("--skip-unreadable", is_flag=True, help="Leave out files that are no models.")
@click.option(
    "--cache",
    type=FOLDER,
    metavar="FOLDER",
    help="Where what is known of models is kept (default: $PATCHTRANSFER_CACHE, else the user's place for caches).",
)
@click.option("--no-cache", is_flag=True, help="Keep nothing.")
@continuity_option("c0")
@transfer_options
@outline_options
@click.option("--plot", "plot_path", type=FILE, metavar="P.png", help="Picture of the multi-patch.")
@html_option
@json_option
@volume_options
@threads_option
def library(
    folder: str,
    target: str,
    output: str | None,
    tries: int,
    keep: int,
    parameterize: bool,
    skip_unreadable: bool,
    cache: str | None,
    no_cache: bool,
    continuity: str,
    plot_path: str | None,
    html_path: str | None,
    json_path: str | None,
    threads: int | None,
    outlines: Outlines,
    **options: Any,
) -> None:
    """Transfer to the boundary TARGET the model of the folder DIR that suits it best.

    All models are compared by a signature, the nearest by registration, and the best of these are transferred; the map
    with the largest proved minimum of the scaled Jacobian is written. A table says how far each came, and why.
    """
    from ..errors import InputError
    from ..library.library import Library
    from ..library.ranked import table

    if cache is not None and no_cache:
        raise click.UsageError("--cache and --no-cache exclude each other")
    report = Report(json_path)
    with failures(report):
        check_outputs(model=output, picture=plot_path, page=html_path, report=json_path)
        shown = plot_path or html_path
        if output is None and shown is not None:
            raise InputError(f"{shown}: it shows the model that is written; name that with -o OUT.xml")
        inputs = [target, *(Path(folder).iterdir() if Path(folder).is_dir() else ())]
        keep_inputs(inputs, [output, plot_path, html_path, json_path])
        set_threads(threads)
        wanted = chosen(options)
        with watched() as progress:
            with Clock(progress)("reading") as stage:
                boundary = outlines.read(target)
                shelf = Library.open(
                    folder,
                    continuity,
                    skip_unreadable=skip_unreadable,
                    cache=False if no_cache else True if cache is None else cache,
                )
                stage.found = f"{shelf!r}, {boundary!r}"
            given = wanted.keywords()
            if output is None:
                ranked = shelf.rank(boundary, keep=keep, progress=progress, **given)
            else:
                # Of a failure all candidates are told first.
                given["on_failure"] = "return"
                found = shelf.transfer(
                    boundary, tries, keep=keep, parameterize=parameterize, progress=progress, **given
                )
        if output is None:
            content = {"library": {"candidates": [c.to_dict() for c in ranked], "notes": list(shelf.notes)}}
            with all_or_nothing(json_path):
                report.write(content | {"error": None})
                if json_path != "-":
                    say(table(ranked))
            warn(shelf.notes)
            return
        if json_path != "-":
            say(str(found))
        warn(found.notes)
        failure = found.failure
        if failure is not None and (wanted.on_failure == "raise" or found.result is None):
            raise failure
        assert found.result is not None
        more = {"library": found.to_dict()["library"]}
        pictures = [(plot_path, partial(draw_patches, found.result))]
        deliver(found.result, output, report, pictures, html_path, boundary, more)
    leave(found.result)
