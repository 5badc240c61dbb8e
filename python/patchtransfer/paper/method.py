"""Driver of the published method's mesh stages: fitted boundary -> control points, with a history of every stage.

Xu, Xiao, Xu, Gu, *Parameterization Transfer for a Planar Computational Domain in Isogeometric Analysis*, CMES 137(2),
2023, §3.3: background meshes, reversible harmonic map, bounded conformal distortion, distortion descent. What the
paper leaves open or gets wrong is said where it is decided. A mesh without flips does not imply an injective spline:
the caller certifies the result.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
from scipy.sparse import csc_array, csr_array, diags_array, eye_array, hstack

from ..errors import InputError
from ..geometry.topology import Topology
from ..mesh.background_mesh import TriangleMesh, source_mesh, target_mesh
from ..mesh.harmonic import mesh_harmonic_map
from ..numeric.arrays import FloatArray, IntArray
from ..progress import Budget, Clock
from .bounded_distortion import remove_foldovers
from .distortion_descent import minimise_distortion
from .options import PaperOptions
from .reversible_harmonic import reverse_boundary, reversible_harmonic_map

__all__ = ["PaperHistory", "PaperMap", "frozen_points", "paper_map"]

DEFAULTS = PaperOptions()
#: The descent's Newton steps converge quadratically: one or two more, and the result is the minimum whatever map it
#: started from, instead of 1e-3 of the diameter beside it.
DESCENT_TOLERANCE = 1e-12
#: Two edges are on a line when one differs from a multiple of the other by less than this part of it: rounding.
FLAT = 1e-12


@dataclass(frozen=True)
class PaperHistory:
    """What happened in every stage.

    Attributes
    ----------
    initial_map : str
        "reversible" or "dirichlet"; the latter also where the former was not possible. Of a pass that starts from the
        map of the one before it: that one's, with its iterations.
    reversible_beta, reversible_energy : tuple of float
        β and energy after every iteration of the reversible harmonic map (each energy belongs to its β).
    boundary_drift : float
        Largest distance of a softly bound boundary point from its place, relative to the square root of the target's
        area, before it is put there.
    flips, distortion_energy, k_max, k_mean : tuple
        Flipped faces, Σ area ‖J - H‖², largest and mean bound k_i: before, then after every local-global step.
    descent_energy : tuple of float
        Mean of σ₁/σ₂ + σ₂/σ₁ over the area: before, then after every step; empty when flips were left.
    descent_stop : str
        Why the descent ended; "skipped" when flips were left.
    rows : int
        Continuity rows of this pass.
    earlier : tuple of PaperHistory
        Of the passes before this one, the first one first: that without rows, and those whose rows could not all hold.
    """

    initial_map: str
    reversible_beta: tuple[float, ...] = ()
    reversible_energy: tuple[float, ...] = ()
    boundary_drift: float = 0.0
    flips: tuple[int, ...] = ()
    distortion_energy: tuple[float, ...] = ()
    k_max: tuple[float, ...] = ()
    k_mean: tuple[float, ...] = ()
    descent_energy: tuple[float, ...] = ()
    descent_stop: str = "skipped"
    rows: int = 0
    earlier: tuple[PaperHistory, ...] = ()

    def after(self, passes: tuple[PaperHistory, ...], rows: int) -> Self:
        """The same as the last of several passes; where it had no first map of its own, with the first one's."""
        if not passes:
            return replace(self, rows=rows)
        names = ("initial_map", "reversible_beta", "reversible_energy", "boundary_drift")
        first = {name: getattr(passes[0], name) for name in names} if self.initial_map == "given" else {}
        return replace(self, rows=rows, earlier=tuple(replace(one, earlier=()) for one in passes), **first)

    def to_dict(self) -> dict[str, Any]:
        """Plain lists and numbers, ready for JSON, with the iteration counts."""
        return {
            "initial_map": {
                "kind": self.initial_map,
                "iterations": len(self.reversible_energy),
                "beta": list(self.reversible_beta),
                "energy": list(self.reversible_energy),
                "boundary_drift": self.boundary_drift,
            },
            "bounded_distortion": {
                "iterations": max(len(self.flips) - 1, 0),
                "flips": list(self.flips),
                "energy": list(self.distortion_energy),
                "k_max": list(self.k_max),
                "k_mean": list(self.k_mean),
            },
            "distortion_descent": {
                "iterations": max(len(self.descent_energy) - 1, 0),
                "energy": list(self.descent_energy),
                "stop": self.descent_stop,
            },
            "rows": self.rows,
            "earlier": [one.to_dict() for one in self.earlier],
        }


