"""The certificate against exact rational arithmetic, on models that are nearly, or just not, injective.

PATCHTRANSFER_EXACT sets the number of models, for longer runs.
"""

from __future__ import annotations

import os
from collections import Counter
from dataclasses import dataclass, field
from functools import cache

import numpy as np
import pytest

from exact import near_critical
from exact.jacobian import examine, values_at
from exact.limited import LimitedCertify
from exact.loops import examine_loops
from exact.model import Disagreement, disagreements, opinion, reproducer
from patchtransfer import BSplineCurve, Certificate, InputError, Interface, MultiPatch, Patch, Side
from shapes import LINE, polygon

#: About a minute of processor time.
MODELS = int(os.environ.get("PATCHTRANSFER_EXACT", "4000"))
#: A family is left when the certificate has broken its limits this often: every time costs seconds.
BROKEN = 3
#: Disagreements printed with their models.
SHOWN = 3

SQUARE = np.array([[[0, 0], [0, 1]], [[1, 0], [1, 1.0]]])


@dataclass
class Findings:
    """A probe that remembers what went wrong."""

    certify: LimitedCertify
    wrong: list[tuple[MultiPatch, Disagreement]] = field(default_factory=list)
    broken: list[tuple[MultiPatch, Disagreement]] = field(default_factory=list)
    statuses: Counter = field(default_factory=Counter)

    def ask(self, model: MultiPatch) -> Certificate | str:
        outcome = self.certify(model)
        if isinstance(outcome, str) and not outcome.startswith("InputError"):
            self.broken.append((model, Disagreement("limits", outcome)))
        return outcome

    def status(self, model: MultiPatch) -> str:
        outcome = self.ask(model)
        return "none" if isinstance(outcome, str) else outcome.status

    def check(self, model: MultiPatch) -> None:
        outcome = self.ask(model)
        if isinstance(outcome, str):
            self.statuses["none"] += 1
            return
        self.statuses[outcome.status] += 1
        self.wrong += [(model, d) for d in disagreements(model, outcome)]


@cache
def findings(family: str) -> Findings:
    with LimitedCertify() as certify, np.errstate(over="ignore", invalid="ignore"):
        probe = Findings(certify)
        seed, share = 0, MODELS / len(near_critical.FAMILIES)
        while sum(probe.statuses.values()) < share and len(probe.broken) < BROKEN:
            try:
                near_critical.FAMILIES[family](np.random.default_rng([seed, *family.encode()]), probe)
            except InputError:
                # Rounding may part glued sides farther than a model is allowed to have them, or make knots too many.
                probe.statuses["refused"] += 1
            seed += 1
        return probe


def report(found: list[tuple[MultiPatch, Disagreement]], family: Findings) -> str:
    found = sorted(found, key=lambda f: sum(p.control_points.size for p in f[0].patches))
    lines = [f"{len(found)} of {dict(family.statuses)}"]
    return "\n".join(lines + [f"{d.text}\n    {reproducer(m)}" for m, d in found[:SHOWN]])


FAMILIES = pytest.mark.parametrize("family", near_critical.FAMILIES)


@FAMILIES
@pytest.mark.parametrize("claim", ["injective", "folded", "boundary", "bound", "degenerate"])
def test_nothing_claimed_is_refuted(family, claim):
    probe = findings(family)
    found = [(m, d) for m, d in probe.wrong if d.claim == claim]
    assert not found, report(found, probe)


@FAMILIES
def test_certify_stays_within_memory_and_time(family):
    probe = findings(family)
    assert not probe.broken, report(probe.broken, probe)


@pytest.mark.parametrize(
    "family", ["polynomial", "rational", "two_bodies", "spirals", "spikes", "subnormal_axes", "rings"]
)
def test_families_have_models_of_both_kinds(family):
    """What is never certified, or never folded, would test nothing."""
    statuses = findings(family).statuses
    assert statuses["certified"] > 0
    assert statuses["folded"] > 0


@FAMILIES
def test_families_are_decided(family):
    """Where nothing is claimed nothing can be refuted."""
    statuses = findings(family).statuses
    assert statuses["certified"] + statuses["degenerate"] + statuses["folded"] > 10


def quad(points) -> Patch:
    return Patch((LINE, LINE), (1, 1), points)


def moved_corner(x: float) -> np.ndarray:
    points = SQUARE.copy()
    points[0, 0] = x
    return points


