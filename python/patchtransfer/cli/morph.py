"""Command line: ``patchtransfer morph A B -o DIR``."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ..errors import InputError
from ..files import write_atomic
from ..progress import Clock
from .options import FOLDER, volume_options
from .streams import print_error, say
from .support import INTERRUPTED, NOT_CERTIFIED, Report, failures, keep_inputs
from .watch import watched

if TYPE_CHECKING:
    from ..motion.morph import Morph

__all__ = ["morph"]


@click.command()
@click.argument("a", type=click.Path())
@click.argument("b", type=click.Path())
@click.option("-n", "frames", type=click.IntRange(2, 10000), default=30, show_default=True, help="Frames, with ends.")
@click.option(
    "-o", "--output", required=True, type=FOLDER, metavar="DIR", help="Folder for all files; made if it does not exist."
)
@click.option(
    "--way",
    type=click.Choice(["auto", "rigid"]),
    default="auto",
    show_default=True,
    help="rigid: blend rotations even where interpolated control points are certified.",
)
@click.option("--gif", is_flag=True, help="Also an animation, morph.gif.")
@click.option("--mp4", is_flag=True, help="Also an animation, morph.mp4 (needs ffmpeg or the extra [video]).")
@click.option("--fps", type=click.IntRange(1, 120), default=15, show_default=True, help="Frames a second.")
@click.option("--keep-uncertified", is_flag=True, help="Write all frames even if some are not certified.")
@volume_options
def morph(
    a: str,
    b: str,
    frames: int,
    output: str,
    way: str,
    gif: bool,
    mp4: bool,
    fps: int,
    keep_uncertified: bool,
) -> None:
    """Certified multi-patches in between A and B, which differ in their control points only.

    Writes to DIR frame-000.xml, ... (G+Smo XML), frame-000.vtu, ... with morph.pvd (ParaView) and report.json.
    """
    from .. import io
    from ..limits import MAX_FRAME_POINTS, at_most
    from ..motion.morph import morph as run
    from ..plot.animation import check_animation

    with failures(Report(None)):
        folder = Path(output)
        animations = [folder / f"morph.{kind}" for kind, wanted in (("gif", gif), ("mp4", mp4)) if wanted]
        for path in animations:
            check_animation(path)
        digits = max(3, len(str(frames - 1)))
        names = [f"frame-{i:0{digits}}" for i in range(frames)]
        models = [folder / f"{name}{suffix}" for name in names for suffix in (".xml", ".vtu")]
        keep_inputs([a, b], [*models, *animations, folder / "morph.pvd", folder / "report.json"])
        with watched(_frame) as progress:
            clock = Clock(progress)
            with clock("reading") as stage:
                first, last = io.read(a), io.read(b)
                stage.found = f"{first!r}, {last!r}"
            count = frames * sum(patch.control_points.size // 2 for patch in first.patches)
            at_most(count, MAX_FRAME_POINTS, "control points of all frames", "take fewer frames")
            with clock("frames") as stage:
                result = run(
                    first,
                    last,
                    frames,
                    way=way,
                    on_failure="return" if keep_uncertified else "raise",
                    progress=partial(progress, "frames"),
                )
                stage.found = _found(result)
            with clock("writing") as stage:
                _write(result, folder, names, animations, fps)
                stage.found = output
    say(f"{_found(result)}; written to {output}")
    sys.exit(0 if result.certified else NOT_CERTIFIED)


def _frame(stage: str, done: int, of: float, *_: float) -> str:
    """What a morph tells of its progress."""
    return f"{stage}: {done} of {of}" if done else stage


def _found(result: Morph) -> str:
    good = sum(frame.certificate.injective for frame in result.frames)
    ways = sorted({frame.way for frame in result.frames[1:-1]})
    return f"{good} of {len(result.frames)} frames certified ({', '.join(ways) or 'ends only'})"


def _write(result: Morph, folder: Path, names: Sequence[str], animations: Sequence[Path], fps: int) -> None:
    """All frames, the report last: a folder with one is complete."""
    from .. import io
    from ..io.vtu import format_series
    from ..plot.animation import animate

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: the folder cannot be made ({error.strerror}); choose another one") from None
    try:
        (folder / "report.json").unlink(missing_ok=True)
        for name, model in zip(names, result, strict=True):
            io.write(model, folder / f"{name}.xml")
            io.write(model, folder / f"{name}.vtu")
        write_atomic(
            folder / "morph.pvd", format_series([f"{n}.vtu" for n in names], [frame.t for frame in result.frames])
        )
        for path in animations:
            animate(list(result), path, fps=fps)
        Report(str(folder / "report.json")).write(
            {
                "certified": result.certified,
                "frames": [
                    {"file": f"{name}.xml", **frame.to_dict()} for name, frame in zip(names, result.frames, strict=True)
                ],
            }
        )
    except KeyboardInterrupt:
        print_error(f"interrupted; {folder} holds a part of the files and no report.json; run the command again")
        sys.exit(INTERRUPTED)
