"""Parameterizations from nothing but an outline."""

from __future__ import annotations

import json

import numpy as np
import pytest

import domains
import patchtransfer as pt
import targets
from patchtransfer import Boundary, InfeasibleTargetError, InputError, NotCertifiedError, examples
from patchtransfer._core import set_threads
from patchtransfer.geometry.areas import polygon_area
from patchtransfer.geometry.outline import Outline
from patchtransfer.sources.auto_layout import Parameterization, parameterize
from shapes import SQUARE, loop, polygon

#: Outlines with the patches that they need, and the least scaled Jacobian of the measured ones less a little.
KNOWN = {
    "square": (loop(SQUARE), {1}, 0.9999),
    "L": (domains.L, {3}, 0.9999),
    "C": (domains.ring_segment(5.5), {3}, 0.99),
    "ring": (domains.ring(), {4}, 0.999),
    "disk": (domains.disk(), {5}, 0.75),
    "oval": (domains.disk(radii=(2.0, 1.0)), {5}, 0.7),
    "star": (examples.load("star")[0].boundary(), set(range(5, 14)), 0.7),
    "pentagon": (domains.pentagon(), {5}, 0.94),
    "plate": (domains.plate(), {8, 12}, 0.69),
    "T": (domains.T, {4}, 0.9999),
}
#: Without symmetries: sharp corners; a smooth loop; corners and a hole.
GENERIC = {
    "skew L": domains.SKEW_L,
    "waves": domains.wavy(3, 0.15, (1.4, 1.0), 0.7),
    "plate": Boundary([*domains.SKEW_L.loops, *domains.disk((0.5, 0.6), (0.25, 0.2)).loops]),
}
CHANGES = {
    "rotated": lambda b: domains.mapped(b, domains.rotation(37)),
    "small": lambda b: domains.mapped(b, 1e-3 * np.eye(2)),
    "large": lambda b: domains.mapped(b, 1e3 * np.eye(2), (2e3, -5e2)),
    "mirrored": lambda b: domains.mapped(b, [[-1, 0], [0, 1]]),
    "reversed": domains.reversed_loops,
    "started elsewhere": domains.started_elsewhere,
    "loops reordered": lambda b: Boundary(b.loops[::-1]),
}


@pytest.fixture(scope="module")
def results():
    """Of the outlines by name, each computed once."""
    boundaries = {name: boundary for name, (boundary, _, _) in KNOWN.items()} | GENERIC
    boundaries["plate with a round hole"] = KNOWN["plate"][0]
    found = {}

    def of(name):
        if name not in found:
            found[name] = parameterize(boundaries[name])
        return found[name]

    return of


def valences(result):
    return sorted(np.bincount(result.layout.quads.ravel()).tolist())


def area(loops):
    """Enclosed by the largest loop without the others."""
    areas = sorted(abs(polygon_area(Outline(curves).polygon(4000))) for curves in loops)
    return areas[-1] - sum(areas[:-1])


def patch_corners(multipatch):
    nets = [patch.control_points for patch in multipatch.patches]
    return np.concatenate([net[[0, 0, -1, -1], [0, -1, 0, -1]] for net in nets])


def is_complete(result, boundary):
    """Certified, on the outline, of its area, with its corners at corners of patches."""
    assert isinstance(result, Parameterization)
    assert result.certificate.status == "certified"
    assert result.boundary_error <= 1e-3
    assert area(result.multipatch.boundary().loops) == pytest.approx(area(boundary.loops), rel=1e-3)
    corners = patch_corners(result.multipatch)
    for curves in boundary.loops:
        outline = Outline(curves)
        for point in outline.point(outline.corners[0]):
            assert np.hypot(*(corners - point).T).min() < 1e-9 * boundary.diameter
    assert len(result.layout.quads) == len(result.multipatch.patches)


