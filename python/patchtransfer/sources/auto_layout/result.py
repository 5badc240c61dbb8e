"""The result of an automatic parameterization: a transfer's, its layout, and what else was tried."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

from ...pipeline.result import TransferResult
from ..quad_layout import QuadLayout
from .judging import Candidate

__all__ = ["Parameterization"]


@dataclass(frozen=True, eq=False, repr=False)
class Parameterization(TransferResult):
    """A parameterization of an outline and its evidence.

    Attributes
    ----------
    layout : QuadLayout
        The quads, a patch each; changed or not, `from_layout` takes it.
    candidates : tuple of Candidate
        All layouts that were tried, the best first.
    """

    layout: QuadLayout | None = None
    candidates: tuple[Candidate, ...] = ()

    @classmethod
    def of(
        cls, result: TransferResult, layout: QuadLayout, candidates: Sequence[Candidate], log: Sequence[str]
    ) -> Parameterization:
        """A result with its layout and candidates; `log` comes before the result's own."""
        values = {field.name: getattr(result, field.name) for field in fields(TransferResult)}
        # What was transferred is a layout found on the way, not a shape of anyone's.
        values["_source"] = None
        values["log"] = (*log, *result.log)
        return cls(**values, layout=layout, candidates=tuple(candidates))

    def __repr__(self) -> str:
        return (
            super()
            .__repr__()
            .replace("<TransferResult:", f"<Parameterization: {len(self.multipatch.patches)} patches,")
        )

    def to_dict(self) -> dict[str, Any]:
        """Everything but the geometry, ready for JSON."""
        return super().to_dict() | {
            "patches": len(self.multipatch.patches),
            "candidates": [candidate.to_dict() for candidate in self.candidates],
        }
