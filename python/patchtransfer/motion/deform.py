"""Deform: drag boundary points of a multi-patch and get the certified parameterization of the new boundary.

The displacement of a loop's boundary is a sum of bumps around its handles, in the length along the loop: Wendland's
C² function with compact support (H. Wendland, *Piecewise polynomial, positive definite and compactly supported radial
functions of minimal degree*, 1995), so that everything farther along the loop than `radius` stays to the bit, and other
loops stay altogether. (A function of the plane would move a neighbouring limb too.) The bumps' weights are solved for,
so that the curves pass exactly through the handles. Where two sides meet smoothly the legs of both move by the slope of
the displacement at the joint, which keeps them on one line. Degrees and knots stay.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InfeasibleTargetError, InputError
from ..geometry.basis import collocation_matrix
from ..geometry.multipatch import MultiPatch
from ..geometry.outline import Outline
from ..geometry.topology import BoundarySide
from ..numeric.arrays import FloatArray
from ..numeric.dense import product, solve, svd
from ..pipeline.plan import Refilled, TransferPlan
from ..pipeline.result import NotCertifiedError
from ..proof.certificate import Certificate
from ..registration.landmarks import SNAP_DISTANCE
from .bumps import LoopBumps

__all__ = ["DeformResult", "Deformer", "deform"]

#: Default radius: this part of the loop's length, or this many times the farthest drag on it.
REACH, REACH_PER_DRAG = 0.15, 3.0


@dataclass(frozen=True, eq=False)
class DeformResult:
    """Outcome of a deformation.

    Attributes
    ----------
    multipatch : MultiPatch
    certificate : Certificate
    moved : (n,) int array
        Boundary control points (of ``multipatch.topology``) that moved.
    log : tuple of str
        What the optimiser did.
    """

    multipatch: MultiPatch
    certificate: Certificate
    moved: NDArray[np.int64]
    log: tuple[str, ...]

    def __repr__(self) -> str:
        return f"<DeformResult: {self.certificate.status}, {len(self.moved)} boundary control points moved>"


class Deformer:
    """A multi-patch prepared for dragging: all work that does not depend on the handles is done once.

    Parameters
    ----------
    mp : MultiPatch
        Injective, connected.
    continuity : str, optional
        Across patches, as in `transfer`; default as there.
    frozen : bool, default False
        Hold the continuity rows and nodes of the map on the model's own boundary for all drags, as `plan.freeze`
        does: maps then follow the handles smoothly, in about half of the time, which is what one wants while dragging.
        Where no certified map is found so, rows follow the new boundary as without it, and the log says so.

    Raises
    ------
    InputError
        On a model that cannot be transferred.
    NotCertifiedError
        When `frozen` finds no certified map on the model's own boundary.

    Examples
    --------
    >>> import patchtransfer as pt
    >>> source, _, _ = pt.examples.load("star")
    >>> deformer = pt.Deformer(source)
    >>> x, y = source.boundary().loops[0][0].start
    >>> [deformer.deform([[x, y, s * x, s * y]]).certificate.status for s in (0.9, 1.1)]
    ['certified', 'certified']
    """

    def __init__(self, mp: MultiPatch, continuity: str | None = None, *, frozen: bool = False) -> None:
        self.multipatch = mp
        self._plan = TransferPlan(mp) if continuity is None else TransferPlan(mp, continuity)
        self._frozen = self._plan.freeze() if frozen else None
        self._loops = [_Loop(mp, sides) for sides in mp.topology.loops]
        self._coordinates = mp.topology.coordinates
        boundary = self._coordinates[mp.topology.boundary_points]
        self._diameter = float(np.linalg.norm(np.ptp(boundary, axis=0)))

    def __repr__(self) -> str:
        return f"<Deformer: {len(self.multipatch.patches)} patches, {len(self._loops)} boundary loops>"

    def deform(self, handles: ArrayLike, *, radius: float | None = None, on_failure: str = "raise") -> DeformResult:
        """Move boundary points of the original model; every call starts from it anew.

        Parameters
        ----------
        handles : (r, 4) array
            Rows (x, y, x_new, y_new): the boundary point nearest to (x, y) goes to (x_new, y_new) exactly. A row with
            x_new = x and y_new = y holds a point where it is.
        radius : float, optional
            Length along the loop, on either side of a handle, that moves with it. Default 0.15 of the loop's length,
            or three times the farthest drag on the loop if that is more, at most half of the loop.
        on_failure : {"raise", "return"}, default "raise"
            What to do when no certified map is found.

        Returns
        -------
        DeformResult

        Raises
        ------
        InputError
            When a handle is off the boundary, two name the same point, or the radius is too small for the knots.
        InfeasibleTargetError
            When the new boundary crosses itself, or has a corner that its patch cannot fill.
        NotCertifiedError
            When no certified map is found and `on_failure` is "raise".
        """
        rows = np.asarray(handles, float)
        if rows.ndim != 2 or rows.shape[1] != 4 or not np.isfinite(rows).all():
            raise InputError(f"handles: expected finite rows (x, y, x_new, y_new), got shape {rows.shape}")
        if radius is not None and not radius > 0:
            raise InputError(f"radius must be positive, got {radius}")
        if on_failure not in ("raise", "return"):
            raise InputError(f"on_failure must be one of raise, return, got {on_failure!r}")
        points = self._coordinates.copy()
        for loop, members, places in self._assigned(rows):
            loop.displace(points, places, rows[members], radius)
        found = self._filled(points)
        moved = np.flatnonzero((points != self._coordinates).any(axis=1))
        if on_failure == "raise" and not found.certificate.injective:
            raise NotCertifiedError(
                f"no certified map was found on the deformed boundary ({found.certificate.status}): "
                f"{'; '.join(found.certificate.reasons[:3])}; drag less far, or raise the radius"
            )
        return DeformResult(found.multipatch, found.certificate, moved, found.log)

    def _filled(self, points: FloatArray) -> Refilled:
        log: tuple[str, ...] = ()
        if self._frozen is not None:
            try:
                held = self._frozen.fill(points[self._frozen.boundary_points])
            except InfeasibleTargetError:
                # The filling below says why, or finds a map under other rows.
                log = ("under the model's own rows no map without folds was found",)
            else:
                log = (f"under the model's own rows: energy {held.energy:.4f}, {held.certificate.status}",)
                if held.certificate.injective:
                    return Refilled(held.multipatch, held.certificate, log)
        found = self._plan.refill(points)
        return found._replace(log=(*log, *found.log))

    def _assigned(self, rows: FloatArray) -> list[tuple[_Loop, NDArray[np.int64], FloatArray]]:
        """Loops with the numbers of their handles and where along the loop those are."""
        if len(rows) == 0:
            return []
        nearest = [loop.outline.nearest(rows[:, :2]) for loop in self._loops]
        distance = np.array([d for _, d in nearest])
        owner = distance.argmin(axis=0)
        far = distance.min(axis=0) > SNAP_DISTANCE * self._diameter
        if far.any():
            i = int(np.argmax(far))
            raise InputError(
                f"handle {i} at ({rows[i, 0]:.6g}, {rows[i, 1]:.6g}) is {distance.min(axis=0)[i]:.3g} away from the "
                f"boundary (allowed {SNAP_DISTANCE * self._diameter:.3g}); put it on the boundary"
            )
        members = [(k, np.flatnonzero(owner == k)) for k in range(len(self._loops))]
        return [(self._loops[k], m, nearest[k][0][m]) for k, m in members if len(m)]


def deform(
    mp: MultiPatch,
    handles: ArrayLike,
    *,
    radius: float | None = None,
    continuity: str | None = None,
    on_failure: str = "raise",
) -> DeformResult:
    """Drag boundary points of a multi-patch, once; see `Deformer.deform` for parameters and errors.

    Examples
    --------
    >>> from patchtransfer import examples
    >>> source, _, _ = examples.load("star")
    >>> x, y = source.boundary().loops[0][0].start
    >>> result = deform(source, [[x, y, 1.1 * x, 1.1 * y]])
    >>> result.certificate.status
    'certified'
    """
    return Deformer(mp, continuity).deform(handles, radius=radius, on_failure=on_failure)


class _Loop:
    """A boundary loop: where its control points are along it, and how they follow bumps in that length."""

    def __init__(self, mp: MultiPatch, sides: tuple[BoundarySide, ...]) -> None:
        self._curves = [side.curve(mp.patches) for side in sides]
        self._indices = [side.points(mp.topology.points[side.patch]) for side in sides]
        self.outline = Outline(self._curves)
        self._bumps = LoopBumps(self.outline)

    def displace(self, points: FloatArray, places: FloatArray, rows: FloatArray, radius: float | None) -> None:
        """Add to `points` the displacement that takes the boundary points at `places` to the last two columns."""
        length = self.outline.length
        curve, parameter = self._locate(places)
        at = np.stack([self._curves[k](t) for k, t in zip(curve, parameter, strict=True)]).reshape(-1, 2)
        drag = rows[:, 2:] - at
        # Snapped handles that ask to stay do stay, wherever they were clicked.
        drag[(rows[:, 2:] == rows[:, :2]).all(axis=1)] = 0.0
        if radius is None:
            radius = max(REACH * length, REACH_PER_DRAG * float(np.linalg.norm(drag, axis=1).max()))
        radius = min(radius, length / 2)
        bumps = [self._bumps.of_curve(k, places, radius) for k in range(len(self._curves))]
        matrix = np.stack(
            [
                product(collocation_matrix(self._curves[k].knots, self._curves[k].degree, np.array([t])), bumps[k])[0]
                for k, t in zip(curve, parameter, strict=True)
            ]
        )
        _, sigma, _ = svd(matrix)
        if sigma[0] > 1e8 * sigma[-1]:
            raise InputError(
                f"the handles cannot be moved independently with radius {radius:.3g}: handles coincide, or the knots "
                "are too coarse; take fewer handles, a larger radius, or insert knots"
            )
        weights = solve(matrix, drag)
        for index, bump in zip(self._indices, bumps, strict=True):
            shift = product(bump, weights)
            # Joints belong to two sides, whose bumps agree there.
            points[index[:-1]] += shift[:-1]

    def _locate(self, places: FloatArray) -> tuple[NDArray[np.int64], FloatArray]:
        """Curve and parameter of arc lengths."""
        joints = self.outline.joints
        curve = np.clip(np.searchsorted(joints, places, side="right") - 1, 0, len(self._curves) - 1)
        parameters = []
        for k, s in zip(curve.tolist(), places.tolist(), strict=True):
            c = self._curves[k]
            first, last = c.domain
            t = np.linspace(first, last, 2049)
            parameters.append(float(np.interp(s, self.outline.arc_length(k, t), t)))
        return curve, np.array(parameters)
