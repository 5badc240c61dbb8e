"""Transfers end to end: evidence, refusals, plans, both methods, real models."""

import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import models
import patchtransfer as pt
import targets
from failing import (
    SHEET,
    SLOT,
    disconnected_source,
    eight,
    folded_source,
    moved_hole,
    notched,
    plate,
    reentrant,
)
from patchtransfer import (
    Boundary,
    BSplineCurve,
    InfeasibleTargetError,
    InputError,
    NotCertifiedError,
    examples,
)
from patchtransfer.geometry.outline import Outline, hausdorff
from patchtransfer.interior import solver
from shapes import SQUARE, circle, polygon, turned
from strategies import knot_vectors

MODELS = os.environ.get("PATCHTRANSFER_MODELS")
needs_models = pytest.mark.skipif(not MODELS, reason="PATCHTRANSFER_MODELS is not set")


def same_structure(result: pt.MultiPatch, source: pt.MultiPatch) -> None:
    """Patches, degrees, knots, ids, interfaces and handedness as before; interface points bit-equal."""
    assert result.interfaces == source.interfaces
    assert result.ids == source.ids
    for a, b in zip(result.patches, source.patches, strict=True):
        assert a.degrees == b.degrees
        assert a.shape == b.shape
        assert a.weights is None
        assert all(np.array_equal(x, y) for x, y in zip(a.knots, b.knots, strict=True))
    assert np.array_equal(result.topology.orientation, source.topology.orientation)
    for f in result.interfaces:
        x = f.side_a.of(result.patches[f.patch_a].control_points)
        y = f.side_b.of(result.patches[f.patch_b].control_points)
        assert np.array_equal(x, y[::-1] if f.reversed else y)


def boundary_distance(result: pt.MultiPatch, target: Boundary) -> float:
    """Hausdorff distance by brute force, relative to the target's diameter: nearest loops are partners."""
    fitted = [Outline(loop) for loop in result.boundary().loops]
    wanted = [Outline(loop) for loop in target.loops]
    return max(min(hausdorff(a, b) for b in wanted) for a in fitted) / target.diameter


def deformations(mp: pt.MultiPatch) -> dict:
    return {
        "bend": targets.bend(mp, 40),
        "bump": targets.bump(mp, (0.9, 0.7), (0.1, 0.05), 0.3),
        "articulation": targets.articulation(mp, 20, at=0.5, blend=0.9),
    }


@pytest.mark.parametrize("deformation", ["bend", "bump", "articulation"])
@pytest.mark.parametrize("name", models.ALL)
def test_end_to_end(name, deformation):
    mp = models.ALL[name]()
    f = deformations(mp)[deformation]
    target, landmarks = targets.deformed(mp, f, seed=len(name), degree=3 if deformation == "bend" else 5)
    result = pt.transfer(mp, target, landmarks)
    assert result.certificate.injective
    assert result.certificate.status == "certified"
    assert result.certificate.lower_bound > 0
    assert pt.certify(result.multipatch) == result.certificate
    same_structure(result.multipatch, mp)
    assert result.boundary_error < 1.5e-3
    assert boundary_distance(result.multipatch, target) == pytest.approx(result.boundary_error, rel=0.02, abs=1e-9)
    for a, b in result.registration.joints:
        np.testing.assert_allclose(b, f(a[None])[0], atol=1e-6 * target.diameter)
    before, after = pt.quality(mp).scaled_jacobian, result.quality.scaled_jacobian
    assert result.quality == pt.quality(result.multipatch)
    assert after.mean >= before.mean - 0.04
    assert 0 < after.min <= result.corner_bound + 1e-9
    assert result.continuity.c0_gap == 0
    assert result.continuity == pt.check_continuity(result.multipatch)


@st.composite
def sheets(draw):
    """One to three patches side by side; degrees, knots and multiplicities differ between patches and directions."""
    q = draw(st.integers(1, 4))
    across = draw(knot_vectors(q, 2))
    patches, x = [], 0.0
    for _ in range(draw(st.integers(1, 3))):
        p = draw(st.integers(1, 4))
        along = draw(knot_vectors(p, 2))
        u, v = models.greville(along, p), models.greville(across, q)
        u, v = (u - u[0]) / (u[-1] - u[0]), (v - v[0]) / (v[-1] - v[0])
        points = np.stack(np.meshgrid(x + u, v, indexing="ij"), axis=-1)
        patches.append(turned(pt.Patch((along, across), (p, q), points), *(draw(st.booleans()) for _ in "tuv")))
        x += 1.0
    return models.welded(pt.MultiPatch(patches))


