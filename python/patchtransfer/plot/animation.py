"""Animations of a sequence of multi-patches: GIF by Pillow, MP4 by ffmpeg, both through matplotlib's writers."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..files import write_atomic
from ..geometry.multipatch import MultiPatch
from .drawing import draw_multipatch, finish, need_matplotlib, side_lines

__all__ = ["animate", "check_animation", "ffmpeg_path"]

#: Inches of a picture's longer side, and white around the motion, in parts of it.
LONGEST, MARGIN = 6.4, 0.02


def animate(
    models: Sequence[MultiPatch],
    path: str | os.PathLike[str],
    *,
    fps: int = 15,
    dpi: int = 100,
    iso_lines: int | None = None,
) -> None:
    """Draw every model as in `plot.multipatch`, in one frame that all of them just fit into, and write an animation.

    Parameters
    ----------
    models : sequence of MultiPatch
    path : path
        ``.gif`` (played forth and back for ever) or ``.mp4`` (needs ffmpeg; see `ffmpeg_path`).
    fps : int, default 15
        Frames a second.
    dpi : int, default 100
        Dots per inch of a picture whose longer side is 6.4 inches.
    iso_lines : int, optional
        As in `plot.multipatch`.

    Raises
    ------
    InputError
        On another suffix, without models, without ffmpeg (MP4), or when the folder cannot be written to.
    """
    path = Path(path)
    check_animation(path)
    if not models:
        raise InputError(f"{path}: an animation needs at least one frame")
    import matplotlib
    from matplotlib.animation import FFMpegWriter, PillowWriter
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    outline = np.concatenate([line for model in models for line in side_lines(model)])
    low, high = outline.min(axis=0), outline.max(axis=0)
    margin = MARGIN * float((high - low).max())
    width, height = (high - low + 2 * margin).tolist()
    longest = max(width, height)
    figure = Figure(figsize=(LONGEST * width / longest, LONGEST * height / longest))
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0, 0, 1, 1))
    # A GIF has no second direction: it gets the way back as frames.
    gif = path.suffix.lower() == ".gif"
    order = [*range(len(models)), *(range(len(models) - 2, 0, -1) if gif else ())]
    settings: Any = {} if gif else {"animation.ffmpeg_path": ffmpeg_path()}
    with tempfile.TemporaryDirectory() as folder, matplotlib.rc_context(settings):
        made = Path(folder) / f"animation{path.suffix.lower()}"
        # H.264 wants even numbers of pixels.
        even = ["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2:color=white", "-pix_fmt", "yuv420p"]
        writer = PillowWriter(fps=fps) if gif else FFMpegWriter(fps=fps, codec="libx264", extra_args=even)
        try:
            with writer.saving(figure, str(made), dpi):
                for index in order:
                    axes.clear()
                    draw_multipatch(axes, models[index], iso_lines)
                    finish(axes, None)
                    axes.set_xlim(low[0] - margin, high[0] + margin)
                    axes.set_ylim(low[1] - margin, high[1] + margin)
                    writer.grab_frame(facecolor="white")
            data = made.read_bytes()
        except OSError as error:
            raise InputError(f"{path}: the animation could not be made ({error}); check ffmpeg and the disk") from None
    write_atomic(path, data)


def check_animation(path: Path) -> None:
    """Raise `InputError` when no animation can be made at this path: its suffix, no matplotlib, no ffmpeg for MP4."""
    if path.suffix.lower() not in (".gif", ".mp4"):
        raise InputError(f"{path}: unknown format for an animation; use .gif or .mp4")
    need_matplotlib(f"{path}: the animation")
    if path.suffix.lower() == ".mp4":
        ffmpeg_path()


def ffmpeg_path() -> str:
    """The ffmpeg that MP4 files are made with: matplotlib's setting or the one on the path, else `imageio-ffmpeg`'s.

    Raises
    ------
    InputError
        When there is none; the message says how to get one.
    """
    import shutil

    import matplotlib

    found = shutil.which(str(matplotlib.rcParams["animation.ffmpeg_path"]))
    if found is not None:
        return found
    try:
        from imageio_ffmpeg import get_ffmpeg_exe

        return str(get_ffmpeg_exe())
    except (ImportError, RuntimeError):
        raise InputError(
            "MP4 needs ffmpeg, which was not found: install it, or pip install 'patchtransfer[video]'; or make a GIF"
        ) from None
