"""Many targets through one plan: any executor gives what the loop gives, errors name their target, Ctrl-C ends it."""

import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import pytest

import models
import patchtransfer as pt
import targets
from failing import eight
from patchtransfer import InfeasibleTargetError, NotCertifiedError

METHODS = [m for m in ("fork", "spawn") if m in multiprocessing.get_all_start_methods()]


@pytest.fixture(scope="module", params=["c0", "c1"])
def family(request):
    """A plan, its targets, and what one after the other gives."""
    mp = models.plate_with_hole(2, 2)
    plan = pt.TransferPlan(mp, request.param)
    given = [targets.deformed(mp, targets.bend(mp, d), seed=i) for i, d in enumerate((-20, 10, 20, 35))]
    return plan, given, list(plan.map(given))


def same_points(a: pt.TransferResult, b: pt.TransferResult) -> bool:
    return a.multipatch == b.multipatch and a.certificate == b.certificate and a.log == b.log


def equal(there, here) -> bool:
    """To the bit, with all that was measured."""
    return len(there) == len(here) and all(
        same_points(a, b)
        and (a.quality, a.continuity, a.boundary_error, a.warnings)
        == (b.quality, b.continuity, b.boundary_error, b.warnings)
        for a, b in zip(there, here, strict=True)
    )


def test_a_plan_gives_what_transfer_gives():
    mp = models.plate_with_hole(2, 2)
    plan, made = pt.TransferPlan(mp), [targets.deformed(mp, targets.bend(mp, d), same_cuts=True)[0] for d in (-20, 10)]
    for target in made:
        assert same_points(plan.transfer(target), pt.transfer(mp, target))
    # Also the second time, and after others.
    assert same_points(plan.transfer(made[0]), pt.transfer(mp, made[0]))


def test_plans_are_picklable_and_map_in_order(family):
    plan, given, expected = family
    again = pickle.loads(pickle.dumps(plan))
    assert same_points(again.transfer(*given[1]), expected[1])
    assert equal(list(plan.map(given)), expected)
    lazy = plan.map(iter(given))
    assert same_points(next(lazy), expected[0])
    (paper,) = plan.map(given[:1], method="paper")
    assert paper.method == "paper"
    result = pickle.loads(pickle.dumps(expected[0]))
    assert result.multipatch == expected[0].multipatch


def test_threads(family):
    plan, given, expected = family
    with ThreadPoolExecutor(3) as pool:
        # Twice, on threads that have optimizers from the first time.
        assert equal(list(plan.map(given, pool)), expected)
        assert equal(list(plan.map(given, pool)), expected)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_processes(family, method):
    plan, given, expected = family
    with ProcessPoolExecutor(2, multiprocessing.get_context(method)) as pool:
        assert equal(list(plan.map(given, pool)), expected)


@pytest.fixture(scope="module")
def dask():
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=2, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client.get_executor()


def test_dask(family, dask):
    plan, given, expected = family
    assert equal(list(plan.map(given, dask)), expected)


@pytest.fixture(scope="module")
def failing():
    """The third of four targets crosses itself."""
    mp = models.grid(1, 1, 2, 2, seed=None)
    plan = pt.TransferPlan(mp, "c0")
    good = targets.deformed(mp, targets.bend(mp, 15))
    return plan, [good, good, eight(), good]


def check_failure(results):
    assert next(results).certificate.injective
    assert next(results).certificate.injective
    with pytest.raises(InfeasibleTargetError, match=r"^targets\[2\]: target boundary: .*crosses itself"):
        next(results)


@pytest.mark.parametrize("kind", [None, ThreadPoolExecutor, ProcessPoolExecutor])
def test_errors_name_their_target(failing, kind):
    plan, given = failing
    if kind is None:
        results = plan.map(given)
        check_failure(results)
        # The loop can go on.
        assert next(results).certificate.injective
        return
    with kind(2) as pool:
        check_failure(plan.map(given, pool))


def test_chunks_are_in_order_and_end_at_an_error(failing):
    """Of many targets of a small source several go to a worker at once: those before a failure are not lost."""
    plan, (_, _, bad, _) = failing
    mp = plan.source
    given = [targets.deformed(mp, targets.bend(mp, 5 + i), seed=i) for i in range(20)]
    expected = list(plan.map(given))
    given[5] = bad
    sizes = []

    class Pool(ThreadPoolExecutor):
        def map(self, work, chunks):
            sizes.extend(map(len, chunks))
            return super().map(work, chunks)

    with Pool(2) as pool:
        results = plan.map(given, pool)
        assert equal([next(results) for _ in range(5)], expected[:5])
        with pytest.raises(InfeasibleTargetError, match=r"^targets\[5\]"):
            next(results)
        assert equal(list(plan.map(given[6:], pool)), expected[6:])
    # The one before the failure came in one chunk with it; the last ones come alone.
    assert sizes[:3] == [2, 2, 2]
    assert sizes[-1] == 1


def test_errors_name_their_target_in_dask(failing, dask):
    plan, given = failing
    check_failure(plan.map(given, dask))


def test_failures_keep_their_result(failing, monkeypatch):
    plan, given = failing
    result = plan.transfer(*given[1])

    def refuse(*_, **__):
        raise NotCertifiedError("no certified map was found", result)

    monkeypatch.setattr(pt.TransferPlan, "transfer", refuse)
    with (
        ThreadPoolExecutor(2) as pool,
        pytest.raises(NotCertifiedError, match=r"^targets\[0\]: no certified") as caught,
    ):
        list(plan.map(given, pool))
    assert pickle.loads(pickle.dumps(caught.value)).result.multipatch == result.multipatch

    def broken(*_, **__):
        raise ZeroDivisionError("division by zero")

    monkeypatch.setattr(pt.TransferPlan, "transfer", broken)
    with pytest.raises(ZeroDivisionError) as other:
        list(plan.map(given))
    assert other.value.__notes__ == ["at targets[0]"]


SCRIPT = """
import signal, sys
# A shell's background jobs, and what they start, ignore Ctrl-C.
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.path.insert(0, sys.argv[1])
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import nullcontext
import models, targets
import patchtransfer as pt

if __name__ == "__main__":
    mp = models.plate_with_hole(3, 4)
    given = [targets.deformed(mp, targets.bend(mp, 20 + i / 100)) for i in range(4)] * 500
    kinds = {"loop": nullcontext, "threads": lambda: ThreadPoolExecutor(2), "processes": lambda: ProcessPoolExecutor(2)}
    with kinds[sys.argv[2]]() as pool:
        for result in pt.TransferPlan(mp).map(given, pool):
            print(result.certificate.status, flush=True)
"""


@pytest.mark.skipif(os.name != "posix", reason="signals to groups of processes")
@pytest.mark.parametrize("kind", ["loop", "threads", "processes"])
def test_ctrl_c_ends_it(kind, tmp_path):
    """Two thousand targets, minutes of work: gone soon after Ctrl-C.

    A terminal sends it to the whole group. Here workers do not get it: one that is interrupted with a lock of the
    pool's queue in its hand leaves the others waiting (a race of the standard library's).
    """
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    process = subprocess.Popen(
        [sys.executable, str(script), str(Path(__file__).parents[1] / "support"), kind],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "certified\n"
        os.kill(process.pid, signal.SIGINT)
        _, errors = process.communicate(timeout=120)
        assert process.returncode != 0
        assert "KeyboardInterrupt" in errors
        # Nothing of the group is left.
        with pytest.raises(ProcessLookupError):
            os.killpg(process.pid, 0)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