@settings(max_examples=15, deadline=None)
@given(sheets(), st.floats(-15, 15))
def test_any_degrees_and_knots(mp, degrees):
    assume(abs(degrees) > 0.1)
    target, landmarks = targets.deformed(mp, targets.bend(mp, degrees))
    result = pt.transfer(mp, target, landmarks, refine="never", on_failure="return")
    assert result.certificate.status == "certified"
    same_structure(result.multipatch, mp)
    # A straight side misses an arc of 15 degrees by its sagitta, 0.033 of the arc's length.
    assert result.boundary_error < 0.033
    assert boundary_distance(result.multipatch, target) == pytest.approx(result.boundary_error, rel=0.05, abs=1e-9)


def test_similar_targets_give_the_similar_source():
    mp = models.o_grid()
    f = targets.similarity(30, 4.0, (2, -9))
    (loop,) = mp.boundary().loops
    moved = Boundary([[BSplineCurve(c.knots, c.degree, f(c.control_points)) for c in loop]])
    rows = np.array([[*c.start, *f(c.start[None])[0]] for c in loop])
    result = pt.transfer(mp, moved, rows, "c0")
    image = f(mp.topology.coordinates)
    # The source's joints are smooth up to the interpolation error of the model only.
    np.testing.assert_allclose(result.multipatch.topology.coordinates, image, atol=1e-2 * moved.diameter)
    assert result.quality.scaled_jacobian.min == pytest.approx(pt.quality(mp).scaled_jacobian.min, abs=0.02)


def test_rational_and_point_targets():
    mp = models.o_grid(3, 3)
    ring = Boundary([[circle(2.0)]])
    (loop,) = mp.boundary().loops
    start = np.array([c.start for c in loop])
    at = start - start.mean(axis=0)
    result = pt.transfer(mp, ring, np.hstack([start, 2 * at / np.linalg.norm(at, axis=1)[:, None]]))
    assert result.certificate.injective
    points = np.concatenate([c(np.linspace(*c.domain, 99)) for c in result.multipatch.boundary().loops[0]])
    assert np.abs(np.linalg.norm(points, axis=1) - 2).max() < 1e-3 * ring.diameter


def test_the_paper_method_runs_end_to_end():
    mp = models.plate_with_hole(2, 3)
    target, landmarks = targets.deformed(mp, targets.bend(mp, 30))
    result = pt.transfer(mp, target, landmarks, method="paper")
    assert result.method == "paper"
    assert result.certificate.injective
    same_structure(result.multipatch, mp)
    assert any("bounded distortion" in entry for entry in result.log)
    to_the_letter = pt.PaperOptions(
        freeze_interfaces=True, literal_rows=True, snap_corners=False, boundary_samples="uniform", boundary_weight=1.0
    )
    literal = pt.transfer(mp, target, landmarks, method="paper", paper_options=to_the_letter)
    ours = pt.transfer(mp, target, landmarks)
    assert ours.quality.scaled_jacobian.mean > literal.quality.scaled_jacobian.mean
    # The paper's fit: uniform parameters, no kept tangents.
    assert not any(side.smooth for loop in result.fitted.loops for side in loop)


