"""What a registration says of the map to come, calibrated: ``python benches/python/calibration.py -o ROWS.json``.

Sources are the bundled examples and the models of others that ``library.py`` names; targets are feasible ones of
``robustness.py``, whose right correspondence is known. Each is registered as it is, turned by a random angle, mirrored,
and with a source that it is not of; the first is transferred besides, with landmarks at all joints and without, C0 and
C1.

A correspondence is right where every joint is within a tenth of the diameter of where it belongs, up to symmetries of
the source: on a star nobody can tell which arm is the first. The constants of
``patchtransfer/registration/calibrated.py`` are fitted to two thirds of the targets, and judged on the others; numbers
in parentheses are those of the margin to the runner-up alone. ``--fit ROWS.json`` fits an earlier run.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from rich.progress import track
from scipy.optimize import linprog, minimize
from scipy.stats import mannwhitneyu, spearmanr

import patchtransfer as pt
from patchtransfer.geometry.outline import Outline
from patchtransfer.registration.confidence import traits
from patchtransfer.registration.expected import POOR, distance
from patchtransfer.registration.mismatch import Mismatch
from patchtransfer.registration.register import Registration, register

sys.path.insert(0, str(Path(__file__).parent))
import library
import robustness

#: A joint farther from where it belongs, in parts of the diameter, belongs to another correspondence. Where nothing
#: holds it, on a side without features, it may be off by half of that and nobody minds.
RIGHT = 0.1
#: A turn or reflection that moves no point of the outline by more of the diameter is a symmetry.
SYMMETRIC = 0.015
#: Seeds apart from those of other benches.
FIRST = 30_000
#: What targets are: images of the source, half of them turned, and one in ten its mirror image or something else.
POPULATION = {"plain": 0.45, "turned": 0.45, "mirrored": 0.05, "other": 0.05}
#: Quantiles.
PARTS = (0.1, 0.5, 0.9)
PLACE = Path(pt.__file__).parent / "registration" / "calibrated.py"
MODULE = '''"""Constants of `confidence` and `expected`, written by ``benches/python/calibration.py --write``."""

from __future__ import annotations

__all__ = ["MEAN", "MINIMUM", "RIGHT"]

#: Weights of 1, log(turned), margin and corners, for the probability that a correspondence is right.
RIGHT = {right}
#: Weights of 1, turned, jump and distances, for quantiles of how much arcosh(1/mean scaled Jacobian) grows.
MEAN = {mean}
#: The same of arcosh(1/least scaled Jacobian).
MINIMUM = {least}
'''
Points = Callable[[np.ndarray], np.ndarray]


def sources() -> list[str]:
    files = [name for name in library.FOREIGN if Path(name).stem not in robustness.FILES]
    return [*robustness.source_names(), *files]


@cache
def outlines(name: str) -> list[Outline]:
    return [Outline(loop) for loop in robustness.source_named(name).boundary().loops]


@cache
def symmetries(name: str) -> tuple[list[float], list[float]]:
    """Shifts of the arc length that turns of the outer loop onto itself are, and reflections (s -> shift - s)."""
    outline, n = outlines(name)[0], 240
    z = outline.polygon(n) @ [1, 1j]
    z -= z.mean()
    diameter = abs(z).max() * 2

    def apart(image: np.ndarray) -> float:
        turn = np.vdot(z, image)
        return float(abs(image - z * turn / max(abs(turn), 1e-300)).max() / diameter)

    turns = [k for k in range(n) if apart(np.roll(z, -k)) < SYMMETRIC]
    back = np.roll(z[::-1].conj(), 1)
    flips = [k for k in range(n) if apart(np.roll(back, k)) < SYMMETRIC]
    return [k / n * outline.length for k in turns], [k / n * outline.length for k in flips]


def moved(boundary: pt.Boundary, f: Points) -> pt.Boundary:
    return pt.Boundary(
        [[pt.BSplineCurve(c.knots, c.degree, f(c.control_points), c.weights) for c in loop] for loop in boundary.loops]
    )


def off(found: Registration, true: Registration, name: str, f: Points, mirrored: bool, diameter: float) -> float:
    """How far a joint is from where it belongs at most, up to symmetries of the source, relative to the diameter."""

    def at(registration: Registration, k: int, s: np.ndarray) -> np.ndarray:
        loop = registration.loops[k]
        return loop.target.point(loop.to_target(np.mod(s, loop.source.length)))

    def error(k: int, of: Points) -> float:
        joints = found.loops[k].source.joints[:-1]
        return float(np.linalg.norm(at(found, k, joints) - f(at(true, k, of(joints))), axis=1).max() / diameter)

    turns, flips = symmetries(name)
    candidates = [error(0, lambda s, c=c: c - s) for c in flips] if mirrored else []
    if not mirrored:
        candidates = [error(0, lambda s, c=c: s + c) for c in turns]
        # Holes of another image are left out: where the outer loop is right, they are.
        candidates.append(max(error(k, lambda s: s) for k in range(len(found.loops))))
    return min(candidates, default=1.0)


def features(registration: Registration) -> dict[str, float]:
    return {
        **registration.mismatch._asdict(),
        "score": registration.loops[0].score,
        "margin": registration.margin,
        "corners": len(registration.loops[0].features),
    }


def rows_of(number: int) -> list[dict[str, object]]:
    """All ways in which one target is looked at."""
    names = sources()
    name, family = names[number % len(names)], robustness.FAMILIES[number // len(names) % len(robustness.FAMILIES)]
    case = FIRST + number
    rng = np.random.default_rng([case, 9])
    strength, target, landmarks = robustness.feasible_target(case, name, family)
    source = robustness.source_named(name)
    single = pt.TransferPlan(source, "c0")._boundary.single
    true = register(outlines(name), target, landmarks, single_patch=single)
    angle = rng.uniform(0, 2 * np.pi)
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    ways = {"plain": np.eye(2), "turned": turn, "mirrored": turn * [-1, 1]}
    blank = {"case": number, "source": name, "family": family, "strength": strength}
    rows = []
    for way, matrix in ways.items():

        def f(x: np.ndarray, matrix: np.ndarray = matrix) -> np.ndarray:
            return x @ matrix

        try:
            found = register(outlines(name), moved(target, f), single_patch=single)
        except pt.TransferError:
            continue
        error = off(found, true, name, f, way == "mirrored", target.diameter)
        rows.append({**blank, "way": way, "off": error, **features(found)})
    others = [n for n in names if n != name and len(outlines(n)) == len(outlines(name))]
    if others:
        other = others[int(rng.integers(len(others)))]
        found = register(outlines(other), target)
        rows.append({**blank, "source": other, "way": "other", "off": 1.0, **features(found)})
    own = pt.quality(source).scaled_jacobian
    for way, given, continuity in (("landmarks", landmarks, "c0"), ("none", None, "c0"), ("smooth", None, "c1")):
        try:
            result = pt.transfer(source, target, given, continuity=continuity, on_failure="return")
        except pt.TransferError as error:
            rows.append({**blank, "way": f"map {way}", "status": type(error).__name__})
            continue
        quality, registration = result.quality, result.registration
        rows.append(
            {
                **blank,
                "way": f"map {way}",
                "status": result.certificate.status if not result.missed else "missed",
                "off": off(registration, true, name, lambda x: x, False, target.diameter),
                "mean": quality.scaled_jacobian.mean,
                "min": quality.proved.min_scaled_jacobian.lower,
                "mean_before": own.mean,
                "min_before": own.min,
                **features(registration),
            }
        )
    return rows


# --- the fit --------------------------------------------------------------------------------------


def logistic(traits: np.ndarray, right: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Weights of most likelihood: with four of them and a thousand cases there is nothing to hold down."""

    def cost(b: np.ndarray) -> float:
        z = traits @ b
        return float((weight * (np.logaddexp(0, z) - right * z)).sum() / weight.sum())

    return minimize(cost, np.zeros(traits.shape[1])).x


