"""A target of a batch: its files, the key of what its result depends on, and its transfer as a row.

What is done here writes into the batch's folder, by whatever process it is done.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from .. import io
from ..errors import InputError, TransferError
from ..files import json_text, write_atomic
from ..geometry.boundary import Boundary
from ..numeric.arrays import FloatArray
from ..pipeline.options import Options
from ..pipeline.plan import TransferPlan
from ..pipeline.result import NotCertifiedError, failure_of

__all__ = ["BatchOptions", "BatchRow", "Job", "digest", "finished", "jobs_of", "keyed", "read", "transferred"]

#: Ends the names of landmark files: they are never targets themselves.
LANDMARKS = ".landmarks.csv"
#: Characters of a path or an error that a row shows of itself: together they fit a line.
NAME = 45


@dataclass(frozen=True, repr=False)
class BatchOptions(Options):
    """Options of every transfer; `time_limit` is each target's own, `keep_uncertified` writes the best maps.

    ``split="auto"`` splits the source once, wherever one of the targets needs it, so that all results have the same
    patches. `clean`, `smooth` and `layers` are those of `read_boundary`.
    """

    keep_uncertified: bool = False
    clean: bool = True
    smooth: bool | None = None
    layers: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "on_failure", "return" if self.keep_uncertified else self.on_failure)


@dataclass(frozen=True)
class BatchRow:
    """One target of a batch.

    Attributes
    ----------
    target : str
        Its path.
    status : str
        The certificate's status, or "failed" without a result.
    ok : bool
        Whether there is a certified result that meets the target.
    skipped : bool
        Whether it was finished before.
    output : str or None
        The result's file.
    min_scaled_jacobian, mean_scaled_jacobian, boundary_error, confidence, seconds : float or None
    patches : int or None
        How many the result has: the same for all, more than the source where it was split.
    refined : bool or None
        Whether the result has more knots than the source, so that it has no coefficients in common with the others.
    mirrored : bool or None
        Whether the source was mirrored for this target.
    landmarks : bool
        Whether a landmarks file was used.
    error : str or None
        What went wrong and what to do.
    """

    target: str
    status: str
    ok: bool
    skipped: bool = False
    output: str | None = None
    min_scaled_jacobian: float | None = None
    mean_scaled_jacobian: float | None = None
    boundary_error: float | None = None
    patches: int | None = None
    refined: bool | None = None
    mirrored: bool | None = None
    confidence: float | None = None
    seconds: float | None = None
    landmarks: bool = False
    error: str | None = None

    def __repr__(self) -> str:
        # The end of a path names the target, the start of an error what went wrong.
        target = self.target if len(self.target) <= NAME else f"…{self.target[1 - NAME :]}"
        error = "" if self.error is None else f", {self.error}".split("\n")[0]
        return f"<BatchRow: {target}, {self.status}{error if len(error) <= NAME else error[: NAME - 1] + '…'}>"


@dataclass(frozen=True)
class Job:
    """A target with its files and the key of everything that its result depends on."""

    target: Path
    landmarks: Path | None
    output: Path
    report: Path
    key: str | None


def jobs_of(source: Path, targets: Sequence[Path], folder: Path) -> list[Job]:
    """The targets with their files, landmarks left out; an `InputError` where names or outputs are in conflict."""
    jobs: dict[str, Job] = {}
    inputs = {path.resolve() for path in (source, *targets)}
    for target in targets:
        if target.name.endswith(LANDMARKS):
            continue
        name = target.stem
        if name in jobs:
            raise InputError(f"{jobs[name].target} and {target} have the same name; rename one, or use two folders")
        landmarks = target.with_name(f"{name}{LANDMARKS}")
        job = Job(
            target,
            landmarks if landmarks.exists() else None,
            folder / f"{name}.xml",
            folder / f"{name}.report.json",
            None,
        )
        if job.output.resolve() in inputs:
            raise InputError(f"{job.output}: the result would replace an input; choose another folder")
        jobs[name] = job
    if not jobs:
        raise InputError(f"no targets (files *{LANDMARKS} hold landmarks of the targets beside them)")
    return list(jobs.values())


def digest(*parts: bytes) -> str:
    """Hash of a sequence of byte strings, each by itself, so that their borders count."""
    return hashlib.sha256(b"".join(hashlib.sha256(part).digest() for part in parts)).hexdigest()


def keyed(job: Job, common: str) -> Job:
    """The job with its key; without one when a file cannot be read: then it fails with the reader's message."""
    try:
        parts = [job.target.read_bytes(), b"" if job.landmarks is None else b"landmarks" + job.landmarks.read_bytes()]
    except OSError:
        return job
    return replace(job, key=digest(common.encode(), *parts))


def finished(job: Job) -> BatchRow | None:
    """The row of a target that was finished with the same inputs and whose result is still there."""
    try:
        batch = json.loads(job.report.read_text())["batch"]
        if job.key is None or batch["key"] != job.key or not batch["row"]["ok"]:
            return None
        if batch["output_sha256"] != hashlib.sha256(job.output.read_bytes()).hexdigest():
            return None
        return BatchRow(**{**batch["row"], "target": str(job.target), "output": str(job.output), "skipped": True})
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        # No report, or one that is not ours: not finished.
        return None


def read(job: Job, options: BatchOptions) -> tuple[Boundary, FloatArray | None]:
    """The target and its landmarks."""
    target = io.read_boundary(job.target, clean=options.clean, smooth=options.smooth, layers=options.layers)
    return target, None if job.landmarks is None else io.read_landmarks(job.landmarks)


def transferred(plan: TransferPlan, job: Job, options: BatchOptions) -> BatchRow:
    """Do one target and write its files; failures become rows."""
    begin = time.perf_counter()
    landmarks = job.landmarks is not None
    content: dict[str, Any] = {}
    try:
        target, points = read(job, options)
        result = plan.transfer(target, points, **options.keywords())
    except BaseException as error:
        if isinstance(error, (KeyboardInterrupt, SystemExit)):
            raise
        # Errors of ours explain themselves; others, a panic of the core among them, must not end the batch either.
        expected = isinstance(error, TransferError)
        text = str(error) if expected else f"{type(error).__name__}: {error} (please report this with the target)"
        status = "failed"
        if isinstance(error, NotCertifiedError) and error.result is not None:
            content, status = error.result.to_dict(), error.result.certificate.status
        row = BatchRow(
            str(job.target), status, False, landmarks=landmarks, seconds=time.perf_counter() - begin, error=text
        )
        written = None
        if job.report.exists():
            # A result of an earlier target of this name.
            job.output.unlink(missing_ok=True)
    else:
        metrics, good = result.quality.scaled_jacobian, result.succeeded
        io.write(result.multipatch, job.output)
        written = hashlib.sha256(job.output.read_bytes()).hexdigest()
        content = result.to_dict() | {"notes": list(target.notes)}
        row = BatchRow(
            str(job.target),
            result.certificate.status,
            good,
            output=str(job.output),
            min_scaled_jacobian=metrics.min,
            mean_scaled_jacobian=metrics.mean,
            boundary_error=result.boundary_error,
            patches=len(result.multipatch),
            refined=result.refined,
            mirrored=result.mirrored,
            confidence=result.registration.confidence,
            seconds=time.perf_counter() - begin,
            landmarks=landmarks,
            error=None if good else str(failure_of(result)),
        )
    content |= {"error": row.error, "batch": {"key": job.key, "output_sha256": written, "row": asdict(row)}}
    # Last, so that a target that was interrupted is not finished.
    write_atomic(job.report, json_text(content))
    return row
