"""geomdl (NURBS-Python): surfaces in space, ``v`` fastest in their control points, alone or in containers."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import InputError
from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch
from ..io.foreign import patch_of
from ..libraries import library
from .sequences import listed

__all__ = ["from_geomdl", "to_geomdl"]


def from_geomdl(surfaces: Any) -> MultiPatch:
    """See `MultiPatch.from_geomdl`."""
    # A surface can be iterated over, too.
    given = [surfaces] if hasattr(surfaces, "knotvector_u") else listed(surfaces, "a surface of geomdl")
    return MultiPatch([_patch(surface, f"surface {k}") for k, surface in enumerate(given)])


def _patch(surface: Any, where: str) -> Patch:
    try:
        degrees = [surface.degree_u, surface.degree_v]
        knots = [np.asarray(surface.knotvector_u), np.asarray(surface.knotvector_v)]
        points, weights = np.asarray(surface.ctrlpts), np.asarray(surface.weights) if surface.rational else None
        trims = surface.trims
    except AttributeError as error:
        raise InputError(f"{where}: not a surface of geomdl ({error}); pass surfaces or a SurfaceContainer") from None
    if trims:
        raise InputError(f"{where}: has {len(trims)} trimming curves, which are not supported; split it into patches")
    return patch_of(where, degrees, knots, points, weights, first_fastest=False)


def to_geomdl(mp: MultiPatch) -> Any:
    """See `MultiPatch.to_geomdl`."""
    return library("geomdl.multi", user="to_geomdl").SurfaceContainer(*[_surface(patch) for patch in mp])


def _surface(patch: Patch) -> Any:
    kind = library("geomdl.BSpline" if patch.weights is None else "geomdl.NURBS", user="to_geomdl")
    # Knots as they are, not on [0, 1].
    surface = kind.Surface(normalize_kv=False)
    surface.degree_u, surface.degree_v = patch.degrees
    x = np.concatenate([patch.control_points, np.zeros((*patch.shape, 1))], axis=2)
    if patch.weights is not None:
        x = np.concatenate([x * patch.weights[..., None], patch.weights[..., None]], axis=2)
    surface.set_ctrlpts(x.reshape(-1, x.shape[2]).tolist(), *patch.shape)
    surface.knotvector_u, surface.knotvector_v = (knots.tolist() for knots in patch.knots)
    return surface