def quantile(traits: np.ndarray, values: np.ndarray, part: float) -> np.ndarray:
    """Weights of a quantile that is linear in the traits: a linear program (Koenker, Bassett 1978)."""
    n, k = traits.shape
    cost = np.concatenate([np.zeros(2 * k), np.full(n, part), np.full(n, 1 - part)])
    rows = np.hstack([traits, -traits, np.eye(n), -np.eye(n)])
    found = linprog(cost, A_eq=rows, b_eq=values, bounds=(0, None), method="highs").x
    return found[:k] - found[k : 2 * k]


def auc(score: np.ndarray, right: np.ndarray) -> float:
    """How often a right one has more than a wrong one."""
    return float(mannwhitneyu(score[right > 0], score[right == 0]).statistic / (right.sum() * (right == 0).sum()))


def calibration_error(chance: np.ndarray, right: np.ndarray, weight: np.ndarray) -> float:
    """Mean difference of probability and share of right ones in ten classes of probability."""
    of = np.minimum((10 * chance).astype(int), 9)
    return sum(abs((weight * (chance - right))[of == k].sum()) for k in range(10)) / weight.sum()


def fit_right(rows: list[dict], way: Callable[[dict], bool]) -> tuple[np.ndarray, str]:
    """Weights of the probability that a correspondence is right, and how they do."""
    of = [row for row in rows if row["way"] in POPULATION]
    x = np.array([traits(Mismatch(*(row[k] for k in Mismatch._fields)), row["margin"], row["corners"]) for row in of])
    right = np.array([row["off"] <= RIGHT for row in of], float)
    weight = np.array([POPULATION[row["way"]] for row in of])
    margin = np.array([row["margin"] for row in of])

    def line(name: str, held: np.ndarray, chance: np.ndarray) -> str:
        own = held & np.array([row["way"] in ("plain", "turned") for row in of])
        certain = own & (right > 0) & (chance < 0.05)
        before = own & (right > 0) & (margin < 0.05)
        return (
            f"| {name} | {held.sum()} | {auc(chance[held], right[held]):.2f} ({auc(margin[held], right[held]):.2f}) | "
            f"{auc(chance[own], right[own]):.2f} ({auc(margin[own], right[own]):.2f}) | "
            f"{calibration_error(chance[held], right[held], weight[held]):.3f} "
            f"({calibration_error(margin[held], right[held], weight[held]):.3f}) | "
            f"{certain.sum()} ({before.sum()}) of {(own & (right > 0)).sum()} |"
        )

    def chance(b: np.ndarray, of: np.ndarray) -> np.ndarray:
        return 1 / (1 + np.exp(-x[of] @ b))

    held = np.array([way(row) for row in of])
    b = logistic(x[~held], right[~held], weight[~held])
    all_of = np.ones(len(of), bool)
    by_source = np.empty(len(of))
    names = np.array([row["source"] for row in of])
    for name in set(names):
        out = names == name
        by_source[out] = chance(logistic(x[~out], right[~out], weight[~out]), out)
    table = [
        "| held out | cases | AUC | of deformed sources | calibration error | right ones below 0.05 |",
        "| --- | --- | --- | --- | --- | --- |",
        line("a third of the targets", held, np.where(held, chance(b, all_of), 0.0)),
        line("each source in turn", all_of, by_source),
    ]
    said = np.where(held, chance(b, all_of), np.nan)
    table += ["", "| said | right, of those held out |", "| --- | --- |"]
    for low, high in ((0, 0.2), (0.2, 0.4), (0.4, 0.6), (0.6, 0.8), (0.8, 0.9), (0.9, 1.0)):
        inside = (said >= low) & (said < high + (high == 1))
        if inside.any():
            share = np.average(right[inside], weights=weight[inside])
            table.append(f"| {low} to {high} | {share:.2f} of {inside.sum()} |")
    return b, "\n".join(table)


