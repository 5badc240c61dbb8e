"""A boundary on the source's own sides: neither registered nor fitted, only filled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..errors import InputError
from ..geometry.multipatch import MultiPatch
from ..geometry.straight_corners import corner_triangles, straighten
from ..gradients.frozen import Frozen, freeze
from ..interior.interior_map import InteriorMap
from ..interior.solver import InteriorSolver
from ..progress import Budget, Clock, Progress
from ..proof.certificate import Certificate, check_boundary
from ..proof.feasibility import check_corners, check_report
from .posed import no_proof
from .result import NotCertifiedError
from .source_boundary import SourceBoundary

__all__ = ["Refilled", "filled", "frozen"]


class Refilled(NamedTuple):
    """Outcome of `TransferPlan.refill`."""

    multipatch: MultiPatch
    certificate: Certificate
    log: tuple[str, ...]


def filled(
    points: ArrayLike, boundary: SourceBoundary, interior: InteriorSolver, progress: Progress | None, what: str
) -> tuple[InteriorMap, tuple[tuple[int, int], ...]]:
    """The inside for the boundary of shared control points (n_points, 2), and the degenerate corners; see `refill`."""
    start = np.asarray(points, float)
    topology = interior.source.topology
    if start.shape != (topology.n_points, 2) or not np.isfinite(start).all():
        raise InputError(f"{what}: expected finite points of shape {(topology.n_points, 2)}, got {start.shape}")
    curves = boundary.curves(start)
    known = check_boundary(curves)
    check_report(known, "boundary")
    degenerate = boundary.degenerate(check_corners(curves, boundary.single, "boundary"))
    start, _ = straighten(start, corner_triangles(topology, degenerate))
    budget = Budget.of_source(interior.step_cost)
    report = check_boundary(boundary.curves(start), known)
    if report.simple:
        found = interior.certified(start, degenerate, progress, Clock(progress), budget, report)
    else:
        reason = no_proof(report).reason
        found = interior.unproved(start, degenerate, progress, Clock(progress), budget, reason, report)
    return found, degenerate


def frozen(points: ArrayLike, boundary: SourceBoundary, interior: InteriorSolver, progress: Progress | None) -> Frozen:
    """The map on a boundary as a function of it; see `TransferPlan.freeze`."""
    found, degenerate = filled(points, boundary, interior, progress, "freeze")
    if not found.certificate.injective:
        raise NotCertifiedError(
            f"freeze: no certified map was found on this boundary ({found.certificate.status}): "
            f"{'; '.join(found.certificate.reasons[:3])}; freeze a boundary nearer to the source's"
        )
    return freeze(interior, None if found.rows is None else found.rows.space, degenerate, found.points)