def test_progress_is_reported():
    mp = models.grid(2, 2, 2, 2)
    target, landmarks = targets.deformed(mp, targets.bend(mp, 30))
    seen = []
    result = pt.transfer(mp, target, landmarks, progress=lambda *a: seen.append(a))
    newton = [s for s in seen if s[1]]
    assert len(newton) >= 2
    stage, step, energy, determinant = newton[0]
    assert isinstance(stage, str)
    assert step == 1
    assert energy > 2
    assert determinant > 0
    for name in {s[0] for s in newton}:
        steps = [s[1] for s in newton if s[0] == name]
        assert steps == list(range(1, len(steps) + 1))
    assert any("under continuity rows" in s[0] for s in newton)
    # A stage is told when it begins, before any number is known; a callable that formats numbers need not look.
    begun = [s for s in seen if not s[1]]
    assert [f"{energy:.4g} {determinant:.3g}" for _, _, energy, determinant in begun] == ["nan nan"] * len(begun)
    assert [s[0] for s in begun[:2]] == ["feasibility", "registration"]
    assert {s[0] for s in begun} == set(result.timings)
    assert set(result.timings) >= {"registration", "feasibility", "fitting", "optimisation", "certificate", "quality"}
    assert all(t >= 0 for t in result.timings.values())

    def interrupt(*_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        pt.transfer(mp, target, landmarks, progress=interrupt)


class Listener:
    """A progress that is also told of every stage's end."""

    def __init__(self):
        self.begun, self.ends = [], []

    def __call__(self, stage, step, energy, determinant):
        if not step:
            self.begun.append(stage)

    def ended(self, stage, seconds, found):
        self.ends.append((stage, seconds, found))


@pytest.mark.parametrize(
    "options", [{}, {"continuity": "c0"}, {"method": "paper"}, {"refine": "tolerance", "fit_tolerance": 1e-6}]
)
def test_every_stage_is_told_when_it_begins_and_ends(options):
    mp = models.plate_with_hole(2, 3)
    target, landmarks = targets.deformed(mp, targets.bend(mp, 30))
    listener = Listener()
    # Half of the joints are free to slide.
    result = pt.transfer(mp, target, landmarks[::2], progress=listener, on_failure="return", **options)
    assert sorted(listener.begun) == sorted(stage for stage, *_ in listener.ends)
    # What is logged adds up to what the report says.
    for stage, seconds in result.timings.items():
        assert seconds == pytest.approx(sum(s for name, s, _ in listener.ends if name == stage), abs=1e-12)
    found = {stage: text for stage, _, text in listener.ends}
    assert re.fullmatch(r"\d+ joints, confidence [01]\.\d\d", found["registration"])
    assert f"{result.fitted.error:.1e}" in found["fitting"]
    assert found["certificate"] == "certified"
    assert f"min {result.quality.scaled_jacobian.min:.3f}" in found["quality"]
    assert ("sliding" in found) == (options.get("method") != "paper")
    assert ("refinement" in found) == ("refine" in options)
    if "optimisation" in found:
        assert re.match(r"\d+ Newton steps, energy \d", found["optimisation"])


def test_a_stage_that_fails_is_not_told_to_have_ended():
    listener = Listener()
    with pytest.raises(InfeasibleTargetError):
        pt.transfer(plate(), moved_hole([0.8, 0]), progress=listener)
    assert listener.begun == ["feasibility"]
    assert listener.ends == []


# --- refusals -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (folded_source, "not an injective.*patch 1 folds"),
        (disconnected_source, "2 separate parts.*one by one"),
    ],
)
def test_unusable_sources_are_refused(source, message):
    mp = source()
    with pytest.raises(InputError, match=message):
        pt.TransferPlan(mp)
    with pytest.raises(InputError, match=message):
        pt.transfer(mp, models.grid(1, 1).boundary())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"continuity": "c2"}, "c0, c1, g1, got 'c2'"),
        ({"method": "magic"}, "method must be one of certified, paper, got 'magic'"),
        ({"refine": "always"}, "refine must be one of auto, never, tolerance"),
        ({"on_failure": "ignore"}, "on_failure must be one of raise, return"),
        ({"fit_tolerance": 0}, "fit_tolerance must lie between 0 and 1, got 0"),
        ({"fit_tolerance": float("nan")}, "fit_tolerance"),
        ({"landmarks": [[9, 9, 0, 0]]}, "landmark row 1.*off the source"),
    ],
)
def test_bad_options_are_refused(options, message):
    mp = models.grid(1, 1)
    with pytest.raises(InputError, match=message):
        pt.transfer(mp, mp.boundary(), **options)


