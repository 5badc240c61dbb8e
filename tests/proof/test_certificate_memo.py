"""What certificates are told: proofs of boundary loops, and how far the knots along interfaces are apart."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import models
import patchtransfer as pt
import targets
from patchtransfer import BSplineCurve, MultiPatch, Patch
from patchtransfer.geometry.topology import Topology
from patchtransfer.interior.solver import InteriorSolver
from patchtransfer.proof import certificate
from patchtransfer.proof.certificate import certify, check_boundary
from shapes import LINE, SQUARE, polygon

QUADRATIC = [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]


def square(tip=(1.0, 1.0)) -> list[BSplineCurve]:
    """Crosses itself when the tip is beyond the opposite corner."""
    return polygon([(0.0, 0.0), (1.0, 0.0), tip, (0.0, 1.0)])


@pytest.fixture(autouse=True)
def proofs(monkeypatch):
    """The core's proofs that are really made."""
    made = []
    original = certificate.certify_loops

    def counted(loops):
        made.append(loops)
        return original(loops)

    monkeypatch.setattr(certificate, "certify_loops", counted)
    return made


def test_known_loops_are_not_proved_again(proofs):
    first = check_boundary([square()])
    assert check_boundary([square()], first) is first  # other objects, equal to the bit
    assert first.simple
    assert len(proofs) == 1
    check_boundary([square()])
    assert len(proofs) == 2


@pytest.mark.parametrize("by", [1.0, 1e-9, np.spacing(1.0)])
def test_changed_loops_are_proved_anew(proofs, by):
    known = check_boundary([square()])
    check_boundary([square((1.0, 1.0 + by))], known)
    check_boundary([square((1.0 - by, 1.0))], known)
    assert len(proofs) == 3


def test_a_crossing_is_seen_with_the_proof_of_its_neighbour():
    known = check_boundary([square()])
    crossed = check_boundary([square((-1.0, -0.5))], known)
    assert crossed.simple is False
    assert check_boundary([square()], crossed).simple is True


def test_arrays_changed_in_place_are_other_loops(proofs):
    points = np.array([[1.0, 0.0], [1.5, 0.5], [1.0, 1.0]])
    outline = square()
    outline[1] = BSplineCurve(QUADRATIC, 2, points)
    known = check_boundary([outline])
    assert known.simple is True
    points[1] = [-2.0, 0.5]
    # The curve has numbers of its own; one from the changed array is another.
    assert check_boundary([outline], known) is known
    outline[1] = BSplineCurve(QUADRATIC, 2, points)
    assert check_boundary([outline], known).simple is False
    assert len(proofs) == 2


def variants() -> list[list[list[BSplineCurve]]]:
    """Loops that hold the same numbers, or nearly, in other places."""
    a, b = square(), polygon(np.add(SQUARE, [3.0, 0.0]))
    straight = BSplineCurve(QUADRATIC, 2, [[1, 0], [1, 0.5], [1, 1]])
    weighted = BSplineCurve(QUADRATIC, 2, [[1, 0], [1, 0.5], [1, 1]], [1.0, 1.0, 1.0])
    heavier = BSplineCurve(QUADRATIC, 2, [[1, 0], [1, 0.5], [1, 1]], [1.0, 2.0, 1.0])
    knotted = BSplineCurve([0, 0, 0, 0.5, 1, 1, 1], 2, [[1, 0], [1, 0.25], [1, 0.75], [1, 1]])
    moved = BSplineCurve([0, 0, 0, 0.25, 1, 1, 1], 2, [[1, 0], [1, 0.25], [1, 0.75], [1, 1]])
    minus = square()
    minus[0] = BSplineCurve(LINE, 1, [[-0.0, 0.0], [1.0, 0.0]])
    replaced = [[a[0], curve, *a[2:]] for curve in (straight, weighted, heavier, knotted, moved)]
    return [
        [a],
        [b],
        [a, b],
        [b, a],
        [a + b],
        [a[1:] + a[:1]],
        [a[:2], a[2:]],
        [minus],
        *([loop] for loop in replaced),
    ]


