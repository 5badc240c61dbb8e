"""Options of a transfer: what they may be."""

from __future__ import annotations

import numpy as np

from ..errors import InputError

__all__ = ["check_fit_tolerance", "check_options", "check_time_limit"]

CHOICES = {
    "method": ("certified", "paper"),
    "refine": ("never", "auto"),
    "on_failure": ("raise", "return"),
}


def check_options(**options: str) -> None:
    """Raise `InputError` on an option that is none of its choices."""
    for name, value in options.items():
        if value not in CHOICES[name]:
            raise InputError(f"{name} must be one of {', '.join(CHOICES[name])}, got {value!r}")


def check_fit_tolerance(fit_tolerance: float) -> None:
    """Raise `InputError` unless it is a number between 0 and 1."""
    if not isinstance(fit_tolerance, int | float | np.number) or not 0 < fit_tolerance < 1:
        raise InputError(f"fit_tolerance must lie between 0 and 1, got {fit_tolerance!r}")


def check_time_limit(time_limit: float | None) -> None:
    """Raise `InputError` unless it is a positive number of seconds, or None."""
    # A comparison with NaN is false as well.
    if time_limit is not None and not (isinstance(time_limit, int | float | np.number) and time_limit > 0):
        raise InputError(f"time_limit must be a positive number of seconds, or None, got {time_limit!r}")
