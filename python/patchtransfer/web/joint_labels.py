"""Where the numbers of joints stand in a picture: outside of the outline, beside their joints, on nothing else."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..numeric.arrays import FloatArray
from ..plot.labels import Place, around, extent, placed
from .picture import Frame

__all__ = ["beside"]

#: Units of a picture for a point of `plot.labels`, whose distances are for a font of about this many points.
UNITS_A_POINT, FONT = 100.0, 10.0
#: What a place costs that sticks out of the picture: more than lying on other labels, for it cannot be read at all.
OUTSIDE = 1000.0


def beside(points: FloatArray, outlines: Sequence[FloatArray], marks: FloatArray, in_frame: Frame) -> FloatArray:
    """The middles (n, 2) of the numbers 0 to n - 1 of joints, in the picture's units.

    Parameters
    ----------
    points : (n, 2) array
        The joints, in the plane.
    outlines : sequence of (m, 2) arrays
        Loops as closely sampled polygons, in the plane.
    marks : (k, 2) array
        Marked points that should stay free, besides the joints.
    in_frame : Frame
    """
    loops = [in_frame(loop) / UNITS_A_POINT for loop in outlines]
    joints, dots = (in_frame(p.reshape(-1, 2)) / UNITS_A_POINT for p in (points, marks))
    sizes = np.array([extent(str(k), FONT) for k in range(len(joints))]).reshape(-1, 2)
    corner = np.array([in_frame.width, in_frame.height]) / UNITS_A_POINT
    places = []
    for joint, direction, size in zip(joints, _outwards(joints, loops), sizes, strict=True):
        place = around(joint, direction)
        out = ((place.at < size / 2) | (place.at > corner - size / 2)).any(axis=1)
        places.append(Place(place.at, place.cost + OUTSIDE * out))
    chosen = placed(places, sizes, np.concatenate([joints, dots]), np.concatenate(loops))
    middles = [place.at[k] for place, k in zip(places, chosen, strict=True)]
    return np.rint(UNITS_A_POINT * np.array(middles).reshape(-1, 2))


def _outwards(points: FloatArray, loops: Sequence[FloatArray]) -> FloatArray:
    """Directions (n, 2) out of the domain at points of its boundary; the largest loop is the outer one."""
    areas = [_area(loop) for loop in loops]
    outer = int(np.argmax(np.abs(areas)))
    away, directions = [], []
    for number, (loop, area) in enumerate(zip(loops, areas, strict=True)):
        far = np.hypot(*(points[:, None] - loop).transpose(2, 0, 1))
        nearest = far.argmin(axis=1)
        along = loop[(nearest + 1) % len(loop)] - loop[nearest - 1]
        sign = np.sign(area) * (1 if number == outer else -1)
        away.append(far.min(axis=1))
        directions.append(sign * np.column_stack([along[:, 1], -along[:, 0]]))
    best = np.argmin(away, axis=0)
    return np.asarray(np.array(directions)[best, np.arange(len(points))])


def _area(loop: FloatArray) -> float:
    x, y = loop.T
    return float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum() / 2)
