r"""What the proportions of patches contribute to the condition number.

With r = \|B_u\| / \|B_v\| the condition number of Eq. 20 is (r + 1/r) / scaled Jacobian: a rectangle of 4 : 1 has
4.25 on the unit square, however good its parameterization. Knots as long as the patches are take that part away.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch
from ..numeric.arrays import FloatArray
from ..numeric.components import components

__all__ = ["condition_number_to_scale", "strips"]

#: Samples a knot span and direction, ends included; those of `quality`.
SAMPLES = 10


def strips(mp: MultiPatch) -> NDArray[np.int64]:
    """Number (m, 2) of the strip of every patch in u and in v: directions that interfaces tie to each other."""

    def along(patch: int, side: int) -> int:
        # Sides 1 and 2 run in v, 3 and 4 in u.
        return 2 * patch + (side <= 2)

    ends = np.array(
        [(along(f.patch_a, int(f.side_a)), along(f.patch_b, int(f.side_b))) for f in mp.interfaces], dtype=np.int64
    ).reshape(-1, 2)
    return components(2 * len(mp), ends[:, 0], ends[:, 1]).reshape(-1, 2)


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
    strip = strips(mp)
    logs = np.array([[np.log(np.linalg.norm(d, axis=-1)).mean() for d in pair] for pair in derivatives])
    number = np.bincount(strip.ravel())
    length = np.exp(np.bincount(strip.ravel(), logs.ravel()) / number)
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
