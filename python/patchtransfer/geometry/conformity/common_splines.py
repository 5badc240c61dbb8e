"""One degree and one knot vector along every strip of patches, by elevation and knot insertion: same geometry."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...numeric.arrays import FloatArray
from ..basis import elevate, reverse_knots
from ..patch import Patch
from ..sides import Interface
from ..strips import Strip, strips_of
from ..topology import knot_gap
from .overlaps import missing_knots

__all__ = ["with_common_splines"]

#: Knots mapped to [0, 1] that differ by this much are one for the certificate; as there.
KNOT_ROUNDING = 2 * float(np.finfo(float).eps)
#: Knots farther from zero than this many times their range lose digits when they are reversed or scaled.
FAR = 2.0


def with_common_splines(patches: Sequence[Patch], interfaces: Sequence[Interface]) -> tuple[list[Patch], list[str]]:
    """Patches whose degrees and knots agree along all interfaces, and sentences on what changed.

    Only strips that need it are touched, and only in the direction along their interfaces.
    """
    patches, notes = list(patches), []
    for strip in strips_of(len(patches), interfaces):
        if not _agrees(patches, interfaces, strip):
            notes += _unify(patches, strip)
    return patches, notes


def _agrees(patches: Sequence[Patch], interfaces: Sequence[Interface], strip: Strip) -> bool:
    for i in strip.interfaces:
        f = interfaces[i]
        (p, a), (q, b) = (
            (patches[k].degrees[side.axis], patches[k].knots[side.axis])
            for k, side in ((f.patch_a, f.side_a), (f.patch_b, f.side_b))
        )
        if p != q or len(a) != len(b) or knot_gap(a.tobytes(), b.tobytes(), f.reversed) > KNOT_ROUNDING:
            return False
    return True


def _unify(patches: list[Patch], strip: Strip) -> list[str]:
    """Change the patches of a strip in place; sentences on each."""
    degree = max(patches[k].degrees[axis] for k, axis in strip.members)
    first, first_axis = next(iter(strip.members))
    domain = patches[first].knots[first_axis][[0, -1]]
    if np.abs(domain).max() > FAR * np.ptp(domain):
        domain = np.array([0.0, np.ptp(domain)])
    before = {member: patches[member[0]] for member in strip.members}
    for k, axis in strip.members:
        patches[k] = _raised(patches[k], axis, degree - patches[k].degrees[axis])
    common = np.repeat(domain, degree + 1)
    for (k, axis), flipped in strip.members.items():
        knots = _mapped(patches[k].knots[axis], domain, flipped)
        common = np.sort(np.concatenate([common, missing_knots(common, knots, degree)]))
        if strip.twisted:
            common = np.sort(np.concatenate([common, missing_knots(common, _mapped(common, domain, True), degree)]))
    notes = []
    for (k, axis), flipped in strip.members.items():
        own = patches[k].knots[axis]
        new = missing_knots(own, _mapped(common, own[[0, -1]], flipped), degree)
        patches[k] = _with_knots(patches[k].insert_knots(axis, new), axis, _mapped(common, domain, flipped))
        notes += _sentences(k, axis, before[k, axis], patches[k], len(new))
    return notes


def _raised(patch: Patch, axis: int, by: int) -> Patch:
    """The patch with one of its degrees raised."""
    if by == 0:
        return patch

    def raise_degree(k: FloatArray, p: int, c: FloatArray) -> tuple[FloatArray, FloatArray, int]:
        knots, degree, coefficients = elevate(k, p, c, by)
        return knots, coefficients, degree

    return patch._along(axis, raise_degree)


def _mapped(knots: FloatArray, domain: FloatArray, flipped: bool) -> FloatArray:
    """Knots on another domain; the same bits if it is their own."""
    if flipped:
        knots = reverse_knots(knots)
    low, high = knots[0], knots[-1]
    if (low, high) == tuple(domain):
        return knots
    moved = domain[0] + (knots - low) * (np.ptp(domain) / (high - low))
    ends = np.array([knots == low, knots == high])
    return np.asarray(np.where(ends[0], domain[0], np.where(ends[1], domain[1], moved)))


def _with_knots(patch: Patch, axis: int, knots: FloatArray) -> Patch:
    """The patch with knots that are its own but for scaling and rounding."""
    both = (knots, patch.knots[1]) if axis == 0 else (patch.knots[0], knots)
    return Patch(both, patch.degrees, patch.control_points, patch.weights)


def _sentences(k: int, axis: int, before: Patch, after: Patch, inserted: int) -> list[str]:
    p, q = before.degrees[axis], after.degrees[axis]
    (a, b), (c, d) = before.knots[axis][[0, -1]], after.knots[axis][[0, -1]]
    what = []
    if p != q:
        what.append(f"degree raised from {p} to {q}")
    if inserted:
        what.append(f"{inserted} knot{'s' if inserted > 1 else ''} inserted")
    if (a, b) != (c, d):
        what.append(f"knots on [{a:.6g}, {b:.6g}] scaled to [{c:.6g}, {d:.6g}]")
    elif p == q and not inserted and (move := float(np.abs(before.knots[axis] - after.knots[axis]).max())):
        what.append(f"knots moved by at most {move:.2g}")
    return [f"patch {k} along {'uv'[axis]}: {', '.join(what)}"] if what else []
