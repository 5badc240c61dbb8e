"""How far a model of a library came, and why not further; all of them as a table."""

from __future__ import annotations

import collections
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ..measure.bounds import Bounds

__all__ = ["STAGES", "Ranked", "table"]

#: How far candidates come, and what is said of those that come no further where there are many.
STAGES = {
    "loops": "with another number of loops",
    "source": "that cannot be transferred",
    "signature": "less alike by signature",
    "registration": "registered",
    "transfer": "transferred",
    "chosen": "chosen",
}
#: Letters of a reason in the table.
REASON = 90


@dataclass(frozen=True)
class Ranked:
    """A model as a candidate for a target.

    Attributes
    ----------
    name : str
    stage : str
        How far it came: "loops", "source", "signature", "registration", "transfer" or "chosen".
    loops : int or None
        Of its boundary.
    distance : float or None
        Of its signature to the target's, 0 for similar shapes; None where numbers of loops differ.
    score : float or None
        Cost of the correspondence, 0 for similar shapes.
    confidence : float or None
        Of the registration.
    expected : float or None
        Median of the least scaled Jacobian that the registration lets expect.
    status : str or None
        Of the result's certificate.
    min_scaled_jacobian : Bounds or None
        Of the result, proved.
    boundary_error : float or None
        Of the result, relative to the target's diameter.
    reason : str or None
        Why it came no further; None where nothing but its place in the order kept it.
    """

    name: str
    stage: str
    loops: int | None = None
    distance: float | None = None
    score: float | None = None
    confidence: float | None = None
    expected: float | None = None
    status: str | None = None
    min_scaled_jacobian: Bounds | None = None
    boundary_error: float | None = None
    reason: str | None = None

    def __repr__(self) -> str:
        name = self.name if len(self.name) <= 40 else f"…{self.name[-39:]}"
        score = "" if self.score is None else f", score {self.score:.3g}"
        least = "" if self.min_scaled_jacobian is None else f", scaled Jacobian {self.min_scaled_jacobian.lower:.3g}"
        return f"<Ranked: {name}, {self.stage}{score}{least}>"

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        bounds = self.min_scaled_jacobian
        return vars(self) | {"min_scaled_jacobian": None if bounds is None else bounds.to_dict()}


def table(candidates: Sequence[Ranked]) -> str:
    """Candidates that were looked at one by one, a line each, and how many others there are."""
    stages = list(STAGES)
    looked_at = [c for c in candidates if stages.index(c.stage) >= stages.index("registration") or c.status]
    others = collections.Counter(c.stage for c in candidates if c not in looked_at)
    rows = [("model", "signature", "score", "confidence", "expected", "min SJ", "outcome")]
    rows += [_row(candidate) for candidate in looked_at]
    # Of what is not known of any there is no column.
    columns = [column for column in zip(*rows, strict=True) if any(column[1:])]
    texts = [_aligned(column, column[0] in ("model", "outcome")) for column in columns]
    lines = ["  ".join(row).rstrip() for row in zip(*texts, strict=True)] if columns else []
    if others:
        said = ", ".join(f"{others[stage]} {STAGES[stage]}" for stage in stages if stage in others)
        lines.append(f"and {sum(others.values())} more: {said}")
    return "\n".join(lines)


def _aligned(column: Sequence[str], left: bool) -> list[str]:
    width = max(map(len, column))
    return [cell.ljust(width) if left else cell.rjust(width) for cell in column]


def _row(candidate: Ranked) -> tuple[str, str, str, str, str, str, str]:
    least = candidate.min_scaled_jacobian
    reason = " ".join((candidate.reason or "").split())
    short = reason if len(reason) <= REASON else f"{reason[:REASON]} ..."
    outcome = "chosen" if candidate.stage == "chosen" else candidate.status or candidate.stage
    return (
        candidate.name,
        _number(candidate.distance),
        _number(candidate.score),
        "" if candidate.confidence is None else f"{candidate.confidence:.2f}",
        "" if candidate.expected is None else f"{candidate.expected:.2f}",
        "" if least is None else f"{least.lower:.4f}",
        f"{outcome}: {short}" if short else outcome,
    )


def _number(x: float | None) -> str:
    return "" if x is None else f"{x:.3g}"
