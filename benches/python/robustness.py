"""Random feasible and infeasible targets, certified or not: ``python benches/python/robustness.py -n 600 -o FILE.md``.

Feasible targets are images of a source's boundary under smooth deformations of the plane that are injective on it
(det D > 0 throughout, boundary still simple), at strengths up to where that ends: an injective map exists, the
deformed source itself, though the source's knots may not hold one. "Moderate" is up to half that strength. Infeasible
targets have a crossing boundary or a reflex corner that a single patch has to fill. Every case is a number (seed), so
that a failure can be looked at again with ``--case NUMBER``.
"""

from __future__ import annotations

import argparse
import collections
import json
import os
import re
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import cache
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from rich.progress import track

import patchtransfer as pt
from patchtransfer import examples

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "support"))
import targets

#: Files of the models directory (environment variable PATCHTRANSFER_MODELS) that take part if they are there.
FILES = ("yeti", "turtle", "disc")
FAMILIES = ("smooth", "bend", "articulation", "bump", "swirl", "stretch")
#: Least det D of a feasible deformation, relative to its mean: closer to zero no knots can follow.
LEAST_DETERMINANT = 0.03
#: Part of the largest feasible strength up to which a target counts as moderate.
MODERATE = 0.5


@dataclass(frozen=True)
class Outcome:
    """What became of one case."""

    case: int
    source: str
    family: str
    strength: float
    continuity: str
    feasible: bool
    status: str
    rung: str
    minimum: float
    mean: float
    boundary_error: float
    message: str

    @property
    def moderate(self) -> bool:
        return self.strength <= MODERATE


@cache
def source_named(name: str) -> pt.MultiPatch:
    folder = os.environ.get("PATCHTRANSFER_MODELS")
    if folder and name in FILES:
        return pt.read(Path(folder) / f"{name}.xml")
    # Other benches name files by their paths.
    return pt.read(Path(folder) / name) if folder and "." in name else examples.load(name)[0]


def source_names() -> list[str]:
    folder = os.environ.get("PATCHTRANSFER_MODELS")
    real = [name for name in FILES if folder and (Path(folder) / f"{name}.xml").exists()]
    return [*examples.EXAMPLES, *real]


@cache
def samples(name: str) -> np.ndarray:
    """Points inside and on the boundary."""
    t = np.linspace(0, 1, 13)
    grids = []
    for patch in source_named(name).patches:
        (u0, u1), (v0, v1) = (knots[[0, -1]] for knots in patch.knots)
        grids.append(patch.grid(u0 + t * (u1 - u0), v0 + t * (v1 - v0)).reshape(-1, 2))
    return np.concatenate(grids)


def deformation(name: str, family: str, strength: float, rng: np.random.Generator) -> targets.Deformation:
    """A deformation of the family; the same generator state gives the same one at another strength."""
    mp = source_named(name)
    low, high = targets.box(mp)
    centre, sign = rng.uniform(0.1, 0.9, 2), rng.choice([-1, 1])
    turn, back = targets.similarity(a := rng.uniform(0, 360), 1.0), targets.similarity(-a, 1.0)

    def in_direction(f: targets.Deformation) -> targets.Deformation:
        # Bends and articulations act along a random axis through the middle.
        middle = (low + high) / 2
        return lambda x: back(f(turn(x - middle) + middle) - middle) + middle

    if family == "bend":
        return in_direction(targets.bend(mp, sign * 300 * strength + 1e-9))
    if family == "articulation":
        return in_direction(
            targets.articulation(mp, sign * 150 * strength, rng.uniform(0.3, 0.7), rng.uniform(0.2, 0.8))
        )
    if family == "bump":
        push = strength * np.array([np.cos(a), np.sin(a)])
        return targets.bump(mp, centre, push, rng.uniform(0.1, 0.5))
    if family == "swirl":
        return targets.swirl(mp, centre, sign * 250 * strength, rng.uniform(0.15, 0.6))
    if family == "stretch":
        return targets.stretch(1 + 4 * strength, rng.uniform(0, 180))
    waves, size = rng.normal(0, 4, (4, 2)), float((high - low).min())
    phase, amplitude = rng.uniform(0, 2 * np.pi, 4), rng.normal(0, 0.25, (4, 2))

    def smooth(x: np.ndarray) -> np.ndarray:
        return x + strength * size * np.sin((x - low) / size @ waves.T + phase) @ amplitude

    return smooth


