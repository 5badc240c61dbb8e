"""`transfer`: a plan made for one target."""

from __future__ import annotations

from typing import Unpack

from numpy.typing import ArrayLike

from ..geometry.boundary import Boundary
from ..geometry.multipatch import MultiPatch
from ..progress import Progress
from .options import SearchOptions
from .plan import TransferPlan
from .result import TransferResult

__all__ = ["transfer"]


def transfer(
    source: MultiPatch,
    target: Boundary,
    landmarks: ArrayLike | None = None,
    continuity: str = "c1",
    method: str = "certified",
    progress: Progress | None = None,
    **options: Unpack[SearchOptions],
) -> TransferResult:
    """Transfer a multi-patch parameterization to a target boundary.

    Parameters
    ----------
    source : MultiPatch
        Polynomial patches, injective, connected.
    target : Boundary
        Closed loops in any order, sense, start, segmentation and degree; as many as the source has.
    landmarks : (r, 4) array, optional
        Rows (xs, ys, xt, yt) of corresponding boundary points, or pairs (source point, target point); see `register`.
    continuity : {"c0", "c1", "g1"}, default "c1"
        Continuity across patches: "c1" keeps C1 rows along interfaces, with the ratio of speeds that the C0 solution
        has, and vertex rows at extraordinary vertices (paper Eq. 10 and 11). "g1" is exact along whole interfaces
        (analysis-suitable gluing) and needs splines with enough freedom: degree 3 or more, inner knots of C^(p - 2),
        two spans where the degree is 3 (`MultiPatch.elevate`, `split_spans`, `reduce_continuity`). See
        ``docs/continuity.md``.
    method : {"certified", "paper"}, default "certified"
        "certified" optimises the spline itself and proves the result. "paper" follows Xu, Xiao, Xu, Gu, CMES
        137(2), 2023: fit at uniform parameters, harmonic map on a triangulated control net, fold-over removal by
        bounded distortion, distortion descent; its result is certified as well, but nothing forces it to be injective.
    progress : callable, optional
        Called as ``progress(stage, step, energy, smallest_determinant)``: before every Newton step, and with step 0 and
        NaN for the numbers when a stage begins. Stages are "feasibility", "registration", "fitting", "refinement",
        "sliding", "optimisation", "continuity rows", "polish", "certificate" and "quality", as in the result's
        ``timings``, and those of the paper's method; Newton steps go by what is tried, as in the result's ``log``:
        "optimise", "under continuity rows: optimise" and so on. Where the callable has a method ``ended(stage, seconds,
        found)``, that is called when a stage ends, with its seconds, without those of stages inside, and the figures
        that matter.
    refine : {"auto", "never", "tolerance"}, default "auto"
        "auto" inserts knots into the source, in whole strips of patches, where its boundary misses the target by
        more than five times `fit_tolerance`, until it is met, and refines the source uniformly once if no certified
        map is found; the result's ``refined`` and a warning tell. "tolerance" does so wherever the boundary misses by
        more than `fit_tolerance`, and with method "paper", which "auto" leaves alone, as well. Neither splits
        patches: that is `split`.
    split : {"never", "auto"}, default "never"
        "auto" splits the source's patches, in whole strips, where the target has corners that no joint of the source
        takes: the same geometry, more patches, and every corner gets a joint. Where a corner of the source that one
        patch fills lies on a smooth place of the target, where the patch would be degenerate, a second patch is made,
        or the patch is left out with a feature that the target lacks. The result's ``split`` and a warning tell;
        refine="auto" acts above `fit_tolerance` then. Where no certified map of the target is found so, the source is
        taken as it is, if that does better.
    mirror : {"never", "auto"}, default "never"
        "auto" takes the target for a mirror image of the source where that fits clearly better, or where landmarks are
        in decreasing order: the source is mirrored (x -> -x) first, so that its right-handed patches become
        left-handed, and u, v, labels and interfaces stay. Landmarks, and those of the result's ``registration``, have
        the source's own coordinates. The result's ``mirrored`` and a warning tell.
    fit_tolerance : float, default 1e-3
        Boundary error, relative to the target's diameter, that the fit should reach.
    fixed_correspondence : bool, optional
        False lets boundary joints that are neither corners nor landmarks slide along the target to lower the
        distortion (see `slide_joints`); True keeps all. Default False, but True with method "paper".
    correspondence : {"best", "runner-up"}, default "best"
        Which of the correspondences found without landmarks to take: where two fit nearly as well (a low
        ``registration.margin``), the other one may be what is wanted.
    on_failure : {"raise", "return"}, default "raise"
        What to do when no certified map is found, or one that misses the target by more than five times
        `fit_tolerance`: raise `NotCertifiedError` or its subclass `BoundaryMissedError` (the best map is its
        ``result``), or return the result with ``succeeded == False``.
    time_limit : float, optional
        Seconds, counted from when the source is prepared, after which searches end with the best map so far; a warning
        says so. They look at the clock between steps. A result that was cut may differ from run to run, others do not
        depend on the limit. Default none: a budget of Newton steps ends what has no hope
        (``docs/stages/optimisation.md``).
    paper_options : PaperOptions, optional
        Choices of ``method="paper"``, each with the paper's section: see `PaperOptions`.
    c1_share : float, optional
        With continuity "c1": knots are inserted, in whole strips of patches, where interfaces are not C1, until this
        part of their length is (the result's ``continuity.c1_share``); warnings say so, or what stops it. Default none:
        where less than half is, a warning says so.
    ratios : {"target", "source"}, default "target"
        Whether continuity rows follow the speeds and frames of the C0 solution, or those of the source. The source's
        are the same for all targets, so that all results lie in one linear space, but for rows that are released: what
        is interpolated between two of them keeps the rows that both have.
    polish : {"scaled_jacobian", "dilatation"}, optional
        What the worst place of the map is to be better in, under the same rows, at about the time of the transfer again
        (``docs/stages/polish.md``): the smallest scaled Jacobian, or the largest dilatation of the map from the source.
        The proved number is never worse; the result's ``polish`` tells. Mean distortion is no longer the least, so that
        such a result has no `freeze`. Default none.

    Returns
    -------
    TransferResult

    Raises
    ------
    InputError
        On a folded or disconnected source, one with weights for "g1" or the paper's method, bad landmarks or options.
    InfeasibleTargetError
        When no injective parameterization with this topology exists on the target.
    NotCertifiedError, BoundaryMissedError
        See `on_failure`.

    Examples
    --------
    >>> import patchtransfer as pt
    >>> source, target, landmarks = pt.examples.load("star")
    >>> result = pt.transfer(source, target, landmarks)
    >>> result.certificate.status, len(result.multipatch)
    ('certified', 6)
    >>> result.boundary_error < 1e-3
    True
    """
    plan = TransferPlan(source, continuity, ratios=options.get("ratios") or "target")
    return plan.transfer(target, landmarks, progress=progress, method=method, **options)
