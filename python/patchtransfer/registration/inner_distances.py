"""The last step of matching by shape: matched points slide along the target until inner distances are kept best.

Metric multidimensional scaling (least squares on distances, near ones weighted up) with the points confined to the
target's boundary. All loops slide together, so that holes without a shape of their own find their start. Distances
alone cannot tell how a boundary stretches where a bend lengthens one side and shortens the other: with `bending` the
map is also made smooth (`thin_plate`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .._core import compare_distances
from ..numeric.arrays import FloatArray
from ..numeric.dense import solve_definite
from .sampled_boundary import BoundaryShape, cyclic_gap, image_of, turning
from .thin_plate import Bending

__all__ = ["energy_of", "slide"]

#: Gauss–Newton steps at most, and the part of the energy that a step must win.
STEPS, GAIN = 16, 1e-3
#: With bending steps go on while they move a point by more than this part of its loop, and are halved so many times
#: when they raise the energy: that slide gives the result, others only rank matchings.
SHORT, HALVINGS = 1e-4, 3
#: Weights of stretch along the loops and of unlike turning; added to the diagonal, relative to its mean.
STRETCH, TURNING, DAMPING = 0.03, 1.0, 1e-6
#: Squared distance (relative to the root mean square) that softens the weight 1/d².
SOFT = 0.02
#: Step, in parts of the loop, of the differences that give the turning's slope: a tenth of its smallest window.
DIFFERENCE = 0.002
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
        moves = np.split(-solve_definite(hessian, np.where(held, 0.0, gradient)), ends)
        for halving in range(HALVINGS + 1 if bending else 1):
            trial = _step(x, [move / 2**halving for move in moves], problem.lengths)
            found = problem.model(trial)
            if found[0] < energy:
                break
        else:
            break
        gained = energy - found[0]
        longest = max(float(abs(a - b).max()) / length for a, b, length in zip(trial, x, problem.lengths, strict=True))
        x, (energy, gradient, hessian) = trial, found
        if gained <= GAIN * energy and (not bending or longest <= SHORT):
            break
    loops = zip(source.s, source.outlines, x, problem.lengths, strict=False)
    closed = [
        np.column_stack([np.append(s, s[0] + o.length), np.append(y, y[0] + length)]) for s, o, y, length in loops
    ]
    return closed, energy


def energy_of(
    source: BoundaryShape, target: BoundaryShape, partners: Sequence[int], anchors: Sequence[FloatArray]
) -> float:
    """Energy of a matching of the first loops as it is, without bending; see `slide`."""
    x = [image_of(a, s) for a, s in zip(anchors, source.s, strict=False)]
    return _Distances(source, target, partners).model(x)[0]


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
        self.target, self.partners = target, partners
        self.bending = bending
        self.plate = Bending(source, target, partners) if bending else None
        loops = range(len(partners))
        self.lengths = [target.outlines[t].length for t in partners]
        n = source.rows(len(partners) - 1).stop
        self.wanted = np.ascontiguousarray(source.distances[:n, :n])
        parts = [source.outlines[k].length / source.outlines[0].length for k in loops]
        shares = [source.shares(k) for k in loops]
        share = np.concatenate([x * part for x, part in zip(shares, parts, strict=True)])
        self.weight = share[:, None] * share / (self.wanted**2 + SOFT)
        self.weight[self.wanted < NEAR * np.sqrt(share[:, None] * share)] = 0.0
        self.weight /= self.weight.sum()
        # Turning: what is wanted at every node, and its weight.
        self.turning = [turning(source.outlines[k], source.s[k]) for k in loops]
        self.turning_weight = [
            TURNING * part * x[:, None] / wanted.shape[1]
            for part, x, wanted in zip(parts, shares, self.turning, strict=True)
        ]
        # Stretch: the next node of every node, and steps as they are without stretch.
        first = [source.rows(k).start for k in loops]
        self.next = np.concatenate([f + np.roll(np.arange(len(x)), -1) for f, x in zip(first, shares, strict=True)])
        self.turn = np.zeros(n)
        self.turn[[source.rows(k).stop - 1 for k in loops]] = self.lengths
        self.part = np.concatenate([np.diff(source.positions(k)) for k in loops])
        self.length = np.repeat(self.lengths, [len(x) for x in shares])
        self.stretching = np.repeat([STRETCH * part**2 for part in parts], [len(x) for x in shares])

    def model(self, x: Sequence[FloatArray]) -> tuple[float, FloatArray, FloatArray]:
        """Energy, gradient and Gauss–Newton matrix in the target's arc lengths."""
        before, after, fraction, gap = [], [], [], []
        for t, y in zip(self.partners, x, strict=True):
            index, f = self.target.locate(t, y)
            nodes = self.target.s[t]
            first, n = self.target.rows(t).start, len(nodes)
            before.append(first + index)
            after.append(first + (index + 1) % n)
            fraction.append(f)
            gap.append(np.diff(nodes, append=nodes[0] + self.target.outlines[t].length)[index])
        energy, gradient, hessian = compare_distances(
            self.target.distances,
            np.concatenate(before),
            np.concatenate(after),
            np.concatenate(fraction),
            np.concatenate(gap),
            self.wanted,
            self.weight,
        )
        energy += self._add_stretch(x, gradient, hessian) + self._add_turning(x, gradient, hessian)
        if self.plate is not None:
            energy += self.plate.add(x, self.bending, gradient, hessian)
        return energy, gradient, hessian

    def _add_turning(self, x: Sequence[FloatArray], gradient: FloatArray, hessian: FloatArray) -> float:
        """Energy of unlike turning at matched points; adds to gradient and matrix."""
        energy, first = 0.0, 0
        for t, y, wanted, weight in zip(self.partners, x, self.turning, self.turning_weight, strict=True):
            outline, n = self.target.outlines[t], len(y)
            h = DIFFERENCE * outline.length
            found = turning(outline, np.concatenate([y - h, y, y + h])).reshape(3, n, -1)
            residual, slope = found[1] - wanted, (found[2] - found[0]) / (2 * h)
            energy += float((weight * residual**2).sum())
            at = first + np.arange(n)
            gradient[at] += 2 * (weight * residual * slope).sum(axis=1)
            hessian[at, at] += 2 * (weight * slope**2).sum(axis=1)
            first += n
        return energy

    def _add_stretch(self, x: Sequence[FloatArray], gradient: FloatArray, hessian: FloatArray) -> float:
        """Energy of uneven stretch along the loops; adds to gradient and matrix."""
        y = np.concatenate(x)
        here, there, mu = np.arange(len(y)), self.next, self.stretching
        stretch = (y[there] - y + self.turn) / (self.part * self.length) - 1
        force, stiffness = 2 * mu * stretch / self.length, 2 * mu / (self.part * self.length**2)
        gradient[there] += force
        gradient -= force
        hessian[there, there] += stiffness
        hessian[here, here] += stiffness
        hessian[here, there] -= stiffness
        hessian[there, here] -= stiffness
        return float((mu * self.part * stretch**2).sum())