@dataclass(frozen=True, eq=False)
class PaperMap:
    """Outcome of `paper_map`.

    Attributes
    ----------
    points : (n_points, 2) array
        Shared control points.
    history : PaperHistory
    log : list of str
        One line a stage.
    notes : list of str
        Warnings: where a stage had to deviate.
    """

    points: FloatArray
    history: PaperHistory
    log: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def paper_map(
    topology: Topology,
    start: FloatArray,
    null_space: Any = None,
    *,
    options: PaperOptions = DEFAULTS,
    given: FloatArray | None = None,
    stage: Clock | None = None,
    budget: Budget | None = None,
) -> PaperMap:
    """Map the source's control points to the target by the published method.

    Parameters
    ----------
    topology : Topology
        Of the source.
    start : (n_points, 2) array
        Shared control points with the fitted boundary; with a null space they satisfy the continuity rows.
    null_space : (n_interior, m) sparse or dense array, optional
        Basis of the displacements of the interior points (``topology.interior_points``) that keep the continuity
        rows B u = 0; default all. The rows tie interior to boundary points, so the boundary is hard from the first
        stage on then.
    options : PaperOptions
    given : (n_points, 2) array, optional
        First map, on the same boundary and satisfying the rows, instead of the one that the options name. It gives way
        to the Dirichlet solve where that has fewer flipped faces.
    stage : Clock, optional
        Put around every stage.
    budget : Budget, optional
        Its time limit ends every stage with what it has; work is limited by the options.

    Returns
    -------
    PaperMap
    """
    budget, stage = budget or Budget(), stage or Clock()
    boundary = topology.boundary_points
    with stage("background mesh"):
        mesh, notes = source_mesh(topology)
        if null_space is not None:
            mesh, flat = _without_flat_faces(mesh, start, topology.interior_points, null_space)
            if flat:
                notes = [*notes, f"{flat} faces of the source's mesh are flat under the continuity rows and left out"]
        # Of the source's resolution, so that closest points on it are about as accurate both ways.
        polygons = [start[loop] for loop in mesh.loops]
        area = TriangleMesh(start, mesh.triangles, ()).areas().sum()
        other = None
        if options.initial == "reversible" and given is None:
            try:
                other = target_mesh(polygons, max_area=abs(float(area)) / len(mesh.triangles))
            except InputError as error:
                notes = [*notes, f"no reversible harmonic map, a Dirichlet solve instead: {error}"]
    with stage("harmonic map"):
        interior = topology.interior_points
        points = mesh_harmonic_map(mesh, boundary, start[boundary], null_space, start[interior])
        history: dict[str, Any] = {"initial_map": "dirichlet"}
        log = []
        if given is not None and _flips(mesh, given) <= _flips(mesh, points):
            points, history = given, {"initial_map": "given"}
        if other is not None:
            weight = math.inf if options.boundary_weight is None else options.boundary_weight
            points, history, line = _reversible(
                mesh, other, boundary, start, points, interior, null_space, weight, budget
            )
            log.append(line)
    with stage("bounded distortion") as told:
        unfolded = remove_foldovers(
            mesh, points, boundary, null_space, max_iterations=options.max_iterations, budget=budget
        )
        history |= {
            "flips": tuple(unfolded.flips),
            "distortion_energy": tuple(unfolded.energy),
            "k_max": tuple(unfolded.k_max),
            "k_mean": tuple(unfolded.k_mean),
        }
        points = unfolded.points
        left = min(unfolded.flips)
        log.append(
            f"bounded distortion: {unfolded.flips[0]} flipped faces, {left} after {unfolded.iterations} iterations, "
            f"bounds k up to {unfolded.k_max[-1]:.3g}"
        )
        told.found = log[-1]
    with stage("distortion descent") as told:
        if not unfolded.converged:
            log.append("distortion descent: skipped, faces are still flipped")
        else:
            fixed, basis = boundary, null_space
            if options.freeze_interfaces:
                fixed, basis = np.union1d(boundary, frozen_points(topology, null_space)), None
            descent = minimise_distortion(
                mesh, points, fixed, basis, tolerance=DESCENT_TOLERANCE, seconds=budget.seconds_left()
            )
            points = descent.points
            history |= {"descent_energy": tuple(descent.energy), "descent_stop": descent.stop}
            log.append(
                f"distortion descent: mean conformal distortion {descent.energy[0]:.4g}, {descent.energy[-1]:.4g} "
                f"after {len(descent.energy) - 1} steps"
            )
        told.found = log[-1]
    return PaperMap(points, PaperHistory(**history), log, list(notes))


