"""The page of `patchtransfer.reproduce`: its data as Markdown tables, with the pictures."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from ..measure.bounds import outwards

__all__ = ["page"]

OPENING = """# The paper's experiments on our samples

Made by `python -m patchtransfer.reproduce`
({}).
Numbers are in the CSV files beside this page and in `reproduction.json`. The paper's models are not published; ours are
drawings of our own, four of them of the same subjects: rows compare in kind, not digit by digit.

## Table 1: quality

Scaled Jacobian (SJ) and condition number κ over 10 × 10 samples a knot span, ends included; what is called proved are
bounds that hold between samples, too. `paper` and `certified` are the two methods, both with C1 rows. Time: one
transfer on a prepared plan. Boundary error: Hausdorff distance to the target over its diameter. Rows in italics are the
paper's, as printed.

At every point κ = (r + 1/r) / SJ with r = |B_u| / |B_v|: long patches alone make κ large. A perfect rectangle of 4 : 1
has κ = 4.25 on the unit square. The column "to scale" is the mean κ of the very same map when every strip of patches
has knots as long as the strip is (one factor a strip).
"""

#: Means of κ above this get a sentence.
LARGE = 2.7

LONG_PATCHES = """Means of κ above {} are due to long patches in the source, which a transfer keeps:
{}.
The samples make do with few patches, so that handles, arms and the strips around holes are several times as long as
wide. Measured to scale, all means are at most {:.2f}.
"""

MARKS = {"contradictory": "contradictory ¹", "doubtful": "doubtful ²"}

NOTES = {
    "contradictory": """¹ {}: as printed, the largest κ is a tenth of 2 / (smallest SJ). At every point κ ≥ 2 / SJ, so
the two numbers cannot belong to one map.
""",
    "doubtful": """² {}: as printed, the largest κ is ten times 2 / (smallest SJ). That is possible, but in the
other rows it is at most one and a half times; perhaps a zero was lost.
""",
}

FIGURES_8_TO_10 = """## Figure 8: sources, targets, results

![Sources, targets and results](figure8.png)

## Figure 9: scaled Jacobian

![Iso-parametric lines coloured by scaled Jacobian](figure9.png)

## Figure 10: slopes across interfaces

![Slope differences without and with continuity rows](figure10.png)

The paper takes differences of slopes; angles are shown here, on the interfaces of the {} that bend most. At the
control points whose rows are active they vanish. Rows are left out at the boundary and at extraordinary vertices,
where they
would fold the map (vertex rows stand in for the latter); there angles stay, or grow. Over all interfaces:
"""

FIGURE_11 = """## Figure 11: Poisson's equation

−Δφ = 2π² sin(πx) sin(πy) with φ = sin(πx) sin(πy), on the results of `certified`. Degrees and numbers of control points
are those of the paper's four columns. It does not name their models: they are taken in the order of Table 1.

![Exact solutions and absolute errors](figure11.png)
"""

FIGURE_12 = """## Figure 12: articulation in equal steps

