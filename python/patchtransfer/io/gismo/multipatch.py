"""The part of G+Smo XML that glues patches: which they are, interfaces, labels of sides."""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping, Sequence
from typing import NamedTuple
from xml.etree.ElementTree import Element

from ...errors import InputError, InputWarning
from ...geometry.conformity.coincidences import widest
from ...geometry.mending import conform_command
from ...geometry.multipatch import MultiPatch
from ...geometry.patch import Patch
from ...geometry.sides import Interface, Side
from ..outline_only import OutlineOnlyError
from ..safe_xml import parse_xml
from .numbers import integer, integers
from .outside import outside
from .rows import NONE, Reading, best, readings
from .splines import CURVE_TYPES, read_patches

__all__ = ["domains", "read_multipatch"]

#: Sides whose ends are within this part of the model's diameter were meant to meet: such a model can be mended.
NEAR = 0.05

Sides = list[tuple[int, Side]]


class _Glue(NamedTuple):
    """What a file says of sides: interfaces, all of them or None if it does not say, and labels."""

    interfaces: list[Interface] | None
    labels: dict[str, Sides]


def domains(root: Element) -> list[Element]:
    """The planar domains of a document."""
    return [root] if root.tag == "PlanarDomain" else list(root.iter("PlanarDomain"))


def read_multipatch(data: bytes) -> MultiPatch:
    """Multi-patch of a G+Smo XML file; see `patchtransfer.read`."""
    root = parse_xml(data)
    blocks = root.findall("MultiPatch")
    if not blocks:
        return _loose(root, data)
    block = blocks[0]
    dimension = block.get("parDim", "2").strip()
    if dimension != "2":
        raise InputError(f"MultiPatch: parDim {dimension} is not supported; only planar patches are")
    geometries = _by_id(root)
    ids = _patch_ids(block, len(geometries))
    for i in ids:
        if i not in geometries:
            raise InputError(f"MultiPatch: there is no Geometry with id {i}; correct <patches>")
    if len(blocks) > 1:
        _warn(f"the file holds {len(blocks)} MultiPatch blocks; the first is read, the others are kept as they are")
    chosen = [geometries[i] for i in ids]
    patches = read_patches(chosen)
    interfaces, labels = _glue(patches, ids, block)
    used = [element for _, element in chosen]
    return MultiPatch(patches, interfaces, ids, labels, outside(root, data, used, block, ids))


def _loose(root: Element, data: bytes) -> MultiPatch:
    """All patches of a file without a block that glues them."""
    geometries = list(enumerate(root.findall("Geometry")))
    chosen = [(k, g) for k, g in geometries if g.get("type") not in CURVE_TYPES]
    if not chosen:
        curves = geometries or domains(root)
        if curves:
            raise OutlineOnlyError("holds only curves")
        raise InputError("holds no Geometry")
    names = [g.get("id", "").strip() for _, g in chosen]
    usable = len(set(names)) == len(names) and all(re.fullmatch(r"-?[0-9]{1,17}", name) for name in names)
    patches = read_patches(chosen)
    ids = [int(name) for name in names] if usable else list(range(len(patches)))
    return MultiPatch(patches, None, ids, None, outside(root, data, [g for _, g in chosen], None, ids))


def _warn(doubt: str) -> None:
    warnings.warn(doubt, InputWarning, stacklevel=2)


def _by_id(root: Element) -> dict[int, tuple[int, Element]]:
    """Geometries and their positions in the file by their ids."""
    found: dict[int, tuple[int, Element]] = {}
    for k, g in enumerate(root.findall("Geometry")):
        if (text := g.get("id")) is not None and found.setdefault(integer(text, "MultiPatch"), (k, g)) != (k, g):
            raise InputError(f"two geometries have the id {text.strip()}; renumber one")
    return found


