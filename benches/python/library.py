"""A library of 40 models asked for 25 unseen targets: ``python benches/python/library.py -o FILE.md``.

Models are the bundled examples, 25 images of theirs under random deformations (``robustness.py``, transferred with
landmarks), and nine that others have drawn, from the folder that PATCHTRANSFER_MODELS names. Targets are images of the
same 15 originals under other deformations; a model is of the right class if it is the target's original or an image of
that. What the library chooses is held against the transfers from all models with as many loops,
but for those without hope.
"""

from __future__ import annotations

import argparse
import collections
import json
import os
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.progress import track

import patchtransfer as pt
from patchtransfer import examples

sys.path.insert(0, str(Path(__file__).parent))
import robustness

#: Models of others, as different as they come; paths in the folder of models.
FOREIGN = (
    "yeti.xml",
    "turtle.xml",
    "real/gismo/heart2p.xml",
    "real/gismo/ellipse_hole.xml",
    "real/gismo/mask.xml",
    "real/unstructured/2p_circular_arrow.xml",
    "real/unstructured/2p_hood.xml",
    "real/unstructured/5p_tunnel_refined.xml",
    "real/geopdes/geo_bifurcation_mp.txt",
)
IMAGES, TARGETS = 25, 25
#: Seeds of images and of targets, apart from each other and from what docs/robustness.md is about.
FIRST_IMAGE, FIRST_TARGET = 10_000, 20_000
#: A score above which nobody would transfer: maps of such pairs count as none.
HOPELESS = 0.3
#: As good as the best.
NEAR = 0.9


class Pair(NamedTuple):
    """A target and a model: distance of their signatures, what registration says, and the smallest scaled Jacobian."""

    distance: float | None
    score: float | None
    confidence: float | None
    expected: float | None
    worth: float


@dataclass(frozen=True)
class Row:
    """What became of one target: smallest scaled Jacobians, 0 without a certified map."""

    number: int
    original: str
    family: str
    strength: float
    first: str
    among_three: bool
    chosen: str | None
    found: float
    by_first: float
    best: float
    best_name: str
    certified: int
    candidates: int
    seconds: float
    pairs: dict[str, Pair]

    @property
    def right_first(self) -> bool:
        return self.first.split("#")[0] == self.original


def image_of(name: str, case: int) -> tuple[str, float, pt.Boundary, np.ndarray]:
    """Family, strength, boundary and landmarks of an original under a random deformation."""
    family = robustness.FAMILIES[case % len(robustness.FAMILIES)]
    return family, *robustness.feasible_target(case, name, family)


def originals() -> list[str]:
    if not os.environ.get("PATCHTRANSFER_MODELS"):
        sys.exit("PATCHTRANSFER_MODELS must name the folder of models; see tests/support/real.py")
    return [*examples.EXAMPLES, *FOREIGN]


def models() -> dict[str, pt.MultiPatch]:
    found = {name: robustness.source_named(name) for name in originals()}
    own, case = list(examples.EXAMPLES), FIRST_IMAGE
    while len(found) < len(originals()) + IMAGES:
        name = own[case % len(own)]
        _, _, boundary, landmarks = image_of(name, case)
        result = pt.transfer(found[name], boundary, landmarks, continuity="c0", on_failure="return")
        if result.certificate.status == "certified":
            found[f"{name}#{case}"] = result.multipatch
        case += 1
    return found


@cache
def library(folder: str) -> pt.Library:
    return pt.Library.open(folder, cache=Path(folder) / "cache")


@cache
def plan(folder: str, name: str) -> pt.TransferPlan:
    return pt.TransferPlan(library(folder)[name], "c0")


def least(result: pt.TransferResult | None) -> float:
    # Of a degenerate map it is 0, in the corner that the proof leaves out.
    if result is None or not result.succeeded or result.certificate.status != "certified":
        return 0.0
    return max(result.quality.proved.min_scaled_jacobian.lower, 0.0)


def ask(folder: str, number: int) -> Row:
    """One target, asked of the library and of all models."""
    name = originals()[number % len(originals())]
    family, strength, target, _ = image_of(name, FIRST_TARGET + number)
    shelf = library(folder)
    begin = time.process_time()
    found = shelf.transfer(target, parameterize=False, on_failure="return")
    end = time.process_time()
    pairs = {c.name: pair(folder, target, c) for c in found.candidates if c.stage not in ("loops", "source")}
    worth = {name: of.worth for name, of in pairs.items()}
    best = max(worth, key=worth.get)
    by_score = sorted((c for c in found.candidates if c.score is not None), key=lambda c: c.score)
    return Row(
        number,
        name,
        family,
        round(strength, 2),
        original(by_score[0].name, True),
        name in [original(c.name) for c in by_score[:3]],
        found.chosen and original(found.chosen, True),
        least(found.result),
        worth[by_score[0].name],
        worth[best],
        original(best, True),
        sum(x > 0 for x in worth.values()),
        len(worth),
        end - begin,
        pairs,
    )


