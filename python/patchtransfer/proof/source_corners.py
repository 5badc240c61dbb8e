"""Straight corners of a model from elsewhere, put on the right side of straight where rounding has them negative."""

from __future__ import annotations

from ..geometry.multipatch import MultiPatch
from ..geometry.straight_corners import corner_triangles, straighten
from .certificate import Certificate, certify

__all__ = ["certify_straight", "straighten_source"]


def certify_straight(multipatch: MultiPatch) -> tuple[MultiPatch, Certificate, list[str]]:
    """A multi-patch with its certificate, after straightening where that is needed, and notes on what moved.

    Parameters
    ----------
    multipatch : MultiPatch
        With bit-equal interfaces.
    """
    certificate = certify(multipatch)
    straight, notes = straighten_source(multipatch, certificate)
    return straight, certify(straight) if notes else certificate, notes


def straighten_source(multipatch: MultiPatch, certificate: Certificate) -> tuple[MultiPatch, list[str]]:
    """A multi-patch whose corners are not negative where its certificate says they are so by rounding, and what moved.

    Parameters
    ----------
    multipatch : MultiPatch
        With bit-equal interfaces.
    certificate : Certificate
        Its own.

    Returns
    -------
    multipatch : MultiPatch
        The same where nothing is to be mended.
    notes : list of str
    """
    corners = [(cell.patch, cell.corner) for cell in certificate.cells if cell.within_rounding]
    topology = multipatch.topology
    points, moved = straighten(topology.coordinates, corner_triangles(topology, corners))
    if not moved:
        return multipatch, []
    places = ", ".join(f"patch {k} corner {c}" for k, c in corners[:4]) + (", ..." if len(corners) > 4 else "")
    note = (
        f"the model was negative within rounding at {len(corners)} straight corner{'s' if len(corners) > 1 else ''} "
        f"({places}): control points were moved by at most {moved:.2g} so that det J >= 0 there"
    )
    return multipatch.with_shared_points(points), [note]
