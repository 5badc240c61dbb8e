"""Batches whose workers die: at some targets, as often as is asked for."""

import os
import signal
import threading
import time
from functools import partial
from pathlib import Path
from uuid import uuid4

import numpy as np

import models
import patchtransfer as pt
import targets

#: Targets as far to the right as this have a worker that waits to be killed, once; those beyond the second kill it.
VICTIM, DEADLY = 100.0, 200.0


class Dying(pt.TransferPlan):
    """A plan that keeps a diary of what happens to it, a folder of files."""

    def __init__(self, source, continuity="c1", *, diary):
        super().__init__(source, continuity)
        self.diary = diary

    def __setstate__(self, state):
        self.__dict__.update(state)
        (self.diary / f"opened-{os.getpid()}-{uuid4().hex}").touch()

    def transfer(self, target, landmarks=None, **options):
        x = float(target.loops[0][0].start[0])
        if x > DEADLY:
            (self.diary / f"died-{uuid4().hex}").touch()
            os.kill(os.getpid(), signal.SIGKILL)
        if x > VICTIM and not (self.diary / "killed").exists():
            (self.diary / "victim.part").write_text(str(os.getpid()))
            (self.diary / "victim.part").rename(self.diary / "victim")
            time.sleep(120)
        return super().transfer(target, landmarks, **options)


def kept(folder: Path, beginning: str) -> list[str]:
    """Names in a diary."""
    return sorted(path.name for path in folder.iterdir() if path.name.startswith(beginning))


def killer(diary: Path) -> threading.Thread:
    """A thread, started, that kills the worker that waits for it, while it works."""

    def kill() -> None:
        while not (diary / "victim").exists():
            time.sleep(0.02)
        (diary / "killed").touch()
        os.kill(int((diary / "victim").read_text()), signal.SIGKILL)

    thread = threading.Thread(target=kill, daemon=True)
    thread.start()
    return thread


def case(folder: Path, places) -> tuple[Path, list[Path]]:
    """A source and a target for every place along the x axis, each bent in its own way."""
    mp = models.grid(2, 1, 2, 2)
    pt.write(mp, folder / "source.xml")
    files = []
    for k, x in enumerate(places):
        bend = targets.bend(mp, 10.0 + k % 20)
        target, _ = targets.deformed(mp, lambda points, bend=bend, x=x: bend(points) + np.array([x, 0.0]))
        files.append(folder / f"t{k:02}.xml")
        pt.write(target, files[-1])
    return folder / "source.xml", files


def with_diary(monkeypatch, folder: Path) -> Path:
    """Have batches take plans with a diary in the folder."""
    diary = folder / "diary"
    diary.mkdir()
    monkeypatch.setattr("patchtransfer.batch.TransferPlan", partial(Dying, diary=diary))
    return diary