@pytest.mark.parametrize(
    ("source", "target", "landmarks", "message"),
    [
        (lambda: models.grid(1, 1), eight, None, r"target boundary: .*loop 0 crosses itself at \(0\.5\d+, 0\.5\d+\)"),
        (plate, lambda: moved_hole([0.8, 0]), None, r"target boundary: boundary loops 0 and 1 cross at \(.*\): curve"),
        (plate, lambda: moved_hole([5, 0]), None, r"target boundary: loop \d lies outside the outer loop \d"),
        (plate, lambda: models.grid().boundary(), None, "source has 1 holes and the target 0"),
        (
            lambda: models.build([models.bilinear(*SQUARE)], 2, 2, None),
            reentrant,
            np.hstack([SQUARE, [[0, 0], [2, 0.5], [0.5, 0.5], [0.5, 2]]]),
            r"^target boundary: at \(0\.5, 0\.5\).*one patch would have to fill an interior angle of 270°",
        ),
    ],
)  # fmt: skip
def test_infeasible_targets_are_refused_by_place(source, target, landmarks, message):
    for method in ("certified", "paper"):
        with pytest.raises(InfeasibleTargetError, match=message):
            pt.transfer(source(), target(), landmarks, method=method)


def test_a_reentrant_corner_of_several_patches_is_feasible():
    mp = models.l_shape()
    target, landmarks = targets.deformed(mp, targets.similarity(5, 1))
    assert pt.transfer(mp, target, landmarks).certificate.injective


def test_a_fit_too_coarse_is_not_called_infeasible():
    with pytest.raises(pt.NotCertifiedError, match=r"target is feasible, but the source's knots cannot.*refine='auto'"):
        pt.transfer(*notched(*SLOT, spans=3), refine="never")


@pytest.mark.parametrize("continuity", ["c1", "g1"])
def test_rows_hold_far_from_the_origin(continuity):
    """Found by trial: rows enlarge the rounding of coordinates until no Hessian is positive definite."""
    mp = models.star(5, 3).split_spans().reduce_continuity(1)
    target, landmarks = targets.deformed(mp, targets.bend(mp, 20))
    near = pt.transfer(mp, target, landmarks, continuity)
    shift = 1e6 * target.diameter * np.array([1.0, -0.5])
    moved = [
        [BSplineCurve(c.knots, c.degree, c.control_points + shift, c.weights) for c in loop] for loop in target.loops
    ]
    far = pt.transfer(mp, Boundary(moved), landmarks + np.array([0, 0, *shift]), continuity)
    assert far.certificate.injective
    assert far.rows.without == near.rows.without
    assert far.rows.active == near.rows.active
    # Of the 16 digits six are the place's; near-singular rows take more.
    assert near.rows.residual <= far.rows.residual < 1e-5
    assert far.quality.scaled_jacobian.mean == pytest.approx(near.quality.scaled_jacobian.mean, abs=1e-4)
    for released in far.rows.released:
        assert np.abs(np.subtract(released[1], shift)).max() < 10 * target.diameter


def test_a_target_that_retraces_itself_is_not_called_feasible():
    """Where curves lie on each other, neither a crossing nor its absence can be proved."""
    mp = models.build([models.bilinear(*SHEET)], 2, 3, None)
    target = Boundary([polygon([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [1, 1], [0, 1]])])
    with pytest.raises(pt.TransferError, match=r"target boundary: .*loop 0") as caught:
        pt.transfer(mp, target)
    assert "feasible" not in str(caught.value)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"target": None}, r"target must be a Boundary .*got NoneType"),
        ({"source": None}, r"source must be a MultiPatch .*got NoneType"),
        ({"fit_tolerance": "a"}, "fit_tolerance must lie between 0 and 1, got 'a'"),
    ],
)
def test_arguments_of_another_type_are_named(changed, message):
    mp = models.build([models.bilinear(*SHEET)], 2, 3, None)
    with pytest.raises(pt.InputError, match=message):
        pt.transfer(**{"source": mp, "target": mp.boundary(), **changed})


@pytest.mark.parametrize("notch", [[[1, 0.1]], [[1.02, 1], [1.0, 0.02], [0.98, 1]]])
def test_a_boundary_that_is_missed_is_told(notch):
    """Also when all samples of the side lie on the target, which the fit may cut short."""
    case = notched(*notch)
    result = pt.transfer(*case, refine="never", on_failure="return")
    assert result.boundary_error > 0.04
    assert result.missed
    assert not result.succeeded
    assert any("boundary loop 0" in warning and "refine" in warning for warning in result.warnings)
    with pytest.raises(pt.NotCertifiedError) as caught:
        pt.transfer(*case, refine="never")
    assert caught.value.result.multipatch == result.multipatch
    if result.certificate.injective:
        assert isinstance(caught.value, pt.BoundaryMissedError)
        assert f"misses the target by {result.boundary_error:.2g} of its diameter" in str(caught.value)


