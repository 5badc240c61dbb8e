"""Measure registration on deformed models and write the tables of ``docs/registration.md``.

``PATCHTRANSFER_MODELS=folder python scripts/registration_table.py [--seed N] [--models a,b] [-o docs/registration.md]``
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from registration_cases import Case, cases, correspondence_error

from patchtransfer import TransferError, TransferPlan
from patchtransfer.fitting.fit import FittedBoundary, fit_boundary
from patchtransfer.registration.register import Registration, register

TEXT = """# Registration, measured

Which point of the target's boundary belongs to which of the source's? Here the answer is known: models are deformed by
maps of the plane, and their boundaries are then cut into other curves, of another degree, start and sense.

- **Correspondence error**: distance of the images of all joints from the true ones, relative to the diagonal of the
  target's box; the mean over the joints, averaged over the cases and for the worst case.
- **Boundary error**: Hausdorff distance of fit and target, relative to the target's diameter; median of the cases.
- **Scaled Jacobian**: mean over the final map, averaged over the cases; **certified**: maps proved injective (or
  degenerate at named corners only, where a patch fills a straight angle).

Columns: landmarks at no joint or at all of them; samples at uniform parameters (the paper's) or with the source's speed
and corrected (the default); joints fixed where registration puts them or slid to lower the distortion of the map (the
default without landmarks). Written by `scripts/registration_table.py`.

Sliding looks for the least distortion, not for the deformation that made the target: its maps are better, its joints as
near to the true ones as before, not nearer.

A bend by a large angle is far from rigid: one side of the model is stretched by half, the other compressed. The last
slide asks for a smooth map between the boundaries and so finds it (yeti bent by 60 degrees across its length, not a
case below: 0.006 to 0.009 off; by inner distances alone 0.02 to 0.03). A disc has no start of its own: its bends and
turned halves also rotate it, which nobody can see, so its row is the rotation. The margin to the runner-up says so: it
is near 0 where another correspondence fits as well. A frame that a stretch makes as wide as it was high fits turned by
a quarter: the one large error of its family. Sides of squares have no features: a swirl moves them along themselves,
and only how they turn tells.
"""
#: Landmarks, parameters, joints.
CHOICES = [
    ("none", "uniform", "fixed"),
    ("none", "speed", "fixed"),
    ("none", "speed", "slid"),
    ("all joints", "uniform", "fixed"),
    ("all joints", "speed", "fixed"),
]
#: Models with rows of their own: a disc's rotation and squares' sides, which tell nothing, would hide the rest.
APART = ("disc", "squares")
Choice = tuple[str, str, str]


class Row:
    """Figures of one family, or of one model."""

    def __init__(self) -> None:
        self.errors: dict[str, list[float]] = defaultdict(list)
        self.boundary: dict[Choice, list[float]] = defaultdict(list)
        self.jacobian: dict[Choice, list[float]] = defaultdict(list)
        self.certified: dict[Choice, list[bool]] = defaultdict(list)
        self.margin: list[float] = []


def measure(case: Case, plan: TransferPlan, rows: list[Row]) -> None:
    """Register and transfer one case in all ways."""
    loops = case.source.boundary().loops
    for landmarks in ("none", "all joints"):
        registration = register(loops, case.target, None if landmarks == "none" else case.truth)
        for row in rows:
            row.errors[landmarks].append(correspondence_error(case, registration.joints))
            if landmarks == "none":
                row.margin.append(registration.margin)
        for choice in CHOICES:
            if choice[0] == landmarks:
                transfer_with(case, plan, registration, choice, rows)


def transfer_with(case: Case, plan: TransferPlan, registration: Registration, choice: Choice, rows: list[Row]) -> None:
    """Transfer with a given registration and choice of parameters."""

    def fit(*arguments: Any, parameters: str = "speed", **options: Any) -> FittedBoundary:
        del parameters
        return fit_boundary(*arguments, parameters=choice[1], **options)

    with (
        patch("patchtransfer.pipeline.source_boundary.fit_boundary", fit),
        patch("patchtransfer.pipeline.source_boundary.register", lambda *_, **__: registration),
    ):
        try:
            fixed = choice[2] == "fixed"
            result = plan.transfer(case.target, fixed_correspondence=fixed, on_failure="return")
        except TransferError as error:
            print(f"{case.model}, {case.family} {case.label}, {choice}: {error}")
            for row in rows:
                row.certified[choice].append(False)
            return
    status = result.certificate.status
    if status not in ("certified", "degenerate"):
        print(f"{case.model}, {case.family} {case.label}, {choice}: {status}")
    for row in rows:
        if not fixed:
            row.errors["slid"].append(correspondence_error(case, result.registration.joints))
        row.boundary[choice].append(result.boundary_error)
        row.jacobian[choice].append(result.quality.scaled_jacobian.mean)
        row.certified[choice].append(status in ("certified", "degenerate"))


def correspondence_table(rows: dict[str, Row], first: str) -> list[str]:
    """Markdown: mean and largest correspondence error."""
    lines = [
        f"| {first} | cases | no landmarks: mean | largest | margin | slid: mean | largest | all joints: mean | "
        "largest |",
        "|---" * 9 + "|",
    ]
    for name, row in rows.items():
        none, slid, every = row.errors["none"], row.errors["slid"], row.errors["all joints"]
        lines.append(
            f"| {name} | {len(none)} | {np.mean(none):.4f} | {max(none):.4f} | {np.mean(row.margin):.2f} | "
            f"{np.mean(slid):.4f} | {max(slid):.4f} | {np.mean(every):.1e} | {max(every):.1e} |"
        )
    return lines


def map_table(rows: dict[str, Row]) -> list[str]:
    """Markdown: boundary error, mean scaled Jacobian and certified maps for every choice."""
    head = [f"{parameters}, landmarks: {landmarks}, {joints}" for landmarks, parameters, joints in CHOICES]
    lines = [f"| family | {' | '.join(head)} |", "|---" * (len(CHOICES) + 1) + "|"]
    for name, row in rows.items():
        cells = [
            f"{np.median(row.boundary[c]):.1e}, {np.mean(row.jacobian[c]):.3f}, "
            f"{sum(row.certified[c])}/{len(row.certified[c])}"
            for c in CHOICES
        ]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    return lines


def main() -> None:
    """Measure all cases and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--models", default="")
    parser.add_argument("-o", "--output", default=str(Path(__file__).parents[1] / "docs" / "registration.md"))
    arguments = parser.parse_args()
    families: dict[str, Row] = defaultdict(Row)
    by_model: dict[str, Row] = defaultdict(Row)
    plans: dict[str, TransferPlan] = {}
    for case in cases(arguments.seed, [name for name in arguments.models.split(",") if name]):
        plan = plans.setdefault(case.model, TransferPlan(case.source))
        family = f"{case.model}: {case.family}" if case.model in APART else case.family
        measure(case, plan, [families[family], by_model[case.model]])
    families = dict(sorted(families.items(), key=lambda item: item[0].startswith(APART)))
    page = [
        TEXT,
        f"## Correspondence (seed {arguments.seed})\n",
        *correspondence_table(families, "family"),
        "",
        *correspondence_table(by_model, "model"),
        "\n## Maps: boundary error, mean scaled Jacobian, certified\n",
        *map_table(families),
    ]
    Path(arguments.output).write_text("\n".join(page) + "\n")


if __name__ == "__main__":
    main()
