"""Options of a transfer, once: their names, defaults and what they may be."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import KW_ONLY, dataclass, field, fields, replace
from numbers import Real
from typing import TYPE_CHECKING, Self, TypedDict, cast

from ..errors import InputError
from ..interior.polish_report import GOALS
from ..progress import Budget, Clock, Progress
from ..records import DEBUG, WARNING, record

if TYPE_CHECKING:
    from ..paper.options import PaperOptions

__all__ = ["CHOICES", "MISSED", "Options", "Run", "SearchOptions", "TransferOptions", "options_of"]

#: A boundary error above so many fit tolerances is no success: the target was missed, not met roughly.
MISSED = 5.0
CHOICES = {
    "method": ("certified", "paper"),
    "refine": ("auto", "never", "tolerance"),
    "split": ("never", "auto"),
    "mirror": ("never", "auto"),
    "correspondence": ("best", "runner-up"),
    "on_failure": ("raise", "return"),
    "ratios": ("target", "source"),
    "polish": GOALS,
}
#: Options that may be None: the plan's own, or nothing.
OPEN = ("ratios", "polish")


class SearchOptions(TypedDict, total=False):
    """`Options` but the method, as keyword arguments."""

    refine: str
    split: str
    mirror: str
    fit_tolerance: float
    fixed_correspondence: bool | None
    correspondence: str
    on_failure: str
    time_limit: float | None
    paper_options: PaperOptions | None
    c1_share: float | None
    ratios: str | None
    polish: str | None


class TransferOptions(SearchOptions, total=False):
    """`Options` as keyword arguments."""

    method: str


@dataclass(frozen=True)
class Options:
    """Options of a transfer; `patchtransfer.transfer` says what they mean.

    Raises
    ------
    InputError
        On a value that an option cannot have, naming both.
    """

    method: str = "certified"
    refine: str = "auto"
    fit_tolerance: float = 1e-3
    _: KW_ONLY
    split: str = "never"
    mirror: str = "never"
    fixed_correspondence: bool | None = None
    correspondence: str = "best"
    on_failure: str = "raise"
    time_limit: float | None = None
    paper_options: PaperOptions | None = None
    c1_share: float | None = None
    ratios: str | None = None
    polish: str | None = None

    def __post_init__(self) -> None:
        for name, choices in CHOICES.items():
            value = getattr(self, name)
            if value not in choices and not (name in OPEN and value is None):
                raise InputError(f"{name} must be one of {', '.join(choices)}, got {value!r}")
        if not (_number(self.fit_tolerance) and 0 < self.fit_tolerance < 1):
            raise InputError(f"fit_tolerance must lie between 0 and 1, got {self.fit_tolerance!r}")
        # A comparison with NaN is false as well.
        if self.time_limit is not None and not (_number(self.time_limit) and self.time_limit > 0):
            raise InputError(f"time_limit must be a positive number of seconds, or None, got {self.time_limit!r}")
        if self.c1_share is not None and not (_number(self.c1_share) and 0 < self.c1_share <= 1):
            raise InputError(f"c1_share must lie between 0 and 1, or be None, got {self.c1_share!r}")
        if self.method == "paper" and self.c1_share is not None:
            raise InputError('c1_share inserts knots with method="certified" only; leave it out')
        if self.method == "paper" and self.fixed_correspondence is not None and not self.fixed_correspondence:
            raise InputError('joints slide with method="certified" only; leave fixed_correspondence out')
        if self.method == "paper" and self.polish is not None:
            raise InputError('polish is for method="certified" only; leave it out')
        if self.paper_options is not None:
            self._check_paper_options()

    def _check_paper_options(self) -> None:
        from ..paper.options import PaperOptions  # Transfers by the other method load nothing of this one.

        if not isinstance(self.paper_options, PaperOptions):
            raise InputError(f"paper_options must be PaperOptions, got {type(self.paper_options).__name__}")
        if self.method != "paper":
            raise InputError('paper_options go with method="paper" only; ask for it, or leave them out')

    def __repr__(self) -> str:
        # What is not a default says what a run was about.
        given = [f.name for f in fields(self) if getattr(self, f.name) != f.default]
        return f"{type(self).__name__}({', '.join(f'{name}={getattr(self, name)!r}' for name in given)})"

    def decided(self, continuity: str) -> Self:
        """The options for a plan of this continuity, with their default for joints: the paper's stay where they are."""
        if self.c1_share is not None and continuity != "c1":
            raise InputError(f'c1_share is for continuity="c1", this plan has "{continuity}"; leave it out')
        if self.fixed_correspondence is not None:
            return self
        return replace(self, fixed_correspondence=self.method == "paper")

    @property
    def refines(self) -> bool:
        """Whether the source may get more knots: the paper's method is a baseline, and does so on demand only."""
        return self.refine == "tolerance" or (self.refine == "auto" and self.method != "paper")

    @property
    def refined_beyond(self) -> float:
        """Boundary error above which knots are inserted into the source."""
        if not self.refines:
            return math.inf
        # A source that is split for its target has no space in common with other results any more.
        rarely = self.refine == "auto" and self.split == "never"
        return self.fit_tolerance * (MISSED if rarely else 1.0)

    def keywords(self) -> TransferOptions:
        """As keyword arguments of a transfer."""
        return cast(TransferOptions, {field.name: getattr(self, field.name) for field in fields(Options)})


def _number(value: object) -> bool:
    return isinstance(value, Real)


def options_of(given: TransferOptions) -> Options:
    """Options from keyword arguments.

    Raises
    ------
    TypeError
        On a name that no option has, as functions do.
    """
    unknown = sorted(set(given) - set(Options.__dataclass_fields__))
    if unknown:
        names = ", ".join(sorted(Options.__dataclass_fields__))
        raise TypeError(f"a transfer has no option {unknown[0]!r}; its options are {names}")
    return Options(**given)


#: Part of a search's work for a whole transfer: 2 to 3 s on small sources. Of 240 certified maps between drawings none
#: needed more than a tenth of that, so that failing may come soon.
TRANSFER = 0.3


@dataclass(frozen=True)
class Run:
    """What one transfer goes by: its options, where its time goes and how much is left, and whom it tells."""

    options: Options
    clock: Clock
    budget: Budget
    progress: Progress | None = None
    #: Warnings that are records already.
    _recorded: set[str] = field(default_factory=set, compare=False)

    @classmethod
    def of(
        cls, given: TransferOptions, step_cost: float, progress: Progress | None = None, continuity: str = "c1"
    ) -> Run:
        """For options as keyword arguments, and a plan of this continuity on which a Newton step costs `step_cost`."""
        options = options_of(given).decided(continuity)
        return cls(options, Clock(progress), Budget.of_source(step_cost, options.time_limit).part(TRANSFER), progress)

    def warn(self, texts: Iterable[str]) -> None:
        """Tell whom it tells, if they listen, what speaks against the work that begins."""
        texts = list(texts)
        self.record((), texts)
        warned = getattr(self.progress, "warned", None)
        if warned is not None:
            for text in texts:
                warned(text)

    def record(self, decisions: Iterable[str], warnings: Iterable[str]) -> None:
        """Records of what was decided, and of warnings that are new."""
        for text in decisions:
            record(DEBUG, "%s", text)
        for text in warnings:
            if text not in self._recorded:
                self._recorded.add(text)
                # Against one attempt of several is not yet against the result.
                record(DEBUG if self.clock.nested else WARNING, "%s", text)

    def part(self, share: float) -> Run:
        """The run with a share of the work."""
        return replace(self, budget=self.budget.part(share))
