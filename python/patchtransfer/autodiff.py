"""Maps of a frozen problem as functions of JAX and PyTorch, which are imported when asked for."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .errors import InputError
from .gradients import Filled, Frozen
from .libraries import library

__all__ = ["jax_function", "torch_function"]

#: Maps that are kept for the derivative to come: a step of an optimiser needs the last one, a line search one more.
KEPT = 4


def jax_function(frozen: Frozen) -> Callable[[Any], Any]:
    """`Frozen.fill` as a function of JAX, from boundary points (n_b, 2) to all points (n_points, 2).

    It may be differentiated in reverse (`jax.grad`, `jax.vjp`), compiled and mapped. Needs JAX's double precision
    (``jax.config.update("jax_enable_x64", True)``) and the extra ``jax``.

    Parameters
    ----------
    frozen : Frozen

    Raises
    ------
    InputError
        Without JAX, or when it is set to single precision.

    Notes
    -----
    A boundary without a map raises within JAX, whose error quotes the `InfeasibleTargetError`. A certificate is no part
    of the function: ``frozen.fill(x).certificate`` has it.

    Examples
    --------
    >>> import patchtransfer as pt
    >>> source, target, landmarks = pt.examples.load("star")
    >>> frozen = pt.transfer(source, target, landmarks).freeze()
    >>> import jax
    >>> jax.config.update("jax_enable_x64", True)
    >>> fill = pt.autodiff.jax_function(frozen)
    >>> slope = jax.grad(lambda boundary: (fill(boundary) ** 2).sum())(frozen.boundary)
    >>> slope.shape == frozen.boundary.shape
    True
    """
    jax = library("jax", user="jax_function")
    if not jax.config.jax_enable_x64:
        raise InputError(
            'jax_function: JAX is set to single precision; call jax.config.update("jax_enable_x64", True) first'
        )
    maps = _Maps(frozen)
    double = jax.numpy.float64
    all_points = jax.ShapeDtypeStruct(frozen.points.shape, double)
    boundary_points = jax.ShapeDtypeStruct(frozen.boundary.shape, double)

    def call(function: Callable[..., Any], shape: Any, *given: Any) -> Any:
        return jax.pure_callback(function, shape, *given, vmap_method="sequential")

    @jax.custom_vjp  # type: ignore[untyped-decorator]
    def fill(boundary: Any) -> Any:
        return call(lambda x: np.array(maps.at(x).points), all_points, boundary)

    def forward(boundary: Any) -> tuple[Any, Any]:
        return fill(boundary), boundary

    def backward(boundary: Any, w: Any) -> tuple[Any]:
        return (call(lambda x, w: maps.at(x).vjp(np.asarray(w)), boundary_points, boundary, w),)

    fill.defvjp(forward, backward)
    return fill  # type: ignore[no-any-return]


def torch_function(frozen: Frozen) -> Callable[[Any], Any]:
    """`Frozen.fill` as a function of PyTorch, from boundary points (n_b, 2) to all points (n_points, 2).

    Tensors are double precision on the CPU. It may be differentiated once (``backward``). Needs the extra ``torch``.

    Parameters
    ----------
    frozen : Frozen

    Raises
    ------
    InputError
        Without PyTorch; the function itself on tensors of another kind.

    Examples
    --------
    >>> import patchtransfer as pt
    >>> source, target, landmarks = pt.examples.load("star")
    >>> frozen = pt.transfer(source, target, landmarks).freeze()
    >>> import torch  # doctest: +SKIP
    >>> boundary = torch.tensor(frozen.boundary, requires_grad=True)  # doctest: +SKIP
    >>> (pt.autodiff.torch_function(frozen)(boundary) ** 2).sum().backward()  # doctest: +SKIP
    >>> boundary.grad.shape == boundary.shape  # doctest: +SKIP
    True
    """
    torch = library("torch", user="torch_function")

    class Fill(torch.autograd.Function):  # type: ignore[misc, name-defined]
        @staticmethod
        def forward(ctx: Any, boundary: Any) -> Any:
            ctx.filled = frozen.fill(boundary.detach().numpy())
            return torch.from_numpy(np.array(ctx.filled.points))

        @staticmethod
        @torch.autograd.function.once_differentiable  # type: ignore[untyped-decorator]
        def backward(ctx: Any, w: Any) -> Any:
            return torch.from_numpy(ctx.filled.vjp(w.numpy()))

    def fill(boundary: Any) -> Any:
        if boundary.dtype != torch.float64 or boundary.device.type != "cpu":
            raise InputError(
                f"torch_function: expected double precision on the CPU, got {boundary.dtype} on {boundary.device}; "
                'use boundary.to("cpu", torch.float64)'
            )
        return Fill.apply(boundary)

    return fill


class _Maps:
    """The last maps of a frozen problem, for the derivatives that follow: JAX hands over boundaries, no objects."""

    def __init__(self, frozen: Frozen) -> None:
        self._frozen = frozen
        self._known: dict[bytes, Filled] = {}

    def at(self, boundary: Any) -> Filled:
        given = np.array(boundary, float)
        key = given.tobytes()
        filled = self._known.pop(key, None) or self._frozen.fill(given)
        self._known[key] = filled
        while len(self._known) > KEPT:
            self._known.pop(next(iter(self._known)), None)
        return filled
