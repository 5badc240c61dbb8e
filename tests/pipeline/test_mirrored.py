"""Targets that are mirror images of the source."""

from __future__ import annotations

import pickle
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import domains
import models
import patchtransfer as pt
from patchtransfer import InfeasibleTargetError, InputError, NotCertifiedError, Side, TransferPlan
from patchtransfer.geometry.blocks import Block
from patchtransfer.pipeline import source_boundary
from patchtransfer.pipeline.mirrored import Reflection
from patchtransfer.registration.register import register
from patchtransfer.registration.register import target_outlines as _turned

# Last: modules of other names lie in tests/support.
sys.path.append(str(Path(__file__).parents[2] / "scripts"))
from glyphs import glyph

MIRROR = np.diag([-1.0, 1.0])
#: Cells of a flag: no symmetry, and no corner that a joint is not at.
FLAG = [(0, 0), (0, 1), (0, 2), (0, 3), (1, 3), (2, 3), (1, 2), (1, 0)]
#: Control points that are the same but for what optimisation and fit leave.
SAME = 1e-5


def cells(where: list[tuple[int, int]]) -> pt.MultiPatch:
    """Unit squares as patches."""
    patches = [models.bilinear((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)) for i, j in where]
    return models.build(patches, 3, 1, 1)


def flag() -> pt.MultiPatch:
    return cells(FLAG).with_labels({"foot": [(0, Side.SOUTH)], "top": [(3, Side.NORTH), (4, Side.NORTH)]})


def points(model: pt.MultiPatch) -> np.ndarray:
    return np.concatenate([patch.control_points.reshape(-1, 2) for patch in model])


def image(boundary: pt.Boundary, matrix: np.ndarray = MIRROR) -> pt.Boundary:
    return domains.mapped(boundary, matrix)


def test_the_mirror_image_of_the_source_gives_that_of_its_patches():
    source = flag()
    result = pt.transfer(source, image(source.boundary()), mirror="auto")
    assert result.mirrored
    assert result.certificate.injective
    assert abs(points(result.multipatch) - points(source) @ MIRROR).max() < SAME
    assert result.multipatch.interfaces == source.interfaces
    assert result.multipatch.sides == source.sides
    assert result.multipatch.ids == source.ids
    assert any("mirror image of the source" in line for line in result.warnings)
    assert result.to_dict()["mirrored"] is True
    assert pickle.loads(pickle.dumps(result)).registration.mirrored


@settings(max_examples=6, deadline=None)
@given(st.floats(-0.2, 0.2), st.floats(0.8, 1.3), st.floats(0, 6.2))
def test_a_mirrored_target_gives_the_mirrored_result(shear, stretch, turn):
    # By two ways: the target is mirrored, and so is the other result.
    source, c, s = flag(), np.cos(turn), np.sin(turn)
    affine = np.array([[c, -s], [s, c]]) @ np.array([[1, shear], [0, stretch]])
    target = image(source.boundary(), affine)
    plan = TransferPlan(source, "c0")
    plain = plan.transfer(target, mirror="auto")
    there = plan.transfer(image(target), mirror="auto")
    assert not plain.mirrored
    assert there.mirrored
    assert abs(points(plain.multipatch) @ MIRROR - points(there.multipatch)).max() < 1e-3


def test_pairs_have_the_source_s_own_points_and_can_be_handed_back():
    source, target = flag(), image(flag().boundary())
    result = pt.transfer(source, target, continuity="c0", mirror="auto")
    for rows in (result.registration.landmarks, result.registration.pairs(40)):
        assert np.allclose(rows[:, :2] @ MIRROR, rows[:, 2:], atol=1e-6)
    for own, other in result.registration.joints:
        assert np.allclose(own @ MIRROR, other, atol=1e-6)
    again = pt.transfer(source, target, result.registration.landmarks, "c0", mirror="auto")
    assert again.mirrored
    assert np.allclose(points(again.multipatch), points(result.multipatch), atol=SAME)