def least_determinant(f: targets.Deformation, points: np.ndarray) -> float:
    """Smallest det D over the points, relative to the mean, by differences."""
    h = 1e-5 * np.ptp(points, axis=0).max()
    dx, dy = ((f(points + d) - f(points - d)) / (2 * h) for d in ([h, 0.0], [0.0, h]))
    det = dx[:, 0] * dy[:, 1] - dx[:, 1] * dy[:, 0]
    return float(det.min() / abs(det).mean())


def polygon_crosses(points: np.ndarray, apart: int) -> bool:
    """Whether a closed polygon crosses itself, by brute force, at segments at least so many places apart.

    Next to a sharp corner the chords of two curves that do not cross may cross.
    """
    a, b = points, np.roll(points, -1, axis=0)
    d = b - a

    def side(p: np.ndarray) -> np.ndarray:
        # Side of point p_j seen from segment i.
        return d[:, None, 0] * (p[None, :, 1] - a[:, None, 1]) - d[:, None, 1] * (p[None, :, 0] - a[:, None, 0])

    start, stop = side(a), side(b)
    straddles = start * stop < 0
    i, j = np.nonzero(straddles & straddles.T)
    places = abs(i - j)
    return bool((np.minimum(places, len(points) - places) >= apart).any())


def boundary_samples(name: str, f: targets.Deformation) -> list[np.ndarray]:
    t = np.linspace(0, 1, 25)[:-1]
    return [
        f(np.concatenate([c(c.domain[0] + t * (c.domain[1] - c.domain[0])) for c in loop]))
        for loop in source_named(name).boundary().loops
    ]


def is_injective(name: str, f: targets.Deformation) -> bool:
    """det D > 0 on the domain and simple loops: then f is injective on it."""
    if least_determinant(f, samples(name)) < LEAST_DETERMINANT:
        return False
    # All loops as one polygon set: loops may not cross each other either.
    loops = boundary_samples(name, f)
    return not any(polygon_crosses(loop, 3) for loop in loops)


def feasible_target(case: int, name: str, family: str) -> tuple[float, pt.Boundary, np.ndarray]:
    """Strength relative to the largest feasible one, target and landmarks at all joints."""
    wanted = np.random.default_rng([case, 1]).uniform(0.05, 1.0)

    def at(strength: float) -> targets.Deformation:
        return deformation(name, family, strength, np.random.default_rng([case, 2]))

    low, high = 0.0, 1.0
    if is_injective(name, at(1.0)):
        low = 1.0
    else:
        for _ in range(12):
            middle = (low + high) / 2
            low, high = (middle, high) if is_injective(name, at(middle)) else (low, middle)
    boundary, landmarks = targets.deformed(source_named(name), at(wanted * low), seed=case, degree=3 + case % 3)
    return wanted, boundary, landmarks