@pytest.mark.parametrize("name", KNOWN)
def test_known_layouts(name, results):
    boundary, patches, least = KNOWN[name]
    result = results("plate with a round hole" if name == "plate" else name)
    is_complete(result, boundary)
    assert len(result.multipatch.patches) in patches
    assert result.quality.scaled_jacobian.min > least


@pytest.mark.parametrize("name", GENERIC)
@pytest.mark.parametrize("change", CHANGES)
def test_the_same_layout_of_the_same_shape(name, change, results):
    boundary = CHANGES[change](GENERIC[name])
    result, before = parameterize(boundary), results(name)
    is_complete(result, boundary)
    assert len(result.multipatch.patches) == len(before.multipatch.patches)
    assert valences(result) == valences(before)


@pytest.mark.parametrize(
    ("boundary", "message"),
    [
        (domains.BOW_TIE, r"loop 0 crosses itself at \(0.5, 0.5\)"),
        (Boundary([polygon(2 * SQUARE), *domains.disk((0.3, 1.0), (0.5, 0.5)).loops]), "loops 0 and 1 cross at"),
        (loop([(0, 0), (2, 0), (2, 2), (1, 0), (0, 2)]), r"loop 0 touches or nearly touches itself at \(1, 0\)"),
        (Boundary([polygon(2 * SQUARE), *domains.disk((0.5, 1.0), (0.5, 0.5)).loops]), "loops 0 and 1 touch"),
        (Boundary([polygon(2 * SQUARE), *domains.disk((5.0, 1.0), (0.5, 0.5)).loops]), "loop 1 lies outside"),
    ],
    ids=["crossing", "crossing hole", "touching", "touching hole", "hole outside"],
)
def test_outlines_that_bound_nothing(boundary, message):
    with pytest.raises(InfeasibleTargetError, match=message):
        parameterize(boundary)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"prefer": "many"}, "prefer must be one of few, quality, got 'many'"),
        ({"symmetric": True}, "symmetric must be one of auto, never, got True"),
        ({"continuity": "c2"}, "continuity must be one of c0, c1, g1, got 'c2'"),
        ({"continuity": "g1", "degree": 2}, 'continuity="g1" needs degree 3'),
        ({"continuity": "g1", "spans": 1}, 'continuity="g1" needs degree 3 or more and two spans'),
        ({"on_failure": "ignore"}, "on_failure must be one of raise, return, got 'ignore'"),
        ({"degree": 0}, "degree must be an integer of at least 1, got 0"),
        ({"degree": 2.5}, "degree must be an integer of at least 1, got 2.5"),
        ({"degree": 99}, "99 as degree, at most 10"),
        ({"spans": 0}, "spans must be an integer of at least 1, got 0"),
        ({"spans": 10**6}, "control points of a patch, at most 50000 are supported; take fewer spans"),
        ({"max_patches": 0}, "max_patches must be an integer of at least 1, got 0"),
        ({"max_patches": 2.5}, "max_patches must be an integer of at least 1, got 2.5"),
        ({"time_limit": 0}, "time_limit must be a positive number of seconds"),
        ({"time_limit": float("nan")}, "time_limit must be a positive number of seconds"),
        ({"fit_tolerance": 0}, "fit_tolerance must lie between 0 and 1, got 0"),
        ({"fit_tolerance": float("nan")}, "fit_tolerance must lie between 0 and 1, got nan"),
        ({"corner_patches": {(0, 6): 1}}, "loop 0 has 6 corners, counted from 0; there is no corner 6"),
        ({"corner_patches": {(1, 0): 1}}, "there is no loop 1"),
        ({"corner_patches": {3: 1}}, r"keys are pairs \(loop, corner\), got 3"),
    ],
)
def test_options_that_cannot_be(options, message):
    with pytest.raises(InputError, match=message):
        parameterize(domains.L, **options)


def test_only_boundaries_are_parameterized():
    with pytest.raises(InputError, match=r"boundary must be a Boundary .* got tuple"):
        parameterize(domains.L.loops)