def test_what_is_met_roughly_is_a_success():
    """Up to five tolerances are a fit, told by its error; "tolerance" refines it, "auto" does not."""
    mp, target, landmarks = hard()
    error = pt.transfer(mp, target, landmarks, refine="never", on_failure="return").boundary_error
    rough = pt.transfer(mp, target, landmarks, fit_tolerance=error / 4)
    assert rough.succeeded
    assert not rough.refined
    assert rough.boundary_error == pytest.approx(error, rel=0.2)
    fine = pt.transfer(mp, target, landmarks, fit_tolerance=error / 4, refine="tolerance")
    assert fine.refined
    assert fine.boundary_error <= error / 4


def hard() -> tuple[pt.MultiPatch, Boundary, np.ndarray]:
    """A sheet bent so far that one patch of few control points cannot follow without folding."""
    mp = models.build([models.bilinear((0, 0), (1, 0), (1, 4), (0, 4))], 2, 2, None)
    target, landmarks = targets.deformed(mp, targets.bend(mp, 300))
    return mp, target, landmarks


def test_failures_carry_the_best_map(monkeypatch):
    """The optimiser never fails on feasible sample targets, so its certificate is made to."""
    mp = models.grid(2, 2, 2, 1)
    target, landmarks = targets.deformed(mp, targets.bend(mp, 20))
    plan = pt.TransferPlan(mp)
    real = solver.certify

    def doubtful(multipatch, **known):
        return replace(
            real(multipatch, **known), injective=False, status="undecided", reasons=("patch 0 is undecided",)
        )

    monkeypatch.setattr(solver, "certify", doubtful)
    with pytest.raises(
        NotCertifiedError, match=r"no certified map was found.*undecided.*patch 0.*more knots did not help"
    ) as caught:
        plan.transfer(target, landmarks)
    best = caught.value.result
    assert isinstance(best, pt.TransferResult)
    assert not best.certificate.injective
    assert len(best.log) >= 3
    same_structure(best.multipatch, mp)
    result = plan.transfer(target, landmarks, on_failure="return")
    assert result.multipatch == best.multipatch


def test_the_paper_method_may_fail_where_ours_does_not():
    mp, target, landmarks = hard()
    ours = pt.transfer(mp, target, landmarks, refine="auto", on_failure="return")
    paper = pt.transfer(mp, target, landmarks, method="paper", on_failure="return")
    assert ours.certificate.injective
    if not paper.certificate.injective:
        with pytest.raises(NotCertifiedError):
            pt.transfer(mp, target, landmarks, method="paper")


def test_refinement_where_the_target_is_missed():
    mp, target, landmarks = hard()
    coarse = pt.transfer(mp, target, landmarks, refine="never", on_failure="return")
    assert coarse.boundary_error > 1e-3
    assert coarse.multipatch.topology.n_points == mp.topology.n_points
    assert any("refine the source" in warning for warning in coarse.warnings)
    fine = pt.transfer(mp, target, landmarks)
    assert fine.refined
    assert fine.boundary_error < coarse.boundary_error / 4
    assert any("the source was refined" in warning for warning in fine.warnings)
    # Only along the two sides that miss it: the strip across keeps its knots.
    assert sorted(np.unique(k).size for k in fine.multipatch.patches[0].knots) == [3, 9]
    # Nothing is refined that needs no refinement.
    easy = pt.transfer(mp, *targets.deformed(mp, targets.bend(mp, 10)))
    assert not easy.refined
    assert easy.multipatch.topology.n_points == mp.topology.n_points


def test_patches_that_share_a_corner_share_its_bound():
    """An L cut along its diagonal: 45 degrees each at one corner, 135 at the other."""
    l_shape = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
    sides = [pt.BSplineCurve([0, 0, 1, 1], 1, [a, b]) for a, b in zip(l_shape, l_shape[1:] + l_shape[:1], strict=True)]
    result = pt.from_layout(l_shape, [[0, 1, 2, 3], [0, 3, 4, 5]], Boundary([sides]))
    assert result.corner_bound == pytest.approx(0.5**0.5, abs=1e-9)
    assert 0.5 < result.quality.scaled_jacobian.min <= result.corner_bound + 1e-9