def infeasible_target(case: int, name: str) -> tuple[str, pt.Boundary, np.ndarray] | None:
    """A crossing boundary or a reflex corner for one patch; None when this case gives neither."""
    rng = np.random.default_rng([case, 3])
    mp = source_named(name)
    if case % 2:
        family = str(rng.choice(["articulation", "bend", "swirl", "smooth"]))
        for strength in np.geomspace(0.5, 8, 12):
            f = deformation(name, family, strength, np.random.default_rng([case, 4]))
            boundary, landmarks = targets.deformed(mp, f, seed=case)
            t = np.linspace(0, 1, 400)[:-1]
            fine = [
                np.concatenate([c(c.domain[0] + t * (c.domain[1] - c.domain[0])) for c in loop])
                for loop in boundary.loops
            ]
            if any(polygon_crosses(loop, 40) for loop in fine):
                return f"crossing, {family}", boundary, landmarks
        return None
    # The tip of a corner that a single patch fills, reflected at the line through its neighbours.
    single = {v.point for v in mp.vertices if v.valence == 1}
    corners = [
        (k, i)
        for k, loop in enumerate(mp.topology.loops)
        for i, side in enumerate(loop)
        if int(side.points(mp.topology.points[side.patch])[0]) in single
    ]
    if not corners:
        return None
    k, i = corners[int(rng.integers(len(corners)))]
    loops = [list(loop) for loop in mp.boundary().loops]
    before, after = loops[k][i - 1], loops[k][i]
    share = rng.uniform(0.2, 0.4)
    a = before(before.domain[1] - share * (before.domain[1] - before.domain[0]))
    b = after(after.domain[0] + share * (after.domain[1] - after.domain[0]))
    tip = (a + b) / 2 + rng.uniform(0.2, 0.8) * ((a + b) / 2 - after.start)
    line = [0.0, 0.0, 1.0, 1.0]
    cut_before = before.restrict(before.domain[0], before.domain[1] - share * (before.domain[1] - before.domain[0]))
    cut_after = after.restrict(after.domain[0] + share * (after.domain[1] - after.domain[0]), after.domain[1])
    inward = [pt.BSplineCurve(line, 1, [cut_before.end, tip]), pt.BSplineCurve(line, 1, [tip, cut_after.start])]
    chain = loops[k][i + 1 :] + loops[k][: i - 1] if i > 0 else loops[k][1:-1]
    loops[k] = [cut_before, *inward, cut_after, *chain]
    landmarks = []
    for j, loop in enumerate(mp.boundary().loops):
        for m, curve in enumerate(loop):
            landmarks.append([*curve.start, *(tip if (j, m) == (k, i) else curve.start)])
    return "reflex corner", pt.Boundary(loops), np.array(landmarks)


