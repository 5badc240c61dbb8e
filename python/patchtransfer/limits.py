"""Upper bounds of what is read and built: within them a command needs less than 2 GB and, as a rule, 20 seconds.

They are far above models of practice, and there to tell a slip of a digit, a scan or a hostile file at once instead of
after all memory is gone. Measured on two cores: the largest model, 10 000 patches of 100 control points, is checked
with 1.6 GB.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ._core import MAX_DEGREE
from .errors import InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

__all__ = [
    "LARGEST",
    "MAX_ALONG",
    "MAX_BOUNDARY_POINTS",
    "MAX_CONTROL_POINTS",
    "MAX_CORNERS",
    "MAX_CURVES",
    "MAX_DEGREE",
    "MAX_DXF_LINES",
    "MAX_FILE_BYTES",
    "MAX_FRAME_POINTS",
    "MAX_JSON_LISTS",
    "MAX_KNOT_RATIO",
    "MAX_LANDMARKS",
    "MAX_LAYOUT_BYTES",
    "MAX_LAYOUT_DEGREE",
    "MAX_LAYOUT_POINTS",
    "MAX_LINES",
    "MAX_LOOPS",
    "MAX_MODEL_LINES",
    "MAX_PATCHES",
    "MAX_PIXELS",
    "MAX_QUADS",
    "MAX_TAGS",
    "MAX_WEIGHT_RATIO",
    "TOO_LARGE",
    "at_most",
    "first_unusable",
]

#: Largest coordinate, knot or weight that is read: squares do not overflow.
LARGEST = 1e150
#: ... as messages write it.
TOO_LARGE = "above 1e150"
#: Largest weight of a patch or curve in units of its smallest. Those of arcs differ by 2 or 3; next to one that is the
#: inverse of the unit roundoff, 2^53 = 9e15, times as heavy a control point is lost in rounding.
MAX_WEIGHT_RATIO = 1e16
#: Length of a domain in units of its shortest knot span. In models it is some hundreds, and 1.8e16 where two knots are
#: neighbouring numbers. With the ratio of weights it bounds derivatives in units of the domain and of the control
#: points: first ones by 1e48, second ones by 1e96, so that their squares and products do not overflow.
MAX_KNOT_RATIO = 1e30

#: Bytes of a file: a million control points in full digits have 45 million.
MAX_FILE_BYTES = 64 * 2**20
#: Tags of an XML or SVG file, opening and closing ones: each takes up to a kilobyte.
MAX_TAGS = 1_000_000
#: Lists and objects of a model in JSON: a million control points with weights have two million. Each takes 64 bytes.
MAX_JSON_LISTS = 3_000_000
#: Bytes of a layout, whose lists take twenty times as much when parsed.
MAX_LAYOUT_BYTES = 4 * 2**20
#: Degree of patches made on a layout: from 12 on the systems of the inside lose so many digits that patches get worse,
#: and from 17 on they cannot be solved.
MAX_LAYOUT_DEGREE = 10
#: Patches of a model.
MAX_PATCHES = 10_000
#: Control points of a model, all patches together, ...
MAX_CONTROL_POINTS = 1_000_000
#: ... and of a patch in one direction: knots are inserted one by one.
MAX_ALONG = 5_000
#: Curves of a boundary (segments of paths in a picture, points of an outline in CSV).
MAX_CURVES = 50_000
#: Control points of a boundary.
MAX_BOUNDARY_POINTS = 200_000
#: Loops of a boundary: every two of them are compared.
MAX_LOOPS = 1_000
#: Corners of a target's loop: matching takes time with their square, 10 s at the bound.
MAX_CORNERS = 4_000
#: Landmarks of a transfer.
MAX_LANDMARKS = 1_000
#: Lines of a text file, comments and empty ones too.
MAX_LINES = 500_000
#: Lines of a model as text: a weight and a point for each control point stand in lines of their own, and as many again.
MAX_MODEL_LINES = 4 * MAX_CONTROL_POINTS
#: Lines of a DXF file: 18 s and 0.6 GB at the bound.
MAX_DXF_LINES = 6_000_000
#: Pixels of an image, which takes 60 bytes for each while its regions are told apart.
MAX_PIXELS = 16_000_000
#: Quads of a layout, ...
MAX_QUADS = 1_000
#: ... and control points of the model made of it, which is optimised: 10 s and 1.5 GB at the bound.
MAX_LAYOUT_POINTS = 50_000
#: Control points of all frames of the command that morphs: they are kept until all are certified.
MAX_FRAME_POINTS = 10_000_000


def first_unusable(values: ArrayLike) -> int | None:
    """Where the first number is, in the flat array, that is NaN or above `LARGEST` in size; None if all are good."""
    # Commands know their bounds before they need numerics: help and version are there at once.
    import numpy as np

    with np.errstate(invalid="ignore"):
        good = np.abs(np.asarray(values)) <= LARGEST
    return None if good.all() else int(np.argmin(good))


def at_most(count: int, limit: int, what: str, remedy: str) -> None:
    """Raise `InputError` if there are more than `limit` of something."""
    if count > limit:
        # Numbers from files may have thousands of digits, which Python refuses to print.
        number = str(count) if count < 10**15 else "more than 10^15"
        raise InputError(f"{number} {what}, at most {limit} are supported; {remedy}")
