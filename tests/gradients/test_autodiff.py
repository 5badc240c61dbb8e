"""Chains through JAX and PyTorch themselves."""

import sys

import numpy as np
import pytest

import models
import patchtransfer as pt
from patchtransfer import InputError
from patchtransfer.autodiff import jax_function, torch_function


@pytest.fixture(scope="module")
def frozen():
    return pt.TransferPlan(models.o_grid()).freeze()


def slope(frozen, objective, boundary, d, step=1e-5):
    values = [objective(frozen.fill(boundary + k * step * d).points) for k in (1, -1)]
    return (values[0] - values[1]) / (2 * step)


@pytest.fixture
def jax():
    jax = pytest.importorskip("jax")
    before = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    yield jax
    jax.config.update("jax_enable_x64", before)


def test_jax_differentiates_through_a_map(frozen, jax):
    fill = jax_function(frozen)
    weights = np.random.default_rng(0).normal(size=frozen.points.shape)

    def objective(points):
        return (weights * points**2).sum()

    def chain(radius):
        return objective(fill(radius * jax.numpy.asarray(frozen.boundary) + 0.1 * radius**2))

    d = frozen.boundary + 0.1 * 2 * 1.2
    expected = slope(frozen, objective, 1.2 * frozen.boundary + 0.1 * 1.2**2, d)
    for function in (jax.grad(chain), jax.jit(jax.grad(chain))):
        assert float(function(1.2)) == pytest.approx(expected, rel=1e-7)
    # Interleaved evaluations do not disturb each other.
    both = jax.vmap(jax.grad(chain))(jax.numpy.array([1.0, 1.2]))
    assert float(both[1]) == pytest.approx(expected, rel=1e-7)
    assert np.array_equal(fill(frozen.boundary), frozen.fill(frozen.boundary).points)


def test_jax_in_single_precision_is_refused(frozen, jax):
    jax.config.update("jax_enable_x64", False)
    with pytest.raises(InputError, match="jax_enable_x64"):
        jax_function(frozen)


def test_torch_differentiates_through_a_map(frozen):
    torch = pytest.importorskip("torch")
    fill = torch_function(frozen)
    boundary = torch.tensor(1.1 * frozen.boundary, requires_grad=True)
    assert np.array_equal(fill(boundary).detach().numpy(), frozen.fill(1.1 * frozen.boundary).points)
    fill(boundary).square().sum().backward()
    d = np.random.default_rng(0).normal(size=frozen.boundary.shape)
    expected = slope(frozen, lambda points: (points**2).sum(), 1.1 * frozen.boundary, d, 1e-6)
    assert float((boundary.grad.numpy() * d).sum()) == pytest.approx(expected, rel=1e-6)
    assert torch.autograd.gradcheck(fill, torch.tensor(frozen.boundary, requires_grad=True), eps=1e-5, fast_mode=True)
    with pytest.raises(InputError, match="double precision on the CPU"):
        fill(boundary.float())


@pytest.mark.parametrize("name", ["jax", "torch"])
def test_what_is_missing_is_named_with_its_extra(frozen, name, monkeypatch):
    monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(InputError, match=rf"pip install 'patchtransfer\[{name}\]'"):
        {"jax": jax_function, "torch": torch_function}[name](frozen)
