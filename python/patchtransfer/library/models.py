"""The models of a library with what is known of them, and plans of those that are transferred."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

from ..geometry.multipatch import MultiPatch
from ..pipeline.plan import TransferPlan
from .entries import Entry, looked_at
from .index import Index, Known

__all__ = ["Models", "StaleError"]

#: Plans that are kept for further targets.
PLANS = 32
#: Signatures of one content differ by rounding of other machines at most.
SAME = 1e-9


class StaleError(Exception):
    """What was kept of a model is not what is found now."""


class Models:
    """Models by name.

    Parameters
    ----------
    entries : sequence of Entry
    continuity : str
        Of the plans.
    index : Index or None
        What keeps what is known.
    notes : sequence of str

    Attributes
    ----------
    entries : dict of Entry
    continuity : str
    notes : tuple of str
        Files that were left out, and what could not be kept.
    """

    def __init__(self, entries: Sequence[Entry], continuity: str, index: Index | None, notes: Sequence[str]) -> None:
        self.entries = {entry.name: entry for entry in entries}
        self.continuity, self.notes = continuity, tuple(notes)
        self._index = index
        self._plan = lru_cache(PLANS)(self._new_plan)

    def known(self) -> dict[str, Known]:
        """What is known of all; models in memory are looked at when somebody asks for the first time."""
        found = {}
        for name, entry in self.entries.items():
            if entry.known is None:
                entry.known = looked_at(entry.load())
            found[name] = entry.known
        return found

    def plan(self, name: str) -> TransferPlan:
        """The plan of a model.

        Raises
        ------
        InputError
            On a model that cannot be transferred, and a file that has changed.
        StaleError
            When the model is not what was kept of it.
        """
        return self._plan(name)

    def _new_plan(self, name: str) -> TransferPlan:
        return TransferPlan(self._checked(self.entries[name]), self.continuity)

    def _checked(self, entry: Entry) -> MultiPatch:
        """A model; what an index has kept of it is held against it."""
        model = entry.load()
        if entry.kept:
            now = looked_at(model)
            assert entry.known is not None
            if now.refusal != entry.known.refusal or not entry.known.signature.distance(now.signature) <= SAME:
                raise StaleError(entry.name)
            entry.kept = False
        return model

    def look_again(self) -> None:
        """Work out anew what was kept: it was not what is found now, though the content is the same."""
        assert self._index is not None
        for entry in self.entries.values():
            entry.known, entry.kept = looked_at(entry.load()), False
        self._index.keep({e.key: e.known for e in self.entries.values() if e.key is not None and e.known is not None})
        note = f"{self._index.path}: what was kept there is not what the models are; it was worked out again"
        self.notes = (*self.notes, note)
