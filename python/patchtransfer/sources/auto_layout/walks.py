"""Paths in a T-mesh and the displacements along them."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from .t_mesh import TMesh

__all__ = ["Displacement", "Walks"]


@dataclass(frozen=True)
class Displacement:
    """From one node to another along a path, unrolled: on two axes, the first along the path's first half-arc.

    Attributes
    ----------
    arcs : two dicts of arc to int
        How often each arc is passed along either axis, with its sign.
    real : two floats
        The displacement in the map.
    last_axis : int
        Axis of the path's last half-arc.
    """

    arcs: tuple[dict[int, int], dict[int, int]]
    real: tuple[float, float]
    last_axis: int

    def integer(self, axis: int, lengths: Sequence[int]) -> int:
        """The displacement along an axis for integer arc lengths."""
        return sum(sign * lengths[arc] for arc, sign in self.arcs[axis].items())


class Walks:
    """The half-arcs of a T-mesh around its nodes."""

    def __init__(self, t_mesh: TMesh) -> None:
        self.origin = [int(node) for ends in t_mesh.arc_nodes for node in ends]
        self.outgoing: list[list[int]] = [[] for _ in t_mesh.node_kind]
        for half, node in enumerate(self.origin):
            self.outgoing[node].append(half)
        self.length = t_mesh.arc_length.tolist()
        self.size = t_mesh.arc_size.tolist()
        self.next = t_mesh.sector_next.tolist()
        self.quarters = t_mesh.sector_quarters.tolist()
        self.critical = t_mesh.node_critical.tolist()
        self.singular = frozenset(np.flatnonzero(t_mesh.node_critical & (t_mesh.node_loop < 0)).tolist())

    def target(self, half: int) -> int:
        """Node where a half-arc ends."""
        return self.origin[half ^ 1]

    def turn(self, start: int, end: int) -> int:
        """Quarter turns from one outgoing half-arc to another of the same node, through the domain.

        The shorter way, counter-clockwise (positive) if both are as long: around a face that is the way inside it.
        """
        left, right = self._quarters(start, end), self._quarters(end, start)
        if left is None or right is None:
            return left if left is not None else -(right or 0)
        return left if left <= right else -right

    def _quarters(self, start: int, end: int) -> int | None:
        """Quarter turns counter-clockwise, or nothing if that leads outside."""
        total = 0
        for _ in self.outgoing[self.origin[start]]:
            if start == end:
                return total
            if self.quarters[start] == 0:
                return None
            total += self.quarters[start]
            start = self.next[start]
        return total if start == end else None

    def beside(self, half: int, left: bool) -> int | None:
        """The outgoing half-arc a quarter turn to the left or right of one, if there is one."""
        for other in self.outgoing[self.origin[half]]:
            if other != half and (self._quarters(half, other) if left else self._quarters(other, half)) == 1:
                return other
        return None

    def straight(self, half: int) -> int | None:
        """The half-arc that goes on straight where one ends, if there is one."""
        for other in self.outgoing[self.target(half)]:
            if other != half ^ 1 and abs(self.turn(half ^ 1, other)) == 2:
                return other
        return None

    def shortest(self, start: int, end: int, allowed: Callable[[int], bool]) -> list[int] | None:
        """Half-arcs of the path that is shortest in the plane, over the allowed arcs only."""
        best = {start: 0.0}
        came: dict[int, int] = {}
        heap = [(0.0, start)]
        while heap:
            distance, node = heapq.heappop(heap)
            if node == end:
                path = []
                while node != start:
                    path.append(came[node])
                    node = self.origin[came[node]]
                return path[::-1]
            if distance > best[node]:
                continue
            for half in self.outgoing[node]:
                there = self.target(half)
                farther = distance + self.size[half // 2]
                if allowed(half // 2) and farther < best.get(there, float("inf")):
                    best[there] = farther
                    came[there] = half
                    heapq.heappush(heap, (farther, there))
        return None

    def displacement(self, path: Sequence[int]) -> Displacement:
        """Displacement along a path of half-arcs."""
        arcs: tuple[dict[int, int], dict[int, int]] = ({}, {})
        real = [0.0, 0.0]
        heading = 0
        for i, half in enumerate(path):
            if i:
                # Straight ahead is two quarters from where one comes.
                heading = (heading + 2 + self.turn(path[i - 1] ^ 1, half)) % 4
            axis, sign = heading % 2, 1 if heading < 2 else -1
            arcs[axis][half // 2] = arcs[axis].get(half // 2, 0) + sign
            real[axis] += sign * self.length[half // 2]
        return Displacement(arcs, (real[0], real[1]), heading % 2)