def test_no_two_of_many_alike_are_confused():
    reports = [check_boundary(loops) for loops in variants()]
    for i, known in enumerate(reports):
        for j, loops in enumerate(variants()):
            assert (check_boundary(loops, known) is known) == (i == j)


def test_a_report_that_was_sent_proves_nothing(proofs):
    known = pickle.loads(pickle.dumps(check_boundary([square()])))
    assert known == check_boundary([square()], known)
    assert len(proofs) == 2


def test_a_transfer_proves_target_fit_and_start_only(proofs, monkeypatch):
    """However many certificates it takes; they are those of a certificate that knows nothing."""
    certificates = []
    original = InteriorSolver.certify

    def counted(solver, points, clock, boundary=None):
        certificates.append(boundary)
        return original(solver, points, clock, boundary)

    monkeypatch.setattr(InteriorSolver, "certify", counted)
    mp = models.plate_with_hole(2, 2)
    target, landmarks = targets.deformed(mp, targets.bend(mp, 40))
    plan = pt.TransferPlan(mp)
    proofs.clear()
    result = plan.transfer(target, landmarks)
    assert len(proofs) <= 3
    assert certificates
    proofs.clear()
    assert certify(result.multipatch) == result.certificate
    assert len(proofs) == 1
    assert certify(result.multipatch, boundary=result.certificate.boundary) == result.certificate
    assert len(proofs) == 1


def test_a_proof_of_another_boundary_certifies_nothing(proofs):
    mp = models.plate_with_hole(2, 2)
    known = certify(mp).boundary
    folded = np.array(mp.topology.coordinates)
    a, b = mp.topology.boundary_points[[0, -1]]
    folded[[a, b]] = folded[[b, a]]
    given = certify(mp.with_shared_points(folded), boundary=known)
    assert given.boundary.simple is False
    assert given == certify(mp.with_shared_points(folded))


# --- knots along interfaces -----------------------------------------------------------------------


def strip(knots) -> MultiPatch:
    """Two patches; the second has other knots along the interface, by as little as the model allows."""
    first = models.bilinear((0, 0), (1, 0), (1, 1), (0, 1))
    second = models.bilinear((1, 0), (2, 0), (2, 1), (1, 1))
    left, right = (models.interpolated(f, 2, 2) for f in (first, second))
    along = np.array(right.knots[1])
    along[3] = knots
    return models.welded(MultiPatch([left, Patch((right.knots[0], along), (2, 2), right.control_points)]))


def fresh(mp: MultiPatch) -> tuple[float, ...]:
    """With nothing carried over."""
    return Topology(mp.patches, mp.interfaces).knot_gaps


@pytest.mark.parametrize("name", models.ALL)
def test_knot_gaps_are_carried_over_as_they_are(name):
    mp = models.ALL[name]()
    assert mp.topology.knot_gaps == fresh(mp)
    bent = mp.with_shared_points(targets.bend(mp, 20)(mp.topology.coordinates))
    # The very same, not found again.
    assert bent.topology.knot_gaps is mp.topology.knot_gaps
    assert bent.topology.knot_gaps == fresh(bent)
    # Other knots are another topology: nothing is carried over.
    for other in (mp.split_spans(2), mp.elevate(1), bent.split_spans(3)):
        assert other.topology.knot_gaps == fresh(other)


def test_a_gap_between_knots_is_still_told_after_the_points_moved():
    mp = strip(0.5 + 1e-13)
    assert mp.topology.knot_gaps[0] == pytest.approx(1e-13, rel=1e-2)
    before = certify(mp)
    assert before.status == "undecided"
    assert "knots of the two sides differ" in before.reasons[0]
    bent = mp.with_shared_points(targets.bend(mp, 20)(mp.topology.coordinates))
    after = certify(bent)
    assert bent.topology.knot_gaps == mp.topology.knot_gaps == fresh(bent)
    assert after.status == "undecided"
    assert "knots of the two sides differ" in after.reasons[0]
    # And a model without it, made from the same points, has none.
    good = strip(0.5)
    assert certify(good).status == "certified"
    assert certify(good.with_shared_points(bent.topology.coordinates)).status == "certified"