def _patch_ids(block: Element, available: int) -> list[int]:
    element = block.find("patches")
    if element is None:
        raise InputError("MultiPatch: <patches> is missing; the file is incomplete")
    kind, values = element.get("type", "").strip(), integers(element, "MultiPatch patches")
    if kind == "id_index":
        ids = values
    elif kind == "id_range" and len(values) == 2:
        # A range is bounded before it is expanded.
        if not 0 <= values[1] - values[0] < available:
            raise InputError(f"MultiPatch: patches {values[0]} to {values[1]}, but there are {available} geometries")
        ids = list(range(values[0], values[1] + 1))
    else:
        raise InputError("MultiPatch: <patches> must be an id_range of two ids or an id_index; correct it")
    if len(set(ids)) != len(ids) or not ids:
        raise InputError("MultiPatch: <patches> is empty or names a patch twice; correct it")
    return ids


def _glue(patches: list[Patch], ids: list[int], block: Element) -> _Glue:
    """Interfaces and labels of a block."""
    elements = block.findall("interfaces")
    tables = [integers(element, "MultiPatch interfaces") for element in elements]
    by_id = {i: k for k, i in enumerate(ids)}
    meanings: list[Mapping[int, int]] = [by_id, {k: k for k in range(len(ids))}]
    interfaces: list[Interface] | None = None
    labels: dict[str, Sides] = {}
    if any(tables):
        reading = best(patches, readings(patches, tables, meanings))
        interfaces = _fitting(patches, reading)
        meanings = [reading.meaning]
        for element, glued in zip(elements, reading.tables, strict=True):
            for f in glued:
                _add(labels, element, [(f.patch_a, f.side_a), (f.patch_b, f.side_b)])
    listed = [_boundary_rows(element, meanings) for element in block.findall("boundary")]
    for element, rows in zip(block.findall("boundary"), listed, strict=True):
        _add(labels, element, rows)
    if interfaces is None and len({side for rows in listed for side in rows}) == 4 * len(patches):
        interfaces = [] if any(element.get(NONE[0]) == NONE[1] for element in elements) else _untold(patches)
    return _Glue(interfaces, labels)


def _untold(patches: list[Patch]) -> list[Interface]:
    """Interfaces of a block that lists all sides as boundary: in most such files nobody looked for interfaces."""
    found = list(MultiPatch(patches).interfaces)
    if found:
        _warn(
            f"MultiPatch: all sides are listed as boundary, as if nobody had looked for interfaces; found where sides "
            f'coincide: {len(found)} (<interfaces rows="0"/> keeps them apart)'
        )
    return found


def _add(labels: dict[str, Sides], element: Element, sides: Sides) -> None:
    """Put sides under an element's name, if it has one, each once."""
    name = element.get("name", "")
    if name.strip():
        labels[name] = list(dict.fromkeys([*labels.get(name, ()), *sides]))


def _boundary_rows(element: Element, meanings: Sequence[Mapping[int, int]]) -> Sides:
    """Sides of a <boundary>; rows that say nothing are an error only if they have a name, that would lose them."""
    name = element.get("name", "").strip()
    values = integers(element, "MultiPatch boundary")
    patches, sides = values[::2], values[1::2]
    meaning = next((m for m in meanings if set(patches) <= m.keys()), None)
    good = meaning is not None and len(values) % 2 == 0 and set(sides) <= set(Side)
    if meaning is not None and good:
        return [(meaning[k], Side(s)) for k, s in zip(patches, sides, strict=True)]
    if name:
        what = "a patch that does not exist" if meaning is None else "rows that are not a patch and a side of 1 to 4"
        raise InputError(f"MultiPatch boundary {name!r}: {what}; correct it")
    return []


def _fitting(patches: list[Patch], reading: Reading) -> list[Interface]:
    """The interfaces that fit. Those that nearly do are left apart, with a warning, so that the model can be mended."""
    found = reading.misfits
    if found:
        near = NEAR * MultiPatch(patches, ()).diameter
        for misfit in found:
            if misfit.kind == "names" or misfit.gap > near:
                raise InputError(f"{misfit.reason}; {misfit.advice}")
        apart = {misfit.number for misfit in found}
        kept = [f for i, f in enumerate(reading.interfaces) if i not in apart]
        gap = max(widest(patches, kept), *(misfit.gap for misfit in found if misfit.kind == "gap"), 0.0)
        more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
        _warn(f"{found[0].reason}{more}: left apart; `{conform_command(gap)}` mends it")
        return kept
    return reading.interfaces
