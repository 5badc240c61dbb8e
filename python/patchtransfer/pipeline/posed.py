"""A target posed as a problem for the inside: what registration and fit have come to, or why they lead nowhere."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from ..fitting.fit import FittedBoundary
from ..numeric.arrays import FloatArray
from ..proof.certificate import BoundaryReport
from ..registration.register import Registration

__all__ = ["FITTED", "Failure", "NoFit", "NoProof", "Posed", "Registered", "no_fit", "no_proof"]

#: What messages on a fit begin with.
FITTED = "fitted boundary"
#: Below this confidence a fit that fails may be due to the correspondence.
SURE = 0.5
IN_VAIN = "no proof is possible, whatever the inside"


class Registered(NamedTuple):
    """A registration, and where the target touches itself, or nearly, so that its own check proves nothing.

    `handed` are corners of the target that were handed to joints which splitting the source has made, `loose` is the
    registration without sides that are the target's own curves, where there are some.
    """

    registration: Registration
    doubt: str | None
    handed: tuple[tuple[float, float], ...] = ()
    loose: Registration | None = None


@dataclass(frozen=True)
class Failure:
    """Why the fitted boundary rules out a certified map.

    Attributes
    ----------
    reason : str
        For the user: the place, why, and what to do.
    of_target : bool
        Whether the target itself is in doubt: more knots or landmarks do not help then.
    """

    reason: str
    of_target: bool


class NoFit(Failure):
    """The fitted boundary crosses itself or asks a patch for an impossible corner: there is no injective map."""


class NoProof(Failure):
    """The fitted boundary is not proved simple, so nothing inside it can be."""


@dataclass(frozen=True)
class Posed:
    """The target's boundary in terms of the source.

    Attributes
    ----------
    registration : Registration
    doubt : str or None
        See `Registered`.
    fitted : FittedBoundary
    start : (n_points, 2) array
        Shared control points with the fitted boundary and the source's interior.
    degenerate : tuple of (patch, corner)
        Corners where one patch fills a straight angle of the target.
    corner_bound : float
        Upper bound of the scaled Jacobian that the boundary's corners impose; -1 where the fit failed.
    report : BoundaryReport
        Proof that the fitted boundary is simple, or what keeps it from that.
    failure : Failure or None
    """

    registration: Registration
    doubt: str | None
    fitted: FittedBoundary
    start: FloatArray
    degenerate: tuple[tuple[int, int], ...]
    corner_bound: float
    report: BoundaryReport
    failure: Failure | None = None


def no_fit(registered: Registered, error: float, reason: str) -> NoFit:
    """Of a fit that rules out an injective map on a target that was not found to."""
    registration, doubt = registered[:2]
    feasible = doubt or "the target is feasible"
    sure = registration.confidence
    wrong = "" if sure >= SURE else f", or its correspondence (confidence {sure:.2f}) needs landmarks"
    return NoFit(
        f"{feasible}, but the source's knots cannot represent it{wrong} (fit error {error:.1e} of the diameter): "
        f"{reason}",
        doubt is not None,
    )


def no_proof(report: BoundaryReport, registered: Registered | None = None) -> NoProof:
    """Of a boundary that is not proved simple: the target's own place where it is the target's fault.

    Without a registration the boundary is the user's.
    """
    if registered is None:
        return NoProof(f"{IN_VAIN}: boundary: {report.reasons[0]}; separate the curves there", True)
    if registered.doubt is not None:
        return NoProof(f"{IN_VAIN}: {registered.doubt}; separate the curves there", True)
    return NoProof(
        f"{IN_VAIN}: {FITTED}: {report.reasons[0]}; the source's knots are too coarse for the target there",
        False,
    )
