"""Neumann and Robin data, values at points, fields in files: exact solutions, derivatives by differences."""

import numpy as np
import pytest
import vtk
from vtk.util.numpy_support import vtk_to_numpy

import models
import patchtransfer as pt
from commands import failed, run
from conics import annulus
from patchtransfer import iga

EXACT = 1e-9


def bar() -> pt.MultiPatch:
    """From x = 0 ("warm") to x = 4 ("cold"), of height 1."""
    patch = pt.Patch(
        ([0, 0, 0, 1, 1, 1],) * 2, (2, 2), np.stack(np.meshgrid([0, 2, 4.0], [0, 0.5, 1.0], indexing="ij"), axis=-1)
    )
    return pt.MultiPatch([patch]).with_labels({"warm": [(0, "west")], "cold": [(0, "east")], "top": [(0, "north")]})


def test_a_linear_solution_comes_out_exactly_under_all_conditions():
    # u = 1 + 2 x: flux 2 at the cold end, -2 at the warm one.
    mp = bar()
    for given in (
        {"g": {"warm": 1.0}, "neumann": {"cold": 2.0}},
        {"g": {"warm": 1.0}, "robin": {"cold": (0.5, 2 + 0.5 * 9)}},
        {"g": {}, "robin": {"warm": (1.0, -2 + 1.0)}, "neumann": {"cold": lambda x, y: 2 + 0 * x}},
    ):
        u = iga.poisson(mp, 0.0, **given)
        points = np.random.default_rng(1).uniform([0, 0], [4, 1], (50, 2))
        np.testing.assert_allclose(u(points), 1 + 2 * points[:, 0], atol=EXACT)


def test_orders_with_a_flux_through_a_circle():
    """On an annulus u = log r: flux 1/R outside, and Robin inside."""
    inner, outer = 0.5, 1.0
    mp = annulus(inner, outer)
    at = {"in": [], "out": []}
    for k, side in mp.boundaries:
        middle = mp.patches[k].grid(*_middle(mp.patches[k], side)).reshape(2)
        at["out" if np.hypot(*middle) > 0.75 else "in"].append((k, side))
    mp = mp.with_labels(at)
    errors = []
    for points in (5, 9):
        found = iga.poisson(
            mp,
            0.0,
            {},
            degree=3,
            points=points,
            neumann={"out": 1 / outer},
            robin={"in": (2.0, -1 / inner + 2 * np.log(inner))},
        )
        r = np.linspace(inner, outer, 20)
        values = found(np.column_stack([r * np.cos(0.3), r * np.sin(0.3)]))
        errors.append(abs(values - np.log(r)).max())
    assert errors[1] < errors[0] / 8


def _middle(patch, side):
    ends = [patch.knots[axis][[0, -1]] for axis in (0, 1)]
    at = [np.array([e.mean()]) for e in ends]
    at[1 - side.axis] = np.array([ends[1 - side.axis][1 if side.at_end else 0]])
    return at


def test_derivatives_by_the_geometry_agree_with_differences():
    mp = bar()
    given = {
        "g": {"warm": 1.0},
        "neumann": {"top": lambda x, y: 0.3 * x + y},
        "robin": {"cold": (lambda x, y: 1 + y, 2.0)},
    }

    def of(points):
        return iga.poisson(mp.with_shared_points(points), lambda x, y: x + 1, **given)

    x = mp.topology.coordinates + 0.05 * np.random.default_rng(2).normal(size=(mp.topology.n_points, 2))
    direction = np.random.default_rng(3).normal(size=x.shape)
    for what in (lambda r: r.integral(lambda x, y: 1 + x), lambda r: r.energy()):
        slope = float((what(of(x))[1] * direction).sum())
        h = 1e-5
        differences = (what(of(x + h * direction))[0] - what(of(x - h * direction))[0]) / (2 * h)
        assert slope == pytest.approx(differences, rel=1e-6)


