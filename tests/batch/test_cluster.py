"""Batches on a Dask cluster of two processes: workers may die, come late, be gone; addresses may be wrong."""

import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time

import pytest

import dying
from commands import failed, run
from patchtransfer import InputError, TransferError
from patchtransfer.batch import run_batch

distributed = pytest.importorskip("distributed")
posix = pytest.mark.skipif(os.name != "posix", reason="signals")


@pytest.fixture(scope="module")
def cluster():
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as made:
        yield made


@pytest.fixture
def address(cluster):
    return cluster.scheduler_address


def outputs(folder):
    return {p.name: p.read_bytes() for p in folder.glob("*.xml")}


def test_the_same_as_in_one_process_and_resumable(tmp_path, address):
    source, files = dying.case(tmp_path, [0, 0, 0, 0])
    (tmp_path / "broken.xml").write_text("<xml")
    files.insert(2, tmp_path / "broken.xml")
    run_batch(source, files, tmp_path / "one")
    seen = []
    out = tmp_path / "out"
    rows = run_batch(source, files, out, scheduler=address, progress=seen.append)
    assert [row.ok for row in rows] == [True, True, False, True, True]
    assert "malformed" in rows[2].error
    assert outputs(out) == outputs(tmp_path / "one")
    assert {p.suffix for p in out.iterdir()} == {".xml", ".json"}
    assert sorted(row.target for row in seen) == sorted(map(str, files))
    (out / "t01.xml").unlink()
    with distributed.Client(address, set_as_default=False) as client:
        again = run_batch(source, files, out, scheduler=client)
        # Left open.
        assert client.submit(abs, -1).result() == 1
    assert [row.skipped for row in again] == [True, False, False, True, True]


def test_every_worker_gets_the_plan_once(tmp_path, address, monkeypatch):
    source, files = dying.case(tmp_path, [0] * 12)
    diary = dying.with_diary(monkeypatch, tmp_path)
    assert all(row.ok for row in run_batch(source, files, tmp_path / "out", scheduler=address))
    opened = [name.split("-")[1] for name in dying.kept(diary, "opened-")]
    assert 1 <= len(opened) <= 2
    assert len(set(opened)) == len(opened)


@posix
def test_a_worker_that_is_killed_costs_nothing(tmp_path, address, monkeypatch):
    source, files = dying.case(tmp_path, [0, dying.VICTIM + 50, 0, 0, 0, 0])
    diary = dying.with_diary(monkeypatch, tmp_path)
    dying.killer(diary)
    rows = run_batch(source, files, tmp_path / "out", scheduler=address)
    assert (diary / "killed").exists()
    assert [row.ok for row in rows] == [True] * 6


@posix
def test_targets_that_kill_are_named_and_the_others_done(tmp_path, address, monkeypatch):
    source, files = dying.case(tmp_path, [0, dying.DEADLY + 50, 0, 0, 0])
    diary = dying.with_diary(monkeypatch, tmp_path)
    rows = run_batch(source, files, tmp_path / "out", scheduler=address)
    assert [row.ok for row in rows] == [True, False, True, True, True]
    assert "ended without a result" in rows[1].error
    # Not as often as Dask would try, with a worker less each time.
    assert len(dying.kept(diary, "died-")) == 2
    assert not list((tmp_path / "out").glob(".batch-*"))


def test_a_wrong_address_is_told_within_seconds(tmp_path):
    source, files = dying.case(tmp_path, [0])
    with socket.create_server(("127.0.0.1", 0)) as silent:
        wrong = {
            # Which of the two depends on what its last attempt had come to when time was up.
            f"tcp://127.0.0.1:{free_port()}": "refused|Timed out",
            # Takes the call, and says nothing.
            f"127.0.0.1:{silent.getsockname()[1]}": "nothing within 5 s",
            "somewhere": "missing port",
            "tcp://127.0.0.1:x": "invalid",
            "": "missing port",
        }
        for address, message in wrong.items():
            begin = time.monotonic()
            done = run("batch", source, *files, "-o", tmp_path / "out", "--scheduler", address)
            failed(done, 2, f"scheduler {address} *does not answer.*({message}).*dask scheduler")
            assert time.monotonic() - begin < 15
    assert not (tmp_path / "out").exists()


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


def test_a_worker_is_no_scheduler(tmp_path, cluster):
    source, files = dying.case(tmp_path, [0])
    with pytest.raises(InputError, match="does not answer"):
        run_batch(source, files, tmp_path / "out", scheduler=next(iter(cluster.workers.values())).worker_address)


