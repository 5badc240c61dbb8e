"""VTK unstructured grids (.vtu) of exact Bézier quadrilaterals, and series of them (.pvd), for ParaView.

Every knot span of a patch is one cell of type VTK_BEZIER_QUADRILATERAL (77) on its own points, which are its Bézier
control points: nothing is sampled. NURBS carry ``RationalWeights``, all cells ``HigherOrderDegrees``. Point data are
Bézier coefficients as well. Left-handed patches have u and v exchanged, so that all cells run counter-clockwise.
"""

from __future__ import annotations

import base64
import os
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._core import bezier_extract
from ..errors import InputError
from ..files import write_atomic
from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch
from ..geometry.sides import Side
from ..measure.quality import sample
from ..numeric.arrays import FloatArray
from ..numeric.dense import least_squares, product
from .safe_xml import quoted

__all__ = ["bezier_pieces", "format_multipatch", "format_series", "write_fields"]

BEZIER_QUADRILATERAL = 77
TYPES = {"f": "Float64", "i": "Int64", "u": "UInt8"}


def format_multipatch(mp: MultiPatch, fields: Mapping[str, Sequence[ArrayLike]] | None = None) -> str:
    """Contents of a .vtu file.

    Parameters
    ----------
    mp : MultiPatch
    fields : mapping of name to sequence of arrays, optional
        Splines on the patches' own knots and degrees, one array of coefficients (n_u, n_v) or (n_u, n_v, d) a patch;
        they are written exactly (on a rational patch as rational functions with its weights). Default none.

    Returns
    -------
    str
        With the point data "scaled_jacobian" (of every span the polynomial of the patch's degrees through uniform
        samples; 0 where it is not defined), "label <name>" for every label (1 on its sides, 0 elsewhere), and the cell
        data "patch" (the ids of the file read).
    """
    given = {name: _coefficients(mp, name, arrays) for name, arrays in (fields or {}).items()}
    if "scaled_jacobian" in given:
        raise InputError('a field cannot be called "scaled_jacobian": that is written already')
    scaled = _scaled_jacobians(mp)
    labels = {f"label {name}": set(sides) for name, sides in mp.sides.items()}
    if clash := [name for name in labels if name in given]:
        raise InputError(f"a field cannot be called {clash[0]!r}: that is the array of a label")
    marks: dict[str, list[NDArray[np.uint8]]] = {name: [] for name in labels}
    points: list[FloatArray] = []
    weights: list[FloatArray] = []
    data: dict[str, list[FloatArray]] = {name: [] for name in ("scaled_jacobian", *given)}
    degrees: list[tuple[int, int]] = []
    owner: list[int] = []
    for k, patch in enumerate(mp.patches):
        swap = bool(mp.topology.orientation[k] < 0)
        order = _node_order(*patch.degrees, swap)
        columns = [given[name][k] for name in given]
        pieces = bezier_pieces(patch, np.concatenate([patch.control_points, *columns], axis=2))
        flat = pieces.reshape(-1, order.size, pieces.shape[-1])[:, order].reshape(-1, pieces.shape[-1])
        w, values = flat[:, -1], flat[:, :-1] / flat[:, -1:]
        points.append(values[:, :2])
        weights.append(w)
        start = 2
        for name in given:
            width = given[name][k].shape[2]
            data[name].append(values[:, start : start + width])
            start += width
        jacobians = _as_coefficients(scaled[k], patch, pieces[..., -1])
        data["scaled_jacobian"].append(jacobians.reshape(-1, order.size)[:, order].reshape(-1, 1))
        for name, named in labels.items():
            on = _on_sides(pieces.shape[:4], [side for j, side in named if j == k])
            marks[name].append(on.reshape(-1, order.size)[:, order].ravel())
        m = len(flat) // order.size
        degrees += [patch.degrees[::-1] if swap else patch.degrees] * m
        owner += [mp.ids[k]] * m
    return _document(
        np.concatenate(points),
        np.concatenate(weights) if mp.is_rational else None,
        np.array(degrees, np.int64),
        np.array(owner, np.int64),
        {name: np.concatenate(parts) for name, parts in (data | marks).items()},
    )


