"""Writing of G+Smo XML."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from xml.etree.ElementTree import Element, tostring

from ...errors import InputError, InputWarning
from ...geometry.blocks import Block
from ...geometry.boundary import Boundary
from ...geometry.curve import BSplineCurve
from ...geometry.interfaces import infer_interfaces
from ...geometry.multipatch import MultiPatch
from ...geometry.patch import Patch
from ...geometry.sides import Interface
from ...numeric.arrays import FloatArray
from ..safe_xml import parse_xml, quoted
from .outside import FORMAT, GEOMETRY, HEAD, ROOT, default_head
from .rows import NONE

__all__ = ["format_boundary", "format_multipatch"]


def _row(values: Iterable[object]) -> str:
    return " ".join(map(repr, values))


def _basis(knots: Sequence[FloatArray], degrees: Sequence[int], weights: FloatArray | None) -> list[str]:
    univariate = [
        ['<Basis type="BSplineBasis"%s>' % (f' index="{i}"' if len(knots) > 1 else ""),
         f' <KnotVector degree="{p}">{_row(k.tolist())}</KnotVector>', "</Basis>"]
        for i, (k, p) in enumerate(zip(knots, degrees, strict=True))
    ]  # fmt: skip
    lines = [line for basis in univariate for line in basis]
    if len(knots) == 2:
        lines = ['<Basis type="TensorBSplineBasis2">', *(" " + line for line in lines), "</Basis>"]
    if weights is None:
        return lines
    kind = "TensorNurbsBasis2" if len(knots) == 2 else "NurbsBasis"
    return [
        f'<Basis type="{kind}">',
        *(" " + line for line in lines),
        " <weights>",
        *(repr(w) for w in weights.T.ravel().tolist()),
        " </weights>",
        "</Basis>",
    ]


def _patch_type(patch: Patch) -> str:
    return "TensorBSpline2" if patch.weights is None else "TensorNurbs2"


def _geometry(item: Patch | BSplineCurve, attribute: str) -> list[str]:
    if isinstance(item, Patch):
        kind = _patch_type(item)
        basis = _basis(item.knots, item.degrees, item.weights)
        points = item.control_points.transpose(1, 0, 2).reshape(-1, 2)
    else:
        kind = "BSpline" if item.weights is None else "Nurbs"
        basis = _basis([item.knots], [item.degree], item.weights)
        points = item.control_points
    return [
        f'<Geometry type="{kind}" {attribute}>',
        *(" " + line for line in basis),
        ' <coefs geoDim="2">',
        *map(_row, points.tolist()),
        " </coefs>",
        "</Geometry>",
    ]


def _document(lines: Iterable[str], root: str = "<xml>") -> str:
    name = root[1:].split()[0].rstrip(">")
    return "\n".join(['<?xml version="1.0" encoding="UTF-8"?>', root, *lines, f"</{name}>", ""])


def format_multipatch(multipatch: MultiPatch) -> str:
    """G+Smo XML text of a multi-patch: all patches, the block that glues them, and what else its file held.

    An interface row's ``dirMap`` maps the direction across side 1 to the one across side 2; ``orient`` is 1
    across if the sides lie at different ends of their directions (parameters then increase through the
    interface), and along it if both sides run in the same sense. Patches are referred to by id.

    Raises
    ------
    InputError
        When a label or a block is not text that XML can hold.
    """
    blocks = [block for block in multipatch.blocks if block.format == FORMAT]
    heads = {block.kind: block.text for block in blocks if block.kind in (ROOT, HEAD)}
    own = _geometries(multipatch, blocks) + _glue(multipatch, heads.get(HEAD) or default_head(multipatch.ids, blocks))
    lines = [] if HEAD in heads else own
    for block in blocks:
        if block.kind == HEAD:
            lines = [*lines, *own]
        elif block.kind not in (ROOT, GEOMETRY):
            lines.append(block.text)
    text = _document(lines, heads.get(ROOT, "<xml>"))
    if blocks or multipatch.sides:
        _check(text, blocks)
    return text


def _check(text: str, blocks: Sequence[Block]) -> None:
    """Refuse labels and blocks, which may be anybody's, that would make a file nobody can read."""
    try:
        parse_xml(text.encode())
    except (InputError, UnicodeEncodeError) as error:
        kinds = ", ".join(dict.fromkeys(block.name for block in blocks)) or "labels"
        raise InputError(f"labels or blocks ({kinds}) cannot be written as XML: {error}") from None


