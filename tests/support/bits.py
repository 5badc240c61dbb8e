"""Run by `test_threads` in processes of their own: prints what all stages compute, and how often BLAS threads woke."""

import hashlib
import json
import os
import time
from pathlib import Path

import numpy as np

import patchtransfer as pt
from patchtransfer import examples
from patchtransfer.geometry.basis import greville
from patchtransfer.iga import biharmonic, poisson

TASKS = Path("/proc/self/task")


class BlasThreads:
    """The threads that NumPy's and SciPy's BLAS keep: all but the main one, before the core has made any."""

    def __init__(self):
        self.names = [p.name for p in TASKS.iterdir() if p.name != str(os.getpid())] if TASKS.exists() else []
        # They wait actively for a while before they sleep.
        before, deadline = None, time.monotonic() + 10
        while (now := self._runs()) != before and time.monotonic() < deadline:
            before = now
            time.sleep(0.2)
        self._start = now

    def _runs(self):
        """How often each was given a core."""
        return [int((TASKS / name / "schedstat").read_text().split()[2]) for name in self.names]

    def woken(self):
        return sum(self._runs()) - sum(self._start)


def digest(*values):
    h = hashlib.sha256()
    for value in values:
        if isinstance(value, pt.MultiPatch):
            for patch in value.patches:
                h.update(patch.control_points.tobytes())
        elif isinstance(value, np.ndarray):
            h.update(value.tobytes())
        else:
            h.update(json.dumps(value).encode())
    return h.hexdigest()[:16]


def evidence(result):
    mp = result.multipatch
    reports = pt.certify(mp), pt.quality(mp), pt.check_continuity(mp)
    return digest(mp, *(report.to_dict() for report in reports))


def strips(spans):
    """Two strips, mirror images, with so many control points along their interface that BLAS would use threads."""
    knots, across = np.concatenate([np.zeros(3), np.linspace(0, 1, spans + 1), np.ones(3)]), np.linspace(-1, 0, 5)
    x = greville(knots, 3)[:, None] + 0.02 * np.sin(9 * across)
    lower = np.stack([x, np.broadcast_to(0.1 * across, x.shape)], axis=2)
    both = (knots, np.array([0, 0, 0, 0, 0.5, 1, 1, 1, 1])), (3, 3)
    return pt.MultiPatch([pt.Patch(*both, lower), pt.Patch(*both, lower[:, ::-1] * [1, -1])])


def main():
    blas, found = BlasThreads(), {}
    for name in examples.EXAMPLES:
        source, target, landmarks = examples.load(name)
        found[f"{name}, no landmarks"] = evidence(pt.transfer(source, target))
        result = pt.transfer(source, target, landmarks)
        found[f"{name}, landmarks"] = evidence(result)
        if name == "star":
            paper = pt.transfer(source, target, landmarks, method="paper", on_failure="return")
            found["paper"] = evidence(paper)
            fine = source.reduce_continuity(1)
            found["g1"] = evidence(pt.transfer(fine, target, landmarks, continuity="g1", on_failure="return"))
            found["morph"] = digest(*pt.morph(source, result.multipatch, 3))
            at = source.boundary().loops[0][0].control_points[0]
            found["deform"] = digest(pt.deform(source, [[*at, *(1.02 * at)]]).multipatch)
            frozen = result.freeze()
            filled = frozen.fill(1.01 * frozen.boundary)
            derivatives = filled.vjp(filled.points[None]), filled.jvp(frozen.boundary)
            curves = frozen.outline(target).matrix.toarray(), frozen.inner_product.gradient(frozen.boundary)
            found["gradients"] = digest(filled.points, *derivatives, *curves)
            found["poisson"] = digest(poisson(source).field.coefficients)
            found["biharmonic"] = digest(biharmonic(source, gluing="nearest").field.coefficients)
        if name == "wrench":
            found["sliding"] = evidence(pt.transfer(source, target, landmarks, fixed_correspondence=False))
    many = strips(400)
    found["many spans"] = digest(many.elevate(), pt.check_continuity(many).to_dict(), pt.quality(many).to_dict())
    woken = blas.woken()
    # That waking them is seen at all.
    square = np.ones((800, 800))
    square @ square
    time.sleep(0.2)
    print(json.dumps({"bits": found, "threads": len(blas.names), "woken": woken, "seen": blas.woken() - woken}))


if __name__ == "__main__":
    main()
