"""The file formats: how each is recognised and what it can hold. A new one is a module and an entry here.

A format's module is loaded when a file asks for it: all of them take longer than to read a model.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from ..geometry.boundary import Boundary
from ..geometry.multipatch import MultiPatch
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


def _late(module: str, name: str) -> Callable[..., Any]:
    """The function `name` of a format's module, which is loaded by the first call."""

    def called(*given: object) -> Any:
        return getattr(import_module(f".{module}", __package__), name)(*given)

    return called


def _points_of_no_model(data: bytes) -> bool:
    from . import geopdes, points

    return points.looks_like_points(data) and not geopdes.looks_like_geopdes(data)


FORMATS = (
    Format(
        "G+Smo XML",
        (".xml",),
        lambda data: _first_tag(data) not in (b"", b"svg", b"VTKFile"),
        _late("gismo", "read_multipatch"),
        _late("gismo", "read_boundary"),
        _late("gismo", "format_multipatch"),
        _late("gismo", "format_boundary"),
        MODEL | {"blocks"},
    ),
    Format(
        "NumPy npz",
        (".npz",),
        _late("npz", "looks_like_npz"),
        _late("npz", "read_multipatch"),
        _late("npz", "read_boundary"),
        _late("npz", "format_multipatch"),
        _late("npz", "format_boundary"),
        MODEL | {"all blocks"},
    ),
    Format(
        "splinepy JSON",
        (".json",),
        _late("splinepy_json", "looks_like_splines"),
        _late("splinepy_json", "read_multipatch"),
        _late("splinepy_json", "read_boundary"),
        _late("splinepy_json", "format_multipatch"),
        holds=frozenset({"weights", "blocks"}),
    ),
    Format(
        "layout JSON",
        (".json",),
        _late("layout_json", "looks_like_a_layout"),
        hint="the command build makes patches of it",
    ),
    Format(
        "SVG",
        (".svg",),
        lambda data: _first_tag(data) == b"svg",
        read_boundary=_late("svg", "read_boundary"),
        layers=True,
    ),
    Format("DXF", (".dxf",), _late("dxf", "looks_like_dxf"), read_boundary=_late("dxf", "read_boundary"), layers=True),
    Format(
        "Rhino 3dm",
        (".3dm",),
        _late("rhino", "looks_like_rhino"),
        read_boundary=_late("rhino", "read_boundary"),
        layers=True,
    ),
    Format(
        "GeoJSON",
        (".geojson", ".json"),
        _late("geojson", "looks_like_geojson"),
        read_boundary=_late("geojson", "read_boundary"),
        layers=True,
    ),
    Format(
        "PNG, TIFF or BMP",
        (".png", ".tif", ".tiff", ".bmp"),
        _late("mask", "looks_like_image"),
        read_boundary=_late("mask", "read_boundary"),
    ),
    Format(
        "airfoil (.dat)",
        (".dat",),
        _late("airfoil", "looks_like_airfoil"),
        read_boundary=_late("airfoil", "read_boundary"),
    ),
    Format(
        "CSV",
        (".csv", ".txt"),
        _points_of_no_model,
        read_boundary=_late("points", "read_boundary"),
    ),
    Format(
        "GeoPDEs",
        (".txt",),
        _late("geopdes", "looks_like_geopdes"),
        _late("geopdes", "read_multipatch"),
        _late("geopdes", "read_boundary"),
        _late("geopdes", "format_multipatch"),
        holds=MODEL - {"ids"} | {"blocks"},
    ),
    Format(
        "MFEM NURBS mesh",
        (".mesh",),
        _late("mfem", "looks_like_mfem"),
        _late("mfem", "read_multipatch"),
        _late("mfem", "read_boundary"),
        _late("mfem", "format_multipatch"),
        holds=MODEL - {"ids"} | {"blocks"},
    ),
    Format(
        "VTU",
        (".vtu",),
        lambda data: _first_tag(data) == b"VTKFile",
        write=_late("vtu", "format_multipatch"),
        holds=MODEL,
        hint="it is written for ParaView, and not read",
    ),
)