def _geometries(mp: MultiPatch, blocks: Sequence[Block]) -> list[str]:
    extra = {block.id: parse_xml(block.text.encode()) for block in blocks if block.kind == GEOMETRY}
    lines = []
    for i, patch in zip(mp.ids, mp.patches, strict=True):
        element = extra.pop(i, None)
        geometry = _geometry(patch, f'id="{i}"')
        if element is not None:
            element.attrib |= {"type": _patch_type(patch), "id": str(i)}
            geometry = [_start(element), *geometry[1:-1], *map(_text, element), geometry[-1]]
        lines += geometry
    if extra:
        gone = ", ".join(f"Geometry id={i}" for i in extra)
        _warn(f"labels and data of {gone} are left out: there is no such patch any more")
    return lines


def _glue(mp: MultiPatch, head: str) -> list[str]:
    """The ``MultiPatch`` element with the attributes and other content of its head."""
    element, ids = parse_xml(head.encode()), mp.ids
    if list(ids) == list(range(ids[0], ids[0] + len(ids))):
        patches = f'<patches type="id_range">{ids[0]} {ids[-1]}</patches>'
    else:
        patches = f'<patches type="id_index">{" ".join(map(str, ids))}</patches>'
    lines = [_start(element), " " + patches, *_interfaces(mp, ids), *_boundaries(mp, ids)]
    return [*lines, *map(_text, element), "</MultiPatch>"]


def _start(element: Element) -> str:
    return tostring(Element(element.tag, element.attrib), "unicode", short_empty_elements=False).partition("</")[0]


def _text(element: Element) -> str:
    return tostring(element, encoding="unicode")


def _interfaces(mp: MultiPatch, ids: Sequence[int]) -> list[str]:
    """Interfaces, those between sides of one label under its name."""
    groups: dict[str | None, list[str]] = {None: []}
    for f in mp.interfaces:
        row, pair = _interface(f, ids), {(f.patch_a, f.side_a), (f.patch_b, f.side_b)}
        names = [name for name, sides in mp.sides.items() if pair <= set(sides)]
        for label in (*names,) if names else (None,):
            groups.setdefault(label, []).append(row)
        for name, sides in mp.sides.items():
            if len(pair.intersection(sides)) == 1 and len(pair) == 2:
                _warn(f"label {name!r} is left out on interface {f.name}: G+Smo XML names both sides of it or none")
    lines = [line for name, rows in groups.items() if rows for line in _element("interfaces", name, rows)]
    # All sides under <boundary> alone would say that nobody looked for interfaces.
    return lines or ([] if not infer_interfaces(mp.patches) else [f' <interfaces {NONE[0]}="{NONE[1]}"></interfaces>'])


def _boundaries(mp: MultiPatch, ids: Sequence[int]) -> list[str]:
    """Sides of the boundary label by label, and those without."""
    boundary, lines = dict.fromkeys(mp.boundaries), []
    for name, sides in mp.sides.items():
        outer = [side for side in sides if side in boundary]
        if outer or not sides:
            lines += _element("boundary", name, [f"{ids[k]} {int(s)}" for k, s in outer])
    named = {side for sides in mp.sides.values() for side in sides}
    rest = [f"{ids[k]} {int(s)}" for k, s in boundary if (k, s) not in named]
    return lines + (_element("boundary", None, rest) if rest else [])


def _element(tag: str, name: str | None, rows: Sequence[str]) -> list[str]:
    return [f" <{tag}>" if name is None else f" <{tag} name={quoted(name)}>", *rows, f" </{tag}>"]


def _warn(doubt: str) -> None:
    warnings.warn(doubt, InputWarning, stacklevel=2)


def _interface(f: Interface, ids: Sequence[int]) -> str:
    along, across = f.side_a.axis, 1 - f.side_a.axis
    direction, orient = [0, 0], [0, 0]
    direction[across], direction[along] = 1 - f.side_b.axis, f.side_b.axis
    orient[across], orient[along] = int(f.side_a.at_end != f.side_b.at_end), int(not f.reversed)
    return _row([ids[f.patch_a], int(f.side_a), ids[f.patch_b], int(f.side_b), *direction, *orient])


def format_boundary(boundary: Boundary) -> str:
    """G+Smo XML text of a boundary: a ``PlanarDomain`` with one ``CurveLoop`` a loop."""
    lines = ['<PlanarDomain id="0">']
    for k, loop in enumerate(boundary.loops):
        lines += [f' <CurveLoop index="{k}">']
        lines += [" " + line for i, curve in enumerate(loop) for line in _geometry(curve, f'index="{i}"')]
        lines += [" </CurveLoop>"]
    return _document([*lines, "</PlanarDomain>"])
