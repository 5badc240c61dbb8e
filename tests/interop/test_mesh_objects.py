"""Meshes of meshio, scikit-fem and PyVista: the same domain, glued, with the labels of its boundary."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import models
from patchtransfer import InputError
from strategies import multipatches

meshio = pytest.importorskip("meshio")
quick = settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])


def shoelace(points: np.ndarray) -> np.ndarray:
    """Areas of polygons (..., n, 2), positive counter-clockwise."""
    ahead = np.roll(points, -1, axis=-2)
    return 0.5 * (points[..., 0] * ahead[..., 1] - points[..., 1] * ahead[..., 0]).sum(-1)


@quick
@given(multipatches(), st.integers(1, 4))
def test_cells_and_lines_enclose_the_same_area(mp, samples):
    mesh = mp.to_meshio(samples)
    quads, lines = mesh.points[mesh.cells_dict["quad"]][..., :2], mesh.points[mesh.cells_dict["line"]][..., :2]
    assert (shoelace(quads) > 0).all()
    # The domain is on the left of its boundary.
    a, b = lines[:, 0], lines[:, 1]
    assert shoelace(quads).sum() == pytest.approx(0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum())
    assert (mesh.points[:, 2] == 0).all()
    # No point is there twice, and all lie on the patches.
    assert len(np.unique(mesh.points.round(9), axis=0)) == len(mesh.points)


def test_points_lie_on_the_patches():
    mp = models.o_grid(3, 2)
    mesh = mp.to_meshio(3)
    for k, patch in enumerate(mp):
        quads = mesh.cells_dict["quad"][mesh.cell_data_dict["patch"]["quad"] == k]
        t = np.linspace(0, 1, 7)
        there = np.unique(mesh.points[np.unique(quads), :2].round(12), axis=0)
        expected = np.unique(patch.grid(t, t).reshape(-1, 2).round(12), axis=0)
        assert np.allclose(there, expected, rtol=0, atol=1e-11)


def test_labels_are_sets_of_lines_in_scikit_fem():
    skfem = pytest.importorskip("skfem")
    from skfem.io.meshio import from_meshio

    mp = models.plate_with_hole(2, 2)
    hole = [(side.patch, side.side) for side in mp.loops[1]]
    (f, *_) = mp.interfaces
    mp = mp.with_labels({"hole": hole, "inside": [(f.patch_a, f.side_a)], "hole and more": [*hole, mp.boundaries[0]]})
    mesh = from_meshio(mp.to_meshio(8))
    assert isinstance(mesh, skfem.MeshQuad)
    assert mesh.subdomains is None
    length = {}
    for name, facets in mesh.boundaries.items():
        basis = skfem.FacetBasis(mesh, skfem.ElementQuad1(), facets=np.asarray(facets))
        length[name] = skfem.Functional(lambda w: 1.0 + 0 * w.x[0]).assemble(basis)
    assert length["hole"] == pytest.approx(0.8 * np.pi, rel=1e-3)
    assert length["inside"] == pytest.approx(
        np.hypot(*np.diff(f.side_a.of(mp[f.patch_a].control_points)[[0, -1]].T)[:, 0]), rel=0.1
    )
    assert length["hole and more"] > length["hole"] - 1e-12


def test_a_label_inside_is_a_line_besides_the_boundary():
    mp = models.grid(2, 1)
    (f,) = mp.interfaces
    plain = mp.to_meshio(2)
    labelled = mp.with_labels({"middle": [(f.patch_a, f.side_a)], "none": []}).to_meshio(2)
    assert len(labelled.cells_dict["line"]) == len(plain.cells_dict["line"]) + 4
    assert [len(cells) for cells in labelled.cell_sets["middle"]] == [0, 4]
    assert [len(cells) for cells in labelled.cell_sets["none"]] == [0, 0]


def test_files_of_meshio_hold_the_mesh(tmp_path):
    mp = models.grid(2, 1).with_labels({"inlet": [(0, 1)]})
    mesh = mp.to_meshio()
    mesh.write(tmp_path / "a.vtu")
    back = meshio.read(tmp_path / "a.vtu")
    assert np.array_equal(back.points, mesh.points)
    assert np.array_equal(back.cell_data_dict["patch"]["quad"], mesh.cell_data_dict["patch"]["quad"])


@pytest.mark.parametrize("samples", [0, -1])
def test_no_cells_are_refused(samples):
    with pytest.raises(InputError, match="cut into 1 part or more"):
        models.grid(1, 1).to_meshio(samples)


@pytest.mark.parametrize("name", ["o-grid p3", "annulus p3"])
def test_pyvista_has_the_exact_cells(name):
    pyvista = pytest.importorskip("pyvista")
    mp = models.ALL[name]()
    grid = mp.to_pyvista()
    assert isinstance(grid, pyvista.UnstructuredGrid)
    assert set(grid.celltypes) == {77}
    assert grid.n_cells == sum(2 * 2 if name == "annulus p3" else 3 * 3 for _ in mp)
    assert sorted(set(grid.cell_data["patch"])) == list(mp.ids)
    # Where VTK evaluates the middles of cells, our patches are.
    for k, patch in enumerate(mp):
        breaks = np.unique(patch.knots[0])
        middles = (breaks[:-1] + breaks[1:]) / 2
        expected = patch.grid(middles, middles).reshape(-1, 2)
        for cell in np.flatnonzero(grid.cell_data["patch"] == mp.ids[k]):
            made = grid.GetCell(int(cell))
            x, w = [0.0] * 3, [0.0] * made.GetNumberOfPoints()
            made.EvaluateLocation(
                __import__("vtkmodules.vtkCommonCore").vtkCommonCore.reference(0), [0.5, 0.5, 0], x, w
            )
            assert np.hypot(*(expected - x[:2]).T).min() < 1e-12
