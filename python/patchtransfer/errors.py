"""Exceptions of the package: every message names the place and the remedy."""

from __future__ import annotations

__all__ = ["InfeasibleTargetError", "InputError", "InputWarning", "TransferError"]


class TransferError(Exception):
    """Base class of all errors that patchtransfer raises on purpose."""


class InputError(TransferError, ValueError):
    """A file, model, landmark or option that cannot be used as it is."""


class InfeasibleTargetError(TransferError):
    """No injective parameterization with the source's topology exists on the target."""


class InputWarning(UserWarning):
    """A file says more than is read, or something twice; or something wanted is not made, and why."""