def pair(folder: str, target: pt.Boundary, candidate: pt.Ranked) -> Pair:
    """Of a candidate; transferred unless the library has done it or there is no hope."""
    before = (candidate.distance, candidate.score, candidate.confidence, candidate.expected)
    if candidate.stage in ("transfer", "chosen"):
        good = candidate.status == "certified" and (candidate.reason is None or candidate.stage == "chosen")
        proved = candidate.min_scaled_jacobian
        return Pair(*before, max(proved.lower, 0.0) if good and proved else 0.0)
    of = plan(folder, candidate.name)
    try:
        registration = of.register(target)
        score, expected = registration.loops[0].score, registration.expected.min_scaled_jacobian.median
        before = (candidate.distance, score, registration.confidence, expected)
        return Pair(*before, 0.0 if score > HOPELESS else least(of.transfer(target, on_failure="return")))
    except pt.TransferError:
        return Pair(*before, 0.0)


def original(file: str, version: bool = False) -> str:
    """The original that a file of the library is of, and which image of it."""
    name, _, case = file.removesuffix(".model.xml").replace("!", "/").partition("#")
    return f"{name}#{case}" if version and case else name


def report(rows: list[Row], known: int) -> str:
    """Markdown."""
    some = [row for row in rows if row.best > 0]
    near = sum(row.found >= NEAR * row.best for row in some)
    near_first = sum(row.by_first >= NEAR * row.best for row in some)
    regret = np.mean([row.best - row.found for row in some])
    lines = [
        f"{known} models ({len(FOREIGN)} of others), {len(rows)} unseen targets; "
        f"{len(some)} of them have a certified map from some model.",
        "",
        "| | |",
        "| --- | --- |",
        f"| right class first | {np.mean([row.right_first for row in rows]):.0%} |",
        f"| right class among the first three | {np.mean([row.among_three for row in rows]):.0%} |",
        f"| chosen one within 10 % of the best minimum scaled Jacobian | {near / len(some):.0%} |",
        f"| the first alone | {near_first / len(some):.0%} |",
        f"| best minimum, mean | {np.mean([row.best for row in some]):.3f} |",
        f"| best minimum minus that of the chosen one, mean | {regret:.3f} |",
        f"| certified pairs | {sum(r.certified for r in rows)} of {sum(r.candidates for r in rows)} |",
        f"| certified targets | {sum(r.found > 0 for r in rows)} of {len(rows)} |",
        f"| processor time of a query (median, largest) | {np.median([r.seconds for r in rows]):.1f} s, "
        f"{max(r.seconds for r in rows):.1f} s |",
        "",
        "| target | family | strength | first | chosen | min SJ | best | from |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for r in rows:
        cells = (r.original, r.family, r.strength, r.first, r.chosen or "–", f"{r.found:.3f}", f"{r.best:.3f}")
        lines.append("| " + " | ".join(map(str, (*cells, r.best_name))) + " |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-n", type=int, default=TARGETS, help="targets")
    parser.add_argument("-o", "--output", help="Markdown file; a JSON file of all targets is put beside it")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        known = models()
        for name, model in known.items():
            pt.write(model, Path(folder) / f"{name.replace('/', '!')}.model.xml")
        begin = time.process_time()
        library(folder)
        print(f"index of {len(known)} models: {time.process_time() - begin:.1f} s of processor time")
        with ProcessPoolExecutor(options.workers, mp_context=get_context("spawn")) as executor:
            jobs = [executor.submit(ask, folder, number) for number in range(options.n)]
            rows = []
            for job in track(jobs, "targets"):
                rows.append(job.result())
                if options.output:
                    # What there is so far: a long run may be cut.
                    content = json.dumps([asdict(row) for row in rows], indent=1)
                    Path(options.output).with_suffix(".json").write_text(content)
    text = report(rows, len(known))
    print(text)
    print(collections.Counter(r.original for r in rows if not r.right_first))
    if options.output:
        Path(options.output).write_text(f"# Library\n\n{' '.join((__doc__ or '').split())}\n\n{text}")


if __name__ == "__main__":
    main()