def test_opinion_on_det_tells_the_last_bit():
    # With its first corner on the diagonal x + y = 1 a square has det J = 0 there.
    assert examine(quad(moved_corner(0.5))).kind == "corners"
    assert examine(quad(moved_corner(np.nextafter(0.5, 0)))).kind == "one sign"
    assert examine(quad(moved_corner(np.nextafter(0.5, 1)))).kind == "mixed"
    flat = SQUARE * [1.0, 0.0]
    assert examine(quad(flat)).kind == "zero"


def test_exact_pieces_agree_with_evaluation():
    rng = np.random.default_rng(5)
    for rational in (False, True):
        patch = near_critical.bent(rng, 4, rational)
        for u, v in rng.uniform(0, 1, (5, 2)):
            (found,) = values_at(patch, u, v)
            du, dv = patch.grid([u], [v], 1, 0)[0, 0], patch.grid([u], [v], 0, 1)[0, 0]
            weight = 1.0
            if rational:
                w = np.repeat(patch.weights[..., None], 2, axis=2)
                weight = Patch(patch.knots, patch.degrees, w).grid([u], [v])[0, 0, 0]
            size = weight**3 * np.linalg.norm(du) * np.linalg.norm(dv)
            assert abs(float(found) - weight**3 * (du[0] * dv[1] - du[1] * dv[0])) < 1e-11 * size


def test_minimum_between_dyadic_points_is_found():
    # x' = (u - 1/3)² + low: positive or negative near u = 1/3 only.
    for low, kind in ((1e-9, "one sign"), (-1e-9, "mixed")):
        x = np.cumsum([0, 1 / 9 + low, -2 / 9 + low, 4 / 9 + low]) / 3
        points = np.stack(np.meshgrid(x, [0.0, 1.0], indexing="ij"), -1)
        patch = Patch(([0.0] * 4 + [1.0] * 4, LINE), (3, 1), points)
        assert examine(patch).kind == kind


def test_opinion_on_polygons():
    square = polygon([(0, 0), (1, 0), (1, 1), (0, 1)])
    assert examine_loops([square]).simple is True
    assert examine_loops([polygon([(0, 0), (0, 1), (1, 1), (1, 0)])]).simple is False
    assert examine_loops([polygon([(0, 0), (1, 1), (1, 0), (0, 1)])]).simple is False
    last = np.nextafter(1, 2)
    assert examine_loops([square, polygon([(1, 0.5), (2, 0), (2, 1)])]).simple is False
    assert examine_loops([square, polygon([(last, 0.5), (2, 0), (2, 1)])]).simple is True
    # A hole runs clockwise, and so does nothing else.
    assert examine_loops([square, polygon([(0.5, 0.2), (0.2, 0.5), (0.5, 0.5)])]).simple is True
    assert examine_loops([square, polygon([(0.5, 0.2), (0.5, 0.5), (0.2, 0.5)])]).simple is False
    # A spike of no width, and one of the smallest.
    assert examine_loops([polygon([(0, 0), (2, 0), (1, 0), (1, 1)])]).simple is False
    assert examine_loops([polygon([(0, 0), (2, 0), (1, 5e-324), (1, 1)])]).simple is True


def test_opinion_on_parabolas():
    knots = [0.0, 0, 0, 1, 1, 1]

    def cap(height):
        return [BSplineCurve(knots, 2, [[0, 0], [1, height], [2, 0]]), *polygon([(2, 0), (1, 9), (0, 0)])[:2]]

    roof = polygon([(-1, -3), (3, -3), (1, -1.0)])
    # The parabola's lowest point is half as low as its middle control point.
    assert examine_loops([cap(-1.99), roof]).simple is True
    assert examine_loops([cap(-2.01), roof]).simple is False
    assert examine_loops([cap(8.9)]).simple is True
    assert examine_loops([cap(9.1)]).simple is False


def test_opinion_on_gluing():
    right = quad(SQUARE + np.array([1.0, 0.0]))
    glue = (Interface(0, Side.EAST, 1, Side.WEST, False),)
    assert opinion(MultiPatch([quad(SQUARE), right], glue)).injective is True
    # Not glued, they touch along a side.
    assert opinion(MultiPatch([quad(SQUARE), right], ())).injective is False
    folded = quad(SQUARE * [-1.0, 1.0] + [2.0, 0.0])
    back = quad(SQUARE * [-0.5, 1.0] + np.array([1.0, 0.0]))
    assert opinion(MultiPatch([quad(SQUARE), back], glue)).folded_over == (0,)
    assert opinion(MultiPatch([quad(SQUARE), folded], (Interface(0, Side.EAST, 1, Side.EAST, False),))).injective
