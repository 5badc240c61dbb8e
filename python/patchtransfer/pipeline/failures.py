"""What a user is told where there is no certified map: the place, why, and what to do."""

from __future__ import annotations

from ..progress import STOPPED
from ..proof.certificate import BoundaryReport
from ..registration.register import Registration
from .result import TransferResult

__all__ = ["FITTED", "SURE", "TARGET", "no_fit", "no_proof", "not_certified"]

#: What messages on the target, and on its fit, begin with.
TARGET, FITTED = "target boundary", "fitted boundary"
#: Below this confidence a fit that fails may be due to the correspondence.
SURE = 0.5
NO_PROOF = "no proof is possible, whatever the inside"


def no_fit(registration: Registration, failure: str) -> str:
    """Of a fit that rules out an injective map on a target that was not found to."""
    feasible = _doubt(registration) or "the target is feasible"
    sure = registration.confidence
    wrong = "" if sure >= SURE else f", or its correspondence (confidence {sure:.2f}) needs landmarks"
    return f"{feasible}, but the source's knots cannot represent it{wrong} {failure}"


def no_proof(report: BoundaryReport, registration: Registration | None = None) -> str:
    """Of a boundary that is not proved simple: the target's own place where it is the target's fault.

    Without a registration the boundary is the user's.
    """
    if registration is None:
        return f"{NO_PROOF}: boundary: {report.reasons[0]}; separate the curves there"
    doubt = _doubt(registration)
    if doubt is not None:
        return f"{NO_PROOF}: {doubt}; separate the curves there"
    return f"{NO_PROOF}: {FITTED}: {report.reasons[0]}; the source's knots are too coarse for the target there"


def not_certified(result: TransferResult) -> str:
    """Of a transfer without a certified map."""
    reasons = result.log[-1] if result.fit_failed else "; ".join(result.certificate.reasons[:3])
    cut = "".join(f"; {note}" for note in result.warnings if note.startswith(STOPPED))
    # More knots or landmarks do not help where the target itself is in doubt.
    more = "" if result.fit_failed and TARGET in reasons else "try --refine auto (refine='auto') or more landmarks; "
    return (
        f"no certified map was found ({result.certificate.status}): {reasons}{cut}; {more}--keep-uncertified "
        "(on_failure='return') gives the best map"
    )


def _doubt(registration: Registration) -> str | None:
    """Where the target touches itself, or nearly, so that its check proves nothing."""
    return next((note for note in registration.warnings if note.startswith(TARGET)), None)
