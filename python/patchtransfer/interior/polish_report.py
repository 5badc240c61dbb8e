"""What a polish may be for, and what it came to; without numerics, for the command line's help."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from ..files import finite_or_none

__all__ = ["GOALS", "PolishReport"]

GOALS = ("scaled_jacobian", "dilatation")


@dataclass(frozen=True)
class PolishReport:
    """What a polish came to.

    Attributes
    ----------
    goal : {"scaled_jacobian", "dilatation"}
    power : int
        Of the energy density whose minimum the map is; 1 where no power gave a better one.
    before, after : float
        The number asked for, proved: the smallest scaled Jacobian from below, or the largest dilatation from above.
    """

    goal: str
    power: int
    before: float
    after: float

    @property
    def words(self) -> str:
        """What it came to, as said in reports."""
        what = "minimum scaled Jacobian" if self.goal == GOALS[0] else "dilatation"
        if self.power == 1:
            return f"no map with a better {what} than {self.before:.4g} was found"
        return f"{what} {self.before:.4g} -> {self.after:.4g}, proved (power {self.power})"

    def __str__(self) -> str:
        return f"polish: {self.words}"

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "goal": self.goal,
            "power": self.power,
            "before": finite_or_none(self.before),
            "after": finite_or_none(self.after),
        }

    @staticmethod
    def from_dict(data: dict[str, Any]) -> PolishReport:
        """Of `to_dict`."""
        before, after = (math.inf if data[name] is None else data[name] for name in ("before", "after"))
        return PolishReport(data["goal"], data["power"], before, after)
