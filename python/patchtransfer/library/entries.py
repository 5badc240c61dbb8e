"""The models of a library: in memory, or files that are read when they are asked for."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from ..errors import InputError, InputWarning
from ..files import read_bytes
from ..geometry.multipatch import MultiPatch
from ..geometry.outline import Outline
from ..io import FORMATS, read
from ..pipeline.accepted import accepted
from ..registration.signature import Signature, signature
from .index import Index, Known, key_of

__all__ = ["Entry", "entries_in", "entry_of", "looked_at", "suffixes"]

#: Unreadable files that a message names.
NAMED = 3


@dataclass
class Entry:
    """A model of a library.

    Attributes
    ----------
    name : str
    load : callable
        Returns the model; raises `InputError` where its file is not what it was.
    known : Known or None
        None until somebody looks.
    kept : bool
        Whether what is known was kept by an index, and not yet held against the model.
    key : bytes or None
        The index's key; None for models in memory.
    """

    name: str
    load: Callable[[], MultiPatch]
    known: Known | None = None
    kept: bool = False
    key: bytes | None = None


def signature_of(model: MultiPatch) -> Signature:
    """The signature of a model's domain."""
    return signature([Outline(loop) for loop in model.boundary().loops])


def looked_at(model: MultiPatch) -> Known:
    """What a library wants to know of a model."""
    try:
        accepted(model, "c0", "target")
    except InputError as error:
        return Known(signature_of(model), str(error))
    return Known(signature_of(model), None)


def entry_of(name: str, model: MultiPatch) -> Entry:
    """A model in memory."""
    return Entry(name, lambda: model)


def suffixes() -> list[str]:
    """Suffixes of files that may hold a model."""
    return list(dict.fromkeys(suffix for format_ in FORMATS if format_.read for suffix in format_.extensions))


def entries_in(folder: Path, skip_unreadable: bool, index: Index | None) -> tuple[list[Entry], list[str]]:
    """The models of a folder with what is known of them, and notes on what was left out.

    Raises
    ------
    InputError
        When the folder cannot be read or has no models, and on files that cannot be read unless they are to be left
        out, naming the first of them.
    """
    known: dict[bytes, Known] = {}
    fresh: dict[bytes, Known] = {}
    entries: list[Entry] = []
    unreadable: list[str] = []
    contents: list[tuple[Path, bytes]] = []
    for path in _files(folder):
        try:
            contents.append((path, key_of(path, read_bytes(path))))
        except InputError as error:
            unreadable.append(f"{path}: {error}")
    if index is not None:
        known = index.known(key for _, key in contents)
    try:
        for path, key in contents:
            try:
                of = known.get(key) or fresh.get(key) or looked_at(_read_silently(path))
            except InputError as error:
                unreadable.append(str(error))
                continue
            if key not in known:
                fresh[key] = of
            entries.append(Entry(path.name, _loader(path, key), of, key in known, key))
    finally:
        # What is known already is kept when somebody loses patience, too.
        if index is not None and fresh:
            index.keep(fresh)
    notes = [f"left out: {text}" for text in unreadable]
    if unreadable and not (skip_unreadable and entries):
        more = f"; and {len(unreadable) - NAMED} more" if len(unreadable) > NAMED else ""
        said = "; ".join(unreadable[:NAMED]) + more
        if skip_unreadable:
            raise InputError(f"{folder}: none of its {len(unreadable)} files can be read as a model: {said}")
        raise InputError(f"{said}; mend or remove it, or leave it out with --skip-unreadable (skip_unreadable=True)")
    return entries, notes


def _files(folder: Path) -> list[Path]:
    try:
        found = sorted(path for path in folder.iterdir() if not path.name.startswith("."))
    except FileNotFoundError:
        raise InputError(f"{folder}: no such folder; check the path") from None
    except NotADirectoryError:
        raise InputError(f"{folder}: this is a file; name the folder of the models") from None
    except OSError as error:
        raise InputError(f"{folder}: cannot be read ({error.strerror}); check its permissions") from None
    able = suffixes()
    files = [path for path in found if path.suffix.lower() in able and not path.is_dir()]
    if not files:
        raise InputError(f"{folder}: no models; none of its {len(found)} files ends in {', '.join(able)}")
    return files


def _read_silently(path: Path) -> MultiPatch:
    """A model without the warnings on its file, which come when it is transferred."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)
        return read(path)


def _loader(path: Path, key: bytes) -> Callable[[], MultiPatch]:
    def load() -> MultiPatch:
        try:
            same = key_of(path, read_bytes(path)) == key
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        if not same:
            raise InputError(f"{path}: changed since the library was opened; open it again")
        return read(path)

    return load


def names_and_models(models: Mapping[str, MultiPatch]) -> list[Entry]:
    """Entries of models in memory.

    Raises
    ------
    InputError
        On none, and on what is no model.
    """
    if not isinstance(models, Mapping):
        raise InputError(
            f"models must be a mapping of names to MultiPatch, got {type(models).__name__}; "
            "Library.open(folder) takes those of a folder"
        )
    if not models:
        raise InputError("the library is empty; give it models")
    for name, model in models.items():
        if not isinstance(model, MultiPatch):
            raise InputError(f"models[{name!r}] must be a MultiPatch (see read), got {type(model).__name__}")
    return [entry_of(str(name), model) for name, model in models.items()]
