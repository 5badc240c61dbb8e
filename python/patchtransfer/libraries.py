"""Libraries that may not be installed: extras of the package, loaded when something asks for them."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from .errors import InputError

__all__ = ["library"]


def library(module: str, extra: str | None = None, user: str = "") -> Any:
    """A module of a library, or an `InputError` that tells what to install.

    Parameters
    ----------
    module : str
        Its dotted name.
    extra : str, optional
        The extra of this package that brings it, by default of the library's name.
    user : str, default ""
        What needs it, the message's first words; none where a file's name will stand there.

    Examples
    --------
    >>> library("math").pi
    3.141592653589793
    >>> library("no_such_library.core", "plot", "a picture")
    Traceback (most recent call last):
    ...
    patchtransfer.errors.InputError: a picture needs no_such_library (No module named 'no_such_library'): \
pip install 'patchtransfer[plot]'
    """
    try:
        return import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        told = f"{user} needs {package} ({error}): pip install 'patchtransfer[{extra or package}]'"
        raise InputError(told.lstrip()) from None
