"""Rhino (``.3dm``): the planar curves of a model are the outline, as the NURBS that they are.

Lines, arcs, polylines and poly-curves have an exact NURBS form, which openNURBS gives. Objects that are no curves
(surfaces, text, block references ...) are left out with a note that counts them, hidden ones likewise.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections import Counter
from typing import Any

import numpy as np

from ..errors import InputError
from ..geometry.boundary import Boundary
from ..libraries import library
from ..limits import MAX_CURVES, at_most
from .damage import damaged
from .options import DEFAULT, BoundaryOptions
from .pieces import Piece, boundary_of, spline

__all__ = ["looks_like_rhino", "read_boundary"]

MAGIC = b"3D Geometry File Format"
#: Longest that an archive is read, which is far from what the largest takes: some damaged ones never end.
SECONDS = 20.0
#: Kinds and layers that a message lists.
LISTED = 8


def looks_like_rhino(data: bytes) -> bool:
    """Whether this is an archive of openNURBS."""
    return data.startswith(MAGIC)


def read_boundary(data: bytes, options: BoundaryOptions = DEFAULT) -> Boundary:
    """Boundary of a model; see `patchtransfer.read_boundary`."""
    model = _contents(data)
    layers = {layer["index"]: layer for layer in model["layers"]}
    shown = {index: _visible(layer, layers) for index, layer in layers.items()}
    chosen = None if options.layers is None else _chosen(options.layers, layers)
    pieces: list[tuple[str, Piece]] = []
    left: dict[str, Counter[str]] = {
        "for they draw no outline": Counter(),
        "for they or their layers are hidden": Counter(),
        "for their layers were not chosen": Counter(),
    }
    other, hidden, unchosen = left.values()
    for entry in model["objects"]:
        index = entry["layer"]
        layer = layers[index]["path"] if index in layers else "?"
        where = f"on layer {layer!r}"
        if chosen is not None and index not in chosen:
            unchosen[where] += 1
        elif chosen is None and not (entry["visible"] and shown.get(index, True)):
            hidden[where] += 1
        elif entry["curve"] is None:
            other[f"{entry['kind']} {where}"] += 1
        else:
            name = f"curve {entry['name']} {where}"
            with damaged(f"{name}: cannot read its geometry", "draw it again"):
                pieces.append((name, _piece(entry["curve"])))
            at_most(len(pieces), MAX_CURVES, "curves", "keep those of the domain")
    notes = [f"left out, {why}: {_listed(counts)}" for why, counts in left.items() if counts]
    if not pieces:
        raise InputError(f"holds no curves{''.join(f'; {note}' for note in notes)}; draw the outline with curves")
    return boundary_of(pieces, notes, options)


def _contents(data: bytes) -> dict[str, Any]:
    """Layers and objects, from a process that is ended if it takes too long."""
    library("rhino3dm", "cad")
    try:
        told = subprocess.run(
            [sys.executable, "-m", f"{__package__}.rhino_archive"], input=data, capture_output=True, timeout=SECONDS
        )
        found: dict[str, Any] | None = json.loads(told.stdout) if told.returncode == 0 else None
    except subprocess.TimeoutExpired:
        raise InputError(f"damaged 3dm file (not read after {SECONDS:g} s); save it again with Rhino") from None
    except (ValueError, OSError) as error:
        raise InputError(f"damaged 3dm file ({str(error)[:80]}); save it again with Rhino") from None
    if found is None:
        raise InputError("damaged 3dm file; save it again with Rhino")
    return found


def _visible(layer: dict[str, Any] | None, layers: dict[int, dict[str, Any]]) -> bool:
    """Whether a layer and all layers around it are visible."""
    by_id = {other["id"]: other for other in layers.values()}
    for _ in range(len(layers)):
        if layer is None or not layer["visible"]:
            break
        layer = by_id.get(layer["parent"])
    return layer is None


def _chosen(wanted: tuple[str, ...], layers: dict[int, dict[str, Any]]) -> set[int]:
    """Indices of layers by their names or paths, without regard to case."""
    found: set[int] = set()
    for name in wanted:
        named = {k for k, x in layers.items() if name.casefold() in (x["name"].casefold(), x["path"].casefold())}
        if not named:
            known = ", ".join(sorted(x["path"] for x in layers.values())[: 4 * LISTED])
            raise InputError(f"has no layer {name!r}; its layers are {known}")
        found |= named
    return found


def _listed(counts: Counter[str]) -> str:
    told = [f"{n} {what}" for what, n in counts.most_common(LISTED)]
    return ", ".join(told + (["..."] if len(counts) > LISTED else []))


def _piece(curve: dict[str, Any]) -> Piece:
    points, knots = np.array(curve["points"]), curve["knots"]
    weights = points[:, 3]
    # openNURBS leaves out the first and the last knot, which have no influence.
    with np.errstate(all="ignore"):
        return spline([knots[0], *knots, knots[-1]], curve["degree"], points[:, :3] / weights[:, None], weights)
