"""A registration with other loops: what it says of the target's corners is said anew."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from .missed_corners import missed_corners, missed_warnings
from .register import LoopRegistration, Registration

__all__ = ["with_loops"]


def with_loops(registration: Registration, loops: Sequence[LoopRegistration]) -> Registration:
    """The registration with other loops, and what it says of the corners that they miss."""
    old = registration.missed_corners
    stale = {line for k in range(len(loops)) for line in missed_warnings([c for c in old if c.loop == k])}
    warnings, missed, unit = [line for line in registration.warnings if line not in stale], [], loops[0].target.diameter
    for k, loop in enumerate(loops):
        of_loop = missed_corners(loop.source, loop.target, loop.anchors, k, unit)
        warnings += missed_warnings(of_loop)
        missed += of_loop
    return replace(registration, loops=tuple(loops), warnings=tuple(warnings), missed_corners=tuple(missed))