def test_workers_of_another_version_are_refused(tmp_path, address, monkeypatch):
    source, files = dying.case(tmp_path, [0])
    monkeypatch.setattr("patchtransfer.batch.cluster.__version__", "99.0")
    with pytest.raises(InputError, match=r"its worker tcp://.* has patchtransfer .*, this is 99\.0; install the same"):
        run_batch(source, files, tmp_path / "out", scheduler=address)
    assert not (tmp_path / "out").exists()


def test_a_folder_that_workers_do_not_see_is_told_before_the_work(tmp_path, address, monkeypatch):
    source, files = dying.case(tmp_path, [0])
    original = distributed.Client.run

    def blind(self, function, *arguments, **options):
        seen = original(self, function, *arguments, **options)
        return {"tcp://far:1": False} if function is os.path.isdir else seen

    monkeypatch.setattr(distributed.Client, "run", blind)
    with pytest.raises(InputError, match="out: not seen by the worker tcp://far:1"):
        run_batch(source, files, tmp_path / "out", scheduler=address)
    assert not list((tmp_path / "out").iterdir())


def test_a_cluster_without_workers(tmp_path, monkeypatch):
    source, files = dying.case(tmp_path, [0, dying.VICTIM + 50])
    diary = dying.with_diary(monkeypatch, tmp_path)
    monkeypatch.setattr("patchtransfer.batch.cluster.FIRST_WORKER", 0.5)
    with distributed.LocalCluster(n_workers=0, threads_per_worker=1, dashboard_address=None) as made:
        with pytest.raises(InputError, match="no worker after"):
            run_batch(source, files, tmp_path / "out", scheduler=made.scheduler_address)
        # All are gone while they work.
        made.scale(1)
        made.wait_for_workers(1)
        monkeypatch.setattr("patchtransfer.batch.cluster.NOBODY", 2.0)

        def leave():
            while not (diary / "victim").exists():
                time.sleep(0.05)
            (diary / "killed").touch()
            made.scale(0)

        threading.Thread(target=leave, daemon=True).start()
        with pytest.raises(TransferError, match=r"no worker is left.*kept"):
            run_batch(source, files, tmp_path / "out", scheduler=made.scheduler_address)
    assert (tmp_path / "out" / "t00.xml").exists()


@posix
def test_a_scheduler_that_dies_ends_the_batch_with_what_is_done_kept(tmp_path):
    source, files = dying.case(tmp_path, [0] * 40)
    address, first = f"tcp://127.0.0.1:{free_port()}", tmp_path / "out" / "t00.xml"
    command = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--no-dashboard", "--host", "127.0.0.1"]
    process = subprocess.Popen([*command, "--port", address.rpartition(":")[2]], stderr=subprocess.DEVNULL)

    def kill():
        while not first.exists():
            time.sleep(0.05)
        process.kill()

    try:
        with distributed.Client(address, timeout=60, set_as_default=False):
            pass
        worker = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny"]
        with subprocess.Popen([*worker, "--no-dashboard"], stderr=subprocess.DEVNULL) as there:
            threading.Thread(target=kill, daemon=True).start()
            with pytest.raises(TransferError, match=r"scheduler is gone.*kept"):
                run_batch(source, files, tmp_path / "out", scheduler=address)
            there.kill()
    finally:
        process.kill()
        process.wait()
    assert first.exists()


@posix
def test_ctrl_c_ends_the_command_and_keeps_what_is_done(tmp_path, address):
    source, files = dying.case(tmp_path, [0] * 60)
    out = tmp_path / "out"
    batch = [str(part) for part in ("batch", source, *files, "-o", out)]
    process = subprocess.Popen(
        [sys.executable, "-m", "patchtransfer.cli", *batch, "--scheduler", address, "-v"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        assert process.stderr is not None
        assert "certified" in process.stderr.readline()
        process.send_signal(signal.SIGINT)
        begin = time.monotonic()
        _, errors = process.communicate(timeout=60)
        assert time.monotonic() - begin < 20
    finally:
        process.kill()
    assert process.returncode == 130
    assert "interrupted; finished targets are kept" in errors
    assert "Traceback" not in errors
    assert not list(out.glob(".batch-*"))
    kept = len(list(out.glob("*.xml")))
    assert 1 <= kept < 60
    again = run(*batch, "--workers", 1)
    assert again.exit_code == 0
    before = int(re.search(r"60 of 60 targets certified, (\d+) finished before", again.output)[1])
    assert kept <= before < 60
