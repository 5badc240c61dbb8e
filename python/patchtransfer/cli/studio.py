"""Command line: ``patchtransfer studio SOURCE [TARGET]``."""

from __future__ import annotations

import os
import sys
from contextlib import suppress

import click

from ..progress import Clock
from .options import FILE, continuity_option, threads_option, volume_options
from .outlines import Outlines, outline_options
from .streams import say
from .support import Report, failures, set_threads
from .watch import watched

__all__ = ["studio"]


@click.command()
@click.argument("source", type=click.Path())
@click.argument("target", type=click.Path(), required=False)
@click.option("--landmarks", type=FILE, metavar="L.csv", help="Landmarks to start with, columns xs,ys,xt,yt.")
@continuity_option("c1")
@outline_options
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="0, the default, takes any free one.")
@click.option("--no-browser", is_flag=True, help="Do not open a browser, only print the address.")
@threads_option
@volume_options
def studio(
    source: str,
    target: str | None,
    landmarks: str | None,
    continuity: str,
    port: int,
    no_browser: bool,
    threads: int | None,
    outlines: Outlines,
) -> None:
    """Open a local page where the target is dragged and the certified result follows.

    SOURCE is a multi-patch and TARGET a boundary, as of transfer; without TARGET it is the source's own boundary.
    SOURCE may be an outline alone, which is parameterized first. The page is served on this machine only; what is saved
    there goes where the browser puts it. Ctrl-C ends the studio.
    """
    from .. import io
    from ..editor.server import serve
    from ..editor.session import Session

    def ready(address: str) -> None:
        say(address)
        sys.stdout.flush()
        if not no_browser:
            import webbrowser

            # A machine without a browser still has the address.
            with suppress(webbrowser.Error):
                webbrowser.open(address)

    with failures(Report(None)):
        set_threads(threads)
        with watched() as progress, Clock(progress)("reading") as stage:
            points = None if landmarks is None else io.read_landmarks(landmarks)
            given = None if target is None else outlines.read(target)
            try:
                model = io.read(source)
            except io.OutlineOnlyError:
                # May take seconds.
                session = Session.of_outline(outlines.read(source), given, points, continuity)
            else:
                session = Session(model, model.boundary() if given is None else given, points, continuity)
            stage.found = repr(session.source)
        title = os.path.basename(source) + (f" → {os.path.basename(target)}" if target else "")
        with suppress(KeyboardInterrupt):
            serve(session, title, port, ready)
