"""What is known of model files by their content, kept on disk so that a library is looked through once.

The key of a file is a digest of its bytes, its suffix, this version of the package and that of the signatures: what is
found is of that very content, read and worked out as now. A file that changes gets another key.
"""

from __future__ import annotations

import hashlib
import os
import sqlite3
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .._core import __version__
from ..errors import InputError
from ..registration.signature import SHAPE, VERSION, Signature

__all__ = ["FOLDER", "Index", "Known", "default_folder", "key_of"]

#: The environment variable that names the folder of kept signatures.
FOLDER = "PATCHTRANSFER_CACHE"
#: The layout of the file's table.
TABLE = 1
NAME = "signatures.sqlite"
#: Seconds that one process waits for another one that writes.
PATIENCE = 30.0


class Known(NamedTuple):
    """What is known of a model: its signature, and why it cannot be transferred, if so."""

    signature: Signature
    refusal: str | None


def default_folder() -> Path:
    """Where signatures are kept unless told: what PATCHTRANSFER_CACHE names, else the user's own place for caches."""
    named = os.environ.get(FOLDER)
    if named:
        return Path(named)
    from platformdirs import user_cache_path

    return user_cache_path("patchtransfer", appauthor=False)


def key_of(path: Path, data: bytes) -> bytes:
    """The key of a file with these bytes; its suffix may decide how it is read."""
    how = f"{__version__}\0{VERSION}\0{path.suffix.lower()}\0".encode()
    return hashlib.sha256(how + data).digest()


class Index:
    """Signatures by key, in a SQLite file that processes may share.

    Parameters
    ----------
    folder : Path
        Made if it does not exist.

    Raises
    ------
    InputError
        Wherever the file cannot be made, read or written.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / NAME
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{folder}: the folder cannot be made ({error.strerror}); choose another one") from None
        with self._open() as database:
            version = database.execute("PRAGMA user_version").fetchone()[0]
            if version not in (0, TABLE):
                raise InputError(f"{self.path}: made by another version; delete it, or choose another folder")
            database.execute(
                "CREATE TABLE IF NOT EXISTS known "
                "(key BLOB PRIMARY KEY, loops INTEGER NOT NULL, digits BLOB NOT NULL, refusal TEXT)"
            )
            database.execute(f"PRAGMA user_version = {TABLE}")

    def known(self, keys: Iterable[bytes]) -> dict[bytes, Known]:
        """What is known of these keys."""
        found = {}
        with self._open() as database:
            for key in keys:
                row = database.execute("SELECT loops, digits, refusal FROM known WHERE key = ?", (key,)).fetchone()
                if row is not None:
                    found[key] = self._parsed(*row)
        return found

    def keep(self, known: Mapping[bytes, Known]) -> None:
        """Keep what was found out, in place of what was known."""
        rows = [
            (key, of.signature.loops, of.signature.values.astype("<f8").tobytes(), of.refusal)
            for key, of in known.items()
        ]
        with self._open() as database:
            database.executemany("INSERT OR REPLACE INTO known VALUES (?, ?, ?, ?)", rows)

    def _parsed(self, loops: object, digits: object, refusal: object) -> Known:
        fits = isinstance(loops, int) and isinstance(digits, bytes) and len(digits) == 8 * SHAPE[0] * SHAPE[1]
        if not fits or not isinstance(refusal, str | None):
            raise InputError(f"{self.path}: damaged; delete it, it is made again")
        assert isinstance(loops, int)
        assert isinstance(digits, bytes)
        values = np.frombuffer(digits, "<f8").astype(np.float64).reshape(SHAPE)
        return Known(Signature(loops, values), refusal)

    @contextmanager
    def _open(self) -> Iterator[sqlite3.Connection]:
        try:
            with closing(sqlite3.connect(self.path, timeout=PATIENCE)) as database, database:
                yield database
        except sqlite3.Error as error:
            raise InputError(
                f"{self.path}: signatures cannot be kept there ({error}); delete it, or choose another folder"
            ) from None
