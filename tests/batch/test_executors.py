"""Batches through executors: the same as in one process, few targets at a time, a death costs one target at most."""

import multiprocessing
import os
import signal
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from functools import partial

import pytest

import dying
import patchtransfer as pt
from patchtransfer import InputError, TransferError
from patchtransfer.batch import BatchOptions, run_batch
from patchtransfer.batch.executors import AHEAD
from patchtransfer.batch.worker import Sent, do

SPAWN = multiprocessing.get_context("spawn")
PROCESSES = partial(ProcessPoolExecutor, 2, SPAWN)
posix = pytest.mark.skipif(os.name != "posix", reason="SIGKILL")


def outputs(folder):
    return {p.name: p.read_bytes() for p in folder.glob("*.xml")}


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """Five targets, one broken, and what one process makes of them."""
    folder = tmp_path_factory.mktemp("plain")
    source, files = dying.case(folder, [0, 0, 0, 0])
    (folder / "broken.xml").write_text("<xml")
    files.insert(2, folder / "broken.xml")
    run_batch(source, files, folder / "one")
    return source, files, outputs(folder / "one")


@pytest.mark.parametrize("kind", ["threads", "processes", "workers"])
def test_any_executor_gives_the_same(plain, kind, tmp_path):
    source, files, expected = plain
    out = tmp_path / "out"
    if kind == "workers":
        rows = run_batch(source, files, out, workers=2)
    else:
        with ThreadPoolExecutor(2) if kind == "threads" else PROCESSES() as executor:
            rows = run_batch(source, files, out, executor=executor)
            # Left open.
            assert executor.submit(abs, -1).result() == 1
    assert [row.ok for row in rows] == [True, True, False, True, True]
    assert "malformed" in rows[2].error
    assert outputs(out) == expected
    # Nothing of the workers' is left.
    assert {p.suffix for p in out.iterdir()} == {".xml", ".json"}
    again = run_batch(source, files, out, executor=ThreadPoolExecutor(1))
    assert [row.skipped for row in again] == [True, True, False, True, True]


def test_paths_may_be_relative(plain, tmp_path, monkeypatch):
    source, files, expected = plain
    monkeypatch.chdir(source.parent)
    out = os.path.relpath(tmp_path / "out")
    rows = run_batch(source.name, [file.name for file in files], out, executor=PROCESSES)
    assert [row.target for row in rows] == [str(file) for file in files]
    assert outputs(tmp_path / "out") == expected


def test_every_process_gets_the_plan_once(tmp_path, monkeypatch):
    source, files = dying.case(tmp_path, [0] * 12)
    diary = dying.with_diary(monkeypatch, tmp_path)
    with PROCESSES() as executor:
        assert all(row.ok for row in run_batch(source, files, tmp_path / "out", executor=executor))
    opened = [name.split("-")[1] for name in dying.kept(diary, "opened-")]
    assert 1 <= len(opened) <= 2
    assert len(set(opened)) == len(opened)


class Watched(Executor):
    """Works when it is asked for a result, and knows how many were not done at most."""

    def __init__(self):
        self.pool, self.open, self.most = ThreadPoolExecutor(1), 0, 0

    def submit(self, fn, /, *args, **kwargs):
        self.open += 1
        self.most = max(self.most, self.open)
        future: Future = self.pool.submit(fn, *args, **kwargs)
        future.add_done_callback(self.done)
        return future

    def done(self, _):
        self.open -= 1


def test_few_targets_are_under_way(tmp_path):
    source, files = dying.case(tmp_path, [0] * 12)
    executor = Watched()
    rows = run_batch(source, files, tmp_path / "out", executor=executor, workers=2)
    assert all(row.ok for row in rows)
    assert 2 <= executor.most <= 2 * AHEAD


@posix
def test_a_worker_that_is_killed_costs_nothing(tmp_path, monkeypatch):
    source, files = dying.case(tmp_path, [0, dying.VICTIM + 50, 0, 0, 0, 0])
    diary = dying.with_diary(monkeypatch, tmp_path)
    dying.killer(diary)
    rows = run_batch(source, files, tmp_path / "out", executor=PROCESSES, workers=2)
    assert (diary / "killed").exists()
    assert [row.ok for row in rows] == [True] * 6


