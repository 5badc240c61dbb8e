"""A library of models: which of them to transfer to a target, by cheap looks at all and dear ones at few."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Unpack

from ..errors import InfeasibleTargetError, InputError
from ..geometry.boundary import Boundary
from ..geometry.multipatch import MultiPatch
from ..interior.solver import CONTINUITY
from ..pipeline.options import TransferOptions, options_of
from ..progress import Progress
from ..registration.expected import POOR
from .choice import LibraryResult
from .entries import entries_in, names_and_models
from .index import Index, default_folder
from .models import Models
from .ranked import Ranked
from .search import Search

__all__ = ["Library"]

#: Candidates that are registered. Registration costs 0.1 to 0.3 s, a signature 10 ms and its comparison nothing: with
#: 12 of 40 models the best three by registration are as good as those of all, with 8 they are not.
KEEP = 12
#: Transfers: after registration one costs a fraction of it, and the best of three is nearly the best of all.
TRIES = 3


class Library:
    """Models to choose a source from.

    A target is compared with all models by a signature, with the nearest by registration, and transferred from the
    best of these; the best proved result is taken.

    Parameters
    ----------
    models : mapping of str to MultiPatch
        At least one; `Library.open` takes the files of a folder.
    continuity : {"c0", "c1", "g1"}, default "c0"
        Of the transfers, as in `transfer`.

    Attributes
    ----------
    names : tuple of str
    continuity : str
    notes : tuple of str
        Files that were left out, and what could not be kept.

    Raises
    ------
    InputError
        On no models, on what is no model, and on another continuity.

    Examples
    --------
    >>> from patchtransfer import Library, examples
    >>> library = Library({name: examples.load(name)[0] for name in ("wrench", "human", "star")})
    >>> _, target, _ = examples.load("star")
    >>> [candidate.name for candidate in library.rank(target)][0]
    'star'
    >>> library.transfer(target)
    <LibraryResult: star of 3, certified>
    """

    def __init__(self, models: Mapping[str, MultiPatch], continuity: str = "c0") -> None:
        self._models = Models(names_and_models(models), _checked(continuity), None, ())

    @classmethod
    def open(
        cls,
        folder: str | Path,
        continuity: str = "c0",
        *,
        skip_unreadable: bool = False,
        cache: str | Path | bool = True,
    ) -> Library:
        """The models in a folder; their names are those of the files.

        Files are read when the library looks at them for the first time, later only those that are transferred: what
        was found is kept under a digest of the file's bytes. Files of other suffixes than those of models, hidden ones
        and folders inside are passed over.

        Parameters
        ----------
        folder : path
        continuity : {"c0", "c1", "g1"}, default "c0"
        skip_unreadable : bool, default False
            Leave out files that are no models, with a note, instead of refusing them.
        cache : path or bool, default True
            Folder for what is kept (one file, ``signatures.sqlite``, about 1 kB a model); made if it does not exist.
            True takes the one that the environment variable PATCHTRANSFER_CACHE names, else the user's own for caches,
            and goes without, with a note, where that cannot be written. False keeps nothing.

        Raises
        ------
        InputError
            On a folder without models, on files that cannot be read, and where `cache` is a folder that cannot be used.
        """
        notes: list[str] = []
        index = None
        if cache is not False:
            try:
                index = Index(default_folder() if cache is True else Path(cache))
            except InputError as error:
                if cache is not True:
                    raise
                notes.append(f"signatures are worked out again each time: {error}")
        entries, left_out = entries_in(Path(folder), skip_unreadable, index)
        library = cls.__new__(cls)
        library._models = Models(entries, _checked(continuity), index, [*notes, *left_out])
        return library

    @property
    def continuity(self) -> str:
        """Of the transfers."""
        return self._models.continuity

    @property
    def names(self) -> tuple[str, ...]:
        """Of the models."""
        return tuple(self._models.entries)

    @property
    def notes(self) -> tuple[str, ...]:
        """Files that were left out, and what could not be kept."""
        return self._models.notes

    def __len__(self) -> int:
        return len(self._models.entries)

    def __iter__(self) -> Iterator[str]:
        return iter(self._models.entries)

    def __getitem__(self, name: str) -> MultiPatch:
        return self._models.entries[name].load()

    def __repr__(self) -> str:
        return f"<Library: {len(self)} models, continuity {self.continuity}>"

    def rank(
        self,
        target: Boundary,
        *,
        keep: int = KEEP,
        progress: Progress | None = None,
        **options: Unpack[TransferOptions],
    ) -> list[Ranked]:
        """All models as candidates for a target, the best first; nothing is transferred.

        Parameters
        ----------
        target : Boundary
        keep : int, default 12
            Candidates that are registered, the nearest ones by signature.
        progress : callable, optional
            As in `transfer`.
        **options
            As of `transfer`; those on the correspondence matter.

        Returns
        -------
        list of Ranked
            First those that were registered, by `score`, then those that were not, by `distance`, then those with
            another number of loops.

        Raises
        ------
        InfeasibleTargetError
            On a target that crosses itself, and where no model has as many loops.
        """
        search = Search(self._models, target, options, progress)
        search.register(keep)
        if not search.begun and not any(c.stage == "registration" for c in search.candidates.values()):
            raise InfeasibleTargetError(search.no_candidate())
        return search.ordered()

    def transfer(
        self,
        target: Boundary,
        tries: int = TRIES,
        *,
        keep: int = KEEP,
        parameterize: bool = True,
        progress: Progress | None = None,
        **options: Unpack[TransferOptions],
    ) -> LibraryResult:
        """The best that the models give for a target.

        Parameters
        ----------
        target : Boundary
        tries : int, default 3
            Models that are transferred, the best ones by registration; more of them while none is certified.
        keep : int, default 12
            As in `rank`.
        parameterize : bool, default True
            Where no model gives a certified map with a scaled Jacobian of at least 0.1, try a layout of the target's
            own (`parameterize`), too.
        progress : callable, optional
            As in `transfer`.
        **options
            As of `transfer`; a `time_limit` is each transfer's own.

        Returns
        -------
        LibraryResult
            The certified map with the largest proved minimum of the scaled Jacobian; `str` of it is a table.

        Raises
        ------
        InfeasibleTargetError
            On a target that crosses itself, and without `parameterize` where no model has as many loops.
        NoModelFitsError
            Where nothing is certified, unless ``on_failure="return"``; its `result` has the reasons.
        """
        if tries < 1:
            raise InputError(f"tries must be at least 1, got {tries}")
        search = Search(self._models, target, options, progress)
        search.register(keep)
        if not search.begun and not parameterize and search.none_of_these_loops():
            raise InfeasibleTargetError(search.no_candidate())
        search.transfer(tries)
        if parameterize and search.least < POOR:
            search.parameterize()
        result = search.result()
        failure = result.failure if options_of(options).on_failure == "raise" else None
        if failure is not None:
            raise failure
        return result


def _checked(continuity: str) -> str:
    if continuity not in CONTINUITY:
        raise InputError(f"continuity must be one of {', '.join(CONTINUITY)}, got {continuity!r}")
    return continuity
