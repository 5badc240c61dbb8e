"""Whole files, read with clear errors and written atomically: others see the old file or the new one. And JSON text."""

from __future__ import annotations

import json
import math
import os
from contextlib import suppress
from pathlib import Path
from typing import Any

from .errors import InputError
from .limits import MAX_FILE_BYTES

__all__ = ["finite_or_none", "json_text", "read_bytes", "write_atomic"]


def read_bytes(path: Path) -> bytes:
    """Contents of a file.

    Raises
    ------
    InputError
        When it does not exist, is a folder, cannot be read, is larger than 64 MB or holds nothing but whitespace. The
        message has no path; the caller knows it.
    """
    try:
        with path.open("rb") as stream:
            # Not the size that the system tells: devices and pipes have none.
            data = stream.read(MAX_FILE_BYTES + 1)
    except FileNotFoundError:
        raise InputError("no such file; check the path") from None
    except IsADirectoryError:
        raise InputError("this is a folder; name a file in it") from None
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror}); check its permissions") from None
    except ValueError:
        raise InputError("a file's name cannot hold the character NUL; correct it") from None
    if len(data) > MAX_FILE_BYTES:
        raise InputError(f"larger than {MAX_FILE_BYTES // 2**20} MB, the most that is read; simplify or split it")
    if not data.strip():
        raise InputError("the file is empty; write it again")
    return data


def write_atomic(path: Path, data: str | bytes) -> None:
    """Write a file through a temporary one in the same folder.

    Parameters
    ----------
    path : Path
        An existing file is replaced; a symbolic link is followed.
    data : str or bytes
        Text is encoded as UTF-8.

    Raises
    ------
    InputError
        When the folder does not exist or cannot be written to; nothing is left behind.
    """
    content = data.encode() if isinstance(data, str) else data
    target = Path(os.path.realpath(path))
    if target.is_dir():
        raise InputError(f"{path}: this is a folder; name a file in it")
    if not target.parent.is_dir():
        raise InputError(f"{path}: the folder {target.parent} does not exist; create it first")
    temporary = target.parent / f".{target.name[:100]}.{os.urandom(6).hex()}.tmp"
    try:
        # Not `tempfile`: that creates private files, and the result would keep mode 0600.
        handle = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o666)
        with os.fdopen(handle, "wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(temporary, target)
    except OSError as error:
        raise InputError(
            f"{path}: cannot be written ({error.strerror or error}); check the folder's permissions and the disk"
        ) from None
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def finite_or_none(x: float) -> float | None:
    """`x` for JSON, which knows neither infinity nor NaN."""
    return x if math.isfinite(x) else None


def json_text(content: Any, indent: int = 2) -> str:
    """JSON text of dictionaries, sequences, texts and numbers; NaN and infinity, which JSON has not, are null."""
    return json.dumps(_finite(content), indent=indent, allow_nan=False) + "\n"


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
