r"""What the proportions of patches contribute to the condition number.

With r = \|B_u\| / \|B_v\| the condition number of Eq. 20 is (r + 1/r) / scaled Jacobian: a rectangle of 4 : 1 has
4.25 on the unit square, however good its parameterization. Knots as long as the patches are take that part away.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch
from ..geometry.strips import strips
from ..numeric.arrays import FloatArray

__all__ = ["condition_number_to_scale"]

#: Samples a knot span and direction, ends included; those of `quality`.
SAMPLES = 10


def condition_number_to_scale(mp: MultiPatch) -> float:
    """Mean condition number when every strip of patches has knots as long as the strip is, in the geometric mean.

    One factor a strip, so that the change of parameters is linear and conforming: the same map, with the same
    interfaces and the same scaled Jacobian.

    Parameters
    ----------
    mp : MultiPatch
        Injective, without weights.
    """
    derivatives = [_derivatives(patch) for patch in mp.patches]
    strip = np.empty((len(mp), 2), np.int64)
    for number, found in enumerate(strips(mp.topology)):
        strip[tuple(np.array(list(found.members)).T)] = number
    logs = np.array([[np.log(np.linalg.norm(d, axis=-1)).mean() for d in pair] for pair in derivatives])
    length = np.exp(np.bincount(strip.ravel(), logs.ravel()) / np.bincount(strip.ravel()))
    values = []
    for (du, dv), (a, b) in zip(derivatives, length[strip], strict=True):
        u, v = du / a, dv / b
        det = abs(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])
        values.append((((u**2).sum(axis=-1) + (v**2).sum(axis=-1)) / det).ravel())
    return float(np.concatenate(values).mean())


def _derivatives(patch: Patch) -> tuple[FloatArray, FloatArray]:
    breaks = [np.unique(knots) for knots in patch.knots]
    u, v = (np.concatenate([np.linspace(a, b, SAMPLES) for a, b in pairwise(t)]) for t in breaks)
    at = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1)
    spline = patch.to_scipy()
    return np.asarray(spline(at, nu=(1, 0))), np.asarray(spline(at, nu=(0, 1)))
