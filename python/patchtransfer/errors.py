"""Exceptions of the package: every message names the place and the remedy."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .result import TransferResult

__all__ = ["InfeasibleTargetError", "InputError", "InputWarning", "NotCertifiedError", "TransferError"]


class TransferError(Exception):
    """Base class of all errors that patchtransfer raises on purpose."""


class InputError(TransferError, ValueError):
    """A file, model, landmark or option that cannot be used as it is."""


class InfeasibleTargetError(TransferError):
    """No injective parameterization with the source's topology exists on the target."""


class InputWarning(UserWarning):
    """A file says more than is read, or something twice."""


class NotCertifiedError(TransferError):
    """The best map found has no proof of injectivity.

    Attributes
    ----------
    result : TransferResult or None
        The best map found, with its certificate and metrics.
    """

    def __init__(self, message: str, result: TransferResult | None = None) -> None:
        super().__init__(message)
        self.result = result
