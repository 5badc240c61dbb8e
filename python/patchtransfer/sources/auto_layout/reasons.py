"""Why there is no layout."""

from __future__ import annotations

from ...errors import TransferError

__all__ = ["NoLayoutError"]


class NoLayoutError(TransferError):
    """A stage of the automatic layout cannot go on.

    Parameters
    ----------
    stage : str
        The stage that gave up.
    reason : str
        What it met, with the values.
    """

    def __init__(self, stage: str, reason: str) -> None:
        super().__init__(f"{stage}: {reason}")
        self.stage = stage
        self.reason = reason

    def __reduce__(self) -> tuple[type[NoLayoutError], tuple[str, str]]:
        return NoLayoutError, (self.stage, self.reason)
