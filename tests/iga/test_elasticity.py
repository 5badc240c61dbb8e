"""Plane stress: known solutions, and derivatives by the geometry against differences of the whole computation."""

import numpy as np
import pytest

import models
from patchtransfer import InputError, MultiPatch, Side, iga
from shape_derivatives import labelled, motion, rational, slope


def on_all(mp: MultiPatch) -> MultiPatch:
    return mp.with_labels({"all": mp.boundaries})


@pytest.mark.parametrize("make", [models.o_grid, lambda: models.plate_with_hole(2, 2), models.grid])
def test_linear_displacements_are_solutions(make):
    """On patches of any orientation: their splines hold linear functions."""
    mp = on_all(make())
    a = np.array([[0.3, -0.2], [0.5, 0.1]])
    given = [lambda x, y, row=row: row[0] * x + row[1] * y for row in a]
    result = iga.elasticity(mp, {"all": given}, modulus=7.0, ratio=0.2)
    first, second = 7 * 0.2 / (1 - 0.04), 7 / 2.4
    expected = first * np.trace(a) * np.eye(2) + second * (a + a.T)
    t = [0.2, 0.7]
    for k in range(len(mp)):
        xx, yy, xy = result.stress(k, t, t)
        for found, value in ((xx, expected[0, 0]), (yy, expected[1, 1]), (xy, expected[0, 1])):
            np.testing.assert_allclose(found, value, atol=1e-11)
    mises = np.sqrt(
        expected[0, 0] ** 2 - expected[0, 0] * expected[1, 1] + expected[1, 1] ** 2 + 3 * expected[0, 1] ** 2
    )
    np.testing.assert_allclose(result.von_mises(0, t, t), mises, rtol=1e-2)


def test_a_polynomial_displacement_with_its_loads():
    """u = (x², x y) on two squares, which the splines hold: body force and tractions from its stress by hand."""
    mp = models.strip(2, 2, 2)
    names = {(0, Side.WEST): "left", (1, Side.EAST): "right"}
    labels: dict[str, list] = {"bottom": [], "top": []} | {name: [side] for side, name in names.items()}
    for k, side in mp.boundaries:
        if (k, side) not in names:
            labels["top" if side == Side.NORTH else "bottom"].append((k, side))
    mp = mp.with_labels(labels)
    first, second = 0.3 / 0.91, 1 / 2.6
    # ε = (2 x, x, y / 2), its trace is 3 x.
    xx, yy = 3 * first + 4 * second, 3 * first + 2 * second
    tractions = {
        "right": (lambda x, y: xx * x, lambda x, y: second * y),
        "top": (lambda x, y: second * y, lambda x, y: yy * x),
        "bottom": (lambda x, y: -second * y, lambda x, y: -yy * x),
    }
    held = {"left": (lambda x, y: x * x, lambda x, y: x * y)}
    result = iga.elasticity(mp, held, tractions, (-xx - second, 0.0))
    t = np.linspace(0, 1, 7)
    for k, patch in enumerate(mp.patches):
        x, y = np.moveaxis(patch.grid(t, t), 2, 0)
        for f, exact in zip(result.displacement, (x * x, x * y), strict=True):
            np.testing.assert_allclose(f.grid(k, t, t), exact, atol=1e-11)
        for found, exact in zip(result.stress(k, t, t), (xx * x, yy * x, second * y), strict=True):
            np.testing.assert_allclose(found, exact, atol=1e-10)


LOADS = {
    "held and pulled": ({"a": (0.0, 0.0)}, {"b": (1.0, -0.5)}, (0.0, 0.0)),
    "functions": (
        {"a": (lambda x, y: x * y, lambda x, y: np.sin(y))},
        {"b": (lambda x, y: 1 + x**2, None)},
        (lambda x, y: np.cos(x), 0.3),
    ),
    "a component each": ({"a": (0.0, 0.1), "b": (None, 0.0)}, {"b": (0.4, None)}, (0.0, -1.0)),
}


@pytest.mark.parametrize("load", LOADS)
@pytest.mark.parametrize("make", [models.o_grid, lambda: models.plate_with_hole(2, 2), lambda: rational(models.grid())])
def test_derivatives(make, load):
    mp = labelled(make())
    v = motion(mp)

    def solved(m):
        return iga.elasticity(m, *LOADS[load], modulus=3.0, ratio=0.25)

    result = solved(mp)
    assert result.residual < 1e-10
    w = np.random.default_rng(2).normal(size=(result.dofs, 2))

    def displaced(m):
        return sum(float((w[:, c] * f.coefficients).sum()) for c, f in enumerate(solved(m).displacement))

    for gradient, objective in (
        (result.compliance()[1], lambda m: solved(m).compliance()[0]),
        (result.vjp(w), displaced),
    ):
        expected = slope(mp, objective, v)
        assert abs((gradient * v).sum() - expected) < 1e-7 * np.abs(gradient * v).sum()


def test_input_errors():
    mp = labelled(models.grid())
    with pytest.raises(InputError, match="displacement along x: the model has no label 'c'"):
        iga.elasticity(mp, {"c": (0.0, 0.0)})
    with pytest.raises(InputError, match=r"traction: label 'a' needs two components"):
        iga.elasticity(mp, {"a": (0.0, 0.0)}, {"a": 1.0})
    with pytest.raises(InputError, match="displacement along y: no side has values"):
        iga.elasticity(mp, {"a": (0.0, None)})
    with pytest.raises(InputError, match="ratio 1"):
        iga.elasticity(mp, {"a": (0.0, 0.0)}, ratio=1.0)
    with pytest.raises(InputError, match="vjp: expected finite derivatives"):
        iga.elasticity(mp, {"a": (0.0, 0.0)}).vjp(np.ones(3))
