"""Differences of computations on models whose control points move."""

import numpy as np

import patchtransfer as pt


def rational(mp: pt.MultiPatch) -> pt.MultiPatch:
    """The same control points with weights, the same on both sides of every interface."""
    t = mp.topology
    weights = 1 + 0.3 * np.random.default_rng(4).uniform(size=t.n_points)
    patches = [
        pt.Patch(p.knots, p.degrees, p.control_points, weights[index])
        for p, index in zip(mp.patches, t.points, strict=True)
    ]
    return pt.MultiPatch(patches, mp.interfaces)


def labelled(mp: pt.MultiPatch) -> pt.MultiPatch:
    sides = mp.boundaries
    return mp.with_labels({"a": sides[:2], "b": sides[2:4]})


def slope(mp, objective, v, step=1e-5):
    x = mp.topology.coordinates
    values = [objective(mp.with_shared_points(x + k * step * v)) for k in (1, -1, 2, -2)]
    return (8 * (values[0] - values[1]) - (values[2] - values[3])) / (12 * step)


def motion(mp):
    return np.random.default_rng(7).normal(size=(mp.topology.n_points, 2)) * 0.1
