"""The file formats: how each is recognised and what it can hold. A new one is a module and an entry here."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

from ..geometry.boundary import Boundary
from ..geometry.multipatch import MultiPatch
from . import (
    airfoil,
    dxf,
    geojson,
    geopdes,
    gismo,
    layout_json,
    mask,
    mfem,
    npz,
    points,
    rhino,
    splinepy_json,
    svg,
    vtu,
)
from .options import BoundaryOptions

__all__ = ["FORMATS", "BoundaryOptions", "Format"]

#: What a model has besides polynomial patches.
MODEL = frozenset({"weights", "interfaces", "ids", "labels"})


@dataclass(frozen=True)
class Format:
    """A file format: how to recognise it and what it can hold; None where it cannot.

    `holds` says what a model keeps when it is written: of "weights", "interfaces", "ids", "labels", "blocks" (those of
    this format) and "all blocks". `hint` says what to do with a file that holds neither patches nor a boundary, and
    `layers` whether a boundary's layers can be chosen.
    """

    name: str
    extensions: tuple[str, ...]
    matches: Callable[[bytes], bool]
    read: Callable[[bytes], MultiPatch] | None = None
    read_boundary: Callable[[bytes, BoundaryOptions], Boundary] | None = None
    write: Callable[[MultiPatch], str | bytes] | None = None
    write_boundary: Callable[[Boundary], str | bytes] | None = None
    holds: frozenset[str] = frozenset()
    hint: str = ""
    layers: bool = False


def _first_tag(data: bytes) -> bytes:
    """Name of the root element without its namespace prefix, empty if the data is not XML."""
    if not data.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<"):
        return b""
    without_comments = re.sub(rb"<!--.*?(-->|$)", b"", data[:65536], flags=re.DOTALL)
    found = re.search(rb"<(?:[\w.-]+:)?([A-Za-z_][\w.-]*)", without_comments)
    return found[1] if found else b"?"


FORMATS = (
    Format(
        "G+Smo XML",
        (".xml",),
        lambda data: _first_tag(data) not in (b"", b"svg", b"VTKFile"),
        gismo.read_multipatch,
        gismo.read_boundary,
        gismo.format_multipatch,
        gismo.format_boundary,
        MODEL | {"blocks"},
    ),
    Format(
        "NumPy npz",
        (".npz",),
        npz.looks_like_npz,
        npz.read_multipatch,
        npz.read_boundary,
        npz.format_multipatch,
        npz.format_boundary,
        MODEL | {"all blocks"},
    ),
    Format(
        splinepy_json.FORMAT,
        (".json",),
        splinepy_json.looks_like_splines,
        splinepy_json.read_multipatch,
        splinepy_json.read_boundary,
        splinepy_json.format_multipatch,
        holds=frozenset({"weights", "blocks"}),
    ),
    Format(
        "layout JSON",
        (".json",),
        layout_json.looks_like_a_layout,
        hint="the command build makes patches of it",
    ),
    Format("SVG", (".svg",), lambda data: _first_tag(data) == b"svg", read_boundary=svg.read_boundary, layers=True),
    Format("DXF", (".dxf",), dxf.looks_like_dxf, read_boundary=dxf.read_boundary, layers=True),
    Format("Rhino 3dm", (".3dm",), rhino.looks_like_rhino, read_boundary=rhino.read_boundary, layers=True),
    Format(
        "GeoJSON", (".geojson", ".json"), geojson.looks_like_geojson, read_boundary=geojson.read_boundary, layers=True
    ),
    Format(
        "PNG, TIFF or BMP", (".png", ".tif", ".tiff", ".bmp"), mask.looks_like_image, read_boundary=mask.read_boundary
    ),
    Format("airfoil (.dat)", (".dat",), airfoil.looks_like_airfoil, read_boundary=airfoil.read_boundary),
    Format(
        "CSV",
        (".csv", ".txt"),
        lambda data: points.looks_like_points(data) and not geopdes.looks_like_geopdes(data),
        read_boundary=points.read_boundary,
    ),
    Format(
        "GeoPDEs",
        (".txt",),
        geopdes.looks_like_geopdes,
        geopdes.read_multipatch,
        geopdes.read_boundary,
        geopdes.format_multipatch,
        holds=MODEL - {"ids"} | {"blocks"},
    ),
    Format(
        "MFEM NURBS mesh",
        (".mesh",),
        mfem.looks_like_mfem,
        mfem.read_multipatch,
        mfem.read_boundary,
        mfem.format_multipatch,
        holds=MODEL - {"ids"} | {"blocks"},
    ),
    Format(
        "VTU",
        (".vtu",),
        lambda data: _first_tag(data) == b"VTKFile",
        write=vtu.format_multipatch,
        holds=MODEL,
        hint="it is written for ParaView, and not read",
    ),
)