def write_fields(
    mp: MultiPatch, path: str | os.PathLike[str], fields: Mapping[str, Sequence[ArrayLike]] | None = None
) -> None:
    """Write a multi-patch with spline fields on it as .vtu, atomically; parameters as of `format_multipatch`."""
    path = Path(path)
    if path.suffix.lower() != ".vtu":
        raise InputError(f"{path}: cannot write {path.suffix or 'a file without extension'}; use .vtu")
    write_atomic(path, format_multipatch(mp, fields))


def format_series(files: Sequence[str], times: Sequence[float] | None = None) -> str:
    """Contents of a .pvd file that names .vtu files (relative to it) and their times, by default 0 to 1."""
    when = np.linspace(0, 1, len(files)).tolist() if times is None else times
    rows = "".join(
        f'    <DataSet timestep="{float(t)!r}" group="" part="0" file={quoted(name)}/>\n'
        for t, name in zip(when, files, strict=True)
    )
    return (
        '<?xml version="1.0"?>\n<VTKFile type="Collection" version="1.0" byte_order="LittleEndian">\n'
        f"  <Collection>\n{rows}  </Collection>\n</VTKFile>\n"
    )


def bezier_pieces(patch: Patch, coefficients: FloatArray) -> FloatArray:
    """Homogeneous Bézier coefficients (m_u, m_v, p + 1, q + 1, d + 1) of (n_u, n_v, d) ones, the weight last."""
    w = np.ones(patch.shape) if patch.weights is None else patch.weights
    h = np.concatenate([coefficients * w[..., None], w[..., None]], axis=2)
    along_u, along_v = (_extraction(k.tobytes(), p) for k, p in zip(patch.knots, patch.degrees, strict=True))
    (m, a, n_u), (n, b, n_v) = along_u.shape, along_v.shape
    rows = product(along_u.reshape(-1, n_u), h.reshape(n_u, -1)).reshape(m * a, n_v, -1)
    return product(along_v.reshape(-1, n_v), rows).reshape(m, a, n, b, -1).transpose(0, 2, 1, 3, 4)


