"""Boundaries of G+Smo XML: planar domains, loose curves, or the boundary of patches."""

from __future__ import annotations

from xml.etree.ElementTree import Element

from ...errors import InputError
from ...geometry.boundary import Boundary
from ...geometry.curve import BSplineCurve
from ...limits import MAX_LOOPS, at_most
from ..cleaning import cleaned, mended
from ..loops import TOLERANCE, chain, check_curves, close_loop, diameter, in_order
from ..options import DEFAULT, BoundaryOptions
from ..safe_xml import parse_xml
from .multipatch import domains, read_multipatch
from .splines import CURVE_TYPES, geometry_name, read_curves

__all__ = ["read_boundary"]


def read_boundary(data: bytes, options: BoundaryOptions = DEFAULT) -> Boundary:
    """Boundary of a G+Smo XML file; see `patchtransfer.read_boundary`."""
    root = parse_xml(data)
    found = domains(root)
    if len(found) > 1:
        raise InputError(f"holds {len(found)} planar domains; keep one")
    if found:
        loops = [list(loop.findall("Geometry")) for loop in found[0].findall("CurveLoop")]
        if not loops or not all(loops):
            raise InputError("PlanarDomain: no CurveLoop, or one without curves; the file is incomplete")
        return _domain(loops, options.clean)
    geometries = root.findall("Geometry")
    loose = [(geometry_name(g, k), g) for k, g in enumerate(geometries) if g.get("type") in CURVE_TYPES]
    if not loose:
        # Patches may meet only up to the last digits.
        return Boundary([close_loop(loop) for loop in read_multipatch(data).boundary().loops])
    if root.find("MultiPatch") is not None or len(loose) < len(geometries):
        raise InputError("holds both patches and loose curves; keep what is the boundary")
    names = [name for name, _ in loose]
    curves = read_curves(names, [g for _, g in loose])
    notes: list[str] = []
    if options.clean:
        names, curves = mended(names, curves, notes)
    chained = chain(names, curves, TOLERANCE * diameter(curves))
    return Boundary(cleaned(chained, notes) if options.clean else chained, notes)


def _domain(elements: list[list[Element]], clean: bool) -> Boundary:
    names = [[f"CurveLoop {k}, {geometry_name(g, i)}" for i, g in enumerate(loop)] for k, loop in enumerate(elements)]
    at_most(len(elements), MAX_LOOPS, "loops", "keep those of the domain")
    flat = iter(read_curves([n for loop in names for n in loop], [g for loop in elements for g in loop]))
    curves = [[next(flat) for _ in loop] for loop in elements]
    tolerance = TOLERANCE * diameter([c for loop in curves for c in loop])
    loops: list[list[BSplineCurve]] = []
    notes: list[str] = []
    for k, (who, loop) in enumerate(zip(names, curves, strict=True)):
        if clean:
            who, loop = mended(who, loop, notes)
        check_curves(who, loop, tolerance)
        if in_order(loop, tolerance):
            loops.append(close_loop(loop))
            continue
        chained = chain(who, loop, tolerance)
        if len(chained) > 1:
            raise InputError(f"CurveLoop {k}: its curves form {len(chained)} loops; put each into its own CurveLoop")
        loops += chained
    return Boundary(cleaned(loops, notes) if clean else loops, notes)
