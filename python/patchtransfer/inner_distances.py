"""The last step of matching by shape: matched points slide along the target until inner distances are kept best.

Metric multidimensional scaling (least squares on distances, near ones weighted up) with the points confined to the
target's boundary. All loops slide together, so that holes without a shape of their own find their start. Distances
alone cannot tell how a boundary stretches where a bend lengthens one side and shortens the other: with `bending` the
map is also made smooth (`thin_plate`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .boundary_shape import BoundaryShape, cyclic_gap, image_of, turning
from .splines import FloatArray
from .thin_plate import Bending

__all__ = ["slide"]

#: Gauss–Newton steps at most; sliding ends when one wins less than this part of the energy and moves no point by more
#: than this part of its loop.
STEPS, GAIN, SHORT = 16, 1e-3, 1e-4
#: Times that a step which raises the energy is halved.
HALVINGS = 4
#: Weights of stretch along the loops and of unlike turning; added to the diagonal, relative to its mean.
STRETCH, TURNING, DAMPING = 0.03, 1.0, 1e-6
#: Squared distance (relative to the root mean square) that softens the weight 1/d².
SOFT = 0.02
#: Distances below this many steps between nodes are left to the stretch term: interpolation cannot tell them.
NEAR = 12.0


def slide(
    source: BoundaryShape,
    target: BoundaryShape,
    partners: Sequence[int],
    anchors: Sequence[FloatArray],
    keep: Sequence[FloatArray],
    bending: float = 0.0,
) -> tuple[list[FloatArray], float]:
    """Improve a matching of the first loops of `source`.

    Parameters
    ----------
    source, target : BoundaryShape
    partners : sequence of int
        Target loop of each of the source's first loops.
    anchors : sequence of (m + 1, 2) arrays
        The matching of each loop to start from.
    keep : sequence of (r,) arrays
        Arc lengths of source nodes whose images stay: corners and landmarks.
    bending : float, default 0
        Weight of the bending energy.

    Returns
    -------
    anchors : list of (n + 1, 2) arrays
        At all nodes of the source.
    energy : float
        Weighted mean square of the change of distances, relative to the distances; never above what the given anchors
        have. Bending is part of it.
    """
    x = [image_of(a, s) for a, s in zip(anchors, source.s, strict=False)]
    problem = _Distances(source, target, partners, bending)
    held = np.concatenate(
        [
            cyclic_gap(s, at, o.length) < 1e-9 * o.length
            for s, at, o in zip(source.s, keep, source.outlines, strict=False)
        ]
    )
    ends = np.cumsum([len(y) for y in x])[:-1]
    energy, gradient, hessian = problem.model(x)
    for _ in range(0 if held.all() else STEPS):
        hessian[np.diag_indices(len(hessian))] += DAMPING * np.trace(hessian) / len(hessian)
        hessian[held] = hessian[:, held] = 0.0
        hessian[held, held] = 1.0
        moves = np.split(-np.linalg.solve(hessian, np.where(held, 0.0, gradient)), ends)
        for halving in range(HALVINGS + 1):
            trial = _step(x, [move / 2**halving for move in moves], problem.lengths)
            found = problem.model(trial)
            if found[0] < energy:
                break
        else:
            break
        gained = energy - found[0]
        longest = max(float(abs(a - b).max()) / length for a, b, length in zip(trial, x, problem.lengths, strict=True))
        x, (energy, gradient, hessian) = trial, found
        if gained <= GAIN * energy and longest <= SHORT:
            break
    loops = zip(source.s, source.outlines, x, problem.lengths, strict=False)
    closed = [
        np.column_stack([np.append(s, s[0] + o.length), np.append(y, y[0] + length)]) for s, o, y, length in loops
    ]
    return closed, energy


def _step(x: Sequence[FloatArray], moves: Sequence[FloatArray], lengths: Sequence[float]) -> list[FloatArray]:
    """The longest part of the step that leaves half of every gap between neighbours."""
    part = 1.0
    for y, move, length in zip(x, moves, lengths, strict=True):
        gaps, change = np.diff(y, append=y[0] + length), np.diff(move, append=move[0])
        part = min(part, 0.5 / max(float((-change / gaps).max()), 0.5))
    return [y + part * move for y, move in zip(x, moves, strict=True)]


class _Distances:
    """Least squares on the inner distances of matched points, and their bending energy of the given weight."""

    def __init__(
        self, source: BoundaryShape, target: BoundaryShape, partners: Sequence[int], bending: float = 0.0
    ) -> None:
        self.source, self.target, self.partners = source, target, partners
        self.bending = bending
        self.plate = Bending(source, target, partners) if bending else None
        self.lengths = [target.outlines[t].length for t in partners]
        n = source.rows(len(partners) - 1).stop
        self.wanted = source.distances[:n, :n]
        parts = [source.outlines[k].length / source.outlines[0].length for k in range(len(partners))]
        self.loop_parts = parts
        self.turning = [turning(source.outlines[k], source.s[k]) for k in range(len(partners))]
        share = np.concatenate([source.shares(k) * part for k, part in enumerate(parts)])
        self.weight = share[:, None] * share / (self.wanted**2 + SOFT)
        self.weight[self.wanted < NEAR * np.sqrt(share[:, None] * share)] = 0.0
        self.weight /= self.weight.sum()

    def model(self, x: Sequence[FloatArray]) -> tuple[float, FloatArray, NDArray[np.float64]]:
        """Energy, gradient and Gauss–Newton matrix in the target's arc lengths."""
        found, slope = self._interpolate(x)
        w, d = self.weight, self.wanted
        # Sizes are compared up to the best scale.
        scale = float((w * d * found).sum() / (w * found * found).sum())
        residual, slope = scale * found - d, scale * slope
        energy = float((w * residual**2).sum())
        gradient = 4 * (w * residual * slope).sum(axis=1)
        # The pair (i, j) has the slopes [i, j] and [j, i] at its two ends.
        hessian = 4 * w * slope * slope.T
        hessian[np.diag_indices(len(hessian))] += 4 * (w * slope * slope).sum(axis=1)
        energy += self._add_stretch(x, gradient, hessian) + self._add_turning(x, gradient, hessian)
        if self.plate is not None:
            energy += self.plate.add(x, self.bending, gradient, hessian)
        return energy, gradient, hessian

    def _interpolate(self, x: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Target's distances at arc lengths `x`, and their derivatives by the row's arc length."""
        before, after, fraction, gap = [], [], [], []
        for t, y in zip(self.partners, x, strict=True):
            index, f = self.target.locate(t, y)
            first, n = self.target.rows(t).start, len(self.target.s[t])
            before.append(first + index)
            after.append(first + (index + 1) % n)
            fraction.append(f)
            gap.append(np.diff(self.target.positions(t))[index] * self.target.outlines[t].length)
        i, j, f, h = (np.concatenate(v) for v in (before, after, fraction, gap))
        d = self.target.distances
        rows, slope = (1 - f)[:, None] * d[i] + f[:, None] * d[j], (d[j] - d[i]) / h[:, None]
        return rows[:, i] * (1 - f) + rows[:, j] * f, slope[:, i] * (1 - f) + slope[:, j] * f

    def _add_turning(self, x: Sequence[FloatArray], gradient: FloatArray, hessian: FloatArray) -> float:
        """Energy of unlike turning at matched points; adds to gradient and matrix."""
        energy, first = 0.0, 0
        for k, (t, y) in enumerate(zip(self.partners, x, strict=True)):
            wanted, outline = self.turning[k], self.target.outlines[t]
            n = len(y)
            h = 0.002 * outline.length
            found = turning(outline, np.concatenate([y - h, y, y + h])).reshape(3, n, -1)
            residual, slope = found[1] - wanted, (found[2] - found[0]) / (2 * h)
            weight = TURNING * self.loop_parts[k] * self.source.shares(k)[:, None] / wanted.shape[1]
            energy += float((weight * residual**2).sum())
            at = first + np.arange(n)
            gradient[at] += 2 * (weight * residual * slope).sum(axis=1)
            hessian[at, at] += 2 * (weight * slope**2).sum(axis=1)
            first += n
        return energy

    def _add_stretch(self, x: Sequence[FloatArray], gradient: FloatArray, hessian: FloatArray) -> float:
        """Energy of uneven stretch along the loops; adds to gradient and matrix."""
        energy, first = 0.0, 0
        for k, (y, length) in enumerate(zip(x, self.lengths, strict=True)):
            mu, part = STRETCH * self.loop_parts[k] ** 2, np.diff(self.source.positions(k))
            stretch = np.diff(y, append=y[0] + length) / (part * length) - 1
            energy += mu * float((part * stretch**2).sum())
            here = first + np.arange(len(y))
            there = np.roll(here, -1)
            first += len(y)
            for at, sign in ((there, 1.0), (here, -1.0)):
                gradient[at] += sign * 2 * mu * stretch / length
                hessian[at, at] += 2 * mu / (part * length**2)
            hessian[here, there] -= 2 * mu / (part * length**2)
            hessian[there, here] -= 2 * mu / (part * length**2)
        return energy
