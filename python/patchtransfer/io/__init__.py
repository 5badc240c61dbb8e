"""Stage 0, input and output: files to `MultiPatch` and `Boundary`, and back.

A format is one entry of `FORMATS` (`formats`); its functions take and return the contents of files, and raise
`InputError` without the path, which is added here.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from ..errors import InputError, InputWarning
from ..files import read_bytes, write_atomic
from ..geometry.boundary import Boundary
from ..geometry.multipatch import MultiPatch
from ..numeric.arrays import FloatArray
from .formats import FORMATS, BoundaryOptions, Format
from .outline_only import OutlineOnlyError

if TYPE_CHECKING:
    from .fields import SplineField
    from .layout_json import LayoutFile

__all__ = [
    "FORMATS",
    "Format",
    "OutlineOnlyError",
    "convert",
    "read",
    "read_boundary",
    "read_landmarks",
    "read_layout",
    "write",
    "write_landmarks",
]


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Put the path in front of the message of an `InputError`."""
    try:
        yield
    except InputError as error:
        # Of whatever kind it is: who calls may answer one of them.
        error.args = (f"{path}: {error}", *error.args[1:])
        raise


def _extensions(formats: list[Format]) -> str:
    return ", ".join(dict.fromkeys(extension for f in formats for extension in f.extensions))


def _format_of(path: Path, data: bytes) -> Format:
    """Format by content; the extension decides only where the content does not tell."""
    by_name = [f for f in FORMATS if path.suffix.lower() in f.extensions]
    # Those of the name first: others need not be loaded where one of them fits.
    likely = [*by_name, *(f for f in FORMATS if f not in by_name)]
    chosen = next((f for f in likely if f.matches(data)), by_name[0] if by_name else None)
    if chosen is None:
        raise InputError(f"unknown format; supported are {_extensions(list(FORMATS))}")
    return chosen


def read(path: str | os.PathLike[str]) -> MultiPatch:
    """Read a multi-patch.

    Parameters
    ----------
    path : path
        G+Smo XML, GeoPDEs text, an MFEM NURBS mesh, npz or splinepy's JSON, told apart by content. Of several
        ``MultiPatch`` blocks of a G+Smo file the first is read, as in G+Smo (with a warning); without any, all patches
        of the file. Interfaces that the file does not state are inferred.

    Returns
    -------
    MultiPatch

    Raises
    ------
    InputError
        When the file cannot be read, or holds no planar B-spline or NURBS patches (three-dimensional and
        hierarchical geometries are refused).

    Examples
    --------
    >>> import patchtransfer as pt
    >>> source, _, _ = pt.examples.load("star")
    >>> import tempfile
    >>> from pathlib import Path
    >>> folder = Path(tempfile.mkdtemp())
    >>> pt.write(source, folder / "source.xml")
    >>> pt.read(folder / "source.xml")
    <MultiPatch: 6 patches, 6 interfaces, 0 holes, 181 control points>
    """
    path = Path(path)
    with _naming(path):
        data = read_bytes(path)
        found = _format_of(path, data)
        return _patches(found, data)


