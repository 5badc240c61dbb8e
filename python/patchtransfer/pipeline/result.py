"""The result of a transfer with all its evidence."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from html import escape
from typing import TYPE_CHECKING, Any

from ..errors import InputError, TransferError
from ..fitting.fit import FittedBoundary
from ..geometry.display import as_page
from ..geometry.labels import plain
from ..geometry.multipatch import MultiPatch
from ..gradients.frozen import Frozen
from ..interior.polish_report import PolishReport
from ..interior.under_rows import ActiveRows
from ..measure.common_layout import same_layout
from ..measure.continuity import ContinuityReport, check_continuity
from ..measure.quality import Quality
from ..measure.similarity import Similarity, similarity
from ..proof.certificate import Certificate
from ..registration.missed_tabs import tab_text
from ..registration.register import Registration
from .divisions import SourceSplit
from .posed import Failure
from .sliding import SlideReport

if TYPE_CHECKING:
    from ..paper.method import PaperHistory

__all__ = [
    "MIRROR_IMAGE",
    "BoundaryMissedError",
    "NotCertifiedError",
    "TransferResult",
    "corners_in_words",
    "failure_of",
    "functions_of_place",
    "split_advice",
]

#: Corners that a message names.
NAMED = 5
MIRROR_IMAGE = (
    "the target looks like a mirror image of the source: --mirror auto (mirror='auto') mirrors the source for it"
)


@dataclass(frozen=True, eq=False)
class TransferResult:
    """A transferred parameterization and its evidence.

    Attributes
    ----------
    multipatch : MultiPatch
        The source's patches, degrees, knots and interfaces on the target; where `split` is not None, the pieces'.
    certificate : Certificate
        Proof of injectivity, or where it fails.
    quality : Quality
        Scaled Jacobian and condition number (paper Eq. 19-21).
    continuity : ContinuityReport
        Gaps, C1 residual, kink angles and AS-G1 residual across interfaces; measured when asked for.
    rows : ActiveRows or None
        The continuity rows that the result satisfies; None for ``continuity="c0"``, and where no injective map was
        found to apply them to.
    boundary_error : float
        Hausdorff distance of the boundary to the target, relative to the target's diameter.
    missed : bool
        Whether that is above five times the fit tolerance: what is certified then is another shape.
    registration : Registration
        Which boundary points correspond, with a confidence.
    fitted : FittedBoundary
        Boundary curves with the error of every side.
    corner_bound : float
        Upper bound of the minimum scaled Jacobian that the boundary's corners alone impose (1 without corners).
    method : str
    log : tuple of str
        What each rung of the method did.
    failure : Failure or None
        Why the fitted boundary itself rules out an injective map, or its proof; the map is only an illustration then,
        and the log's last entry the reason.
    warnings : tuple of str
    timings : dict
        Seconds per stage.
    paper_history : PaperHistory or None
        Iterations, flips, bounds and energies of ``method="paper"``.
    sliding : SlideReport or None
        Energies of the sliding joints' rounds; None where no joints were to slide.
    stopped : str or None
        Why the search ended early, where its time or its budget of steps did not suffice.
    polish : PolishReport or None
        What a polish came to; None where none was asked for, or nothing could be proved (a warning says why).
    refined : bool
        Whether the source got more knots, so that the result's spline space is not the source's.
    split : SourceSplit or None
        How the source was split so that corners of the target have joints, and which patch comes from which of the
        source's; None where the patches are the source's own.
    split_in_vain : bool
        Whether splitting the source was tried, and the source as it is did better.
    refined_in_vain : bool
        Whether a uniform refinement of the source was tried, and found no certified map either.
    mirrored : bool
        Whether the source was mirrored (x -> -x) for a target that is a mirror image; its patches have the other hand.
    looks_mirrored : bool
        Whether the target looks like a mirror image, and the source was not mirrored. It is looked at where the shapes
        fit poorly or nothing certified was found, without landmarks.
    """

    multipatch: MultiPatch
    certificate: Certificate
    quality: Quality
    rows: ActiveRows | None
    boundary_error: float
    missed: bool
    registration: Registration
    fitted: FittedBoundary
    corner_bound: float
    method: str
    log: tuple[str, ...]
    failure: Failure | None
    warnings: tuple[str, ...]
    timings: dict[str, float]
    paper_history: PaperHistory | None = None
    sliding: SlideReport | None = None
    stopped: str | None = None
    polish: PolishReport | None = None
    refined: bool = False
    split: SourceSplit | None = None
    split_in_vain: bool = False
    refined_in_vain: bool = False
    mirrored: bool = False
    looks_mirrored: bool = False
    _source: MultiPatch | None = field(default=None, repr=False)
    _freeze: Callable[[], Frozen] | None = field(default=None, repr=False)

    def __getstate__(self) -> dict[str, Any]:
        # The plan stays where it is.
        return {name: value for name, value in self.__dict__.items() if name != "_freeze"}

    def freeze(self) -> Frozen:
        """The map as a smooth function of its boundary, with derivatives; see `TransferPlan.freeze`.

        Raises
        ------
        NotCertifiedError
            When the map is not certified.
        InputError
            When the map is polished, or the result comes from another process.
        """
        if not self.certificate.injective:
            raise NotCertifiedError(f"freeze: the map is not certified ({self.certificate.status})", self)
        if self.polish is not None and self.polish.power > 1:
            raise InputError(
                "freeze: the map is polished, and derivatives are those of a minimum of the energy itself, which it is "
                "no more; transfer without polish (polish=None)"
            )
        if self._freeze is None:
            raise InputError(
                "freeze: this result comes from another process, and its plan is there; "
                "use plan.freeze(result.multipatch.topology.coordinates)"
            )
        return self._freeze()

    @cached_property
    def continuity(self) -> ContinuityReport:
        """Gaps, C1 residual, kink angles and AS-G1 residual across interfaces."""
        return check_continuity(self.multipatch)

    @cached_property
    def dilatation(self) -> Similarity:
        """Dilatation of the map from the source to the result, with what every map has at least; see `similarity`.

        The source is the one that was transferred: with the knots, the splits and the mirror image that it took.

        Raises
        ------
        InputError
            When degrees exceed 14 (7 of rational patches).
        """
        return self._similarity(energy=True)

    def _similarity(self, energy: bool) -> Similarity:
        if self._source is None:
            raise InputError("dilatation: this result was not transferred from a source; compare it with `similarity`")
        return similarity(self._source, self.multipatch, energy=energy)

    @cached_property
    def _reported_similarity(self) -> Similarity | None:
        """For reports, without what takes time; None where models cannot be compared."""
        source = self._source
        return None if source is None or same_layout(source, self.multipatch) else self._similarity(energy=False)

    @property
    def succeeded(self) -> bool:
        """Whether the map is proved injective and its boundary meets the target."""
        return self.certificate.injective and not self.missed

    @property
    def fit_failed(self) -> bool:
        """Whether the fitted boundary itself rules out an injective map, or its proof."""
        return self.failure is not None

    def with_warnings(self, texts: Sequence[str]) -> TransferResult:
        """The result with more warnings."""
        return replace(self, warnings=(*self.warnings, *texts))

    def to_dict(self) -> dict[str, Any]:
        """Everything but the geometry, ready for JSON."""
        return {
            "certificate": self.certificate.to_dict(),
            "quality": self.quality.to_dict(),
            "corner_bound": self.corner_bound,
            "similarity": self._reported_similarity and self._reported_similarity.to_dict(),
            "continuity": self.continuity.to_dict() | {"rows": None if self.rows is None else self.rows.to_dict()},
            "boundary_error": self.boundary_error,
            "boundary_missed": self.missed,
            "refined": self.refined,
            "split": None if self.split is None else self.split.to_dict(),
            "mirrored": self.mirrored,
            "registration": {
                "joints": [{"source": a.tolist(), "target": b.tolist()} for a, b in self.registration.joints],
                "confidence": self.registration.confidence,
                "margin": self.registration.margin,
                "mismatch": self.registration.mismatch._asdict(),
                "expected": self.registration.expected and self.registration.expected.to_dict(),
                "landmarks": self.registration.landmarks.tolist(),
                "missed_corners": [corner.to_dict() for corner in self.registration.missed_corners],
                "missed_tabs": [tab.to_dict() for tab in self.registration.missed_tabs],
                "runner_up": self.registration.runner_up and self.registration.runner_up.to_dict(),
            },
            "labels": plain(self.multipatch.sides),
            "method": self.method,
            "polish": None if self.polish is None else self.polish.to_dict(),
            "log": list(self.log),
            "paper_history": None if self.paper_history is None else self.paper_history.to_dict(),
            "timings": self.timings,
            "warnings": list(self.warnings),
            "error": None,
        }

    def to_html(self) -> str:
        """The report as one self-contained HTML document: pictures to look into, certificate, quality, continuity.

        Examples
        --------
        >>> import patchtransfer as pt
        >>> page = pt.transfer(*pt.examples.load("star")).to_html()
        >>> page[:15], "certified" in page, "://" in page
        ('<!doctype html>', True, False)
        """
        return as_page(self)

    def __repr__(self) -> str:
        return (
            f"<TransferResult: {self.certificate.status}, scaled Jacobian "
            f"{self.quality.scaled_jacobian.min:.3f} / {self.quality.scaled_jacobian.mean:.3f}, boundary error "
            f"{self.boundary_error:.1e}>"
        )

    def _repr_svg_(self) -> str | None:
        return self.multipatch._repr_svg_()

    def _repr_html_(self) -> str:
        summary = escape(repr(self)[1:-1])
        return f"<p>{summary}</p>{self.multipatch._repr_html_()}"


class NotCertifiedError(TransferError):
    """The best map found has no proof of injectivity.

    Attributes
    ----------
    result : TransferResult or None
        The best map found, with its certificate and metrics.
    """

    def __init__(self, message: str, result: TransferResult | None = None) -> None:
        super().__init__(message)
        self.result = result


class BoundaryMissedError(NotCertifiedError):
    """The map is certified, but its boundary is not the target: the certificate proves another shape."""


def failure_of(result: TransferResult) -> NotCertifiedError | None:
    """The error of a transfer without a certified map of the target; None for a success."""
    if result.succeeded:
        return None
    tabs = result.registration.missed_tabs
    if result.certificate.injective:
        side = max((side for sides in result.fitted.loops for side in sides), key=lambda side: side.error)
        x, y = side.curve(sum(side.curve.domain) / 2).tolist()
        tried = "even with more knots" if result.refined else "try --refine auto (refine='auto') or more landmarks"
        advice = split_advice(result)
        tried += f"; {advice}" if advice else ""
        tried += f"; {tab_text(tabs)}" if tabs else ""
        tried += f"; {MIRROR_IMAGE}" if result.looks_mirrored else ""
        return BoundaryMissedError(
            f"the boundary misses the target by {result.boundary_error:.2g} of its diameter, most along the side "
            f"about ({x:.4g}, {y:.4g}): {tried}; --keep-uncertified (on_failure='return') gives the map",
            result,
        )
    failure = result.failure
    reasons = "; ".join(result.certificate.reasons[:3]) if failure is None else failure.reason
    cut = "" if result.stopped is None else f"; {result.stopped}"
    # More knots or landmarks do not help where the target itself is in doubt.
    in_vain = failure is not None and failure.of_target
    knots = "more knots did not help; try" if result.refined_in_vain else "try --refine auto (refine='auto') or"
    own = "or a source with a layout of the target's own (parameterize)"
    more = "" if in_vain else f"{knots} more landmarks, {own}; "
    advice = split_advice(result)
    more += f"{advice}; " if advice else ""
    more += f"{tab_text(tabs)}; " if tabs else ""
    more += f"{MIRROR_IMAGE}; " if result.looks_mirrored else ""
    return NotCertifiedError(
        f"no certified map was found ({result.certificate.status}): {reasons}{cut}; {more}--keep-uncertified "
        "(on_failure='return') gives the best map",
        result,
    )


def split_advice(result: TransferResult) -> str | None:
    """To split the source, where the target has corners without joints and it was not tried."""
    corners = [(corner.x, corner.y) for corner in result.registration.missed_corners]
    if not corners or result.split_in_vain:
        return None
    return (
        f"--split auto (split='auto') splits the source's patches, so that {corners_in_words(corners)} of the target "
        "get joints"
    )


def functions_of_place(source: MultiPatch) -> list[str]:
    """A note on what the source's file says of places, for a result that has them elsewhere."""
    named = [block.name for block in source.blocks if block.of_place]
    if not named:
        return []
    return [f"{', '.join(named)}: kept as written for the source; functions of x and y now mean other places on it"]


def corners_in_words(corners: Sequence[tuple[float, float]]) -> str:
    """Corners by their coordinates, the first few of them."""
    places = ", ".join(f"({x:.4g}, {y:.4g})" for x, y in corners[:NAMED])
    more = f" and {len(corners) - NAMED} more" if len(corners) > NAMED else ""
    return f"{len(corners)} corner{'' if len(corners) == 1 else 's'} {places}{more}"