def test_the_runner_up_is_the_source_s_as_well():
    a, b = glyph("n", "STIXGeneral"), glyph("n", "DejaVuSans")
    own = register(_turned(a), b).loops[0].source
    found = replace(register(_turned(image(a)), image(b)), mirrored=True)
    assert found.runner_up is not None
    rows = found.runner_up.landmarks
    assert own.nearest(rows[:, :2])[1].max() < 1e-9 * own.diameter
    assert np.allclose(rows, found.loops[0].runner_up.landmarks * [-1, 1, 1, 1])


def test_landmarks_in_decreasing_order_decide_and_are_an_error_without_it():
    # A square: its shape says nothing.
    square = cells([(0, 0)])
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    rows = np.c_[corners, corners @ MIRROR]
    target = image(square.boundary())
    with pytest.raises(InputError, match=r"run backwards.*--mirror auto \(mirror='auto'\)"):
        pt.transfer(square, target, rows)
    result = pt.transfer(square, target, rows, mirror="auto")
    assert result.mirrored
    assert abs(points(result.multipatch) - points(square) @ MIRROR).max() < SAME
    straight = pt.transfer(square, target, np.c_[corners, corners - [1, 0]], mirror="auto")
    assert not straight.mirrored


def test_errors_of_landmarks_stay_with_it():
    square = cells([(0, 0)])
    corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    with pytest.raises(InputError, match="cross"):
        pt.transfer(square, square.boundary(), np.c_[corners, corners[[0, 2, 1, 3]]], mirror="auto")
    with pytest.raises(InputError, match="off the source boundary"):
        pt.transfer(square, square.boundary(), [[5, 5, 0, 0]], mirror="auto")
    with pytest.raises(InfeasibleTargetError, match="0 holes and the target 1"):
        pt.transfer(square, cells([(i, j) for i in range(3) for j in range(3) if i != 1 or j != 1]).boundary(),
                    mirror="auto")  # fmt: skip
    with pytest.raises(InputError, match="target must be a Boundary"):
        pt.transfer(square, square, mirror="auto")
    with pytest.raises(InputError, match="mirror must be one of never, auto"):
        pt.transfer(square, square.boundary(), mirror="always")


@pytest.mark.parametrize(
    "where", [[(0, 0)], [(0, 0), (1, 0)], [(0, 0), (1, 0), (2, 0), (1, 1)], [(0, 0), (1, 0), (0, 1)]]
)
def test_symmetric_shapes_are_not_mirrored(where):
    source = cells(where)
    for matrix in (np.eye(2), MIRROR, np.array([[0.0, 1.0], [1.0, 0.0]]), np.array([[1.3, 0.1], [0.0, 1.0]])):
        result = pt.transfer(source, image(source.boundary(), matrix), continuity="c0", mirror="auto")
        assert not result.mirrored
        assert not result.looks_mirrored


@pytest.mark.parametrize("character", "AGKRSZkny257")
def test_letters_of_two_styles_are_told_from_mirrored_ones(character):
    a, b = (glyph(character, font) for font in ("DejaVuSans", "DejaVuSans-Bold"))
    reflection = Reflection([loop.source for loop in register(_turned(a), a).loops])
    assert not reflection.fits(b, None, None)
    # A and its like are their own mirror images, and S and Z when turned by 180 degrees are not.
    assert reflection.fits(image(b), None, None) == (character not in "AK")


def test_a_family_of_both_hands_has_the_same_patches(tmp_path):
    source = flag()
    # The flag's right end is pointed: a corner without a joint.
    tip = pt.Boundary.from_points([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (2, 2), (2, 3), (3, 3), (3.3, 3.4), (3, 4),
                                   (0, 4)])  # fmt: skip
    # As in the mirror, but the corner is nearer to one end.
    other = pt.Boundary.from_points([(0, 0), (-2, 0), (-2, 1), (-1, 1), (-1, 2), (-2, 2), (-2, 3), (-3, 3), (-3, 4),
                                     (-2.7, 4.4), (-2.3, 4), (0, 4)][::-1])  # fmt: skip
    plan = TransferPlan(source, "c0")
    split = plan.split_for([tip, other], mirror="auto")
    here, there = split.map([tip, other], mirror="auto")
    assert (here.mirrored, there.mirrored) == (False, True)
    for result in (here, there):
        assert result.succeeded
        assert not result.registration.missed_corners
        assert len(result.multipatch) == len(split.source) > len(source)
        assert result.multipatch.interfaces == split.source.interfaces
    assert [o.to_dict() for o in here.split.origin] == [o.to_dict() for o in there.split.origin]
    alone = plan.transfer(image(tip), mirror="auto", split="auto")
    assert alone.mirrored
    assert len(alone.multipatch) > len(source)
    assert not alone.registration.missed_corners


