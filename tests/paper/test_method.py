import json

import numpy as np
import pytest
from scipy.sparse import csc_array

import models
import patchtransfer as pt
import targets
from patchtransfer import InputError, TransferPlan, _core, examples
from patchtransfer.mesh.background_mesh import TriangleMesh, source_mesh
from patchtransfer.mesh.harmonic import mesh_harmonic_map
from patchtransfer.paper.method import frozen_points, paper_map
from patchtransfer.paper.options import PaperOptions


def deformed_start(mp, f):
    """Shared control points with the boundary moved by f, the interior as in the source."""
    points = mp.topology.coordinates.copy()
    boundary = mp.topology.boundary_points
    points[boundary] = f(points[boundary])
    return points


def areas(mp, points):
    return TriangleMesh(points, source_mesh(mp.topology)[0].triangles, ()).areas()


@pytest.fixture(scope="module")
def case():
    mp = models.plate_with_hole(3, 2)
    return mp, deformed_start(mp, targets.bend(mp, 40))


@pytest.mark.parametrize("initial", ["reversible", "dirichlet"])
def test_all_stages_run(case, initial):
    mp, start = case
    result = paper_map(mp.topology, start, options=PaperOptions(initial=initial))
    history = result.history
    assert history.initial_map == initial
    assert not result.notes
    boundary = mp.topology.boundary_points
    np.testing.assert_array_equal(result.points[boundary], start[boundary])
    assert (areas(mp, result.points) > 0).all()
    assert history.flips[-1] == 0
    assert len(history.flips) == len(history.distortion_energy) == len(history.k_max) == len(history.k_mean)
    assert history.descent_stop == "converged"
    assert (np.diff(history.descent_energy) < 0).all()
    assert (0 < len(history.reversible_energy) < 100) == (initial == "reversible")
    assert [line.split(":")[0] for line in result.log][-2:] == ["bounded distortion", "distortion descent"]
    assert json.loads(json.dumps(history.to_dict()))["distortion_descent"]["iterations"] > 0


def test_both_first_maps_end_alike(case):
    mp, start = case
    first, second = (
        paper_map(mp.topology, start, options=PaperOptions(initial=name)).points for name in ("reversible", "dirichlet")
    )
    np.testing.assert_allclose(first, second, atol=1e-3)


def test_frozen_interfaces_stay(case):
    mp, start = case
    frozen = frozen_points(mp.topology)
    assert 0 < len(frozen) < len(mp.topology.interior_points)
    before = paper_map(mp.topology, start, options=PaperOptions("dirichlet", freeze_interfaces=True))
    free = paper_map(mp.topology, start, options=PaperOptions("dirichlet"))
    unfolded = before.history.descent_energy[0]
    assert free.history.descent_energy[0] == unfolded
    assert free.history.descent_energy[-1] < before.history.descent_energy[-1] < unfolded
    # Where the first stages left them: the harmonic map itself, which had no flips.
    assert before.history.flips == (0,)
    mesh, _ = source_mesh(mp.topology)
    harmonic = mesh_harmonic_map(mesh, mesh.boundary, start[mesh.boundary])
    np.testing.assert_allclose(before.points[frozen], harmonic[frozen], atol=1e-14)
    assert np.abs(free.points[frozen] - harmonic[frozen]).max() > 1e-4