def _patches(found: Format, data: bytes) -> MultiPatch:
    if found.read is not None:
        return found.read(data)
    if found.read_boundary is not None:
        raise OutlineOnlyError(f"a {found.name} file holds no patches")
    raise InputError(f"a {found.name} file holds no patches; {found.hint}")


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
        taken), SVG (every closed outline that is drawn is a loop, its pieces are joined; y is flipped, so that pictures
        are upright), DXF (what is drawn in model space), Rhino's 3dm (curves), GeoJSON (a polygon), an airfoil's
        points, an image (PNG, TIFF, BMP) of the region or CSV (lines ``x,y``, one closed outline per block, blocks
        separated by blank lines; polygons, or cubic splines between corners).
    clean : bool, default True
        Mend what is plainly a slip: slivers, spikes, repeated points, tiny gaps. Every change is one of the
        boundary's ``notes``.
    smooth : bool, optional
        Whether points are samples of smooth curves (True) or corners of a polygon (False); None (the default) decides
        by all turns together and tells in a note.
    layers : sequence of str, optional
        Layers of a drawing to read (of SVG: labels or ids of groups), or the name or number of a GeoJSON polygon; None
        (the default) takes all that are visible.

    Returns
    -------
    Boundary
        Consecutive curves share their end points to the bit.

    Raises
    ------
    InputError
        When the file cannot be read or its curves do not close up.

    Examples
    --------
    >>> import patchtransfer as pt
    >>> import tempfile
    >>> from pathlib import Path
    >>> folder = Path(tempfile.mkdtemp())
    >>> svg = '<svg xmlns="http://www.w3.org/2000/svg"><path d="M 0 0 H 3 V 2 H 0 Z"/></svg>'
    >>> _ = (folder / "plate.svg").write_text(svg)
    >>> outline = pt.read_boundary(folder / "plate.svg")
    >>> outline
    <Boundary: 1 loop of 4 curves>
    >>> round(outline.diameter, 3)
    3.606
    """
    path = Path(path)
    with _naming(path):
        data = read_bytes(path)
        found = _format_of(path, data)
        if found.read_boundary is None:
            raise InputError(f"a {found.name} file holds no boundary; {found.hint}")
        if layers is not None and not found.layers:
            raise InputError(f"a {found.name} file has no layers; leave out --layer (layers=)")
        return found.read_boundary(data, BoundaryOptions(clean, smooth, None if layers is None else tuple(layers)))


def read_landmarks(path: str | os.PathLike[str]) -> FloatArray:
    """Read landmarks: pairs of points that correspond on the source's and the target's boundary.

    Parameters
    ----------
    path : path
        CSV with the header ``xs,ys,xt,yt`` (columns in any order, others are ignored, as ``name`` of
        `write_landmarks`); ``#`` starts a comment.

    Returns
    -------
    (r, 4) array
        Source x and y, target x and y.

    Raises
    ------
    InputError
        When a column is missing, or an entry is not a finite number.

    Examples
    --------
    >>> import patchtransfer as pt
    >>> import tempfile
    >>> from pathlib import Path
    >>> folder = Path(tempfile.mkdtemp())
    >>> pt.write_landmarks([[0, 0, 1, 1], [2, 0, 3, 1]], folder / "pairs.csv")
    >>> pt.read_landmarks(folder / "pairs.csv").tolist()
    [[0.0, 0.0, 1.0, 1.0], [2.0, 0.0, 3.0, 1.0]]
    """
    path = Path(path)
    with _naming(path):
        from .points import read_landmarks as parsed

        return parsed(read_bytes(path))


def write_landmarks(landmarks: ArrayLike, path: str | os.PathLike[str], names: Sequence[str] | None = None) -> None:
    """Write landmarks as CSV, atomically; `read_landmarks` gives back the same bits.

    Parameters
    ----------
    landmarks : (r, 4) array, or sequence of pairs of points
        Rows (xs, ys, xt, yt) or ((xs, ys), (xt, yt)), as `transfer` takes them; ``result.registration.landmarks``, say.
    path : path
        An existing file is replaced.
    names : sequence of str, optional
        One a landmark, for a column ``name``.

    Raises
    ------
    InputError
        On another shape, NaN, names with commas, or when the file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_landmarks([((0, 0), (0.5, 0)), ((1, 0), (2, 0.25))], Path(folder, "l.csv"), ["heel", "toe"])
    ...     print(Path(folder, "l.csv").read_text(), end="")
    ...     print(read_landmarks(Path(folder, "l.csv"))[1])
    name,xs,ys,xt,yt
    heel,0.0,0.0,0.5,0.0
    toe,1.0,0.0,2.0,0.25
    [1.   0.   2.   0.25]
    """
    from ..registration.landmarks import read_landmark_rows
    from .points import landmarks_text

    path = Path(path)
    with _naming(path):
        write_atomic(path, landmarks_text(read_landmark_rows(landmarks), names))


def read_layout(
    path: str | os.PathLike[str],
    *,
    clean: bool = True,
    smooth: bool | None = None,
    layers: Sequence[str] | None = None,
) -> LayoutFile:
    """Read a quad layout (JSON) with the boundary file that it names.

    Fields: ``vertices`` [[x, y], ...], ``quads`` [[a, b, c, d], ...], ``boundary`` (a file, relative to the layout's
    folder), optionally ``degree`` (3), ``spans`` (2) and ``assignment`` {vertex: [x, y]}. `clean`, `smooth` and
    `layers` are those of `read_boundary`.

    Raises
    ------
    InputError
        Naming the file and what is wrong.
    """
    path = Path(path)
    with _naming(path):
        from .layout_json import parse_layout

        return parse_layout(
            read_bytes(path), path.parent, partial(read_boundary, clean=clean, smooth=smooth, layers=layers)
        )


def write(
    geometry: MultiPatch | Boundary,
    path: str | os.PathLike[str],
    *,
    fields: Mapping[str, SplineField] | None = None,
) -> None:
    """Write a multi-patch or a boundary, atomically.

    Numbers are written in full, so that reading gives back the same bits; but GeoPDEs' control points are multiplied by
    their weights, which rounds. What the format cannot hold is left out, with an `InputWarning`.

    Parameters
    ----------
    geometry : MultiPatch or Boundary
    path : path
        The extension names the format: ``.xml`` (G+Smo) and ``.npz`` (NumPy) for both, ``.txt`` (GeoPDEs), ``.mesh``
        (MFEM), ``.json`` (splinepy) and ``.vtu`` (ParaView) for multi-patches. An existing file is replaced.
    fields : mapping of names to fields or solutions, optional
        To ``.vtu`` only: fields of `patchtransfer.iga` on this model, exactly; degrees are raised and knots inserted
        until the model's space holds them. A displacement becomes a vector of three components, the last 0.

    Raises
    ------
    InputError
        On another extension, fields that are another model's, or when the folder does not exist or cannot be written
        to; no file is left behind.

    Examples
    --------
    >>> import tempfile
    >>> from patchtransfer import examples, iga
    >>> source, _, _ = examples.load("star")
    >>> solution = iga.poisson(source, f=1.0)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write(source, Path(folder, "u.vtu"), fields={"u": solution})
    ...     Path(folder, "u.vtu").read_text().count('Name="u"')
    1
    """
    path = Path(path)
    if fields:
        _write_fields(geometry, path, fields)
    else:
        _write(geometry, path)


def _write_fields(geometry: MultiPatch | Boundary, path: Path, fields: Mapping[str, SplineField]) -> None:
    from .fields import SplineField, in_one_space
    from .vtu import format_multipatch

    if not isinstance(geometry, MultiPatch) or path.suffix.lower() != ".vtu":
        raise InputError(f"{path}: fields are written beside a multi-patch, to .vtu; leave them out, or choose that")
    for name, field in fields.items():
        if not isinstance(field, SplineField):
            raise InputError(f"field {name!r}: expected a field or solution of iga, got {type(field).__name__}")
    with _naming(path):
        finer, coefficients = in_one_space(geometry, fields)
        write_atomic(path, format_multipatch(finer, coefficients))


def _write(geometry: MultiPatch | Boundary, path: Path) -> None:
    with _naming(path):
        content, lost = _written(geometry, path)
    write_atomic(path, content)
    for what in lost:
        warnings.warn(f"{path}: {what}", InputWarning, stacklevel=3)


def _written(geometry: MultiPatch | Boundary, path: Path) -> tuple[str | bytes, list[str]]:
    """Contents of a file, and what it lacks."""
    formats = [f for f in FORMATS if f.write or f.write_boundary]
    chosen = next((f for f in formats if path.suffix.lower() in f.extensions), None)
    if chosen is None:
        raise InputError(f"cannot write {path.suffix or 'a file without extension'}; use {_extensions(formats)}")
    if isinstance(geometry, MultiPatch):
        if chosen.write:
            from .losses import losses

            return chosen.write(geometry), losses(geometry, chosen)
    elif not isinstance(geometry, Boundary):
        raise InputError(f"cannot write a {type(geometry).__name__}; pass a MultiPatch or a Boundary")
    elif chosen.write_boundary:
        return chosen.write_boundary(geometry), []
    other = "Boundary" if isinstance(geometry, MultiPatch) else "MultiPatch"
    able = [f for f in FORMATS if (f.write if isinstance(geometry, MultiPatch) else f.write_boundary)]
    raise InputError(
        f"a {chosen.name} file is written of a {other}, not of a {type(geometry).__name__}; use {_extensions(able)}"
    )


def convert(path: str | os.PathLike[str], to: str | os.PathLike[str]) -> MultiPatch | Boundary:
    """Read a file and write it in another format.

    Parameters
    ----------
    path : path
        A multi-patch, or an outline where the file holds no patches; the format is told by the content.
    to : path
        The extension names the format, as for `write`: any for a multi-patch, ``.xml`` or ``.npz`` for an outline.

    Returns
    -------
    MultiPatch or Boundary
        What was written.

    Raises
    ------
    InputError
        When the file cannot be read or the other one cannot be written; nothing is written then.

    Warns
    -----
    InputWarning
        For everything that the other format cannot hold: labels, other blocks, ids, interfaces that cannot be inferred.

    Examples
    --------
    >>> import patchtransfer as pt
    >>> source, _, _ = pt.examples.load("star")
    >>> import tempfile
    >>> from pathlib import Path
    >>> folder = Path(tempfile.mkdtemp())
    >>> pt.write(source, folder / "star.xml")
    >>> _ = pt.convert(folder / "star.xml", folder / "star.npz")
    >>> pt.read(folder / "star.npz") == source
    True
    """
    path, to = Path(path), Path(to)
    geometry: MultiPatch | Boundary
    with _naming(path):
        data = read_bytes(path)
        found = _format_of(path, data)
        try:
            geometry = _patches(found, data)
        except OutlineOnlyError:
            if found.read_boundary is None:
                raise
            geometry = found.read_boundary(data, BoundaryOptions())
    _write(geometry, to)
    return geometry
