import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings

import models
import patchtransfer as pt
import strategies
from patchtransfer import InputError, MultiPatch, Patch, examples, iga
from patchtransfer.cli import main
from patchtransfer.io import vtu

BEZIER_QUADRILATERAL = 77


def load(path):
    pytest.importorskip("vtk")
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader

    reader = vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(path))
    reader.Update()
    assert reader.GetErrorCode() == 0
    return reader.GetOutput()


def evaluate(grid, cell, u, v, field=None):
    """A point of a cell, or a field there, by VTK."""
    quad = grid.GetCell(cell)
    assert quad.GetCellType() == BEZIER_QUADRILATERAL
    x, weights = [0.0] * 3, [0.0] * quad.GetNumberOfPoints()
    quad.EvaluateLocation(_reference(0), [u, v, 0.0], x, weights)
    if field is None:
        return np.array(x)
    array = grid.GetPointData().GetArray(field)
    ids = [quad.GetPointId(i) for i in range(quad.GetNumberOfPoints())]
    return np.array(weights) @ np.array([array.GetTuple(i) for i in ids])


def _reference(value):
    from vtkmodules.vtkCommonCore import reference

    return reference(value)


def cells_in_order(mp):
    """(patch index, span in u, span in v) of every cell."""
    for k, patch in enumerate(mp.patches):
        spans = [np.unique(knots) for knots in patch.knots]
        for i in range(len(spans[0]) - 1):
            for j in range(len(spans[1]) - 1):
                yield k, spans[0][i : i + 2], spans[1][j : j + 2]


def agree(mp, grid, fields=None):
    assert grid.GetNumberOfCells() == sum(1 for _ in cells_in_order(mp))
    owner = grid.GetCellData().GetArray("patch")
    size = np.abs(mp.topology.coordinates).max()
    for cell, (k, u, v) in enumerate(cells_in_order(mp)):
        assert owner.GetValue(cell) == mp.ids[k]
        swap = mp.topology.orientation[k] < 0
        for s, t in ((0.0, 0.0), (1.0, 0.0), (0.3, 0.0), (1.0, 0.6), (0.25, 0.7), (0.9, 1.0), (0.0, 0.45)):
            at = u[0] + s * (u[1] - u[0]), v[0] + t * (v[1] - v[0])
            here = (t, s) if swap else (s, t)
            found = evaluate(grid, cell, *here)
            np.testing.assert_allclose(found, [*mp.patches[k](*at), 0], atol=1e-12 * size)
            for name, f in (fields or {}).items():
                np.testing.assert_allclose(evaluate(grid, cell, *here, field=name), f(k, *at), atol=1e-11)


@settings(max_examples=15, deadline=None)
@given(strategies.multipatches())
def test_vtk_reads_what_we_evaluate(tmp_path_factory, mp):
    path = tmp_path_factory.mktemp("vtu") / "model.vtu"
    pt.write(mp, path)
    agree(mp, load(path))


@settings(max_examples=15, deadline=None)
@given(strategies.patches(max_degree=3))
def test_any_patch_and_mixed_degrees(tmp_path_factory, patch):
    mp = MultiPatch([patch])
    path = tmp_path_factory.mktemp("vtu") / "model.vtu"
    pt.write(mp, path)
    agree(mp, load(path))


def test_cells_run_counter_clockwise(tmp_path):
    mp, _, _ = examples.load("wrench")
    turned = models.grid(2, 2, 3, 2)
    assert (turned.topology.orientation < 0).any()
    for k, model in enumerate((mp, turned)):
        pt.write(model, tmp_path / f"{k}.vtu")
        grid = load(tmp_path / f"{k}.vtu")
        for cell in range(grid.GetNumberOfCells()):
            a, b, c = (evaluate(grid, cell, *at)[:2] for at in ((0.5, 0.5), (0.5001, 0.5), (0.5, 0.5001)))
            assert np.linalg.det([b - a, c - a]) > 0


