"""Records for those who listen to ``logging.getLogger("patchtransfer")``.

=========  ==================================================================================================
WARNING    what speaks against a result, as in its ``warnings``
INFO       a stage that has ended: its seconds and what it came to (attributes ``stage``, ``seconds``, ``found``)
DEBUG      a stage that begins, what was decided inside (a result's ``log``), and all of this of maps that are tried
           inside another stage
=========  ==================================================================================================

What is odd in a file is no record but an `InputWarning`; ``logging.captureWarnings(True)`` leads these to the logger
``py.warnings``. The library prints nothing.
"""

from __future__ import annotations

import sys
from typing import Any

__all__ = ["DEBUG", "INFO", "NAME", "WARNING", "record"]

NAME = "patchtransfer"
#: As in `logging`, which is not loaded for them.
DEBUG, INFO, WARNING = 10, 20, 30


def record(level: int, text: str, *values: object, **attributes: Any) -> None:
    """Hand a record to the package's logger; nothing where the program has not loaded `logging`.

    Nobody can listen there, and loading it takes 6 ms where a whole transfer takes 150.

    Parameters
    ----------
    level : int
    text : str
        With places for `values`, as in `logging`.
    *values : object
    **attributes : object
        Further attributes of the record.

    Examples
    --------
    >>> import logging
    >>> heard = []
    >>> listener = logging.Handler()
    >>> listener.emit = lambda record: heard.append((record.levelname, record.getMessage()))
    >>> logger = logging.getLogger("patchtransfer")
    >>> logger.addHandler(listener); logger.setLevel(logging.INFO)
    >>> record(INFO, "%s: %.3f s", "fitting", 0.25); record(DEBUG, "not heard")
    >>> logger.removeHandler(listener); logger.setLevel(logging.NOTSET)
    >>> heard
    [('INFO', 'fitting: 0.250 s')]
    """
    logging = sys.modules.get("logging")
    if logging is None:
        return
    logger = logging.getLogger(NAME)
    if not logger.handlers:
        # Or Python would print warnings where the program has set up nothing.
        logger.addHandler(logging.NullHandler())
    logger.log(level, text, *values, extra=attributes, stacklevel=2)
