"""Middles of c chosen by the energy: their derivatives, and maps that are better with no larger kinks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import models
import patchtransfer as pt
import smoothness
import targets
from patchtransfer import examples
from patchtransfer.continuity.g1 import gluing_data, rows_of
from patchtransfer.continuity.interfaces import control_rows
from patchtransfer.continuity.middles import Middles, mean_kink
from patchtransfer.continuity.null_space import row_space
from patchtransfer.interior import solver
from patchtransfer.interior.optimizer import SplineOptimizer

MODELS = ["o-grid p3", "star of valence 5, p3", "star of valence 6", "nine cells", "quartic, one span"]


def fitted(name: str, monkeypatch: pytest.MonkeyPatch) -> tuple[pt.MultiPatch, np.ndarray]:
    """A model, and its exact map with the middles that fit the map with C1 rows best."""
    monkeypatch.setattr(
        solver, "with_better_middles", lambda t, control, x, certificate, rows, *_: (x, certificate, rows, [])
    )
    mp = models.SPACES[name]()
    target, landmarks = targets.deformed(mp, targets.bend(mp, 30), seed=len(name))
    found = pt.transfer(mp, target, landmarks, "g1").multipatch.topology.coordinates
    monkeypatch.undo()
    return mp, found


def changed(data, free: np.ndarray, by: np.ndarray):
    coefficients = data.coefficients.copy()
    coefficients[free, 5] += by
    return replace(data, coefficients=coefficients)


@pytest.mark.parametrize("name", MODELS)
def test_motions_keep_the_rows_of_other_middles(name, monkeypatch):
    mp, x = fitted(name, monkeypatch)
    control = control_rows(mp.topology)
    data = gluing_data(mp.topology, control, x)
    middles = Middles(mp.topology, control, data, x)
    _, motions = middles.space()
    assert len(motions) == len(middles.free) > 0
    closed = mp.topology.interior_points
    for k, motion in enumerate(motions):
        outside = np.delete(motion, closed, axis=0)
        np.testing.assert_array_equal(outside, 0)
        if name == "nine cells":
            continue  # There no middle changes alone: the twists would not close.
        step = 1e-3 * np.eye(len(motions))[k]
        rows = rows_of(mp.topology, control, changed(data, middles.free, step))
        moved = x + 1e-3 * motion
        assert np.abs(rows.matrix @ x).max() > 1e-6 * mp.diameter
        # Quadratic in the step: half of it leaves a quarter.
        left = np.abs(rows.matrix @ moved).max()
        half = rows_of(mp.topology, control, changed(data, middles.free, step / 2))
        assert np.abs(half.matrix @ (x + 5e-4 * motion)).max() < 0.3 * left + 1e-9 * mp.diameter


@pytest.mark.parametrize("name", ["o-grid p3", "star of valence 5, p3"])
def test_slopes_are_those_of_the_least_energy(name, monkeypatch):
    """Second route: the minimum under rows of other middles, by the optimiser."""
    mp, x = fitted(name, monkeypatch)
    t, control = mp.topology, control_rows(mp.topology)
    data = gluing_data(t, control, x)
    middles = Middles(t, control, data, x)
    space, motions = middles.space()
    optimizer = SplineOptimizer(t, null_space=space.columns)
    assert optimizer.linearise(x)
    _, slopes, _ = optimizer.motions(motions)
    direction = np.random.default_rng(1).normal(size=len(slopes))

    def least(step: float) -> float:
        rows = row_space(rows_of(t, control, changed(data, middles.free, step * direction)), t.interior_points, x)
        return SplineOptimizer(t, null_space=rows.columns).minimise(rows.project(x), tolerance=1e-12).energy

    h = 1e-3
    np.testing.assert_allclose((least(h) - least(-h)) / (2 * h), slopes @ direction, rtol=1e-3, atol=1e-7)


@pytest.mark.parametrize("name", [*MODELS, *models.EXAMPLES])
def test_maps_have_less_energy_and_no_larger_kinks(name, monkeypatch):
    if name in examples.EXAMPLES:
        source, target, landmarks = examples.load(name)
        source = source.reduce_continuity(1)
    else:
        source = models.SPACES[name]()
        target, landmarks = targets.deformed(source, targets.bend(source, 30), seed=len(name))
    after = pt.transfer(source, target, landmarks, "g1")
    monkeypatch.setattr(
        solver, "with_better_middles", lambda t, control, x, certificate, rows, *_: (x, certificate, rows, [])
    )
    before = pt.transfer(source, target, landmarks, "g1")
    assert after.certificate.injective
    assert after.continuity.as_g1_residual < 1e-10
    assert after.rows.residual < 1e-10
    assert after.rows.active == before.rows.active
    kinks = [smoothness.mean_kink(smoothness.spans(r.multipatch)) for r in (before, after)]
    assert kinks[1] < 1.005 * kinks[0]
    least = [r.quality.scaled_jacobian.min for r in (before, after)]
    assert least[1] > (1 - 1e-3) * least[0]
    energies = [
        SplineOptimizer(source.topology).minimise(r.multipatch.topology.coordinates, max_steps=0).energy
        for r in (before, after)
    ]
    assert energies[1] <= energies[0] + 1e-12
    if name == "human":
        assert least[1] > least[0] + 0.04
    if name == "star":
        assert kinks[1] < 0.985 * kinks[0]
        assert energies[1] < energies[0] - 5e-3


def test_kinks_are_those_of_the_iso_lines():
    """Second route: evaluated patches."""
    for name in ("star of valence 5, p3", "grid p3"):
        mp = models.jiggled(models.SPACES[name](), 3)
        found = np.degrees(mean_kink(control_rows(mp.topology), mp.topology.coordinates))
        np.testing.assert_allclose(found, smoothness.mean_kink(smoothness.spans(mp)), rtol=0.02)