def test_fields_are_exact(tmp_path):
    mp = models.o_grid(3, 2)
    linear = [p.control_points @ [2.0, -1.0] + 0.5 for p in mp.patches]
    both = [p.control_points[..., ::-1].copy() for p in mp.patches]
    path = tmp_path / "fields.vtu"
    vtu.write_fields(mp, path, {"height": linear, "swapped": both})

    def height(k, u, v):
        x, y = mp.patches[k](u, v)
        return [2 * x - y + 0.5]

    agree(mp, load(path), {"height": height, "swapped": lambda k, u, v: mp.patches[k](u, v)[::-1]})


def test_a_displacement_is_a_vector_in_space(tmp_path):
    """Elasticity: the file's field is the solution at any point, and on patches of either orientation."""
    mp = models.plate_with_hole(2, 2)
    mp = mp.with_labels({"held": [mp.boundaries[0]]})
    solution = iga.elasticity(mp, {"held": (0.0, 0.0)}, body=(0.0, -1.0), degree=3, points=6)
    pt.write(mp, tmp_path / "plate.vtu", fields={"u": solution})
    grid = load(tmp_path / "plate.vtu")
    assert grid.GetPointData().GetArray("u").GetNumberOfComponents() == 3
    largest = 0.0
    for cell in range(grid.GetNumberOfCells()):
        for at in ((0.3, 0.4), (0.8, 0.2)):
            x, u = evaluate(grid, cell, *at), evaluate(grid, cell, *at, field="u")
            np.testing.assert_allclose(u, [*solution(x[:2]), 0], atol=1e-10)
            largest = max(largest, np.hypot(*u[:2]))
    assert largest > 0.1
    assert np.isnan(solution([100.0, 100.0])).all()


def test_a_clamped_plate_is_written(tmp_path):
    mp = models.grid()
    solution = iga.biharmonic(mp, degree=4, gluing="nearest")
    pt.write(mp, tmp_path / "plate.vtu", fields={"w": solution})
    grid = load(tmp_path / "plate.vtu")
    found = []
    for cell in range(grid.GetNumberOfCells()):
        x, w = evaluate(grid, cell, 0.3, 0.6), evaluate(grid, cell, 0.3, 0.6, field="w")
        found.append(w[0])
        np.testing.assert_allclose(w, solution(x[:2]), atol=1e-10)
    assert np.ptp(found) > 0.1


def test_fields_on_rational_patches(tmp_path):
    r = 0.5**0.5
    points = np.array([[[1, 0], [2, 0]], [[1, 1], [2, 2]], [[0, 1], [0, 2]]], float)
    quarter = Patch(([0, 0, 0, 1, 1, 1], [0, 0, 1, 1]), (2, 1), points, [[1, 1], [r, r], [1, 1]])
    mp = MultiPatch([quarter])
    path = tmp_path / "ring.vtu"
    vtu.write_fields(mp, path, {"x": [points[..., 0]]})
    grid = load(path)
    assert grid.GetPointData().GetRationalWeights() is not None
    agree(mp, grid, {"x": lambda k, u, v: mp.patches[k](u, v)[:1]})
    for t in np.linspace(0, 1, 7):
        # Left-handed, so VTK's second direction runs along the arc.
        assert np.linalg.norm(evaluate(grid, 0, 0.0, t)) == pytest.approx(1, abs=1e-14)


def test_scaled_jacobian(tmp_path):
    mp, _, _ = examples.load("wrench")
    path = tmp_path / "wrench.vtu"
    pt.write(mp, path)
    grid = load(path)
    # The interpolant meets the samples, span corners among them.
    for cell, (k, u, v) in enumerate(cells_in_order(mp)):
        for s, t in ((0, 0), (1, 0), (1, 1), (1 / 3, 2 / 3)):
            at = [u[0] + s * (u[1] - u[0])], [v[0] + t * (v[1] - v[0])]
            if (s == 1 and u[1] < mp.patches[k].knots[0][-1]) or (t == 1 and v[1] < mp.patches[k].knots[1][-1]):
                continue  # derivatives at inner knots are those of the next span there
            a, b = mp.patches[k].grid(*at, 1, 0)[0, 0], mp.patches[k].grid(*at, 0, 1)[0, 0]
            expected = np.linalg.det([a, b]) / np.linalg.norm(a) / np.linalg.norm(b) * mp.topology.orientation[k]
            swap = mp.topology.orientation[k] < 0
            found = evaluate(grid, cell, *((t, s) if swap else (s, t)), field="scaled_jacobian")
            np.testing.assert_allclose(found, [expected], atol=1e-10)


