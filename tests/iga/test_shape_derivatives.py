"""Derivatives by the geometry's control points against differences of the whole computation."""

import numpy as np
import pytest

import models
import patchtransfer as pt
from patchtransfer import InputError, iga
from shape_derivatives import labelled, motion, rational, slope

MODELS = {
    "o-grid": models.o_grid,
    "turned patches, p2": lambda: models.plate_with_hole(2, 2),
    "rational": lambda: rational(models.grid()),
}

LOADS = {
    "constant load": {"f": 1.5, "g": 0.0},
    "functions": {"f": lambda x, y: 1 + x * y, "g": lambda x, y: np.sin(x) + y**2},
    "on labels": {"f": lambda x, y: x, "g": {"a": lambda x, y: x + 2 * y, "b": 1.0}},
    "another degree": {"f": 1.0, "g": lambda x, y: x, "degree": 3, "points": 6},
}


@pytest.mark.parametrize("load", LOADS)
@pytest.mark.parametrize("name", MODELS)
def test_poisson(name, load):
    mp = labelled(MODELS[name]())
    v = motion(mp)
    result = iga.poisson(mp, **LOADS[load])
    w = np.random.default_rng(2).normal(size=result.dofs)

    def weight(x, y):
        return np.cos(x) + y

    objectives = {
        "coefficients": lambda m: float((w * iga.poisson(m, **LOADS[load]).field.coefficients).sum()),
        "integral": lambda m: iga.poisson(m, **LOADS[load]).integral()[0],
        "weighted": lambda m: iga.poisson(m, **LOADS[load]).integral(weight)[0],
        "energy": lambda m: iga.poisson(m, **LOADS[load]).energy()[0],
    }
    found = {
        "coefficients": result.vjp(w),
        "integral": result.integral()[1],
        "weighted": result.integral(weight)[1],
        "energy": result.energy()[1],
    }
    for what, objective in objectives.items():
        expected = slope(mp, objective, v)
        scale = np.abs(found[what] * v).sum()
        assert abs((found[what] * v).sum() - expected) < 1e-7 * scale, what


def test_values_are_those_of_the_field():
    """Torsion of a disc to the accuracy of its splines; energy is half of the load's work."""
    mp = models.o_grid()
    result = iga.poisson(mp, f=2.0)
    work, _ = result.integral(2.0)
    assert 2 * result.energy()[0] == pytest.approx(work, rel=1e-10)


def test_functions_of_the_place_alone_do_not_depend_on_translations_of_constants():
    mp = models.o_grid()
    _, gradient = iga.poisson(mp, f=1.0).integral()
    assert np.abs(gradient.sum(axis=0)).max() < 1e-10 * np.abs(gradient).sum()
    # Torsion grows with the fourth power of the size.
    value, gradient = iga.poisson(mp, f=1.0).integral()
    assert (gradient * mp.topology.coordinates).sum() == pytest.approx(4 * value, rel=1e-10)


def test_the_chain_from_outline_to_objective():
    """Outline, map, solution, objective: one derivative, against differences of the whole chain."""
    mp = models.o_grid()
    frozen = pt.TransferPlan(mp).freeze()
    outline = frozen.outline(mp.boundary())
    given = outline.control_points
    v = np.column_stack([np.sin(given[:, 1]), 0.3 * given[:, 0] ** 2])

    def chain(t):
        filled = frozen.fill(outline(t))
        value, gradient = iga.poisson(filled.multipatch, f=1.0).integral()
        return value, outline.transpose(filled.vjp(gradient))

    gradient = chain(given)[1]
    values = [chain(given + k * 1e-4 * v)[0] for k in (1, -1, 2, -2)]
    expected = (8 * (values[0] - values[1]) - (values[2] - values[3])) / 12e-4
    assert (gradient * v).sum() == pytest.approx(expected, rel=1e-6)


def test_input_errors():
    result = iga.poisson(models.grid(), f=1.0)
    with pytest.raises(InputError, match="vjp: expected finite derivatives"):
        result.vjp(np.ones(3))
