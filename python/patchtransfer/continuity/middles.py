"""Middles of c for exact G1 rows, chosen by the energy of the map that the rows allow, at kinks that are no larger.

The best fit to a map with C1 rows asks what is nearest to that map, not what is best: c_1 enters the rows linearly, so
that of the map under them slope and second derivatives of its energy are known, and its kinks follow from c itself. The
derivation is in ``docs/continuity.md``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..geometry.topology import Topology
from ..numeric.arrays import FloatArray, IntArray
from ..numeric.dense import product, solve_definite, svd
from .conditions import evaluated
from .g1 import RANK, GluingData, rows_of, twist_closure
from .interfaces import ControlRows
from .null_space import RowSpace, row_space

__all__ = ["Middles", "free_middles", "mean_kink"]

#: Parameters per knot span at which kinks are compared.
SAMPLES = 6
#: Step of c_1, relative to c, by which rows are differentiated: they are linear in it but for their scaling.
STEP = 1e-6
#: Kinks below this part of the mean count as if they were so large where squares stand for sizes.
SMALL_KINK = 0.1
#: Weights of kinks beside the energy that are tried, relative to where both curve alike, by powers of 2.
POWERS = range(-8, 13)


class Middles:
    """The middles c_1 that may change without another number of rows, at a map that is exact.

    Parameters
    ----------
    topology : Topology
    control : tuple of ControlRows
    data : GluingData
    points : (n_points, 2) array
        The map of least energy under the rows of the data.

    Attributes
    ----------
    free : (k,) int array
        Of `free_middles`; at least one.
    """

    def __init__(
        self, topology: Topology, control: tuple[ControlRows, ...], data: GluingData, points: FloatArray
    ) -> None:
        self._topology, self._control, self._data, self._points = topology, control, data, points
        self.free = free_middles(data)
        # At samples of all of them: the interface, its length there, and D_L and D_R = rest + share c_1 C'.
        parts = [self._sampled(i) for i in self.free.tolist()]
        self._of = np.repeat(np.arange(len(parts)), [len(part[0]) for part in parts])
        self._lengths, self._share, self._left, self._tangent, self._rest = (
            np.concatenate(part) for part in zip(*parts, strict=True)
        )

    def _sampled(self, index: int) -> tuple[FloatArray, ...]:
        r, data = self._control[index], self._data.coefficients[index].copy()
        t, width = _samples(r)
        left, _, tangent = r.derivatives(self._points, *r.basis(t))
        data[5] = 0.0
        a, b, c = evaluated(data, t).T
        rest = (c[:, None] * tangent - a[:, None] * left) / b[:, None]
        return width * np.hypot(*tangent.T), 2 * t * (1 - t) / b, left, tangent, rest

    def space(self) -> tuple[RowSpace, list[FloatArray]]:
        """The maps under the rows, and motions (n_points, 2) of the map that keep the rows as c_1 grow, one for each.

        c_1 are added to the points as two fixed ones each, whose coordinates are (c_1, 0) and (0, c_1).
        """
        rates = {}
        for i in self.free.tolist():
            data = self._data.coefficients[i].copy()
            step = STEP * max(1.0, float(np.abs(data[4:]).max()))
            data[5] += step
            moved = self._data.with_coefficients(i, data)
            r = self._control[i]
            rates[i] = product(moved.conditions(i, r), self._points[r.columns]) / step
        n, k = self._topology.n_points, len(self.free)
        rows = rows_of(self._topology, self._control, self._data, rates=rates)
        space = row_space(rows, self._topology.interior_points, np.concatenate([self._points, np.zeros((2 * k, 2))]))
        motions = np.zeros((k, n, 2))
        of_parameters = space.of_fixed(np.arange(n, n + 2 * k))
        motions[:, space.interior] = of_parameters.T.reshape(k, 2, -1).transpose(0, 2, 1)
        return space, list(motions)

    def step(self, slopes: FloatArray, hessian: FloatArray) -> GluingData | None:
        """Data of less energy with kinks that are no larger, by Newton's model of the energy in the free c_1.

        Parameters
        ----------
        slopes : (k,) array
            Of the energy, in the free c_1.
        hessian : (k, k) array

        Returns
        -------
        GluingData or None
            None where nothing is left to gain.
        """
        closing = twist_closure(self._topology, self._control, self._data, self._points)[:, self.free]
        _, sigma, vt = svd(closing, full=True)
        kept = vt[int((sigma > RANK * sigma.max(initial=0.0)).sum()) :].T
        now, lengths = self._data.coefficients[self.free, 5], self._lengths
        kink = self._kinks(now)
        total = float((lengths * np.abs(kink)).sum())
        if not kept.shape[1] or not total:
            return None
        # Of sum |κ|, the sum of κ² / |κ_0| that touches it from above; κ is all but linear in c_1.
        width = STEP * np.maximum(1.0, np.abs(now))
        rate = (self._kinks(now + width) - kink) / width[self._of]
        each = lengths / np.maximum(np.abs(kink), SMALL_KINK * total / float(lengths.sum()))
        pull, bend = (np.bincount(self._of, each * x * rate, len(now)) for x in (kink, rate))
        energy = product(product(kept.T, hessian), kept)
        kinks = product(kept.T, bend[:, None] * kept)
        alike = float(np.trace(energy) / np.trace(kinks))
        for weight in (0.0, *(alike * 2.0**power for power in POWERS)):
            downhill = -product(kept.T, slopes + weight * pull)
            change = product(kept, solve_definite(energy + weight * kinks, downhill))
            if float((lengths * np.abs(self._kinks(now + change))).sum()) <= total:
                break
        else:
            return None
        if float((slopes * change).sum() + (change * product(hessian, change)).sum() / 2) >= 0:
            return None
        coefficients = self._data.coefficients.copy()
        coefficients[self.free, 5] += change
        return replace(self._data, coefficients=coefficients)

    def _kinks(self, middles: FloatArray) -> FloatArray:
        """Kinks at samples of the free interfaces for other c_1, while D_L, a and b stay."""
        right = self._rest + (self._share * middles[self._of])[:, None] * self._tangent
        return _turn(self._left, right)


def free_middles(data: GluingData) -> IntArray:
    """Interfaces whose c is quadratic, and not only so that twists close."""
    return np.flatnonzero((data.degree == 2) & ~data.constant)


def mean_kink(control: tuple[ControlRows, ...], points: FloatArray) -> float:
    """Mean angle by which iso-lines bend at interfaces, weighted by length, in radians."""
    lengths = kinks = 0.0
    for r in control:
        t, width = _samples(r)
        left, right, tangent = r.derivatives(points, *r.basis(t))
        w = width * np.hypot(*tangent.T)
        lengths, kinks = lengths + float(w.sum()), kinks + float((w * np.abs(_turn(left, right))).sum())
    return kinks / lengths


def _samples(r: ControlRows) -> tuple[FloatArray, FloatArray]:
    """Parameters in the middle of equal parts of spans, and the parts' widths."""
    spans = np.diff(r.breaks)
    t = r.breaks[:-1, None] + spans[:, None] * (np.arange(SAMPLES) + 0.5) / SAMPLES
    return t.ravel(), np.repeat(spans / SAMPLES, SAMPLES)


def _turn(left: FloatArray, right: FloatArray) -> FloatArray:
    """Angle from the continuation of D_L to D_R."""
    cross = left[:, 1] * right[:, 0] - left[:, 0] * right[:, 1]
    return np.asarray(np.arctan2(cross, -(left * right).sum(axis=1)))