@pytest.mark.parametrize(("corner", "patches"), [(0, 2), (3, 2), (3, 4)])
def test_patches_at_a_corner(corner, patches):
    """Merged singularities would bring back the number that the angle asks for."""
    result = parameterize(domains.SKEW_L, corner_patches={(0, corner): patches})
    is_complete(result, domains.SKEW_L)
    place = domains.SKEW_L.loops[0][corner].start
    near = np.hypot(*(patch_corners(result.multipatch) - place).T) < 1e-9
    assert near.sum() == patches


def test_a_right_angle_is_halved_at_most_to_sin_45_degrees():
    result = parameterize(domains.L, corner_patches={(0, 0): 2})
    assert result.quality.scaled_jacobian.min < np.sqrt(0.5) + 1e-9


def test_fewer_patches():
    """The plate's four sides, a patch each: worse, but as few as asked for."""
    result = parameterize(domains.plate(), max_patches=4)
    is_complete(result, domains.plate())
    assert len(result.multipatch.patches) == 4
    assert all(len(c.layout.quads) <= 4 for c in result.candidates if c.reason is None)


def test_too_few_patches():
    """Not even the last resort has fewer."""
    with pytest.raises(NotCertifiedError, match="2 patches where max_patches is 1; allow more"):
        parameterize(domains.L, max_patches=1)


def test_degree_and_spans():
    result = parameterize(domains.SKEW_L, degree=2, spans=4)
    assert {(patch.degrees, patch.control_points.shape) for patch in result.multipatch.patches} == {((2, 2), (6, 6, 2))}


def test_no_time_for_a_second_layout():
    result = parameterize(domains.plate(), time_limit=1e-9)
    assert result.certificate.status == "certified"
    assert len(result.candidates) == 1


def test_progress_is_told():
    told = []
    parameterize(domains.L, progress=lambda stage, number: told.append((stage, number)))
    assert told == [("cross field", 0), ("layouts", 1), ("sliding", 0), ("finish", 0)]


@pytest.mark.parametrize("name", ["skew L", "disk", "plate"])
def test_the_layout_is_one_for_from_layout(name, results):
    result = results(name)
    layout, boundary = result.layout, (GENERIC | {"disk": KNOWN["disk"][0]})[name]
    again = pt.from_layout(layout.vertices, layout.quads, boundary, assignment=layout.assignment)
    assert again.certificate.status == "certified"
    assert len(again.multipatch.patches) == len(result.multipatch.patches)
    assert again.boundary_error < 1e-3


def test_report(results):
    content = results("plate").to_dict()
    assert json.loads(json.dumps(content)) == content
    assert {"certificate", "quality", "boundary_error", "corner_bound", "patches", "candidates"} <= content.keys()
    assert content["patches"] == len(results("plate").multipatch.patches)
    best, *others = content["candidates"]
    assert best["patches"] == content["patches"]
    assert best["status"] == "certified"
    assert len(others) > 0
    scores = [c["score"] for c in content["candidates"] if c["score"] is not None]
    assert scores == sorted(scores, reverse=True)


def asymmetry(multipatch, image):
    """Largest distance of a control point from the nearest one's image."""
    points = np.concatenate([patch.control_points.reshape(-1, 2) for patch in multipatch.patches])
    return np.linalg.norm(points[:, None] - image(points)[None], axis=2).min(axis=1).max()


@pytest.mark.parametrize(
    ("name", "image"),
    [
        ("T", lambda x: x * [-1, 1]),
        ("plate with a round hole", lambda x: x * [-1, 1]),
        ("plate with a round hole", lambda x: x @ [[0, 1], [-1, 0]]),
        ("pentagon", lambda x: x @ domains.rotation(72).T),
    ],
    ids=["T mirrored", "plate mirrored", "plate turned", "pentagon turned"],
)
def test_symmetric_outlines_get_symmetric_patches(name, image, results):
    assert asymmetry(results(name).multipatch, image) < 1e-9 * 2.8
    assert any(line.startswith("symmetric under") for line in results(name).log)


