"""What stages 4 to 9 come to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..numeric.arrays import FloatArray
from ..progress import StopReason
from ..proof.certificate import Certificate
from .polish_report import PolishReport
from .under_rows import ActiveRows

if TYPE_CHECKING:
    from ..paper.method import PaperHistory

__all__ = ["InteriorMap"]


@dataclass(frozen=True, eq=False)
class InteriorMap:
    """Control points for a boundary, and how they were found.

    Attributes
    ----------
    points : (n_points, 2) array
        Shared control points.
    certificate : Certificate
    log : list of str
        What each rung of the method did.
    notes : list of str
        Warnings: where a stage had to deviate.
    rows : ActiveRows, optional
        The continuity rows that hold.
    history : PaperHistory, optional
        Of ``method="paper"``.
    polish : PolishReport, optional
        What a polish came to.
    """

    points: FloatArray
    certificate: Certificate
    log: list[str]
    notes: list[str]
    rows: ActiveRows | None = None
    history: PaperHistory | None = None
    polish: PolishReport | None = None

    @property
    def stopped(self) -> StopReason | None:
        """Why the search that came last was ended, if its budget ended it."""
        last = self.log[-1] if self.log else None
        return last if isinstance(last, StopReason) else None
