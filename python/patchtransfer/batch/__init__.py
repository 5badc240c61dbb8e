"""Batch: one source to many target files, in processes, resumable, every failure by itself.

For the target ``NAME.svg`` the folder gets ``NAME.xml`` (the result) and ``NAME.report.json``. Landmarks are taken
from ``NAME.landmarks.csv`` beside the target if that file exists. A target counts as finished when its report says so
for these very inputs (the bytes of source, target and landmarks, all options, this version) and the result is still the
file that was written then. Whatever else is in the folder is left alone.
"""

from __future__ import annotations

import csv
import hashlib
import io as memory
import json
import multiprocessing
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

from .. import interruption, io
from .._core import __version__, set_threads
from ..errors import InputError, TransferError
from ..files import json_text, write_atomic
from ..geometry.boundary import Boundary
from ..numeric.arrays import FloatArray
from ..pipeline.options import Options
from ..pipeline.plan import TransferPlan
from ..pipeline.result import NotCertifiedError, failure_of

__all__ = ["BatchOptions", "BatchRow", "run_batch", "write_summary"]

#: Ends the names of landmark files: they are never targets themselves.
LANDMARKS = ".landmarks.csv"
SUMMARY = ("summary.csv", "summary.json")
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
class _Job:
    """A target with its files and the key of everything that its result depends on."""

    target: Path
    landmarks: Path | None
    output: Path
    report: Path
    key: str | None


def run_batch(
    source: str | Path,
    targets: Sequence[str | Path],
    folder: str | Path,
    options: BatchOptions | None = None,
    *,
    continuity: str | None = None,
    workers: int = 1,
    force: bool = False,
    progress: Callable[[BatchRow], None] | None = None,
) -> list[BatchRow]:
    """Transfer a source file to many target files.

    Parameters
    ----------
    source : path
    targets : sequence of paths
        Their names without suffix must differ. Files ``*.landmarks.csv`` among them are passed over, so that
        ``*.csv`` can name the targets.
    folder : path
        For the results; made if it does not exist.
    options : BatchOptions, optional
    continuity : str, optional
        As in `transfer`; default as there.
    workers : int, default 1
        Processes; 1 works in this one. (Scripts that ask for more need ``if __name__ == "__main__":``.)
    force : bool, default False
        Do finished targets again.
    progress : callable, optional
        Called with every row as it is finished.

    Returns
    -------
    list of BatchRow
        In the order of the targets. A target that fails does not end the batch: its row says why.

    Raises
    ------
    InputError
        When the source cannot be used, an option is wrong, two targets have the same name, an output would replace an
        input, or the folder cannot be made.

    Examples
    --------
    >>> import patchtransfer as pt
    >>> source, target, landmarks = pt.examples.load("star")
    >>> import tempfile
    >>> from pathlib import Path
    >>> folder = Path(tempfile.mkdtemp())
    >>> pt.write(source, folder / "source.xml")
    >>> pt.write(target, folder / "target.xml")
    >>> rows = pt.batch.run_batch(folder / "source.xml", [folder / "target.xml"], folder / "results")
    >>> [row.status for row in rows]
    ['certified']
    """
    options = BatchOptions() if options is None else options
    if workers < 1:
        raise InputError(f"workers must be at least 1, got {workers}")
    folder, source = Path(folder), Path(source)
    jobs = _jobs(source, [Path(t) for t in targets], folder)
    model = io.read(source)
    plan = TransferPlan(model) if continuity is None else TransferPlan(model, continuity)
    plan, one = _split(plan, jobs, options)
    division = None if plan.split is None else plan.split.to_dict()
    settings = json.dumps([asdict(options), plan.continuity, division])
    common = _digest(__version__.encode(), source.read_bytes(), settings.encode())
    jobs = [_keyed(job, common) for job in jobs]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: the folder cannot be made ({error.strerror}); choose another one") from None
    rows: dict[Path, BatchRow] = {}

    def done(job: _Job, row: BatchRow) -> None:
        rows[job.target] = row
        if progress is not None:
            progress(row)

    left = []
    for job in jobs:
        finished = None if force else _finished(job)
        if finished is None:
            left.append(job)
        else:
            done(job, finished)
    results = _here(plan, left, one) if workers == 1 else _in_processes(plan, left, one, workers)
    for job, row in results:
        done(job, row)
    return [rows[job.target] for job in jobs]


def _split(plan: TransferPlan, jobs: Sequence[_Job], options: BatchOptions) -> tuple[TransferPlan, BatchOptions]:
    """The plan of a source that has joints for all targets, if that is asked for, and options that keep its patches."""
    if options.split == "never":
        return plan, options
    targets, landmarks = [], []
    for job in jobs:
        # What is wrong with a file is said when its turn comes.
        with suppress(Exception), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            target, points = _read(job, options)
            targets.append(target)
            landmarks.append(points)
    split = plan.split_for(targets, landmarks, skip_failures=True, **options.keywords())
    return split, replace(options, split="never")


def write_summary(rows: Sequence[BatchRow], folder: str | Path) -> None:
    """Write ``summary.csv`` and ``summary.json`` into a folder."""
    table = memory.StringIO()
    writer = csv.DictWriter(table, [f.name for f in fields(BatchRow)], lineterminator="\n")
    writer.writeheader()
    writer.writerows(asdict(row) for row in rows)
    content = {"certified": sum(row.ok for row in rows), "targets": [asdict(row) for row in rows]}
    write_atomic(Path(folder) / SUMMARY[0], table.getvalue())
    write_atomic(Path(folder) / SUMMARY[1], json_text(content))


