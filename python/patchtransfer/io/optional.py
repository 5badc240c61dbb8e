"""Libraries that only some formats need: extras of the package, loaded when a file asks for them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from ..errors import InputError

__all__ = ["damaged", "library"]

#: What libraries raise on files that are cut off, mangled or made to harm.
FAILURES = (
    ValueError,
    TypeError,
    LookupError,
    ArithmeticError,
    AssertionError,
    AttributeError,
    OSError,
    RuntimeError,
    StopIteration,
)


def library(name: str, extra: str) -> Any:
    """The module `name`, or an `InputError` that tells which extra brings it."""
    try:
        return import_module(name)
    except ModuleNotFoundError as error:
        package = name.partition(".")[0]
        if (error.name or "").partition(".")[0] != package:
            raise
        raise InputError(f"needs {package}, which is not installed: pip install 'patchtransfer[{extra}]'") from None


@contextmanager
def damaged(what: str, remedy: str, *failures: type[Exception]) -> Iterator[None]:
    """Turn what a library raises on a damaged file, `failures` besides the usual, into an `InputError`."""
    caught: tuple[type[Exception], ...] = FAILURES + failures
    try:
        yield
    except InputError:
        raise
    except caught as error:
        told = " ".join(str(error).split())[:80] or type(error).__name__
        raise InputError(f"{what} ({told}); {remedy}") from None