def test_the_source_may_be_refined_and_have_a_reference():
    source = flag()
    bent = pt.MultiPatch([models.interpolated(models.after(_at(cell), models.wave), 3, 4) for cell in FLAG])
    plan = TransferPlan(source, "c0", reference=source.patches)
    result = plan.transfer(image(bent.boundary()), mirror="auto", refine="tolerance", fit_tolerance=1e-6)
    assert result.mirrored
    assert result.refined
    assert result.succeeded


def _at(cell):
    i, j = cell
    return models.bilinear((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1))


def test_without_the_option_the_refusal_names_it():
    source = flag()
    target = image(source.boundary(), MIRROR @ np.array([[0.6, -0.8], [0.8, 0.6]]))
    result = pt.transfer(source, target, continuity="c0", on_failure="return")
    assert not result.mirrored
    assert result.looks_mirrored
    assert any("--mirror auto (mirror='auto')" in line for line in result.warnings)
    fitting = pt.transfer(source, source.boundary(), continuity="c0")
    assert not fitting.looks_mirrored


def test_every_failure_looks_in_the_mirror():
    # Fits too well to be looked at for its score; nothing meets such a tolerance.
    a, b = glyph("J", "cmss10"), glyph("J", "DejaVuSans")
    source = pt.parameterize(a).multipatch
    with pytest.raises(NotCertifiedError, match=r"mirror image of the source: --mirror auto \(mirror='auto'\)"):
        pt.transfer(source, image(b), continuity="c0", fit_tolerance=1e-9, refine="never")
    with pytest.raises(NotCertifiedError) as caught:
        pt.transfer(source, b, continuity="c0", fit_tolerance=1e-9, refine="never")
    assert "mirror" not in str(caught.value)


def test_a_target_that_crosses_itself_is_not_looked_at():
    with pytest.raises(InfeasibleTargetError, match="crosses itself") as caught:
        pt.transfer(flag(), pt.Boundary.from_points([(0, 0), (3, 0), (0, 4), (3, 4)]))
    assert "mirror" not in str(caught.value)


def test_a_correspondence_that_is_infeasible_may_be_due_to_the_mirror(monkeypatch):
    source = flag()
    target = image(source.boundary())
    check, calls = source_boundary.check_target_corners, []

    def infeasible_at_first(*arguments):
        calls.append(arguments)
        if len(calls) == 1:
            raise InfeasibleTargetError("one patch would have to fill 270 degrees")
        check(*arguments)

    monkeypatch.setattr(source_boundary, "check_target_corners", infeasible_at_first)
    with pytest.raises(InfeasibleTargetError, match=r"270 degrees; .*--mirror auto \(mirror='auto'\)"):
        pt.transfer(source, target, continuity="c0")
    calls.clear()
    assert pt.transfer(source, target, continuity="c0", mirror="auto").mirrored
    assert len(calls) == 2
    # Where the mirror image is no better, the error stays.
    calls.clear()
    with pytest.raises(InfeasibleTargetError, match=r"270 degrees$"):
        pt.transfer(source, source.boundary(), continuity="c0", mirror="auto")


def test_functions_of_place_are_told_of_once():
    plain = flag()
    block = Block("G+Smo XML", "Function", '<Function id="50">x</Function>', of_place=True)
    source = pt.MultiPatch(plain.patches, plain.interfaces, blocks=[block])
    # Turned as well, so that the mirror image does not stay where it is.
    for matrix in (MIRROR, MIRROR @ domains.rotation(40)):
        result = pt.transfer(source, image(source.boundary(), matrix), continuity="c0", mirror="auto")
        assert result.mirrored
        assert [line for line in result.warnings if "mean other places" in line] == [
            "Function id=50: kept as written for the source; functions of x and y now mean other places on it"
        ]