def test_values_at_points_are_those_on_grids_and_nan_outside():
    mp = models.star()
    u = iga.poisson(mp, 1.0, degree=4, points=8)
    rng = np.random.default_rng(4)
    for k, patch in enumerate(mp.patches):
        s, t = (np.sort(rng.uniform(*knots[[0, -1]], 4)) for knots in patch.knots)
        np.testing.assert_allclose(u(patch.grid(s, t)), u.field.grid(k, s, t), atol=1e-10)
    assert np.isnan(u([[1e3, 0.0]])).all()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"neumann": {"warm": 0.0, "cold": 0.0, "top": 0.0, "floor": 0.0}}, "every side has Neumann data"),
        ({"neumann": {"hot": 0.0}}, "Neumann data: the model has no label 'hot'"),
        ({"robin": {"cold": 1.0}}, "needs a pair"),
        ({"robin": {"cold": (-1.0, 0.0)}}, "0 or more"),
        ({"neumann": {"cold": 1.0}, "robin": {"cold": (1.0, 0.0)}}, "has Neumann data already"),
        ({"g": {"cold": 0.0}, "neumann": {"cold": 1.0}}, "Dirichlet data and a flux"),
        ({"neumann": {"cold": lambda x, y: x / 0 * np.nan}}, "flux on east side of patch 0"),
    ],
)
def test_conditions_that_do_not_fit_are_refused(given, message):
    mp = bar().with_labels({"floor": [(0, "south")]} | {k: list(v) for k, v in bar().sides.items()})
    with pytest.raises(pt.InputError, match=message), np.errstate(all="ignore"):
        iga.poisson(mp, 0.0, **given)


def test_without_a_right_hand_side_fluxes_are_refused():
    with pytest.raises(pt.InputError, match="need a right-hand side"):
        iga.poisson(bar(), neumann={"cold": 1.0})


@pytest.mark.parametrize("rational", [False, True])
def test_fields_in_files_are_exact(tmp_path, rational):
    mp = annulus(0.5, 1.0) if rational else models.plate_with_hole(2, 2)
    solution = iga.poisson(mp, 1.0, degree=3, points=6)
    pt.write(mp, tmp_path / "u.vtu", fields={"u": solution})
    reader = vtk.vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(tmp_path / "u.vtu"))
    reader.Update()
    grid = reader.GetOutput()
    u = vtk_to_numpy(grid.GetPointData().GetArray("u"))
    points = vtk_to_numpy(grid.GetPoints().GetData())[:, :2]
    # Corners of cells are interpolated by Bézier points, so that the field can be compared there.
    checked = 0
    for c in range(grid.GetNumberOfCells()):
        ids = [grid.GetCell(c).GetPointId(i) for i in range(4)]
        inside = solution(points[ids])
        there = np.isfinite(inside)
        np.testing.assert_allclose(u[ids][there], inside[there], atol=1e-10)
        checked += int(there.sum())
    assert checked > 20


def test_fields_of_other_models_or_in_other_formats_are_refused(tmp_path):
    mp = bar()
    solution = iga.poisson(mp, 1.0)
    with pytest.raises(pt.InputError, match=r"to \.vtu"):
        pt.write(mp, tmp_path / "u.xml", fields={"u": solution})
    with pytest.raises(pt.InputError, match="expected a field or solution"):
        pt.write(mp, tmp_path / "u.vtu", fields={"u": 3.0})
    assert not list(tmp_path.iterdir())


def test_models_of_any_size_have_waves_that_suit_them():
    mp = models.star()
    large = mp.with_control_points([100 * p.control_points for p in mp.patches])
    small, big = (iga.poisson(model, degree=4, points=8) for model in (mp, large))
    assert big.errors.max == pytest.approx(small.errors.max, rel=1e-6)


def test_the_command_takes_fluxes_and_writes_fields(tmp_path):
    pt.write(bar(), tmp_path / "bar.xml")
    done = run(
        "poisson", tmp_path / "bar.xml", "--dirichlet", "warm=1", "--robin", "cold=0.5,6.5", "-o", tmp_path / "u.vtu"
    )
    assert done.exit_code == 0, done.output
    assert 'Name="u"' in (tmp_path / "u.vtu").read_text()
    failed(run("poisson", tmp_path / "bar.xml", "--robin", "cold=0.5"), 2, "two numbers; write LABEL=A,H")
    failed(run("poisson", tmp_path / "bar.xml", "--neumann", "cold"), 2, "not a label and a number")
