"""What certificates remember: proofs of boundary loops, and how far the knots along interfaces are apart."""

from __future__ import annotations

import random
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import models
import patchtransfer as pt
import targets
from patchtransfer import BSplineCurve, MultiPatch, Patch
from patchtransfer.geometry.topology import Topology
from patchtransfer.proof import certificate
from patchtransfer.proof.certificate import _check_boundary, _Loops, certify, check_boundary
from shapes import LINE, SQUARE, polygon

QUADRATIC = [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]


def square(tip=(1.0, 1.0)) -> list[BSplineCurve]:
    """Crosses itself when the tip is beyond the opposite corner."""
    return polygon([(0.0, 0.0), (1.0, 0.0), tip, (0.0, 1.0)])


def chains(loops) -> _Loops:
    return _Loops([[(c.knots, c.degree, c.control_points, c.weights) for c in loop] for loop in loops])


@pytest.fixture(autouse=True)
def proofs(monkeypatch):
    """The core's proofs that are really made, on an empty memo."""
    made = []
    original = certificate.certify_loops

    def counted(loops):
        made.append(loops)
        return original(loops)

    monkeypatch.setattr(certificate, "certify_loops", counted)
    _check_boundary.cache_clear()
    yield made
    _check_boundary.cache_clear()


def test_the_same_loops_are_proved_once(proofs):
    first = check_boundary([square()])
    again = check_boundary([square()])  # other objects, equal to the bit
    assert first == again
    assert first.simple
    assert len(proofs) == 1


@pytest.mark.parametrize("by", [1.0, 1e-9, np.spacing(1.0)])
def test_changed_loops_are_proved_anew(proofs, by):
    check_boundary([square()])
    check_boundary([square((1.0, 1.0 + by))])
    check_boundary([square((1.0 - by, 1.0))])
    assert len(proofs) == 3


def test_a_crossing_is_seen_after_a_proof_of_its_neighbour():
    assert check_boundary([square()]).simple is True
    assert check_boundary([square((-1.0, -0.5))]).simple is False
    assert check_boundary([square()]).simple is True


def test_arrays_changed_in_place_are_other_loops(proofs):
    points = np.array([[1.0, 0.0], [1.5, 0.5], [1.0, 1.0]])
    outline = square()
    outline[1] = BSplineCurve(QUADRATIC, 2, points)
    assert check_boundary([outline]).simple is True
    points[1] = [-2.0, 0.5]
    # The curve has numbers of its own; one from the changed array is another.
    assert check_boundary([outline]).simple is True
    assert len(proofs) == 1
    outline[1] = BSplineCurve(QUADRATIC, 2, points)
    assert check_boundary([outline]).simple is False
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
    keys = [chains(loops) for loops in variants()]
    for i, a in enumerate(keys):
        for j, b in enumerate(keys):
            assert (a == b) == (i == j)
    for loops, key in zip(variants(), keys, strict=True):
        again = chains(loops)
        assert again == key
        assert hash(again) == hash(key)
    assert keys[0] != "loops"


def test_equal_hashes_are_not_enough(proofs):
    good, bad = chains([square()]), chains([square((-1.0, -0.5))])
    good._hash = bad._hash = 7
    assert _check_boundary(good).simple is True
    assert _check_boundary(bad).simple is False
    assert _check_boundary(good).simple is True
    assert len(proofs) == 2


def test_the_memo_is_bounded(proofs):
    for k in range(40):
        check_boundary([square((1.0, 1.0 + k / 64))])
    info = _check_boundary.cache_info()
    assert info.currsize <= info.maxsize <= 32
    assert len(proofs) == 40
    # The oldest was dropped and is proved again.
    check_boundary([square()])
    assert len(proofs) == 41


def test_threads_get_the_report_of_their_own_loops():
    cases = [[square((1.0 + k / 64, 1.0))] for k in range(12)] + [[square((-1.0 - k / 64, -0.5))] for k in range(12)]
    expected = [check_boundary(loops) for loops in cases]
    assert {report.simple for report in expected} == {True, False}
    _check_boundary.cache_clear()
    barrier = threading.Barrier(4)

    def work(seed):
        order = list(range(len(cases))) * 20
        random.Random(seed).shuffle(order)
        barrier.wait()
        return all(check_boundary(cases[i]) == expected[i] for i in order)

    with ThreadPoolExecutor(4) as executor:
        assert all(executor.map(work, range(4)))


def test_certificates_and_transfers_remember_and_stay_the_same(proofs):
    """A transfer asks about each boundary again and again; results are those of a memo that forgets everything."""
    mp = models.plate_with_hole(2, 2)
    target, landmarks = targets.deformed(mp, targets.bend(mp, 40))
    result = pt.transfer(mp, target, landmarks)
    remembered = len(proofs)
    proofs.clear()
    again = pt.transfer(mp, target, landmarks)
    assert again.multipatch == result.multipatch
    assert again.certificate == result.certificate
    assert len(proofs) < remembered
    _check_boundary.cache_clear()
    assert certify(result.multipatch) == result.certificate


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