def tied_rows(mp, start):
    """One smooth point: on an interface between two patches, p + q = 2 s, and a basis of what it leaves."""
    topology = mp.topology
    interior = topology.interior_points
    number = {int(v): i for i, v in enumerate(interior)}
    f = topology.interfaces[0]
    side = [s.of(topology.points[k], row) for k, s in ((f.patch_a, f.side_a), (f.patch_b, f.side_b)) for row in (0, 1)]
    across = side[3][::-1] if f.reversed else side[3]
    p, s, q = (int(row[len(row) // 2]) for row in (side[1], side[0], across))
    start = start.copy()
    start[s] = (start[p] + start[q]) / 2
    masters = [v for v in interior.tolist() if v != s]
    column = {v: i for i, v in enumerate(masters)}
    entries = [(number[v], column[v], 1.0) for v in masters]
    entries += [(number[s], column[p], 0.5), (number[s], column[q], 0.5)]
    rows, columns, values = zip(*entries, strict=True)
    return (p, s, q), start, csc_array((values, (rows, columns)), shape=(len(interior), len(masters)))


def test_rows_are_kept(case):
    mp, start = case
    (p, s, q), start, z = tied_rows(mp, start)
    result = paper_map(mp.topology, start, z)
    assert result.history.initial_map == "reversible"
    np.testing.assert_allclose(2 * result.points[s] - result.points[p] - result.points[q], 0, atol=1e-12)
    # The face p, s, q is flat under the row; all others keep their sense.
    assert any("1 faces" in note for note in result.notes)
    assert np.count_nonzero(areas(mp, result.points) <= 1e-12) == 1
    assert result.history.flips[-1] == 0
    plain = paper_map(mp.topology, start).points
    assert np.abs(2 * plain[s] - plain[p] - plain[q]).max() > 1e-4
    # Frozen then are all three, on the interface or not.
    assert {p, s, q} <= set(frozen_points(mp.topology, z).tolist())
    assert not {p, q} <= set(frozen_points(mp.topology).tolist())
    frozen = paper_map(mp.topology, start, z, options=PaperOptions(freeze_interfaces=True)).points
    np.testing.assert_allclose(2 * frozen[s] - frozen[p] - frozen[q], 0, atol=1e-12)


def test_a_target_without_a_mesh_takes_the_dirichlet_solve():
    # The fitted curve is simple, its control polygon is not.
    mp = models.build([models.bilinear((0, 0), (1, 0), (1, 1), (0, 1))], 3, 1, None)
    start = mp.topology.coordinates.copy()
    bottom = mp.topology.points[0][:, 0]
    start[bottom[1]], start[bottom[2]] = (0.9, 0.2), (0.1, 0.2)
    start[mp.topology.points[0][0, 1]] = (0.2, 0.1)
    result = paper_map(mp.topology, start)
    assert result.history.initial_map == "dirichlet"
    assert "no reversible harmonic map" in result.notes[0]


def test_left_over_flips_are_said(case):
    mp, _ = case
    start = mp.topology.coordinates * [-1, 1]  # a mirrored boundary: nothing can unfold it
    result = paper_map(mp.topology, start, options=PaperOptions("dirichlet", max_iterations=5))
    assert result.history.descent_stop == "skipped"
    assert result.history.descent_energy == ()
    assert result.history.flips[-1] > 0
    assert "skipped" in result.log[-1]


@pytest.mark.parametrize(
    ("name", "factor", "angle"),
    [("wrench", 4, 0), ("wrench", 5, 0), ("human", 8**0.5, 0), ("human", 5, 20), ("two-hole-plate", 8**0.5, 45)],
)
def test_no_flips_on_strong_stretches(name, factor, angle):
    """Cases on which 2000 steps with slowly raised bounds left flips."""
    mp, _, _ = examples.load(name)
    target, landmarks = targets.deformed(mp, targets.stretch(factor, angle))
    result = TransferPlan(mp, "c0").transfer(target, landmarks, method="paper", on_failure="return")
    history = result.paper_history
    assert history.flips[-1] == 0
    assert max(history.flips) > 0
    assert list(history.k_max) == sorted(history.k_max)
    assert len(history.flips) < 2000


def test_results_do_not_depend_on_the_number_of_threads(case):
    mp, start = case
    try:
        results = []
        for n in (1, 2, 3):
            _core.set_threads(n)
            results.append(paper_map(mp.topology, start).points)
    finally:
        _core.set_threads(0)
    np.testing.assert_array_equal(results[0], results[1])
    np.testing.assert_array_equal(results[0], results[2])


def test_result_carries_the_history():
    mp = models.grid(2, 2, 2, 2)
    target, landmarks = targets.deformed(mp, targets.bend(mp, 30))
    paper = pt.transfer(mp, target, landmarks, method="paper")
    data = json.loads(json.dumps(paper.to_dict()))["paper_history"]
    assert data["initial_map"]["kind"] == "reversible"
    assert len(data["initial_map"]["energy"]) == data["initial_map"]["iterations"]
    assert len(data["bounded_distortion"]["flips"]) == data["bounded_distortion"]["iterations"] + 1
    assert data["distortion_descent"]["stop"] == "converged"
    assert {"background mesh", "harmonic map", "bounded distortion", "distortion descent"} <= set(paper.timings)
    ours = pt.transfer(mp, target, landmarks)
    assert ours.paper_history is None
    assert ours.to_dict()["paper_history"] is None


def test_bad_options():
    with pytest.raises(InputError, match="initial"):
        PaperOptions("magic")
    with pytest.raises(InputError, match="max_iterations"):
        PaperOptions(max_iterations=-1)
