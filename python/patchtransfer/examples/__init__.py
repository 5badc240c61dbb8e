"""Bundled examples: models and drawings of our own that show the whole pipeline.

An example is a folder with ``source.xml`` (a multi-patch), ``target.svg`` (a drawn outline; of rational sources
``target.xml``, with exact circles) and ``landmarks.csv`` (corresponding places), and one line here.
"""

from __future__ import annotations

import os
import warnings
from importlib.resources import as_file, files
from pathlib import Path

from .. import io
from ..errors import InputError, InputWarning
from ..files import json_text, write_atomic
from ..geometry.boundary import Boundary
from ..geometry.multipatch import MultiPatch
from ..numeric.arrays import FloatArray
from ..pipeline.result import TransferResult
from ..pipeline.transfer import transfer
from ..plot import figures as plot
from ..plot.drawing import need_matplotlib
from ..progress import Clock, Progress

__all__ = ["EXAMPLES", "RATIONAL", "load", "run"]

EXAMPLES = {
    "wrench": "an open-end wrench of 18 bicubic patches, moved to a drawing with a turned jaw and a bent handle",
    "rabbit": "a rabbit of 20 bicubic patches, vertices of valence 3 and 5, moved to a drawing with one ear bent",
    "human": "a standing figure of 29 bicubic patches, vertices of valence 3 and 5, moved to raised arms and a step",
    "frame": "a wavy picture frame of 14 bicubic patches, moved to a bent trapezoidal one with waves inside and out",
    "two-hole-plate": "a plate of 21 bicubic patches, four around each hole, moved to a bent one with oblique holes",
    "star": "a six-armed star of 6 bicubic patches, moved to one with bent arms of unequal lengths",
    "annulus": "an annulus of 4 rational patches (NURBS), moved to an eccentric one of other radii, exactly",
    "plate-with-hole": "a square plate of 4 rational patches around a hole, moved to an oblique one with an ellipse",
}
"""One line for each example, by name."""

RATIONAL = ("annulus", "plate-with-hole")
"""The examples whose source has weights."""

STEPS = {"wrench": 4}
"""Further targets of an example: the shape moved on in equal steps."""


def inputs(name: str) -> tuple[str, str, str]:
    """The files of an example: source, target and landmarks."""
    return "source.xml", "target.xml" if name in RATIONAL else "target.svg", "landmarks.csv"


def load(name: str, step: int | None = None) -> tuple[MultiPatch, Boundary, FloatArray]:
    """Read a bundled example.

    Parameters
    ----------
    name : str
        A key of `EXAMPLES`.
    step : int, optional
        Of the examples in `STEPS` the target of this step, 1 and up; default the example's own target.

    Returns
    -------
    source : MultiPatch
    target : Boundary
    landmarks : (r, 4) array
        Rows (xs, ys, xt, yt), in the example's unit (millimetres for the wrench).

    Raises
    ------
    InputError
        When there is no such example or step.

    Examples
    --------
    >>> source, target, landmarks = load("wrench")
    >>> source
    <MultiPatch: 18 patches, 24 interfaces, 1 hole, 510 control points>
    """
    _check_name(name)
    folder = files(__name__) / name
    source, target, landmarks = inputs(name)
    if step is not None:
        if not 1 <= step <= STEPS.get(name, 0):
            raise InputError(f"example {name!r} has {STEPS.get(name, 0)} steps, there is no step {step}")
        target, landmarks = f"target-step{step}.svg", f"landmarks-step{step}.csv"
    with as_file(folder / source) as path:
        model = io.read(path)
    with as_file(folder / target) as path:
        boundary = io.read_boundary(path)
    with as_file(folder / landmarks) as path:
        return model, boundary, io.read_landmarks(path)


def run(name: str, folder: str | os.PathLike[str], progress: Progress | None = None) -> TransferResult:
    """Transfer a bundled example and keep everything in a folder.

    Writes the inputs ``source.xml``, ``target.svg`` (or ``target.xml``) and ``landmarks.csv``, then ``result.xml``, the
    pictures ``transfer.png`` and ``registration.png``, and ``report.json``. Files of these names are replaced. Without
    matplotlib there are no pictures, which an `InputWarning` says.

    Parameters
    ----------
    name : str
        A key of `EXAMPLES`.
    folder : path
        Created if it does not exist.
    progress : callable, optional
        As in `patchtransfer.transfer`.

    Returns
    -------
    TransferResult

    Raises
    ------
    InputError
        When there is no such example or the folder cannot be written to.

    Examples
    --------
    >>> import patchtransfer as pt
    >>> import tempfile
    >>> from pathlib import Path
    >>> folder = Path(tempfile.mkdtemp())
    >>> result = pt.examples.run("star", folder)
    >>> sorted(path.name for path in folder.iterdir())[:3]
    ['landmarks.csv', 'registration.png', 'report.json']
    """
    _check_name(name)
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: the folder cannot be made ({error.strerror}); choose another one") from None
    clock = Clock(progress)
    with clock("reading") as stage:
        for item in inputs(name):
            write_atomic(folder / item, (files(__name__) / name / item).read_bytes())
        source, target, landmarks = load(name)
        stage.found = f"{source!r}, {target!r}, {len(landmarks)} landmarks"
    result = transfer(source, target, landmarks, progress=progress)
    metrics = result.quality.scaled_jacobian
    caption = f"{result.certificate.status}; scaled Jacobian at least {metrics.min:.3f}, mean {metrics.mean:.3f}"
    with clock("writing") as stage:
        try:
            need_matplotlib("drawing")
        except InputError as missing:
            warnings.warn(f"{folder}: no pictures are made: {missing}", InputWarning, stacklevel=2)
        else:
            plot.savefig(plot.transfer(source, target, result.multipatch, caption=caption), folder / "transfer.png")
            pairs = [[*a, *b] for a, b in result.registration.joints]
            fitted = result.multipatch.boundary()
            plot.savefig(plot.registration(source.boundary(), fitted, pairs, target), folder / "registration.png")
        io.write(result.multipatch, folder / "result.xml")
        write_atomic(folder / "report.json", json_text(result.to_dict()))
        stage.found = str(folder)
    return result


def _check_name(name: str) -> None:
    if name not in EXAMPLES:
        raise InputError(f"no example is called {name!r}; there is {', '.join(EXAMPLES)}")