@lru_cache(maxsize=64)
def _extraction(knot_bytes: bytes, degree: int) -> FloatArray:
    """Bézier coefficients (spans, degree + 1, n) of every basis function."""
    knots = np.frombuffer(knot_bytes)
    n = len(knots) - degree - 1
    # The core takes three coordinates at a time.
    units = np.eye(n, 3 * -(-n // 3))
    columns = [bezier_extract(knots, degree, units[:, k : k + 3].copy()) for k in range(0, n, 3)]
    return np.asarray(np.concatenate(columns, axis=2)[:, :, :n])


def _on_sides(shape: tuple[int, ...], sides: Sequence[Side]) -> NDArray[np.uint8]:
    """Ones at the Bézier points (m_u, m_v, p + 1, q + 1) on some sides of a patch."""
    on = np.zeros(shape, np.uint8)
    for side in sides:
        cells, rows = (-1, -1) if side.at_end else (0, 0)
        if side.axis == 1:
            on[cells, :, rows, :] = 1
        else:
            on[:, cells, :, rows] = 1
    return on


def _coefficients(mp: MultiPatch, name: str, arrays: Sequence[ArrayLike]) -> list[FloatArray]:
    given = [np.asarray(a, float) for a in arrays]
    if len(given) != len(mp.patches):
        raise InputError(f"field {name!r}: expected {len(mp.patches)} arrays, one a patch, got {len(given)}")
    out = []
    for k, (patch, values) in enumerate(zip(mp.patches, given, strict=True)):
        if values.shape[:2] != patch.shape or values.ndim > 3 or not np.isfinite(values).all():
            raise InputError(
                f"field {name!r}, patch {k}: expected finite coefficients of shape {patch.shape} or "
                f"{(*patch.shape, 'd')}, got {values.shape}"
            )
        out.append(values.reshape(*patch.shape, -1))
    if len({values.shape[2] for values in out}) != 1:
        raise InputError(f"field {name!r}: all patches need as many components")
    return out


def _scaled_jacobians(mp: MultiPatch) -> list[FloatArray]:
    """Samples (m_u, m_v, s, s) of every patch at uniform parameters of every span, s its higher degree + 1."""
    out: list[FloatArray] = [np.empty(0)] * len(mp.patches)
    sizes = [max(patch.degrees) + 1 for patch in mp.patches]
    for s in set(sizes):
        for k, (_, scaled) in enumerate(sample(mp, s)):
            if sizes[k] == s:
                m_u, m_v = scaled.shape[0] // s, scaled.shape[1] // s
                out[k] = np.nan_to_num(scaled.reshape(m_u, s, m_v, s).transpose(0, 2, 1, 3))
    return out


def _as_coefficients(samples: FloatArray, patch: Patch, weights: FloatArray) -> FloatArray:
    """Bézier coefficients (m_u, m_v, p + 1, q + 1) through samples; rational ones with the given weights."""
    t = np.linspace(0, 1, samples.shape[2])
    along_u, along_v = (_bernstein(degree, t) for degree in patch.degrees)
    denominator = np.einsum("ai,bj,mnij->mnab", along_u, along_v, weights)
    inverse_u, inverse_v = (least_squares(x, np.eye(len(t)), 1e-15) for x in (along_u, along_v))
    return np.asarray(np.einsum("ia,jb,mnab->mnij", inverse_u, inverse_v, samples * denominator) / weights)


def _bernstein(degree: int, t: FloatArray) -> FloatArray:
    from scipy.special import comb

    k = np.arange(degree + 1)
    return np.asarray(comb(degree, k) * t[:, None] ** k * (1 - t[:, None]) ** (degree - k))


def _node_order(p: int, q: int, swap: bool) -> NDArray[np.int64]:
    """VTK's order of the points (i, j): corners, then the edges south, east, north, west, then rows of the inside."""
    if swap:
        p, q = q, p
    nodes = [(0, 0), (p, 0), (p, q), (0, q)]
    nodes += [(i, 0) for i in range(1, p)] + [(p, j) for j in range(1, q)]
    nodes += [(i, q) for i in range(1, p)] + [(0, j) for j in range(1, q)]
    nodes += [(i, j) for j in range(1, q) for i in range(1, p)]
    # Position in the patch's own array, whose second index runs fastest.
    return np.array([j * (p + 1) + i if swap else i * (q + 1) + j for i, j in nodes], np.int64)


def _document(
    points: FloatArray,
    weights: FloatArray | None,
    degrees: NDArray[np.int64],
    owner: NDArray[np.int64],
    data: Mapping[str, NDArray[np.generic]],
) -> str:
    count = (degrees + 1).prod(axis=1)
    m, n = len(degrees), len(points)
    space = np.column_stack([points, np.zeros(n)])
    cells = [
        _array("connectivity", np.arange(n, dtype=np.int64)),
        _array("offsets", np.cumsum(count)),
        _array("types", np.full(m, BEZIER_QUADRILATERAL, np.uint8)),
    ]
    point_data = [_array(name, values) for name, values in data.items()]
    rational = ""
    if weights is not None:
        point_data.append(_array("RationalWeights", weights))
        rational = ' RationalWeights="RationalWeights"'
    cell_data = [
        _array("HigherOrderDegrees", np.column_stack([degrees, np.zeros(m, np.int64)]).astype(float)),
        _array("patch", owner),
    ]
    blocks = [
        ("PointData", f'{rational} Scalars="scaled_jacobian"', point_data),
        ("CellData", ' HigherOrderDegrees="HigherOrderDegrees"', cell_data),
        ("Points", "", [_array("Points", space)]),
        ("Cells", "", cells),
    ]
    body = "".join(
        f"      <{tag}{attributes}>\n{''.join(arrays)}      </{tag}>\n" for tag, attributes, arrays in blocks
    )
    return (
        '<?xml version="1.0"?>\n'
        '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" header_type="UInt64">\n'
        f'  <UnstructuredGrid>\n    <Piece NumberOfPoints="{n}" NumberOfCells="{m}">\n'
        f"{body}    </Piece>\n  </UnstructuredGrid>\n</VTKFile>\n"
    )


def _array(name: str, values: NDArray[np.generic]) -> str:
    """A DataArray in base64, which keeps every bit."""
    little = np.ascontiguousarray(values, values.dtype.newbyteorder("<"))
    payload = np.array([little.nbytes], "<u8").tobytes() + little.tobytes()
    width = "" if values.ndim == 1 else f' NumberOfComponents="{values.shape[1]}"'
    text = base64.b64encode(payload).decode("ascii")
    kind = TYPES[values.dtype.kind]
    return f'        <DataArray type="{kind}" Name={quoted(name)}{width} format="binary">{text}</DataArray>\n'
