"""Poisson's equation with values on the sides of labels and no flux elsewhere."""

import json

import numpy as np
import pytest

import models
import patchtransfer as pt
from commands import failed, run
from patchtransfer import InputError, iga


def plate() -> pt.MultiPatch:
    """The square [0, 2]² of four patches, with labels."""
    cells = [(0, 0), (1, 0), (0, 1), (1, 1)]
    mp = models.build([models.bilinear((a, b), (a + 1, b), (a + 1, b + 1), (a, b + 1)) for a, b in cells], 2, 2)
    west = [(k, s) for k, s in mp.boundaries if np.allclose(s.of(mp.patches[k].control_points)[:, 0], 0)]
    east = [(k, s) for k, s in mp.boundaries if np.allclose(s.of(mp.patches[k].control_points)[:, 0], 2)]
    inner = mp.interfaces[0]
    return mp.with_labels({"west": west, "east": east, "all": mp.boundaries, "in": [(inner.patch_a, inner.side_a)]})


def values(result, f) -> float:
    """Largest difference to a function at many points."""
    t = np.linspace(0, 1, 9)
    worst = 0.0
    for k, patch in enumerate(result.multipatch.patches):
        x = patch.grid(t, t)
        worst = max(worst, float(np.abs(result.field.grid(k, t, t) - f(x[..., 0], x[..., 1])).max()))
    return worst


def test_values_at_two_ends_make_a_linear_field():
    mp = plate()
    result = iga.poisson(mp, 0.0, {"west": 3.0, "east": lambda x, y: 1.0 + 0 * x})
    assert values(result, lambda x, y: 3 - x) < 1e-12
    assert result.errors is None


def test_unlabelled_sides_have_no_flux():
    # u = x (4 − x) / 2 has −u'' = 1, u(0) = 0 and u'(2) = 0, and no flux across the horizontal sides.
    mp = plate()
    result = iga.poisson(mp, 1.0, {"west": 0.0})
    assert values(result, lambda x, y: x * (4 - x) / 2) < 1e-12


def test_values_on_all_sides_by_label_are_those_by_function():
    def g(x, y):
        return x**2 - y**2

    mp = plate()
    a, b = iga.poisson(mp, 0.0, {"all": g}), iga.poisson(mp, 0.0, g)
    assert np.array_equal(a.field.coefficients, b.field.coefficients)


def test_one_solver_for_several_sets_of_sides():
    mp = plate()
    solver = iga.PoissonSolver(mp)
    for g in ({"west": 1.0}, {"east": 1.0}, 1.0, {"west": 1.0}):
        assert values(solver.solve(mp, 0.0, g), lambda x, y: 1 + 0 * x) < 1e-12


@pytest.mark.parametrize(
    ("g", "message"),
    [
        ({"nort": 1.0}, "no label 'nort'; its labels are 'west', 'east', 'all', 'in'"),
        ({"in": 1.0}, "label 'in' is glued to another patch"),
        ({"west": 1.0, "all": 2.0}, "of label 'all' has values by label 'west' already"),
        ({}, "no side has values"),
        ({"west": lambda x, y: np.nan * x}, "Dirichlet data"),
    ],
)
def test_bad_labels_are_errors(g, message):
    with pytest.raises(InputError, match=message):
        iga.poisson(plate(), 0.0, g)


def test_a_model_without_labels_says_so():
    with pytest.raises(InputError, match="its labels are none"):
        iga.poisson(models.grid(), 0.0, {"west": 1.0})


def test_the_command_takes_constants(tmp_path):
    mp = plate()
    mp = mp.with_labels({name: mp.sides[name] for name in ("west", "east")} | {"a=b": mp.sides["east"][:1]})
    pt.write(mp, tmp_path / "m.xml")
    result = run("poisson", tmp_path / "m.xml", "--dirichlet", "west=1", "--dirichlet", "a=b=2", "--json", "-")
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["l2_error"] is None
    assert run("poisson", tmp_path / "m.xml", "--dirichlet", "west=1", "--load", "2").exit_code == 0
    failed(run("poisson", tmp_path / "m.xml", "--dirichlet", "west"), 2, "not a label and a number")
    failed(run("poisson", tmp_path / "m.xml", "--dirichlet", "south=1"), 2, "no label 'south'")
    failed(run("poisson", tmp_path / "m.xml", "--load", "1"), 2, "give --dirichlet")