![The wrench's jaws turned in equal steps](figure12.png)

Articulated are the patches that move from step to step: {}.
The corner bound is what the boundary's corners alone impose on the smallest scaled Jacobian.
"""


def page(data: dict[str, Any]) -> str:
    """The page that shows all data and pictures, in Markdown."""
    parts = [_opening(data), _table1(data["table1"])]
    parts += _long_patches(data["table1"])
    parts += [NOTES[r["remark"]].format(r["model"]) for r in data["table1"] if r["remark"]]
    parts += [FIGURES_8_TO_10.format(data["figure10_drawn"]), _table10(data["figure10"])]
    if data["figure11"]:
        parts += [FIGURE_11, _table11(data["figure11"])]
    if data["figure12"]:
        parts += [FIGURE_12.format(", ".join(map(str, data["figure12_articulated"]))), _table12(data["figure12"])]
    return "\n".join(parts)


def _opening(data: dict[str, Any]) -> str:
    made = f"patchtransfer {data['version']}"
    if data["commit"]:
        made += f", commit `{data['commit'][:12]}`" + (" with changes" if data["commit"].endswith("-dirty") else "")
    return OPENING.format(made)


def _table(header: str, rows: list[list[str]]) -> str:
    names = [name.strip() for name in header.split("|")]
    rule = "|".join("---" if k < 3 else "---:" for k in range(len(names)))
    lines = [f"| {' | '.join(cells)} |" for cells in [names, *rows]]
    return "\n".join([lines[0], f"|{rule}|", *lines[1:]]) + "\n"


def _number(x: float | None, digits: int = 4) -> str:
    return "∞" if x is None else f"{x:.{digits}g}" if abs(x) >= 1e-3 or x == 0 else f"{x:.2e}"


def _bound(x: float | None, towards: Callable[[float], int]) -> str:
    """A bound as it still holds."""
    return _number(None if x is None else outwards(x, 4, towards))


def _long_patches(rows: list[dict[str, Any]]) -> list[str]:
    """Why some means of κ are large: those of the sources are, and to scale they are not."""
    ours = {(r["sample"], r["method"]): r for r in rows if r["method"] in ("source", "certified")}
    large = [r for (_, method), r in ours.items() if method == "certified" and r["kappa_mean"] > LARGE]
    if not large:
        return []
    texts = [
        f"{r['sample']} (source {ours[r['sample'], 'source']['kappa_mean']:.2f}, result {r['kappa_mean']:.2f}; "
        f"to scale {ours[r['sample'], 'source']['kappa_mean_to_scale']:.2f} and {r['kappa_mean_to_scale']:.2f})"
        for r in large
    ]
    highest = max(r["kappa_mean_to_scale"] for r in rows if r["method"] != "printed")
    return [LONG_PATCHES.format(LARGE, ",\n".join(texts), highest)]


def _table1(rows: list[dict[str, Any]]) -> str:
    cells = []
    for r in rows:
        printed = r["method"] == "printed"
        numbers = [_number(r[key]) for key in ("sj_min", "sj_mean", "sj_max", "kappa_min", "kappa_mean", "kappa_max")]
        bounds = [("sj_min_proved", math.floor), ("kappa_max_proved", math.ceil)]
        least, most = ("–" if printed else _bound(r[key], towards) for key, towards in bounds)
        numbers = [numbers[0], least, *numbers[1:], most]
        numbers.append("–" if printed else _number(r["kappa_mean_to_scale"]))
        evidence = [
            MARKS[r["remark"]] if r["remark"] else (r["status"] or "–"),
            "–" if r["boundary_error"] is None else f"{r['boundary_error']:.1e}",
            "–" if r["seconds"] is None else f"{r['seconds']:.2f} s",
        ]
        name = f"*{r['model']}*" if printed else r["model"]
        cells.append([name, r["shape"], "*as printed*" if printed else r["method"], *numbers, *evidence])
    header = (
        "model | shape | method | SJ min | SJ min, proved | SJ mean | SJ max | κ min | κ mean | κ max | κ max, proved"
    )
    header += " | κ mean, to scale | certificate | boundary error | time"
    return _table(header, cells)


def _table10(rows: list[dict[str, Any]]) -> str:
    cells = []
    for r in rows:
        angles = [r[key] for key in ("slope_median_deg", "slope_mean_deg", "kink_mean_deg", "kink_max_deg")]
        residual = "–" if r["residual"] is None else f"{r['residual']:.0e}"
        left_out = "–" if r["left_out"] is None else str(r["left_out"])
        cells.append([r["sample"], r["rows"], str(r["active"]), left_out, residual, *(f"{x:.1f}°" for x in angles)])
    header = (
        "sample | rows | active | left out | residual / diameter | slope median | slope mean | kink mean | kink max"
    )
    return _table(header, cells)


def _table11(rows: list[dict[str, Any]]) -> str:
    cells = []
    for r in rows:
        errors = [f"{r[key]:.1e}" for key in ("l2_error", "h1_error", "max_error")]
        cells.append([r["sample"], str(r["degree"]), r["points"], str(r["dofs"]), *errors, f"{r['exact_max']:.2f}"])
    header = "sample | degree | points a patch | unknowns | L2 error | H1 error | max error | max of solution"
    return _table(header, cells)


def _table12(rows: list[dict[str, Any]]) -> str:
    keys = ("corner_bound", "sj_min", "sj_mean", "articulated_sj_min", "articulated_sj_mean")
    cells = [[str(r["step"]), r["status"], *(_number(r[key], 3) for key in keys)] for r in rows]
    header = "step | certificate | corner bound | SJ min | SJ mean | articulated SJ min | articulated SJ mean"
    return _table(header, cells)
