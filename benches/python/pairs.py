"""Transfer between real drawings of the same kind of thing: ``python benches/python/pairs.py --table OUT.md``.

Both directions of every pair, no landmarks, defaults; ``--options split=auto,mirror=auto`` hands options to `transfer`.
Every direction runs in a process of its own, which a limit of processor time ends. ``--sheet OUT.png`` is to be looked
at: whether a correspondence is right, a person tells.
"""

from __future__ import annotations

import argparse
import json
import resource
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import pair_report
import pair_sheet
from pair_families import FAMILIES, Drawing, Pair, pairs
from pair_judgement import Direction, jacobian, judge
from pair_sheet import Drawn

import patchtransfer as pt

#: Pairs of each family in a quick run.
QUICK = 1
#: An answer that takes this many times its limit on the clock has no processor to itself, or sleeps.
PATIENCE = 20
OURS = [
    f"patchtransfer.{name}" for name in ("pipeline.transfer", "sources.auto_layout.parameterize", "measure.quality")
]
#: Dots per inch of the picture in the documentation.
SMALL = 55
#: From a clean process, so that no thread is copied; what takes time to import is so once.
CONTEXT = get_context("forkserver")
CONTEXT.set_forkserver_preload(["fontTools.ttLib", "matplotlib.figure", "PIL.Image", "scipy.interpolate", *OURS])

Source = tuple[pt.MultiPatch | None, str, tuple[float, float] | None]
Sources = dict[str, Future[Source]]


def limited(function: Callable[..., Any], arguments: tuple[Any, ...], seconds: float) -> Any:
    """What the function returns, in a process of its own; None where the processor time did not suffice."""
    receiver, sender = CONTEXT.Pipe(duplex=False)
    process = CONTEXT.Process(target=_answer, args=(sender, seconds, function, arguments))
    process.start()
    sender.close()
    try:
        return receiver.recv() if receiver.poll(PATIENCE * seconds) else None
    except EOFError:
        return None
    finally:
        process.kill()
        process.join()


def _answer(sender: Connection, seconds: float, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    limit = int(time.process_time() + seconds) + 1
    resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
    sender.send(function(*arguments))


def source_of(boundary: pt.Boundary) -> Source:
    """Source, why there is none, and its scaled Jacobian."""
    try:
        mp = pt.parameterize(boundary).multipatch
    except pt.TransferError as error:
        return None, f"{type(error).__name__}: {error}", None
    return mp, "", jacobian(mp)


def source_in_time(boundary: pt.Boundary, seconds: float) -> Source:
    """A layout is no transfer: it may take several times as long."""
    return limited(source_of, (boundary,), 4 * seconds) or (None, f"none within {4 * seconds:g} s", None)


def direction(a: Drawing, b: Drawing, sources: Sources, family: str, options: dict[str, str], seconds: float) -> Drawn:
    """One direction with what is drawn of it."""
    source, reason, of_source = sources[a.name].result()
    own = sources[b.name].result()[2]
    blank = Direction(family, a.name, b.name, source_jacobian=of_source, own_jacobian=own)
    if source is None:
        blank.status, blank.reason = "no source", reason
        return blank, None, None, b.boundary
    answer = limited(judge, (blank, source, b.boundary, options), seconds)
    if answer is None:
        blank.reason = f"none within {seconds:g} s of processor time"
        return blank, source, None, b.boundary
    return answer[0], source, answer[1], b.boundary


def run(chosen: Sequence[Pair], options: dict[str, str], workers: int, seconds: float) -> list[Drawn]:
    """All directions; what is done is printed."""
    sources: Sources = {}
    jobs, outcomes = [], []
    with ThreadPoolExecutor(workers) as threads:
        for pair in chosen:
            # First come, first served: a source that a direction waits for is done or under way.
            for d in (pair.first, pair.second):
                if d.name not in sources:
                    sources[d.name] = threads.submit(source_in_time, d.boundary, seconds)
            for a, b in ((pair.first, pair.second), (pair.second, pair.first)):
                jobs.append(threads.submit(direction, a, b, sources, pair.family, options, seconds))
        for job in jobs:
            outcomes.append(job.result())
            print(pair_report.line(outcomes[-1][0]), flush=True)
    return outcomes


def chosen_pairs(families: Sequence[str], number: int | None, quick: bool) -> list[Pair]:
    """The first pairs of every family."""
    if quick:
        number = QUICK
    return [pair for family in families for pair in pairs(family)[:number]]


def first_of_each_family(outcomes: Sequence[Drawn]) -> list[Drawn]:
    """Both directions of a pair."""
    return [one for family in FAMILIES for one in [one for one in outcomes if one[0].family == family][:2]]


def option(text: str) -> dict[str, str]:
    """KEY=VALUE,KEY=VALUE as a dictionary."""
    return dict(part.split("=", 1) for part in text.split(",") if part)  # type: ignore[misc]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = ", ".join(FAMILIES)
    parser.add_argument("--families", nargs="+", default=FAMILIES, choices=FAMILIES, metavar="NAME", help=names)
    parser.add_argument("-n", type=int, help="pairs of each family at most")
    parser.add_argument("--quick", action="store_true", help="the first pair of each family only")
    parser.add_argument("--options", type=option, default={}, metavar="KEY=VALUE,...", help="handed to transfer")
    parser.add_argument("--limit", type=float, default=25.0, help="processor seconds of a direction (default: 25)")
    parser.add_argument("--workers", type=int, default=1, help="directions at once (1; more disturb each other)")
    parser.add_argument("--json", type=Path, metavar="OUT", help="all directions")
    parser.add_argument("--sheet", type=Path, metavar="OUT.png", help="contact sheet, in pages where it is large")
    parser.add_argument("--table", type=Path, metavar="OUT.md", help="page of the documentation")
    a = parser.parse_args()
    outcomes = run(chosen_pairs(a.families, a.n, a.quick), a.options, a.workers, a.limit)
    directions = [one[0] for one in outcomes]
    print(pair_report.table(directions))
    print(pair_report.by_cause(directions))
    if a.json:
        rows = [asdict(o) | {"clean": o.clean, "causes": list(o.causes())} for o in directions]
        a.json.write_text(json.dumps(rows, indent=1) + "\n")
    if a.sheet:
        print(*pair_sheet.draw(outcomes, a.sheet))
    if a.table:
        given = " --quick" * a.quick + (f" -n {a.n}" if a.n else "") + _given(a)
        picture = a.table.parent / "images" / f"{a.table.stem}.png"
        pair_sheet.draw(first_of_each_family(outcomes), picture, len(FAMILIES), SMALL)
        a.table.write_text(pair_report.page(directions, given, picture.name))


def _given(a: argparse.Namespace) -> str:
    """Options that change what is measured, as they were given."""
    families = "" if tuple(a.families) == FAMILIES else f" --families {' '.join(a.families)}"
    options = ",".join(f"{key}={value}" for key, value in a.options.items())
    return families + (f" --options {options}" if options else "")


if __name__ == "__main__":
    main()