def frozen_points(topology: Topology, null_space: Any = None) -> IntArray:
    """Interior points on interfaces, and those that continuity rows tie to others (sorted)."""
    on_interfaces = [f.side_a.of(topology.points[f.patch_a]) for f in topology.interfaces]
    interior = topology.interior_points
    frozen = np.intersect1d(np.concatenate([np.empty(0, np.int64), *on_interfaces]), interior)
    if null_space is not None:
        # A free point moves with a column of its own.
        rows = csr_array(csc_array(null_space))
        shared = csc_array(rows).count_nonzero(axis=0) > 1
        tied = (rows.count_nonzero(axis=1) != 1) | (abs(rows) @ shared.astype(float) > 0)
        frozen = np.union1d(frozen, interior[tied])
    return np.asarray(frozen, np.int64)


def _flips(mesh: TriangleMesh, points: FloatArray) -> int:
    return int((TriangleMesh(points, mesh.triangles, ()).areas() <= 0).sum())


def _without_flat_faces(
    mesh: TriangleMesh, start: FloatArray, interior: IntArray, null_space: Any
) -> tuple[TriangleMesh, int]:
    """The mesh without faces whose corners the rows keep on a line (2 s = p + q), and their number."""
    rows = csr_array(eye_array(len(start), format="csr")[:, interior] @ csc_array(null_space))
    tied = np.zeros(len(start), bool)
    tied[interior] = rows[interior].count_nonzero(axis=1) != 1
    doubtful = np.flatnonzero(tied[mesh.triangles].any(axis=1))
    # Always on a line when two edges depend on the unknowns, and on the start, by one ratio.
    corner = mesh.triangles[doubtful].T
    motion = csr_array(hstack([rows, start]))
    edges = [motion[corner[k]] - motion[corner[0]] for k in (1, 2)]
    swap = diags_array((_dots(edges[1], edges[1]) > _dots(edges[0], edges[0])).astype(float))
    # The longer one first, and what the other has beside it.
    long, short = (edges[k] + swap @ (edges[1 - k] - edges[k]) for k in (0, 1))
    length2 = _dots(long, long)
    beside = short - diags_array(_dots(long, short) / np.where(length2 > 0, length2, 1)) @ long
    keep = np.ones(len(mesh.triangles), bool)
    keep[doubtful] = _dots(beside, beside) > FLAT**2 * length2
    return TriangleMesh(mesh.points, mesh.triangles[keep], mesh.loops), int((~keep).sum())


def _dots(a: csr_array, b: csr_array) -> FloatArray:
    """Scalar products row by row."""
    return np.asarray(a.multiply(b).sum(axis=1), float).ravel()


def _reversible(
    mesh: TriangleMesh,
    other: TriangleMesh,
    boundary: IntArray,
    start: FloatArray,
    harmonic: FloatArray,
    interior: IntArray,
    null_space: Any,
    weight: float,
    budget: Budget,
) -> tuple[FloatArray, dict[str, Any], str]:
    """Reversible harmonic map with its boundary made exact, what to record of it, and the log's line."""
    basis = None if null_space is None else csc_array(eye_array(len(start), format="csr")[:, interior] @ null_space)
    found = reversible_harmonic_map(
        mesh,
        other,
        boundary,
        start[boundary],
        harmonic,
        reverse_boundary(mesh, other),
        null_space=basis,
        weight=weight,
        budget=budget,
    )
    # The paper's later stages need the exact boundary: the smoothest correction with these boundary values.
    gap = start[boundary] - found.points[boundary]
    points = found.points
    if null_space is None and np.isfinite(weight):
        points = points + mesh_harmonic_map(mesh, boundary, gap)
    points[boundary] = start[boundary]
    drift = float(np.linalg.norm(gap, axis=1).max() / np.sqrt(other.areas().sum()))
    record = {
        "initial_map": "reversible",
        "reversible_beta": tuple(step.beta for step in found.steps),
        "reversible_energy": tuple(step.after_closest for step in found.steps),
        "boundary_drift": drift,
    }
    rest = "" if found.converged else " (not at rest yet)"
    line = (
        f"reversible harmonic map: {len(found.steps)} iterations{rest}, energy {found.steps[-1].after_closest:.4g}, "
        f"boundary off by {drift:.1e} before it is made exact"
    )
    return points, record, line