def run(case: int, continuity: str, feasible: bool) -> Outcome | None:
    """One case."""
    names = source_names()
    name, family = names[case % len(names)], FAMILIES[case // len(names) % len(FAMILIES)]
    if feasible:
        strength, target, landmarks = feasible_target(case, name, family)
    else:
        found = infeasible_target(case, name)
        if found is None:
            return None
        strength = 0.0
        family, target, landmarks = found
    blank = (case, name, family, round(strength, 3), continuity, feasible)
    try:
        result = pt.transfer(source_named(name), target, landmarks, continuity=continuity, on_failure="return")
    except pt.TransferError as error:
        return Outcome(*blank, type(error).__name__, "", 0.0, 0.0, 0.0, str(error))
    quality, log = result.quality.scaled_jacobian, result.log
    message = "" if result.certificate.injective else (log[-1] if result.fit_failed else result.certificate.reasons[0])
    rung = "fit" if result.fit_failed else re.sub(r"under \d+ rows", "under rows", log[-1].split(":")[0])
    status = "fit failed" if result.fit_failed else result.certificate.status
    return Outcome(*blank, status, rung, quality.min, quality.mean, result.boundary_error, message)


def good(outcome: Outcome) -> bool:
    return outcome.status in ("certified", "degenerate")


def table(header: list[str], rows: list[list[object]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(str(cell) for cell in line) + " |" for line in lines)


def share(outcomes: list[Outcome]) -> str:
    return f"{sum(map(good, outcomes))}/{len(outcomes)}" if outcomes else "–"


def report(outcomes: list[Outcome]) -> str:
    """Markdown."""
    parts = []
    for continuity in sorted({o.continuity for o in outcomes}):
        feasible = [o for o in outcomes if o.feasible and o.continuity == continuity]
        if not feasible:
            continue
        names = list(dict.fromkeys(o.source for o in feasible))
        rows: list[list[object]] = []
        for name in names:
            of = [o for o in feasible if o.source == name]
            by_family = [share([o for o in of if o.family == family]) for family in FAMILIES]
            rows.append([name, *by_family, share([o for o in of if o.moderate]), share(of)])
        total = [share([o for o in feasible if o.family == family]) for family in FAMILIES]
        rows.append(["all", *total, share([o for o in feasible if o.moderate]), share(feasible)])
        percent = 100 * sum(map(good, feasible)) / len(feasible)
        parts.append(f"## {continuity}: {percent:.2f} % of {len(feasible)} feasible targets certified\n")
        parts.append(table(["source", *FAMILIES, "moderate", "all"], rows) + "\n")
        rungs = collections.Counter(o.rung for o in feasible if good(o))
        parts.append("Certified by rung: " + ", ".join(f"{rung} {n}" for rung, n in rungs.most_common()) + ".\n")
        failures = [o for o in feasible if not good(o)]
        if failures:
            lines: list[list[object]] = [
                [o.case, o.source, o.family, o.strength, o.status, o.message[:160].replace("|", "/")] for o in failures
            ]
            parts.append(table(["case", "source", "family", "strength", "outcome", "message"], lines) + "\n")
    infeasible = [o for o in outcomes if not o.feasible]
    if infeasible:
        kinds = collections.Counter((o.family.split(",")[0], o.status) for o in infeasible)
        parts.append("## Infeasible targets\n")
        parts.append(table(["kind", "outcome", "number"], [[*kind, n] for kind, n in sorted(kinds.items())]) + "\n")
        # For the right reason: landmarks are not to blame.
        missed = [o for o in infeasible if o.status != "InfeasibleTargetError"]
        refused = sum(not o.feasible and o not in missed for o in outcomes)
        called = sum(o.feasible and o.status == "InfeasibleTargetError" for o in outcomes)
        parts.append(
            f"Refused: {refused} of {len(infeasible)}. Feasible targets called infeasible: {called} of "
            f"{len(outcomes) - len(infeasible)}.\n"
        )
        parts += [f"- case {o.case}, {o.source}, {o.family}: {o.status} {o.message[:160]}" for o in missed]
    return "\n".join(parts)


def _run(arguments: tuple[int, str, bool]) -> Outcome | None:
    return run(*arguments)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-n", type=int, default=600, help="feasible targets for each continuity")
    parser.add_argument("--infeasible", type=int, default=100, help="infeasible targets")
    parser.add_argument("--continuity", nargs="+", default=["c0", "c1"])
    parser.add_argument("--case", type=int, help="run one feasible case and print it")
    parser.add_argument("-o", "--output", help="Markdown file; a JSON file of all cases is put beside it")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    options = parser.parse_args()
    if options.case is not None:
        for continuity in options.continuity:
            print(run(options.case, continuity, True))
        return
    jobs = [(case, continuity, True) for continuity in options.continuity for case in range(options.n)]
    jobs += [(case, "c0", False) for case in range(options.infeasible)]
    with ProcessPoolExecutor(options.workers, mp_context=get_context("spawn")) as executor:
        results = executor.map(_run, jobs, chunksize=4)
        outcomes = [o for o in track(results, "targets", total=len(jobs)) if o is not None]
    text = report(outcomes)
    print(text)
    if options.output:
        path = Path(options.output)
        what = " ".join(__doc__.split("\n\n")[1].split())
        head = f"Made by `python benches/python/robustness.py -n {options.n} --infeasible {options.infeasible}`. {what}"
        path.write_text(f"# Robustness\n\n{head}\n\n{text}\n")
        path.with_suffix(".json").write_text(json.dumps([asdict(o) for o in outcomes], indent=1) + "\n")


if __name__ == "__main__":
    main()
