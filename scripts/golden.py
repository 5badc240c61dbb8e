"""Writes what all examples give, bit by bit, to compare two states of the code: ``python scripts/golden.py OUT.json``.

Every example with c0, c1 and g1 rows, by both methods, with landmarks and (c1) without: a hash of the control points
and the report without timings. Two files that are equal come from code that behaves alike.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import patchtransfer as pt
from patchtransfer.examples import EXAMPLES, load


def main() -> None:
    """Run all cases and write one line for each."""
    Path(sys.argv[1]).write_text("".join(json.dumps(case, sort_keys=True) + "\n" for case in cases()))


def cases() -> Iterator[dict[str, Any]]:
    """Outcome of every example under every option."""
    for name in EXAMPLES:
        source, target, landmarks = load(name)
        for continuity in ("c0", "c1", "g1"):
            wanted = source.split_spans(2).reduce_continuity(1) if continuity == "g1" else source
            for method in ("certified", "paper"):
                yield outcome(f"{name} {continuity} {method}", wanted, target, landmarks, continuity, method)
        yield outcome(f"{name} c1 certified, no landmarks", source, target, None, "c1", "certified")


def outcome(case: str, *arguments: Any) -> dict[str, Any]:
    """Hash of the control points, and the report."""
    try:
        result = pt.transfer(*arguments, on_failure="return")
    except pt.TransferError as error:
        return {"case": case, "error": str(error)}
    bits = hashlib.sha256(b"".join(patch.control_points.tobytes() for patch in result.multipatch.patches))
    report = {key: value for key, value in result.to_dict().items() if key != "timings"}
    return {"case": case, "control_points": bits.hexdigest(), "report": report, "log": result.log}


if __name__ == "__main__":
    main()