def fit_quantiles(rows: list[dict], number: str, way: Callable[[dict], bool]) -> tuple[dict[float, np.ndarray], str]:
    """Weights of quantiles of what a scaled Jacobian loses, and which part of those held out is below."""
    plain = {row["case"]: row for row in rows if row["way"] == "plain"}
    x, lost, held, after, median = [], [], [], [], []
    for row in rows:
        if row["way"].startswith("map") and row.get("status") == "certified":
            # Joints slide during a transfer: what it began with counts.
            begun = row if row["way"] == "map landmarks" else plain[row["case"]]
            x.append([1.0, *(begun[k] for k in Mismatch._fields)])
            lost.append(distance(row[number]) - distance(row[f"{number}_before"]))
            held.append(way(row))
            after.append(row[number])
            median.append(distance(row[f"{number}_before"]))
    x, lost, held, after, before = np.array(x), np.array(lost), np.array(held), np.array(after), np.array(median)
    found = {part: quantile(x[~held], lost[~held], part) for part in PARTS}
    below = ", ".join(f"{(lost[held] <= x[held] @ b).mean():.2f}" for b in found.values())
    said = 1 / np.cosh(np.maximum(before + x @ found[0.5], 0.0))
    error = np.median(abs(said - after)[held])
    rank = spearmanr(said[held], after[held]).statistic
    poor = said[held] < POOR
    text = (
        f"| {number} | {held.sum()} | {below} | {rank:.2f} | {error:.3f} | {np.median(after[held]):.3f} | "
        f"{(after[held][poor] < POOR).sum()} of {poor.sum()} |"
    )
    return found, text