@posix
def test_targets_that_kill_are_named_and_the_others_done(tmp_path, monkeypatch):
    source, files = dying.case(tmp_path, [0, dying.DEADLY + 50, 0, 0, dying.DEADLY + 50, 0, 0])
    diary = dying.with_diary(monkeypatch, tmp_path)
    seen = []
    rows = run_batch(source, files, tmp_path / "out", workers=2, progress=seen.append)
    assert [row.ok for row in rows] == [True, False, True, True, False, True, True]
    for row in (rows[1], rows[4]):
        assert "ended without a result" in row.error
        assert "process " in row.error
    assert sorted(row.target for row in seen) == [row.target for row in rows]
    # Once beside others, once alone; by the time that a broken pool is taken down the second may have begun or not.
    assert 3 <= len(dying.kept(diary, "died-")) <= 4
    assert len(list((tmp_path / "out").glob("*.xml"))) == 5
    assert not list((tmp_path / "out").glob(".batch-*"))


@posix
def test_a_pool_that_cannot_be_made_anew_ends_the_batch_with_what_is_done_kept(tmp_path, monkeypatch):
    source, files = dying.case(tmp_path, [0, 0, 0, dying.DEADLY + 50, 0])
    dying.with_diary(monkeypatch, tmp_path)
    with (
        ProcessPoolExecutor(1, SPAWN) as executor,
        pytest.raises(TransferError, match=r"executor is broken.*t03\.xml was begun by process.*partial"),
    ):
        run_batch(source, files, tmp_path / "out", executor=executor, workers=1)
    rows = run_batch(source, files, tmp_path / "out", executor=PROCESSES)
    assert [row.ok for row in rows] == [True, True, True, False, True]
    assert [row.skipped for row in rows[:3]] == [True] * 3


def test_workers_that_never_begin_end_the_batch(plain, tmp_path):
    source, files, _ = plain
    made = []

    def dead():
        made.append(ProcessPoolExecutor(1, SPAWN, os._exit, (3,)))
        return made[-1]

    with pytest.raises(TransferError, match="before they begin"):
        run_batch(source, files, tmp_path / "out", executor=dead)
    assert 2 <= len(made) <= 6


def test_workers_of_another_version_are_refused(plain, tmp_path, monkeypatch):
    source, files, _ = plain
    monkeypatch.setattr("patchtransfer.batch.worker.__version__", "99.0")
    with pytest.raises(InputError, match=r"worker process \d+ on .* has patchtransfer .*, the batch 99\.0"):
        run_batch(source, files, tmp_path / "out", executor=PROCESSES)
    assert not list((tmp_path / "out").iterdir())


def test_a_worker_that_does_not_see_the_folder_says_so(plain, tmp_path):
    source, _, _ = plain
    sent = Sent.of(plan_of(source), BatchOptions(fit_tolerance=2e-3), tmp_path / "plan")
    elsewhere = Sent(sent.version, sent.home, sent.digest, tmp_path / "nowhere" / "plan")
    with pytest.raises(InputError, match=r"not seen by the worker .* same paths"):
        do(elsewhere, None, tmp_path / "mark")
    with pytest.raises(InputError, match=r"not seen by the worker .* same paths"):
        do(sent, None, tmp_path / "nowhere" / "mark")


def test_a_plan_that_somebody_has_changed_is_not_unpickled(plain, tmp_path):
    source, _, _ = plain
    sent = Sent.of(plan_of(source), BatchOptions(split="auto"), tmp_path / "plan")
    (tmp_path / "plan").write_bytes(b"cos\nsystem\n(S'true'\ntR.")
    with pytest.raises(InputError, match="has changed"):
        sent.opened()


def plan_of(source):
    return pt.TransferPlan(pt.read(source))


def test_contradictions_are_refused(plain, tmp_path):
    source, files, _ = plain
    with pytest.raises(InputError, match="knows its workers"):
        run_batch(source, files, tmp_path / "out", scheduler="tcp://127.0.0.1:1", workers=2)
    with pytest.raises(InputError, match="knows its workers"):
        run_batch(source, files, tmp_path / "out", scheduler="tcp://127.0.0.1:1", executor=PROCESSES)
    assert not (tmp_path / "out").exists()


@posix
def test_an_interrupted_executor_batch_keeps_what_is_done(tmp_path):
    """Ctrl-C while workers of a made pool work: they are gone at once, nothing of theirs is left, and it resumes."""
    source, files = dying.case(tmp_path, [0] * 8)

    def press(row):
        os.kill(os.getpid(), signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        run_batch(source, files, tmp_path / "out", executor=PROCESSES, workers=2, progress=press)
    assert not multiprocessing.active_children()
    assert not list((tmp_path / "out").glob(".batch-*"))
    rows = run_batch(source, files, tmp_path / "out")
    assert all(row.ok for row in rows)
    assert any(row.skipped for row in rows)
