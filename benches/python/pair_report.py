"""Tables of all directions by family, and what is not as it should be by cause."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pair_families import FAMILIES
from pair_judgement import CLEAN, SUCCESS, Direction

HEADER = """# Pairs of real drawings

Made by `python benches/python/pairs.py{options}`. Two drawings of the same kind of thing, not one and its deformation:
a glyph in two fonts that ship with matplotlib, airfoils and icons by formula, outlines of other programs' models.
Every outline's source is what `parameterize` finds; each is transferred to the other, without landmarks, with
`continuity="c1"` and otherwise defaults but for the options above. Measured by means of their own: corners (turns
above 25°) that a joint of the result lies on, and turns at, within 1e-3 of the diameter; the distance of dense
polygons, relative to the diameter; scaled Jacobians beside those of the target's own layout.

Clean: certified, all corners of the target on joints, boundary error at most {clean:g}. Wrongly a success: returned,
with a boundary error above {success:g}. Corners kept, boundary error (median / 95 %) and loss are of what was returned.
Loss: mean scaled Jacobian of the target's own layout less that of the result, median / 95 %; in brackets against the
source's. CPU: processor time of the transfer in seconds, median / largest, on a machine busy with other work.

"""

COLUMNS = ("family", "directions", "certified or degenerate", "clean", "wrongly a success", "corners kept")
COLUMNS += ("boundary error", "loss", "CPU", "exceptions")
TABLE = f"| {' | '.join(COLUMNS)} |\n|---|{'---:|' * (len(COLUMNS) - 1)}\n"

PICTURE = """
![Source and result of some directions side by side, patches that correspond in like colours](images/{name})

Red circles: corners of the target without a joint. Brown squares: corners of the source on smooth places.
"""

CAUSES = """
## What is not as it should be, by cause

A direction may have several.

"""


def page(directions: Sequence[Direction], options: str, picture: str | None) -> str:
    """The page of the documentation."""
    text = HEADER.format(options=options, clean=CLEAN, success=SUCCESS) + table(directions)
    return text + (PICTURE.format(name=picture) if picture else "") + CAUSES + by_cause(directions)


def table(directions: Sequence[Direction]) -> str:
    """A row a family, and one for all."""
    rows = {family: [o for o in directions if o.family == family] for family in FAMILIES}
    return TABLE + "".join(_row(name, rows) for name, rows in [*rows.items(), ("all", list(directions))] if rows)


def _row(name: str, of: Sequence[Direction]) -> str:
    done = [o for o in of if o.success]
    wrongly = sum(o.boundary_error is not None and o.boundary_error > SUCCESS for o in done)
    wanted, lost = sum(o.corners for o in done), sum(len(o.lost) for o in done)
    errors = [o.boundary_error for o in done if o.boundary_error is not None]
    own = [o.loss for o in done if o.loss is not None]
    before = [o.source_jacobian[1] - o.jacobian[1] for o in done if o.source_jacobian and o.jacobian]
    seconds = [o.seconds for o in of if np.isfinite(o.seconds)]
    late = any(o.status == "no answer" for o in of)
    cells = [name, str(len(of)), _share(len(done), len(of)), _share(sum(o.clean for o in of), len(of)), str(wrongly)]
    cells += [f"{wanted - lost} of {wanted}", _two(errors, 95, ".0e"), f"{_two(own, 95)} ({_two(before, 95)})"]
    cells += ["> " * late + _two(seconds, 100, ".1f"), str(sum(o.status == "exception" for o in of))]
    return f"| {' | '.join(cells)} |\n"


def _share(part: int, whole: int) -> str:
    return f"{100 * part / whole:.0f} %"


def _two(numbers: Sequence[float], percent: float, form: str = ".3f") -> str:
    """Median and percentile."""
    return f"{np.median(numbers):{form}} / {np.percentile(numbers, percent):{form}}" if numbers else "–"


def by_cause(directions: Sequence[Direction]) -> str:
    """Names of the directions by cause."""
    found: dict[str, list[str]] = {}
    for o in directions:
        for cause in o.causes():
            found.setdefault(cause, []).append(o.name)
    order = sorted(found.items(), key=lambda item: -len(item[1]))
    return "\n".join(f"- **{cause}** ({len(names)}): {'; '.join(names)}" for cause, names in order) + "\n"


def line(o: Direction) -> str:
    """One direction, as it is done."""
    measured = ""
    if o.jacobian is not None:
        own = f" (own {o.own_jacobian[1]:.2f})" if o.own_jacobian else ""
        measured = (
            f", error {o.boundary_error:.1e}, {o.corners - len(o.lost)} of {o.corners} corners, scaled Jacobian "
            f"{o.jacobian[0]:.2f} / {o.jacobian[1]:.2f}{own}"
        )
    reason = "" if o.status == "certified" else f": {o.reason[:160]}"
    return f"{o.family}: {o.name}: {o.status}{measured}, {o.seconds:.1f} s{reason}"
