"""What came of a library: the result, where it is from, and all candidates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ..errors import TransferError
from ..geometry.multipatch import MultiPatch
from ..pipeline.result import TransferResult
from .ranked import Ranked, table

__all__ = ["PARAMETERIZE", "LibraryResult", "NoModelFitsError"]

#: The name of the candidate that is no model: a layout of the target's own.
PARAMETERIZE = "(parameterize)"
#: Failures that a message names.
NAMED = 3


@dataclass(frozen=True, eq=False)
class LibraryResult:
    """The best of what was tried on a target, and why it is that.

    Attributes
    ----------
    result : TransferResult or None
        Certified where one was found; else the best map, or None without any.
    chosen : str or None
        The name of its model; "(parameterize)" where no model fits and a layout of the target's own was made.
    candidates : tuple of Ranked
        All models, the furthest first; `table` of them is ``str(...)``.
    timings : dict
        Seconds: "signatures", "registration", "transfer" and "parameterize".
    notes : tuple of str
        On the library: what was left out, and what could not be kept.
    """

    result: TransferResult | None
    chosen: str | None
    candidates: tuple[Ranked, ...]
    timings: dict[str, float]
    notes: tuple[str, ...] = ()

    @property
    def succeeded(self) -> bool:
        """Whether there is a certified map of the target."""
        return self.result is not None and self.result.succeeded

    @property
    def failure(self) -> NoModelFitsError | None:
        """The error that `Library.transfer` raises of it; None for a success."""
        return None if self.succeeded else NoModelFitsError(self)

    @property
    def multipatch(self) -> MultiPatch:
        """The parameterization found.

        Raises
        ------
        NoModelFitsError
            Without any.
        """
        if self.result is None:
            raise NoModelFitsError(self)
        return self.result.multipatch

    def to_dict(self) -> dict[str, Any]:
        """Everything but the geometry, ready for JSON: the result's own report, and "library"."""
        library = {
            "chosen": self.chosen,
            "candidates": [candidate.to_dict() for candidate in self.candidates],
            "timings": self.timings,
            "notes": list(self.notes),
        }
        return ({} if self.result is None else self.result.to_dict()) | {"library": library}

    def __repr__(self) -> str:
        name = self.chosen if self.chosen is None or len(self.chosen) <= 40 else f"…{self.chosen[-39:]}"
        status = "no map" if self.result is None else self.result.certificate.status
        return f"<LibraryResult: {name} of {len(self.candidates)}, {status}>"

    def __str__(self) -> str:
        return table(self.candidates)


class NoModelFitsError(TransferError):
    """No model of a library gives a certified map of a target, nor does a layout of its own where it was tried.

    Attributes
    ----------
    result : LibraryResult
        All candidates with the reasons, and the best map.
    """

    def __init__(self, result: LibraryResult) -> None:
        tried = [c for c in result.candidates if c.stage in ("registration", "transfer")]
        failed = [f"{c.name}: {c.reason}" for c in tried if c.reason]
        more = f"; and {len(failed) - NAMED} more" if len(failed) > NAMED else ""
        why = "; ".join(failed[:NAMED]) + more if failed else "none has as many boundary loops"
        own = "" if any(c.name == PARAMETERIZE for c in result.candidates) else "let parameterize make a layout, or "
        super().__init__(f"no model of the library gives a certified map: {why}; {own}add a model like the target")
        self.result = result
