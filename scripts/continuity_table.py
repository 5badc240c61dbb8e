"""What continuity costs in quality: ``python scripts/continuity_table.py [MODEL.xml ...]`` writes a Markdown table.

Every sample is transferred to its own target and to its boundary bent and nodding, with c0, c1 and g1, all in the same
spline space (degree 3 or more, inner knots of C1, two spans or more, which g1 needs). `docs/continuity.md` holds the
output, with disc, turtle and yeti of the G+Smo collection as models.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

import patchtransfer as pt
from patchtransfer import examples

Deformation = Callable[[np.ndarray], np.ndarray]


def bend(points: np.ndarray, degrees: float) -> Deformation:
    """Bend the longer side of the bounding box into an arc of the given angle."""
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    along = int(np.argmax(size))
    radius = size[along] / np.radians(degrees)

    def f(x: np.ndarray) -> np.ndarray:
        s, t = x[:, along] - low[along], x[:, 1 - along] - low[1 - along] - size[1 - along] / 2
        bent = np.column_stack([(radius - t) * np.sin(s / radius), radius - (radius - t) * np.cos(s / radius)])
        # An exchange of the axes would mirror.
        return bent if along == 0 else bent * [1, -1]

    return f


def nod(points: np.ndarray, degrees: float) -> Deformation:
    """Rotate what lies beyond 65 % of the longer side, with a smooth transition over 30 % of it."""
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    along = int(np.argmax(size))
    joint = low + size / 2
    joint[along] = low[along] + 0.65 * size[along]

    def f(x: np.ndarray) -> np.ndarray:
        s = np.clip((x[:, along] - joint[along]) / (0.3 * size[along]) + 0.5, 0, 1)
        angle = np.radians(degrees) * s**3 * (10 - 15 * s + 6 * s**2)
        d = x - joint
        turned = np.column_stack(
            [np.cos(angle) * d[:, 0] - np.sin(angle) * d[:, 1], np.sin(angle) * d[:, 0] + np.cos(angle) * d[:, 1]]
        )
        return np.asarray(joint + turned)

    return f


def deformed(mp: pt.MultiPatch, f: Deformation) -> tuple[pt.Boundary, np.ndarray]:
    """The boundary with its control points deformed, and its joints as landmarks."""
    loops = mp.boundary().loops
    target = pt.Boundary([[pt.BSplineCurve(c.knots, c.degree, f(c.control_points)) for c in loop] for loop in loops])
    joints = np.array(
        [[*c.start, *d.start] for a, b in zip(loops, target.loops, strict=True) for c, d in zip(a, b, strict=True)]
    )
    return target, joints


def with_freedom(mp: pt.MultiPatch) -> pt.MultiPatch:
    """The space that g1 needs."""
    p = min(min(patch.degrees) for patch in mp.patches)
    spans = min(len(np.unique(k)) - 1 for patch in mp.patches for k in patch.knots)
    mp = mp.elevate(3 - p) if p < 3 else mp
    return (mp.split_spans(2) if spans == 1 else mp).reduce_continuity(1)


def cases(paths: list[str]) -> Iterator[tuple[str, pt.MultiPatch, pt.Boundary, np.ndarray]]:
    """Model, spline space, target and landmarks by name."""
    for name in examples.EXAMPLES:
        source, target, landmarks = examples.load(name)
        source = with_freedom(source)
        points = source.topology.coordinates
        yield f"{name}, its target", source, target, landmarks
        yield f"{name}, bend 40°", source, *deformed(source, bend(points, 40))
        yield f"{name}, nod 25°", source, *deformed(source, nod(points, 25))
    for path in paths:
        source = with_freedom(pt.read(path))
        points = source.topology.coordinates
        yield f"{Path(path).name} (G+Smo), bend 40°", source, *deformed(source, bend(points, 40))
        yield f"{Path(path).name} (G+Smo), nod 25°", source, *deformed(source, nod(points, 25))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("models", nargs="*", metavar="MODEL.xml", help="more models than the samples")
    paths = parser.parse_args().models
    print("| model and target | continuity | scaled Jacobian min | mean | condition number mean | kink mean | AS-G1 |")
    print("|---|---|---|---|---|---|---|")
    for name, source, target, landmarks in cases(paths):
        for continuity in ("c0", "c1", "g1"):
            try:
                result = pt.transfer(
                    source,
                    target,
                    landmarks,
                    continuity,
                    refine="never",
                    fixed_correspondence=True,
                    on_failure="return",
                )
            except pt.TransferError as error:
                print(f"| {name} | {continuity} | {type(error).__name__}: {error} |")
                continue
            jacobian, smooth = result.quality.scaled_jacobian, result.continuity
            note = "" if result.certificate.injective else f" ({result.certificate.status})"
            if result.rows is not None and result.rows.without:
                note += f" ({len(result.rows.without)} interfaces without rows)"
            print(
                f"| {name} | {continuity}{note} | {jacobian.min:.3f} | {jacobian.mean:.3f} | "
                f"{result.quality.condition_number.mean:.3f} | {smooth.kink_deg.mean:.1f}° | "
                f"{smooth.as_g1_residual:.0e} |"
            )


if __name__ == "__main__":
    main()