def test_a_viewers_picture_has_the_right_area(tmp_path):
    """Cells as VTK tessellates them for display: their area tends to that of the domain."""
    mp, _, _ = examples.load("human")
    pt.write(mp, tmp_path / "human.vtu")
    grid = load(tmp_path / "human.vtu")
    from vtkmodules.vtkFiltersCore import vtkMassProperties, vtkTriangleFilter
    from vtkmodules.vtkFiltersGeometry import vtkDataSetSurfaceFilter

    surface, triangles, mass = vtkDataSetSurfaceFilter(), vtkTriangleFilter(), vtkMassProperties()
    surface.SetInputData(grid)
    surface.SetNonlinearSubdivisionLevel(3)
    triangles.SetInputConnection(surface.GetOutputPort())
    mass.SetInputConnection(triangles.GetOutputPort())
    mass.Update()
    loops = [np.concatenate([c(np.linspace(*c.domain, 400)[:-1]) for c in loop]) for loop in mp.boundary().loops]
    area = sum(0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1)) for x, y in (loop.T for loop in loops))
    assert mass.GetSurfaceArea() == pytest.approx(area, rel=1e-4)


def test_command_line_writes_it_too(tmp_path):
    mp = models.grid(1, 1)
    pt.write(mp, tmp_path / "a.xml")
    result = CliRunner().invoke(
        main, ["transfer", str(tmp_path / "a.xml"), str(tmp_path / "a.xml"), "-o", str(tmp_path / "b.vtu")]
    )
    assert result.exit_code == 0, result.output
    assert load(tmp_path / "b.vtu").GetNumberOfCells() == sum(1 for _ in cells_in_order(mp))


def test_series(tmp_path):
    text = vtu.format_series(["a.vtu", "b & c.vtu"], [0, 2.5])
    import xml.etree.ElementTree as ET

    sets = ET.fromstring(text).findall("./Collection/DataSet")
    assert [(s.get("timestep"), s.get("file")) for s in sets] == [("0.0", "a.vtu"), ("2.5", "b & c.vtu")]


def test_bad_input(tmp_path):
    mp = models.grid(1, 1)
    shape = mp.patches[0].shape
    for bad, message in (
        ({"f": []}, "one a patch"),
        ({"f": [np.zeros((2, 2))]}, "patch 0"),
        ({"f": [np.full(shape, np.nan)]}, "finite"),
        ({"scaled_jacobian": [np.zeros(shape)]}, "scaled_jacobian"),
    ):
        with pytest.raises(InputError, match=message):
            vtu.write_fields(mp, tmp_path / "x.vtu", bad)
    two = models.grid(2, 1)
    shape = two.patches[0].shape
    with pytest.raises(InputError, match="components"):
        vtu.format_multipatch(two, {"f": [np.zeros(shape), np.zeros((*shape, 2))]})
    with pytest.raises(InputError, match=r"use \.vtu"):
        vtu.write_fields(mp, tmp_path / "x.vtk")
    with pytest.raises(InputError, match="MultiPatch"):
        pt.write(mp.boundary(), tmp_path / "x.vtu")
    pt.write(mp, tmp_path / "x.vtu")
    with pytest.raises(InputError, match="VTU file holds no patches"):
        pt.read(tmp_path / "x.vtu")
    assert list(tmp_path.iterdir()) == [tmp_path / "x.vtu"]
