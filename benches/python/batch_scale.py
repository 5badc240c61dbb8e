"""Thousands of targets through one plan: ``python batch_scale.py [-n 1000] [--workers 2] [--dask] [--continuity c0]``.

The bundled wrench to its own bent boundaries with landmarks, by a batch with processes or, with ``--dask``, a Dask
cluster of this machine. Told are the resident memory of this process and of the largest worker as the batch goes on,
the growth by a target over the second half (and what that makes of 10,000, if fewer were done), and processor time by a
target: of the whole batch with all its processes and their start; of a batch in one process, which reads targets,
measures and writes results and reports as well; and of `plan.transfer` alone, whose targets have been read. Processor
times and their ratios depend little on what else the machine does.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from pathlib import Path

import numpy as np
import psutil
from transfer_yeti import bent_boundary

import patchtransfer as pt
from patchtransfer import _core, examples
from patchtransfer.batch import BatchRow, run_batch

MB = 2**20
#: How often memory is looked at, as a part of the targets.
LOOKS = 20
#: Targets that the plan's own time is taken from.
SAMPLE = 100
ASKED = 10_000


def processor_seconds() -> float:
    """Of this process and of its children, those that have ended and those that have not."""
    spent = psutil.Process().cpu_times()
    alive = [child.cpu_times() for child in psutil.Process().children(recursive=True)]
    ended = spent.children_user + spent.children_system
    return spent.user + spent.system + ended + sum(times.user + times.system for times in alive)


class Watch:
    """Looks at the memory of this process and of its children as rows come."""

    def __init__(self, total: int) -> None:
        self.every, self.rows = max(total // LOOKS, 1), 0
        self.looks: list[tuple[int, float, float]] = []
        self.look()

    def look(self) -> None:
        here = psutil.Process()
        children = [child.memory_info().rss for child in here.children(recursive=True)]
        self.looks.append((self.rows, here.memory_info().rss / MB, max(children, default=0) / MB))

    def __call__(self, row: BatchRow) -> None:
        assert row.ok, row.error
        self.rows += 1
        if self.rows % self.every == 0:
            self.look()

    def slope(self, column: int) -> float:
        """Kilobytes by a target over the second half."""
        late = [look for look in self.looks if look[0] >= self.rows / 2]
        return 1024 * float(np.polyfit([look[0] for look in late], [look[column] for look in late], 1)[0])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-n", type=int, default=1000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--dask", action="store_true")
    parser.add_argument("--continuity", default="c0")
    options = parser.parse_args()
    source = examples.load("wrench")[0]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        pt.write(source, folder / "source.xml")
        files = []
        for k, angle in enumerate(np.linspace(0.2, 1.2, options.n)):
            files.append(folder / f"t{k:05}.xml")
            target, landmarks = bent_boundary(source, float(angle))
            pt.write(target, files[-1])
            beside = files[-1].with_suffix(".landmarks.csv")
            np.savetxt(beside, landmarks, delimiter=",", header="xs,ys,xt,yt", comments="")
        own = own_seconds(source, files, options.continuity)
        one = one_process(folder, files, options.continuity)
        how: dict[str, object] = {"continuity": options.continuity}
        if options.dask:
            from distributed import LocalCluster

            with LocalCluster(n_workers=options.workers, threads_per_worker=1, dashboard_address=None) as cluster:
                tell(options.n, own, one, *watched(folder, files, scheduler=cluster.scheduler_address, **how))
        else:
            tell(options.n, own, one, *watched(folder, files, workers=options.workers, **how))


def own_seconds(source: pt.MultiPatch, files: list[Path], continuity: str) -> float:
    """Processor time of the plan alone, by a target."""
    _core.set_threads(1)
    plan = pt.TransferPlan(source, continuity)
    chosen = files[:: max(len(files) // SAMPLE, 1)]
    targets = [(pt.read_boundary(file), pt.read_landmarks(file.with_suffix(".landmarks.csv"))) for file in chosen]
    list(plan.map(targets[:3]))
    begin = time.process_time()
    list(plan.map(targets))
    return (time.process_time() - begin) / len(targets)


def one_process(folder: Path, files: list[Path], continuity: str) -> float:
    """Processor time of a batch in this process, by a target."""
    chosen = files[:: max(len(files) // SAMPLE, 1)]
    begin = time.process_time()
    run_batch(folder / "source.xml", chosen, folder / "one", continuity=continuity)
    return (time.process_time() - begin) / len(chosen)


def watched(folder: Path, files: list[Path], **how: object) -> tuple[float, float, Watch]:
    """Processor time and seconds of the whole batch, and how memory was meanwhile."""
    watch = Watch(len(files))
    spent, begin = processor_seconds(), time.perf_counter()
    run_batch(folder / "source.xml", files, folder / "out", progress=watch, **how)
    return processor_seconds() - spent, time.perf_counter() - begin, watch


def tell(n: int, own: float, one: float, spent: float, seconds: float, watch: Watch) -> None:
    print(f"{n} targets in {seconds:.0f} s on {os.cpu_count()} cores; load {os.getloadavg()[0]:.1f}")
    times = f"{1e3 * spent / n:.1f} ms, in one process {1e3 * one:.1f} ms, the plan's own {1e3 * own:.1f} ms"
    print(f"processor time by a target: {times}; ratios {spent / n / one:.2f}, {one / own:.2f}")
    print("targets done | this process, MB | largest worker, MB")
    for rows, here, worker in watch.looks:
        print(f"{rows:12} | {here:16.1f} | {worker:18.1f}")
    for name, column in (("this process", 1), ("largest worker", 2)):
        slope, peak = watch.slope(column), max(look[column] for look in watch.looks)
        told = f"{name}: {peak:.0f} MB at most, {slope:+.2f} KB a target over the second half"
        print(told if n >= ASKED else f"{told}; at {ASKED} targets {peak + (ASKED - n) * max(slope, 0) / 1024:.0f} MB")


if __name__ == "__main__":
    main()
