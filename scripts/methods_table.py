"""Compare method="certified" with method="paper" on all samples and deformations: writes docs/methods.md.

python scripts/methods_table.py [OUT.md]
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path

import patchtransfer as pt
from patchtransfer import MultiPatch, TransferPlan, TransferResult, examples

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "support"))
import targets  # noqa: E402  (deformations with known correspondence)

DEFORMATIONS: dict[str, Callable[[MultiPatch], targets.Deformation]] = {
    "bend 30°": lambda mp: targets.bend(mp, 30),
    "bend 60°": lambda mp: targets.bend(mp, 60),
    "bend 90°": lambda mp: targets.bend(mp, 90),
    "articulation 30°": lambda mp: targets.articulation(mp, 30, blend=0.4),
    "swirl 60°": lambda mp: targets.swirl(mp, (0.5, 0.5), 60, 0.5),
    "bump": lambda mp: targets.bump(mp, (0.2, 0.5), (0.15, 0.05), 0.25),
    "stretch 4:1": lambda mp: targets.stretch(2, 0),
    "stretch 8:1": lambda mp: targets.stretch(8**0.5, 0),
    "stretch 8:1, oblique": lambda mp: targets.stretch(8**0.5, 30),
    "stretch 16:1": lambda mp: targets.stretch(4, 0),
}

HEADER = """# The two methods side by side

Written by `scripts/methods_table.py`. Every sample goes to its own target and to deformations of its own boundary, by
`method="certified"` (c) and `method="paper"` (p), patches joined C0. Status: the certificate's. Flips: flipped faces of
the paper's mesh after the harmonic map → at the end, with the local-global steps in parentheses; a mesh without flips
need not give an injective spline. min, mean: scaled Jacobian. Time: processor time of the whole transfer on a prepared
plan, of which the paper's method spends nearly all in the iterations of the reversible harmonic map.

| sample | target | status c | status p | flips p | min c | min p | mean c | mean p | time c | time p |
|---|---|---|---|---|---:|---:|---:|---:|---:|---:|
"""


def run(plan: TransferPlan, *args: object, method: str) -> tuple[TransferResult, float]:
    """Result and processor time."""
    begin = time.process_time()
    result = plan.transfer(*args, method=method, refine="never", fixed_correspondence=True, on_failure="return")  # type: ignore[arg-type]
    return result, time.process_time() - begin


def row(name: str, kind: str, both: list[tuple[TransferResult, float]]) -> str:
    """One line of the table."""
    (ours, _), (paper, _) = both
    history = paper.paper_history
    flips = "–"
    if history is not None:
        flips = f"{history.flips[0]} → {min(history.flips)} ({len(history.flips) - 1})"
    metrics = [r.quality.scaled_jacobian for r, _ in both]
    cells = [name, kind, ours.certificate.status, paper.certificate.status, flips]
    cells += [f"{m.min:.3f}" for m in metrics] + [f"{m.mean:.3f}" for m in metrics]
    cells += [f"{1e3 * seconds:.0f} ms" for _, seconds in both]
    return f"| {' | '.join(cells)} |\n"


def main(output: Path) -> None:
    """Run everything and write the table."""
    text, results, refused = HEADER, [], []
    for name in examples.EXAMPLES:
        source, target, landmarks = examples.load(name)
        plan = TransferPlan(source, "c0")
        cases = [("own target", lambda t=target, marks=landmarks: (t, marks))]
        for kind, make in DEFORMATIONS.items():
            cases.append((kind, lambda f=make, mp=source: targets.deformed(mp, f(mp))))
        for kind, case in cases:
            try:
                both = [run(plan, *case(), method=method) for method in ("certified", "paper")]
            except pt.TransferError as error:
                refused.append(f"- {name}, {kind}: {error}\n")
                continue
            results.append([r for r, _ in both])
            text += row(name, kind, both)
            print(text.splitlines()[-1], flush=True)
    certified = [sum(pair[i].certificate.injective for pair in results) for i in (0, 1)]
    free = sum(min(p.paper_history.flips) == 0 for _, p in results if p.paper_history)
    better = sum(c.quality.scaled_jacobian.min > p.quality.scaled_jacobian.min for c, p in results)
    text += (
        f"\nOf {len(results)} targets {certified[0]} are certified by `certified`, {certified[1]} by `paper`; {free} "
        f"of the paper's meshes end without flips. The smallest scaled Jacobian of `certified` is the larger one on "
        f"{better}.\n"
    )
    if refused:
        text += "\nRefused as targets, by both methods:\n\n" + "".join(refused)
    output.write_text(text)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("output", type=Path, nargs="?", default=ROOT / "docs" / "methods.md", metavar="OUT.md")
    main(parser.parse_args().output)
