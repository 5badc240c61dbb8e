"""Batch: one source to many target files, by many workers, resumable, every failure by itself.

For the target ``NAME.svg`` the folder gets ``NAME.xml`` (the result) and ``NAME.report.json``, as soon as it is done.
Landmarks are taken from ``NAME.landmarks.csv`` beside the target if that file exists. A target counts as finished when
its report says so for these very inputs (the bytes of source, target and landmarks, all options, this version) and the
result is still the file that was written then. Whatever else is in the folder is left alone.
"""

from __future__ import annotations

import csv
import io as memory
import json
import shutil
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING
from uuid import uuid4

from .. import io
from .._core import __version__
from ..errors import InputError
from ..files import json_text, write_atomic
from ..pipeline.plan import TransferPlan
from .cluster import Cluster, connected
from .executors import Crew, processes, streamed
from .targets import BatchOptions, BatchRow, Job, digest, finished, jobs_of, keyed, read, transferred
from .worker import Sent

if TYPE_CHECKING:
    from distributed import Client

__all__ = ["BatchOptions", "BatchRow", "run_batch", "write_summary"]

SUMMARY = ("summary.csv", "summary.json")
#: Workers of an executor that does not say how many it has: more than most have, and what waits for them is small.
MANY = 64


def run_batch(
    source: str | Path,
    targets: Sequence[str | Path],
    folder: str | Path,
    options: BatchOptions | None = None,
    *,
    continuity: str | None = None,
    workers: int | None = None,
    executor: Executor | Callable[[], Executor] | None = None,
    scheduler: str | Client | None = None,
    force: bool = False,
    progress: Callable[[BatchRow], None] | None = None,
) -> list[BatchRow]:
    r"""Transfer a source file to many target files.

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
    workers : int, optional
        Processes of this machine; 1, the default, works in this one. (Scripts that ask for more need
        ``if __name__ == "__main__":``.) With an executor: how many workers it has, by default 64 at most.
    executor : Executor, or a function that makes one, optional
        Of `concurrent.futures`, or of a library in that form, ``mpi4py.futures.MPIPoolExecutor`` for one. What is given
        is left open. A pool of processes is broken when one of them dies: only a function, as in
        ``partial(ProcessPoolExecutor, 4)``, lets the batch go on then.
    scheduler : str or distributed.Client, optional
        Address of a Dask scheduler, or a client of one, which is left open; needs the extra ``distributed``.
    force : bool, default False
        Do finished targets again.
    progress : callable, optional
        Called with every row as it is finished.

    Returns
    -------
    list of BatchRow
        In the order of the targets. A target that fails does not end the batch: its row says why. Nor does a worker
        that dies: its target is done once more, with no other beside it, and if a worker dies again its row says so.

    Raises
    ------
    InputError
        When the source cannot be used, an option is wrong, two targets have the same name, an output would replace an
        input, or the folder cannot be made; when nobody answers at the scheduler's address, or a worker has another
        version or does not see the folder.
    TransferError
        When all workers are lost. Finished targets are kept.

    Notes
    -----
    With an executor or a scheduler, workers read the targets and write the results themselves: they need both folders
    under the same paths, and rows name targets by absolute ones. The plan is sent to every worker once. Of targets, a
    few a worker are under way at a time; results are on disk when their row is told to `progress`.

    Examples
    --------
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from patchtransfer import MultiPatch, Patch, write
    >>> knots = ([0, 0, 1, 1], [0, 0, 1, 1])
    >>> square = MultiPatch([Patch(knots, (1, 1), [[[0, 0], [0, 1]], [[1, 0], [1, 1]]])])
    >>> with TemporaryDirectory() as folder, ThreadPoolExecutor(2) as executor:
    ...     source, target = Path(folder, "source.xml"), Path(folder, "kite.csv")
    ...     write(square, source)
    ...     _ = target.write_text("0,0\n1,0\n2,2\n0,1\n0,0\n")
    ...     rows = run_batch(source, [target], Path(folder, "out"), executor=executor)
    ...     sorted(path.name for path in Path(folder, "out").iterdir())
    ['kite.report.json', 'kite.xml']
    >>> rows[0].status
    'certified'
    """
    options = BatchOptions() if options is None else options
    if workers is not None and workers < 1:
        raise InputError(f"workers must be at least 1, got {workers}")
    if scheduler is not None and (workers is not None or executor is not None):
        raise InputError("a scheduler knows its workers: give no number of them, and no executor")
    folder, source, files = Path(folder), Path(source), [Path(target) for target in targets]
    if executor is not None or scheduler is not None:
        # Workers may run in another folder.
        folder, files = folder.absolute(), [file.absolute() for file in files]
    jobs = jobs_of(source, files, folder)
    model = io.read(source)
    with nullcontext() if scheduler is None else connected(scheduler) as client:
        plan = TransferPlan(model) if continuity is None else TransferPlan(model, continuity)
        plan, one = _split(plan, jobs, options)
        jobs = _keyed(jobs, source, plan, options)
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{folder}: the folder cannot be made ({error.strerror}); choose another one") from None
        rows: dict[Path, BatchRow] = {}

        def done(job: Job, row: BatchRow) -> None:
            rows[job.target] = row
            if progress is not None:
                progress(row)

        left = []
        for job in jobs:
            before = None if force else finished(job)
            if before is None:
                left.append(job)
            else:
                done(job, before)
        if client is None and executor is None and workers in (None, 1):
            for job in left:
                done(job, transferred(plan, job, one))
        elif left:
            with _crew(plan, one, folder, client, executor, workers or MANY) as (crew, scratch):
                for job, row in streamed(left, crew, scratch):
                    done(job, row)
    return [rows[job.target] for job in jobs]


@contextmanager
def _crew(
    plan: TransferPlan,
    options: BatchOptions,
    folder: Path,
    client: Client | None,
    executor: Executor | Callable[[], Executor] | None,
    workers: int,
) -> Iterator[tuple[Crew, Path]]:
    """Workers that know the plan, and a folder of theirs inside the batch's, for as long as they work."""
    scratch = folder / f".batch-{uuid4().hex}"
    scratch.mkdir()
    try:
        if client is not None:
            crew: Crew = Cluster(client, Sent.of(plan, options), scratch)
        else:
            sent = Sent.of(plan, options, scratch / "plan")
            crew = Crew(processes(workers) if executor is None else executor, workers, sent)
        try:
            yield crew, scratch
        except BaseException:
            crew.stop()
            raise
        finally:
            crew.close()
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def _keyed(jobs: Sequence[Job], source: Path, plan: TransferPlan, options: BatchOptions) -> list[Job]:
    """The jobs with their keys: inputs, options and version."""
    division = None if plan.split is None else plan.split.to_dict()
    settings = json.dumps([asdict(options), plan.continuity, division])
    common = digest(__version__.encode(), source.read_bytes(), settings.encode())
    return [keyed(job, common) for job in jobs]


def _split(plan: TransferPlan, jobs: Sequence[Job], options: BatchOptions) -> tuple[TransferPlan, BatchOptions]:
    """The plan of a source that has joints for all targets, if that is asked for, and options that keep its patches."""
    if options.split == "never":
        return plan, options
    targets, landmarks = [], []
    for job in jobs:
        # What is wrong with a file is said when its turn comes.
        with suppress(Exception), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            target, points = read(job, options)
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
