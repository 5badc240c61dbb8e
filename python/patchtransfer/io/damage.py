"""What libraries raise on files that are damaged, as an error of ours."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from ..errors import InputError

__all__ = ["damaged"]

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
