"""Rhino's 3dm: curves of layers, exact; checked with models that rhino3dm writes."""

from __future__ import annotations

import math

import numpy as np
import pytest

import patchtransfer as pt
from patchtransfer import InputError
from patchtransfer.geometry.outline import Outline

rhino = pytest.importorskip("rhino3dm")


def point(x, y, z=0.0):
    return rhino.Point3d(x, y, z)


class Model:
    """A model with layers that are made as they are named."""

    def __init__(self):
        self.file = rhino.File3dm()
        self.layers = {}

    def on(self, name, visible=True):
        attributes = rhino.ObjectAttributes()
        if name not in self.layers:
            layer = rhino.Layer()
            layer.Name, layer.Visible = name, visible
            self.layers[name] = self.file.Layers.Add(layer)
        attributes.LayerIndex = self.layers[name]
        return attributes

    def read(self, folder, **options):
        path = folder / "model.3dm"
        self.file.Write(str(path), 7)
        return pt.read_boundary(path, **options)


def stadium():
    """Two lines and an arc, and a poly-line with the rest; a circle as hole; text."""
    model = Model()
    plate, holes = model.on("Plate"), model.on("Holes")
    model.file.Objects.AddLine(point(0, 0), point(4, 0), plate)
    model.file.Objects.AddArc(rhino.Arc(point(4, 0), point(5, 1), point(4, 2)), plate)
    model.file.Objects.AddPolyline([point(0, 0), point(-1, 1), point(0, 2), point(4, 2)], plate)
    model.file.Objects.AddCircle(rhino.Circle(point(2, 1), 0.5), holes)
    model.file.Objects.AddTextDot("plate", point(0, 0), plate)
    return model


def test_lines_arcs_and_polylines_are_chained(tmp_path):
    boundary = stadium().read(tmp_path)
    outer, hole = boundary.loops
    assert len(outer) == 3
    assert math.isclose(Outline(outer).length, 8 + math.pi + 2 * math.sqrt(2), rel_tol=1e-6)
    away = np.linalg.norm(Outline(hole).polygon(100) - [2, 1], axis=1) - 0.5
    assert np.abs(away).max() < 1e-12
    assert boundary.notes == ("left out, for they draw no outline: 1 TextDot on layer 'Plate'",)


def test_polycurves_and_nurbs_with_weights_are_exact(tmp_path):
    model = Model()
    curve = rhino.PolyCurve()
    curve.Append(rhino.Line(point(-1, 0), point(1, 0)))
    curve.Append(rhino.Arc(point(1, 0), point(0, 1), point(-1, 0)))
    model.file.Objects.AddCurve(curve, model.on("A"))
    (loop,) = model.read(tmp_path).loops
    assert len(loop) == 1
    t = np.linspace(*loop[0].domain, 400)
    points = loop[0](t)
    on_arc = points[points[:, 1] > 1e-9]
    assert np.abs(np.linalg.norm(on_arc, axis=1) - 1).max() < 1e-14
    assert len(Outline(loop).corners[0]) == 2


def test_layers_are_chosen_and_hidden_ones_left_out(tmp_path):
    model = stadium()
    model.file.Objects.AddLine(point(9, 9), point(8, 8), model.on("Frame", visible=False))
    boundary = model.read(tmp_path)
    assert len(boundary.loops) == 2
    assert "hidden: 1 on layer 'Frame'" in boundary.notes[1]
    (hole,) = model.read(tmp_path, layers=["holes"]).loops
    assert len(hole) == 1
    with pytest.raises(InputError, match="no layer 'x'; its layers are Frame, Holes, Plate"):
        model.read(tmp_path, layers=["x"])


def test_messages_name_curve_and_layer(tmp_path):
    model = stadium()
    attributes = model.on("Plate")
    attributes.Name = "slanted"
    model.file.Objects.AddLine(point(9, 9), point(8, 8, 1), attributes)
    with pytest.raises(InputError, match="curve slanted on layer 'Plate' is 1 away from the plane z = 0"):
        model.read(tmp_path)
    empty = Model()
    empty.file.Objects.AddTextDot("a", point(0, 0), empty.on("A"))
    with pytest.raises(InputError, match=r"holds no curves; .* 1 TextDot on layer 'A'"):
        empty.read(tmp_path)
    (tmp_path / "bad.3dm").write_bytes(b"3D Geometry File Format       80" + b"x" * 100)
    with pytest.raises(InputError, match="damaged 3dm file"):
        pt.read_boundary(tmp_path / "bad.3dm")


def test_a_file_that_is_never_read_to_its_end_is_given_up(tmp_path, monkeypatch):
    monkeypatch.setattr("patchtransfer.io.rhino.SECONDS", 0.001)
    with pytest.raises(InputError, match="not read after"):
        stadium().read(tmp_path)