def constants(right: np.ndarray, mean: dict[float, np.ndarray], least: dict[float, np.ndarray]) -> str:
    """The module that holds them."""

    def row(values: np.ndarray) -> str:
        return "(" + ", ".join(f"{value:.3g}" if abs(value) >= 5e-4 else "0.0" for value in values) + ")"

    def table(of: dict[float, np.ndarray]) -> str:
        return "{\n" + "".join(f"    {part}: {row(values)},\n" for part, values in of.items()) + "}"

    return MODULE.format(right=row(right), mean=table(mean), least=table(least))


def fit(rows: list[dict], write: bool) -> str:
    """Constants of two thirds of the targets, and what they are worth on the others."""

    def held_out(row: dict) -> bool:
        return row["case"] % 3 == 2

    right, first = fit_right(rows, held_out)
    mean, second = fit_quantiles(rows, "mean", held_out)
    least, third = fit_quantiles(rows, "min", held_out)
    text = constants(right, mean, least)
    if write:
        PLACE.write_text(text)
    header = (
        "| scaled Jacobian | maps held out | part below the three quantiles | rank correlation of median and map | "
        "median error | median | poor ones among those called poor |\n| --- | --- | --- | --- | --- | --- | --- |"
    )
    return f"{text}\n{first}\n\n{header}\n{second}\n{third}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-n", type=int, default=384, help="targets")
    parser.add_argument("-o", "--output", help="JSON file of all that was found")
    parser.add_argument("--workers", type=int, default=os.cpu_count())
    parser.add_argument("--fit", metavar="ROWS.json", help="fit what an earlier run has found")
    parser.add_argument("--write", action="store_true", help="write the constants into the package")
    options = parser.parse_args()
    if options.fit:
        print(fit(json.loads(Path(options.fit).read_text()), options.write))
        return
    with ProcessPoolExecutor(options.workers, mp_context=get_context("spawn")) as executor:
        jobs = [executor.submit(rows_of, number) for number in range(options.n)]
        rows = []
        for done, job in enumerate(track(jobs, "targets")):
            rows += job.result()
            if done % 32 == 31 and options.output:
                Path(options.output).write_text(json.dumps(rows))
    if options.output:
        Path(options.output).write_text(json.dumps(rows))
    print(fit(rows, options.write))


if __name__ == "__main__":
    main()
