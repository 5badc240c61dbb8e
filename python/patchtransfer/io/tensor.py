"""Patches from the numbers of a text file, and back."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..errors import InputError
from ..geometry.basis import weights_agree
from ..geometry.boundary import Boundary
from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch
from ..limits import MAX_ALONG, MAX_CONTROL_POINTS, MAX_DEGREE, TOO_LARGE, at_most, first_unusable
from ..numeric.arrays import FloatArray
from .loops import close_loop

__all__ = ["boundary_of", "check_sizes", "exchanged", "homogeneous", "patch_of"]


def check_sizes(degrees: Sequence[int], counts: Sequence[int], before: int, where: str) -> int:
    """Refuse sizes that are no patch's, or too large; the control points of this and `before`."""
    for degree, count in zip(degrees, counts, strict=True):
        if degree < 1:
            raise InputError(f"{where}: degree {degree} is not supported, it must be at least 1")
        at_most(degree, MAX_DEGREE, f"as degree of {where}", "take a lower one")
        if count <= degree:
            raise InputError(f"{where}: degree {degree} needs at least {degree + 1} control points, got {count}")
        at_most(count, MAX_ALONG, f"control points in one direction of {where}", "coarsen it")
    total = before + int(np.prod(counts))
    at_most(total, MAX_CONTROL_POINTS, "control points", "coarsen the model or split it")
    return total


def patch_of(
    where: str,
    knots: Sequence[FloatArray],
    degrees: Sequence[int],
    points: FloatArray,
    weights: FloatArray,
    weighted: bool,
) -> Patch:
    """A patch of a file that stores weights.

    Parameters
    ----------
    where : str
        What messages call it.
    knots, degrees : pairs
    points : (n_u, n_v, 2 or 3) array
        With a third coordinate that must be 0.
    weights : (n_u, n_v) array
    weighted : bool
        Whether the points are multiplied by their weights.

    Raises
    ------
    InputError
        When it lies in space, has weights that are not positive, or knots that do not fit.
    """
    if (points[..., 2:] != 0).any():
        raise InputError(f"{where}: lies in space (z is not 0); only models in the plane are supported")
    if not (weights > 0).all():
        raise InputError(f"{where}: weight {weights.min():g} is not positive; correct it")
    points = points[..., :2]
    if weighted:
        with np.errstate(over="ignore"):
            points = points / weights[..., None]
        if first_unusable(points) is not None:
            raise InputError(f"{where}: a coordinate divided by its weight is {TOO_LARGE}; correct them")
    try:
        return Patch(knots, degrees, points, None if weights_agree(weights) else weights)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def homogeneous(patch: Patch, where: str) -> FloatArray:
    """Control points multiplied by their weights, and the weights, shape (n_u, n_v, 3)."""
    weights = np.ones(patch.shape) if patch.weights is None else patch.weights
    with np.errstate(over="ignore"):
        points = patch.control_points * weights[..., None]
    if first_unusable(points) is not None:
        raise InputError(f"{where}: a coordinate times its weight is {TOO_LARGE}; scale the model or its weights")
    return np.concatenate([points, weights[..., None]], axis=2)


def exchanged(patch: Patch) -> Patch:
    """The patch with u and v exchanged."""
    weights = None if patch.weights is None else patch.weights.T
    return Patch(patch.knots[::-1], patch.degrees[::-1], patch.control_points.transpose(1, 0, 2), weights)


def boundary_of(multipatch: MultiPatch) -> Boundary:
    """The boundary curves; patches may meet only up to the last digits."""
    return Boundary([close_loop(loop) for loop in multipatch.boundary().loops])