def test_a_flat_corner_of_one_patch_is_degenerate_not_folded():
    """The target is smooth where a single patch fills the corner: det J = 0 there, proved positive elsewhere."""
    mp = models.build([models.bilinear((-1, -1), (1, -1), (1, 1), (-1, 1))], 3, 2, None)
    diagonal = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    result = pt.transfer(mp, Boundary([[circle(1.0)]]), np.hstack([diagonal, diagonal / 2**0.5]))
    assert result.certificate.status == "degenerate"
    assert result.certificate.injective
    assert len(result.certificate.cells) == 4
    assert {cell.point for cell in result.certificate.cells} == {(0, 0), (1, 0), (0, 1), (1, 1)}
    assert isinstance(hash(result.certificate), int)
    assert result.corner_bound == 0
    # The four corners do not count.
    assert result.quality.scaled_jacobian.min > 0
    assert result.quality.nonpositive == 0


def test_results_are_plain_to_read():
    mp = models.grid(1, 1)
    result = pt.transfer(mp, mp.boundary())
    data = result.to_dict()
    assert data["error"] is None
    assert data["certificate"]["injective"] is True
    assert len(data["registration"]["joints"]) == 4
    assert "certified" in repr(result)
    assert result.with_warnings(["x"]).warnings == (*result.warnings, "x")
    assert result._repr_svg_().startswith("<svg")
    assert "certified" in result._repr_html_()


# --- real models ----------------------------------------------------------------------------------


def real(name: str) -> pt.MultiPatch:
    return pt.read(Path(MODELS or "") / f"{name}.xml")


REAL = {
    "bend 30": lambda mp: targets.bend(mp, 30),
    "bend -45": lambda mp: targets.bend(mp, -45),
    "bend 60": lambda mp: targets.bend(mp, 60),
    "bump": lambda mp: targets.bump(mp, (0.1, 0.55), (0.1, 0.03), 0.12),
    "bump at the right": lambda mp: targets.bump(mp, (0.9, 0.3), (0.08, -0.05), 0.15),
    "articulation": lambda mp: targets.articulation(mp, 20, blend=0.4),
}


@needs_models
@pytest.mark.parametrize("deformation", REAL)
@pytest.mark.parametrize(("name", "error"), [("yeti", 1e-3), ("turtle", 3e-3), ("disc", 1e-3)])
def test_real_models(name, error, deformation):
    mp = real(name)
    f = REAL[deformation](mp)
    target, landmarks = targets.deformed(mp, f)
    result = pt.transfer(mp, target, landmarks)
    assert result.certificate.injective
    assert result.certificate.status == "certified"
    same_structure(result.multipatch, mp)
    assert result.boundary_error <= error
    before = pt.quality(mp).scaled_jacobian.mean
    assert result.quality.scaled_jacobian.mean >= before - 0.04


@needs_models
def test_real_models_by_the_paper():
    mp = real("yeti")
    target, landmarks = targets.deformed(mp, targets.bend(mp, 30))
    result = pt.transfer(mp, target, landmarks, method="paper", on_failure="return")
    same_structure(result.multipatch, mp)
    assert result.boundary_error < 1e-2


def test_optimizers_under_rows_are_reused_and_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    source = examples.load("rabbit")[0]
    made: list[bool] = []
    original = solver.SplineOptimizer.__init__

    def counted(self: solver.SplineOptimizer, *args: object, **options: object) -> None:
        made.append(options.get("null_space") is not None)
        original(self, *args, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(solver.SplineOptimizer, "__init__", counted)
    plan = pt.TransferPlan(source)
    pairs = [targets.deformed(source, targets.bend(source, angle), seed=4) for angle in (15, 16, 15)]
    results = [plan.transfer(*pair) for pair in pairs]
    under_rows = sum(made)
    for result, pair in zip(results, pairs, strict=True):
        fresh = pt.transfer(source, *pair)
        for a, b in zip(result.multipatch.patches, fresh.multipatch.patches, strict=True):
            assert np.array_equal(a.control_points, b.control_points)
    assert under_rows < sum(made) - under_rows
