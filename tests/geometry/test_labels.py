"""Labels of sides: what is taken, what is refused, where they show, and what becomes of them when patches change."""

import json
import warnings

import numpy as np
import pytest

import models
import patchtransfer as pt
from commands import arguments, inputs_of_transfer, run
from patchtransfer import InputError, InputWarning, Side
from patchtransfer.geometry.labels import relabelled
from patchtransfer.io import vtu

MP = models.grid()


@pytest.mark.parametrize(
    "where", [[(0, 1)], [(0, Side.WEST)], [[0, "west"]], (0, "West"), iter([(np.int64(0), np.int64(1))])]
)
def test_pairs_may_be_written_in_many_ways(where):
    assert dict(MP.with_labels({"inlet": where}).sides) == {"inlet": ((0, Side.WEST),)}


def test_no_sides_are_a_label_too():
    assert dict(MP.with_labels({"later": []}).sides) == {"later": ()}


@pytest.mark.parametrize(
    ("labels", "message"),
    [
        ({"inlet": "west"}, "label 'inlet': expected .patch, side. pairs such as"),
        ({"inlet": 3}, "expected .patch, side. pairs"),
        ({"inlet": [3]}, "3 is not a pair"),
        ({"inlet": ["w1"]}, "'w1' is not a pair"),
        ({"inlet": [(0, 1, 2)]}, "is not a pair"),
        ({"inlet": [(0.5, 1)]}, "a patch is a whole number, not 0.5"),
        ({"inlet": [("0", 1)]}, "a patch is a whole number, not '0'"),
        ({"inlet": [(4, 1)]}, "there is no patch 4, the patches are 0 to 3"),
        ({"inlet": [(-1, 1)]}, "there is no patch -1"),
        ({"inlet": [(0, 0)]}, "side 0 of patch 0 is not one of 1, 2, 3, 4"),
        ({"inlet": [(0, "left")]}, "side 'left' of patch 0"),
        ({"inlet": [(0, None)]}, "side None of patch 0"),
        ({"inlet": [(0, 1), (0, "west")]}, "names a side twice"),
        ({" ": [(0, 1)]}, "a label is a name"),
        ({3: [(0, 1)]}, "a label is a name, not 3"),
        ([("inlet", [(0, 1)])], "labels are a mapping"),
    ],
)
def test_what_makes_no_sense_is_an_error_that_names_the_label(labels, message):
    with pytest.raises(InputError, match=message):
        MP.with_labels(labels)


def test_labels_follow_split_and_dropped_patches():
    # Patch 0 is halved along u, patch 1 is dropped, 2 and 3 become 2 and 3 of the new model.
    labels = {"a": ((0, Side.SOUTH), (1, Side.SOUTH)), "b": ((2, Side.NORTH),), "c": ((1, Side.EAST),)}
    parts = {(0, Side.SOUTH): [(0, Side.SOUTH), (1, Side.SOUTH)], (2, Side.NORTH): [(2, Side.NORTH)]}
    new, lost = relabelled(labels, parts)
    assert new == {"a": [(0, Side.SOUTH), (1, Side.SOUTH)], "b": [(2, Side.NORTH)], "c": []}
    assert lost == [
        "label 'a' lost patch 1 south: there is no such side any more",
        "label 'c' lost patch 1 east: there is no such side any more",
    ]


# --- where they show ------------------------------------------------------------------------------


def with_blocks(folder):
    """The source of the commands' transfer with labels, a constant and a function of x, as a file."""
    inputs_of_transfer(folder)
    file = folder / "source.xml"
    mp = pt.read(file)
    pt.write(mp.with_labels({"inlet & co": mp.boundaries[:2]}), file)
    text = file.read_text()
    more = (
        '<Function id="50" type="FunctionExpr" dim="2">x+1</Function><Function id="51" type="FunctionExpr">2</Function>'
    )
    file.write_text(text.replace("</xml>", f"{more}</xml>"))
    return file, mp


def test_a_transfer_keeps_labels_and_notes_functions_of_the_old_place(tmp_path):
    file, mp = with_blocks(tmp_path)
    result = run(*arguments(tmp_path, "--json", tmp_path / "r.json"))
    assert result.exit_code == 0, result.output
    report = json.loads((tmp_path / "r.json").read_text())
    assert report["labels"] == {"inlet & co": [{"patch": k, "side": int(s)} for k, s in mp.boundaries[:2]]}
    notes = [w for w in report["warnings"] if "Function" in w]
    assert len(notes) == 1
    assert notes[0].startswith("Function id=50: kept as written for the source")
    made = pt.read(tmp_path / "out.xml")
    assert made.sides == pt.read(file).sides
    assert made.blocks == pt.read(file).blocks


def test_check_prints_labels_and_reports_them(tmp_path):
    file, mp = with_blocks(tmp_path)
    shown = run("check", file)
    k, side = mp.boundaries[0]
    assert f"inlet & co: {k} {side.name.lower()}" in shown.stdout
    report = json.loads(run("check", file, "--json", "-").stdout)
    assert report["labels"]["inlet & co"][0] == {"patch": k, "side": int(side)}


def test_other_formats_say_what_they_leave_out(tmp_path):
    file, _ = with_blocks(tmp_path)
    mp = pt.read(file)
    with pytest.warns(InputWarning, match="VTU holds no Function id=50, Function id=51 of G.Smo XML; left out"):
        pt.write(mp, tmp_path / "o.vtu")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        pt.write(mp, tmp_path / "o.xml")


def test_labels_in_vtu_are_ones_on_their_sides(tmp_path):
    vtk_io = pytest.importorskip("vtkmodules.vtkIOXML")
    from vtkmodules.util.numpy_support import vtk_to_numpy

    # One patch left-handed, so that its points are in another order.
    mp = models.strip(2, 2, 3)
    left = mp.patches[0]
    turned = pt.Patch(left.knots[::-1], left.degrees[::-1], left.control_points.transpose(1, 0, 2))
    mp = pt.MultiPatch([turned, mp.patches[1]]).with_labels({"rim": [(0, Side.SOUTH), (1, Side.NORTH)], "x": [(1, 2)]})
    pt.write(mp, tmp_path / "o.vtu")
    reader = vtk_io.vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(tmp_path / "o.vtu"))
    reader.Update()
    grid = reader.GetOutput()
    points = vtk_to_numpy(grid.GetPoints().GetData())
    for name, sides in mp.sides.items():
        on = vtk_to_numpy(grid.GetPointData().GetArray(f"label {name}")).astype(bool)
        assert on.any()
        ends = [side.of(mp.patches[k].control_points)[[0, -1]] for k, side in sides]
        boxes = [(pair.min(axis=0) - 1e-12, pair.max(axis=0) + 1e-12) for pair in ends]
        # The grid's sides are straight and parallel to the axes.
        inside = [((points[:, :2] >= low) & (points[:, :2] <= high)).all(axis=1) for low, high in boxes]
        assert not (on & ~np.any(inside, axis=0)).any()
        assert on.sum() == sum(3 * 3 for _ in sides)


def test_a_field_cannot_take_the_name_of_a_label():
    mp = MP.with_labels({"rim": [(0, 1)]})
    with pytest.raises(InputError, match="cannot be called 'label rim'"):
        vtu.format_multipatch(mp, {"label rim": [np.zeros(p.shape) for p in mp.patches]})