@pytest.mark.parametrize("angle", [0, 37])
def test_a_smooth_loop_keeps_all_symmetries(angle):
    """Joints slide where nothing but the loop's symmetry tells them to be."""
    result = parameterize(domains.mapped(domains.disk(radii=(1.6, 1.0)), domains.rotation(angle)))
    assert "symmetric under 3 of 3 symmetries of the outline" in result.log
    assert len(result.multipatch) == 5
    assert result.quality.scaled_jacobian.min > 0.8


def test_a_symmetric_blob():
    boundary = domains.mirrored_blob()
    result = parameterize(boundary)
    is_complete(result, boundary)
    assert asymmetry(result.multipatch, lambda x: x * [-1, 1]) < 1e-9 * boundary.diameter


def test_symmetry_is_not_forced(results):
    result = parameterize(domains.plate(), symmetric="never")
    is_complete(result, domains.plate())
    assert not any("symmetric" in line for line in result.log)
    assert valences(result) == valences(results("plate with a round hole"))


@pytest.mark.parametrize("continuity", ["c1", "g1"])
def test_smooth_across_patches(continuity):
    boundary = GENERIC["waves"]
    result = parameterize(boundary, continuity=continuity)
    is_complete(result, boundary)
    assert result.rows is not None
    report = result.continuity
    assert (report.c1_residual if continuity == "c1" else report.as_g1_residual) < 1e-9


def test_a_source_of_transfers(results):
    source = results("L").multipatch
    target, landmarks = targets.deformed(source, targets.bend(source, 30))
    moved = pt.transfer(source, target, landmarks, continuity="c1")
    assert moved.certificate.status == "certified"
    assert len(moved.multipatch.patches) == 3


def test_the_same_bits_with_any_number_of_threads():
    found = []
    try:
        for threads in (1, 2):
            set_threads(threads)
            result = parameterize(GENERIC["plate"])
            found.append(b"".join(patch.control_points.tobytes() for patch in result.multipatch.patches))
    finally:
        set_threads(0)
    assert found[0] == found[1]


@pytest.mark.parametrize("backwards", [False, True], ids=["as drawn", "backwards, holes first"])
def test_sides_that_miss_waves_get_edges_whatever_the_loops_order_and_sense(backwards):
    """Three spans cannot follow the frame's waves: the sides that miss them are divided, and no others."""
    loops = pt.examples.load("frame")[0].boundary().loops
    if backwards:
        loops = [[curve.reversed() for curve in reversed(curves)] for curves in reversed(loops)]
    result = parameterize(pt.Boundary(loops))
    is_complete(result, pt.Boundary(loops))
    assert len(result.multipatch.patches) <= 16
    assert result.candidates[0].origin.endswith("edges added")


def test_a_stroke_without_corners_in_its_bend_gets_patches_enough():
    """A U is two corners at either end: one long patch by its topology."""
    t = np.linspace(0, np.pi, 41)
    bend = np.column_stack([np.cos(t), -np.sin(t)])
    outer = np.vstack([[[-1, 2.2]], [[-1, 1.1]], bend[::-1], [[1, 1.1]], [[1, 2.2]]])
    inner = np.vstack([[[0.65, 2.2]], [[0.65, 1.1]], 0.65 * bend, [[-0.65, 1.1]], [[-0.65, 2.2]]])
    sides = [domains.through(outer), domains.through(inner)]
    ends = [pt.BSplineCurve([0, 0, 1, 1], 1, [a.end, b.start]) for a, b in (sides, sides[::-1])]
    result = parameterize(Boundary([[sides[0], ends[0], sides[1], ends[1]]]))
    assert 3 <= len(result.multipatch) <= 5
    assert result.quality.scaled_jacobian.mean > 0.98
