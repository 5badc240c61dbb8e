"""Libraries that may not be installed."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from ..errors import InputError

__all__ = ["library", "listed"]


def listed(objects: Any, what: str) -> list[Any]:
    """Objects of a sequence; `InputError` if it is none."""
    try:
        return list(objects)
    except TypeError:
        raise InputError(f"{str(objects)[:40]} is neither {what} nor a sequence of them") from None


def library(module: str) -> Any:
    """A module of a library; `InputError` with what to install if it is missing."""
    try:
        return import_module(module)
    except ImportError as error:
        name = module.partition(".")[0]
        raise InputError(f"{name} cannot be loaded ({error}); pip install 'patchtransfer[{name}]'") from None