def _jobs(source: Path, targets: Sequence[Path], folder: Path) -> list[_Job]:
    jobs: dict[str, _Job] = {}
    inputs = {path.resolve() for path in (source, *targets)}
    for target in targets:
        if target.name.endswith(LANDMARKS):
            continue
        name = target.stem
        if name in jobs:
            raise InputError(f"{jobs[name].target} and {target} have the same name; rename one, or use two folders")
        landmarks = target.with_name(f"{name}{LANDMARKS}")
        job = _Job(
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


def _digest(*parts: bytes) -> str:
    """Hash of a sequence of byte strings, each by itself, so that their borders count."""
    return hashlib.sha256(b"".join(hashlib.sha256(part).digest() for part in parts)).hexdigest()


def _keyed(job: _Job, common: str) -> _Job:
    """The job with its key; without one when a file cannot be read: then it fails with the reader's message."""
    try:
        parts = [job.target.read_bytes(), b"" if job.landmarks is None else b"landmarks" + job.landmarks.read_bytes()]
    except OSError:
        return job
    return _Job(job.target, job.landmarks, job.output, job.report, _digest(common.encode(), *parts))


def _finished(job: _Job) -> BatchRow | None:
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


def _read(job: _Job, options: BatchOptions) -> tuple[Boundary, FloatArray | None]:
    """The target and its landmarks."""
    target = io.read_boundary(job.target, clean=options.clean, smooth=options.smooth, layers=options.layers)
    return target, None if job.landmarks is None else io.read_landmarks(job.landmarks)


def _transfer(plan: TransferPlan, job: _Job, options: BatchOptions) -> BatchRow:
    """Do one target and write its files; failures become rows."""
    begin = time.perf_counter()
    landmarks = job.landmarks is not None
    content: dict[str, Any] = {}
    try:
        target, points = _read(job, options)
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
        digest = None
        if job.report.exists():
            # A result of an earlier target of this name.
            job.output.unlink(missing_ok=True)
    else:
        metrics, good = result.quality.scaled_jacobian, result.succeeded
        io.write(result.multipatch, job.output)
        digest = hashlib.sha256(job.output.read_bytes()).hexdigest()
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
    content |= {"error": row.error, "batch": {"key": job.key, "output_sha256": digest, "row": asdict(row)}}
    # Last, so that a target that was interrupted is not finished.
    write_atomic(job.report, json_text(content))
    return row


def _here(plan: TransferPlan, jobs: Iterable[_Job], options: BatchOptions) -> Iterator[tuple[_Job, BatchRow]]:
    for job in jobs:
        yield job, _transfer(plan, job, options)


_worker: tuple[TransferPlan, BatchOptions] | None = None


def _start_worker(plan: TransferPlan, options: BatchOptions) -> None:
    global _worker
    _worker = plan, options
    interruption.ignore()
    # Processes share the cores.
    set_threads(1)


def _in_worker(job: _Job) -> BatchRow:
    assert _worker is not None
    return _transfer(_worker[0], job, _worker[1])


def _in_processes(
    plan: TransferPlan, jobs: Sequence[_Job], options: BatchOptions, workers: int
) -> Iterator[tuple[_Job, BatchRow]]:
    """Rows as they are finished. Jobs of a pool that breaks are done again, each in a process of its own."""
    left = {job.target: job for job in jobs}
    for job, row in _pool(plan, jobs, options, min(workers, len(jobs))):
        if row is not None:
            del left[job.target]
            yield job, row
    for job in left.values():
        for _, row in _pool(plan, [job], options, 1):
            yield (
                job,
                row
                or BatchRow(
                    str(job.target),
                    "failed",
                    False,
                    landmarks=job.landmarks is not None,
                    error="the process ended without a result (out of memory?); try fewer workers or a smaller target",
                ),
            )


def _pool(
    plan: TransferPlan, jobs: Sequence[_Job], options: BatchOptions, workers: int
) -> Iterator[tuple[_Job, BatchRow | None]]:
    """Rows in the order in which they are finished; None for jobs that were lost with their process."""
    if not jobs:
        return
    # Not forked: this process may run threads, a progress bar's for one.
    context = multiprocessing.get_context("spawn")
    executor = ProcessPoolExecutor(workers, context, _start_worker, (plan, options))
    futures: dict[Future[BatchRow], _Job] = {}
    lost: list[_Job] = []
    others = set(multiprocessing.active_children())
    try:
        # Processes start as jobs are handed over. A terminal sends Ctrl-C to all of them, and each would complain.
        with interruption.held_back():
            for job in jobs:
                try:
                    futures[executor.submit(_in_worker, job)] = job
                except BrokenProcessPool:
                    lost.append(job)
        for future in as_completed(futures):
            row = None
            with suppress(BrokenProcessPool):
                row = future.result()
            yield futures[future], row
        yield from ((job, None) for job in lost)
    except (KeyboardInterrupt, GeneratorExit):
        # Not waited for: a transfer may take minutes, and is done again when the batch is resumed.
        for process in set(multiprocessing.active_children()) - others:
            process.terminate()
        raise
    finally:
        executor.shutdown(wait=True, cancel_futures=True)
