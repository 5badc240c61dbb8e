"""The frame, the two-hole plate and the star: what their sources are for, and where their transfers end."""

from __future__ import annotations

import numpy as np
import pytest

import patchtransfer as pt
from other_programs import gismo_finds_interfaces, gismo_model, gismo_sides
from patchtransfer import examples

# Patches, loops and the valences of the extraordinary vertices.
PLATES = {"frame": (14, 2, []), "two-hole-plate": (21, 3, [5] * 8), "star": (6, 1, [6])}


@pytest.fixture(scope="module", params=PLATES)
def plate(request):
    return request.param, *examples.load(request.param)


def test_source(plate, tmp_path):
    name, source, _, _ = plate
    patches, loops, valences = PLATES[name]
    assert (len(source.patches), len(source.loops)) == (patches, loops)
    assert [v.valence for v in source.vertices if v.extraordinary] == valences
    assert {p.degrees for p in source.patches} == {(3, 3)}
    assert pt.certify(source).status == "certified"
    assert pt.quality(source).scaled_jacobian.mean >= 0.93
    pt.write(source, tmp_path / "again.xml")
    assert pt.read(tmp_path / "again.xml") == source


def test_transfer(plate):
    _, source, target, landmarks = plate
    result = pt.transfer(source, target, landmarks)
    assert result.certificate.status == "certified"
    assert result.boundary_error <= 2e-4
    assert result.quality.scaled_jacobian.mean >= 0.93
    low = result.continuity.c1_share < 0.5
    assert [warning.startswith("C1 across patches") for warning in result.warnings] == [True] * low


def test_target_is_cut_elsewhere(plate):
    _, source, target, landmarks = plate
    joints = np.array([xy for _, xy in pt.transfer(source, target, landmarks).registration.joints])
    ends = np.array([curve.start for loop in target.loops for curve in loop])
    assert len(ends) != len(joints)
    # Not only corners: ends of the drawing's curves that are no joints of patches.
    apart = np.linalg.norm(ends[:, None] - joints[None], axis=2).min(axis=1) / target.diameter
    assert (apart > 1e-2).sum() >= len(ends) / 2


def test_gismo_finds_the_same_interfaces(plate, tmp_path):
    _, source, _, _ = plate
    pt.write(source, tmp_path / "source.xml")
    theirs = gismo_model(tmp_path / "source.xml")
    found = gismo_sides(gismo_finds_interfaces(theirs))
    assert len(found) == len(source.interfaces)
    assert found == gismo_sides(theirs)
