"""Stage 0, input and output: files to `MultiPatch` and `Boundary`, and back.

=========  ==========  =======================================  ==============================
format     extensions  holds                                    reads / writes
=========  ==========  =======================================  ==============================
G+Smo XML  .xml        patches, boundary curves                 multi-patch, boundary / both
CSV        .csv, .txt  points of closed outlines, landmarks     boundary, landmarks / –
SVG        .svg        closed paths and shapes                  boundary / –
VTU        .vtu        Bézier quadrilaterals                    – / multi-patch
=========  ==========  =======================================  ==============================

A format is one entry of `FORMATS` (`formats`); its functions take and return the contents of files, and raise
`InputError` without the path, which is added here.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from ..errors import InputError, InputWarning
from ..files import read_bytes, write_atomic
from ..geometry.boundary import Boundary
from ..geometry.multipatch import MultiPatch
from ..numeric.arrays import FloatArray
from . import points
from .formats import FORMATS, BoundaryOptions, Format
from .layout_json import LayoutFile, parse_layout

__all__ = ["FORMATS", "Format", "read", "read_boundary", "read_landmarks", "read_layout", "write"]


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Put the path in front of the message of an `InputError`."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _extensions(formats: list[Format]) -> str:
    return ", ".join(extension for f in formats for extension in f.extensions)


def _format_of(path: Path, data: bytes) -> Format:
    """Format by content; the extension decides only where the content does not tell."""
    by_content = [f for f in FORMATS if f.matches(data)]
    by_name = [f for f in FORMATS if path.suffix.lower() in f.extensions]
    both = [f for f in by_content if f in by_name]
    chosen = both or by_content or by_name
    if not chosen:
        raise InputError(f"unknown format; supported are {_extensions(list(FORMATS))}")
    return chosen[0]


def read(path: str | os.PathLike[str]) -> MultiPatch:
    """Read a multi-patch.

    Parameters
    ----------
    path : path
        A G+Smo XML file. Of several ``MultiPatch`` blocks the first is read, as in G+Smo (with a warning);
        without any, all patches of the file. Interfaces that the file does not state are inferred.

    Returns
    -------
    MultiPatch

    Raises
    ------
    InputError
        When the file cannot be read, or holds no planar B-spline or NURBS patches (three-dimensional and
        hierarchical geometries are refused).
    """
    path = Path(path)
    with _naming(path):
        data = read_bytes(path)
        found = _format_of(path, data)
        if found.read is None:
            able = _extensions([f for f in FORMATS if f.read])
            raise InputError(
                f"a {found.name} file holds no patches; use read_boundary, and parameterize for patches, "
                f"or a file of type {able}"
            )
        return found.read(data)


def read_boundary(
    path: str | os.PathLike[str],
    *,
    clean: bool = True,
    smooth: bool | None = None,
    layers: Sequence[str] | None = None,
) -> Boundary:
    """Read the boundary curves of a domain.

    Parameters
    ----------
    path : path
        G+Smo XML (a ``PlanarDomain``, loose curves in any order and sense, or patches, whose boundary is
        taken), SVG (every closed path is a loop; y is flipped, so that pictures are upright) or CSV (lines
        ``x,y``, one closed outline per block, blocks separated by blank lines; interpolated by cubic
        splines between corners).
    clean : bool, default True
        Mend what is plainly a slip: slivers, repeated points, tiny gaps. Every change is one of the boundary's
        ``notes``.
    smooth : bool, optional
        Whether points are samples of smooth curves (True) or corners of a polygon (False); None (the default) decides
        by all turns together and tells in a note.
    layers : sequence of str, optional
        Layers of a drawing to read; None (the default) takes all that are visible.

    Returns
    -------
    Boundary
        Consecutive curves share their end points to the bit.

    Raises
    ------
    InputError
        When the file cannot be read or its curves do not close up.
    """
    path = Path(path)
    with _naming(path):
        data = read_bytes(path)
        found = _format_of(path, data)
        if found.read_boundary is None:
            raise InputError(f"a {found.name} file holds no boundary")
        return found.read_boundary(data, BoundaryOptions(clean, smooth, None if layers is None else tuple(layers)))


def read_landmarks(path: str | os.PathLike[str]) -> FloatArray:
    """Read landmarks: pairs of points that correspond on the source's and the target's boundary.

    Parameters
    ----------
    path : path
        CSV with the header ``xs,ys,xt,yt`` (columns in any order, others are ignored); ``#`` starts a
        comment.

    Returns
    -------
    (r, 4) array
        Source x and y, target x and y.

    Raises
    ------
    InputError
        When a column is missing, or an entry is not a finite number.
    """
    path = Path(path)
    with _naming(path):
        return points.read_landmarks(read_bytes(path))


def read_layout(path: str | os.PathLike[str]) -> LayoutFile:
    """Read a quad layout (JSON) with the boundary file that it names.

    Fields: ``vertices`` [[x, y], ...], ``quads`` [[a, b, c, d], ...], ``boundary`` (a file, relative to the layout's
    folder), optionally ``degree`` (3), ``spans`` (2) and ``assignment`` {vertex: [x, y]}.

    Raises
    ------
    InputError
        Naming the file and what is wrong.
    """
    path = Path(path)
    with _naming(path):
        return parse_layout(read_bytes(path), path.parent, read_boundary)


def _warn_of_lost(model: MultiPatch, format_: str) -> None:
    """Name the blocks of other formats; comments and heads of elements are not worth a word."""
    lost = [b for b in model.blocks if b.format != format_ and b.kind != "comment" and not b.kind.endswith("head")]
    if lost:
        names = ", ".join(dict.fromkeys(b.name for b in lost))
        doubt = f"{names} of {lost[0].format} cannot be kept in {format_}, and are left out"
        warnings.warn(doubt, InputWarning, stacklevel=3)


def write(geometry: MultiPatch | Boundary, path: str | os.PathLike[str]) -> None:
    """Write a multi-patch or a boundary as G+Smo XML, or a multi-patch as VTU (for ParaView), atomically.

    Numbers are written in full, so that reading gives back the same bits.

    Parameters
    ----------
    geometry : MultiPatch or Boundary
    path : path
        Must end in ``.xml`` or ``.vtu``; an existing file is replaced.

    Raises
    ------
    InputError
        On another extension, or when the folder does not exist or cannot be written to; no file is left
        behind.
    """
    path = Path(path)
    with _naming(path):
        formats = [f for f in FORMATS if f.write or f.write_boundary]
        chosen = next((f for f in formats if path.suffix.lower() in f.extensions), None)
        if chosen is None:
            raise InputError(f"cannot write {path.suffix or 'a file without extension'}; use {_extensions(formats)}")
        if isinstance(geometry, MultiPatch) and chosen.write:
            _warn_of_lost(geometry, chosen.name)
            text = chosen.write(geometry)
        elif isinstance(geometry, Boundary) and chosen.write_boundary:
            text = chosen.write_boundary(geometry)
        else:
            raise InputError(f"cannot write a {type(geometry).__name__}; pass a MultiPatch or a Boundary")
    write_atomic(path, text)
