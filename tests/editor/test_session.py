"""Sessions: what is shown follows what is edited, and messages that are not understood change nothing."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import patchtransfer as pt
from patchtransfer import InputError, examples
from patchtransfer.editor.editing import control_points
from patchtransfer.editor.messages import obey
from patchtransfer.editor.session import Session
from patchtransfer.editor.view import View


def opened(landmarks=True):
    source, target, points = examples.load("star")
    return Session(source, target, points if landmarks else None)


@pytest.fixture(scope="module")
def shared():
    return opened()


def place(session, at):
    return session.edited.target.loops[at.loop][at.curve].control_points[at.point]


def test_a_drag_is_followed_and_its_drop_is_a_transfer():
    session = opened()
    at = session.handles[3]
    to = place(session, at) + 0.02 * session.edited.target.diameter
    session.grab(at)
    for part in (0.3, 0.7, 1.0):
        session.drag(tuple(place(session, at) * (1 - part) + part * to))
        assert session.shown.live
        assert session.shown.certificate.injective
        assert pt.certify(session.shown.model).injective
    session.drop()
    assert not session.shown.live
    np.testing.assert_allclose(place(session, at), to)
    again = pt.transfer(session.source, session.edited.target, session.landmark_rows)
    assert again.multipatch == session.result.multipatch


def test_what_follows_is_what_a_drop_gives_nearly():
    """Held rows and feet against a transfer of the same target."""
    session = opened()
    at = session.handles[0]
    session.grab(at)
    session.drag(tuple(place(session, at) + 0.02))
    live = session.shown.model
    session.drop()
    # A transfer may refine where the boundary needs it; the parameters stay.
    t = np.linspace(0, 1, 9)
    pairs = zip(live.patches, session.result.multipatch.patches, strict=True)
    assert max(np.abs(a.grid(t, t) - b.grid(t, t)).max() for a, b in pairs) < 0.02 * live.diameter


def test_an_infeasible_drag_says_where_and_recovers():
    session = opened()
    before = session.edited.target
    at = session.handles[0]
    home = tuple(place(session, at))
    session.grab(at, 0.1)
    # Across the shape and far out on the other side.
    centre = control_points(before).mean(axis=0)
    session.drag(tuple(centre + 3 * (centre - np.array(home))))
    assert session.shown.error is not None
    assert session.shown.certificate is None or not session.shown.certificate.injective
    assert session.shown.places
    assert session.shown.model is not None
    state = View(session).state()
    assert not state["ok"]
    assert state["places"]
    session.drag(home)
    assert session.shown.error is None
    session.drop()
    assert session.result.succeeded


def test_a_map_that_cannot_follow_is_no_success():
    """A spike of one control point, which a fit at held feet does not see: a proof of another shape."""
    session = opened()
    at = session.handles[0]
    centre = control_points(session.edited.target).mean(axis=0)
    session.grab(at)
    session.drag(tuple(centre + 1.5 * (place(session, at) - centre)))
    assert "cannot follow so far" in session.shown.error
    assert not View(session).state()["ok"]


def test_everything_can_be_undone_and_done_again():
    session = opened(landmarks=False)
    states = [session.edited]
    session.grab(session.handles[2])
    session.drag(tuple(place(session, session.handles[2]) + 0.01))
    session.drop()
    states.append(session.edited)
    x, y = session.source.boundary().loops[0][0].start
    u, v = session.edited.target.loops[0][0].start
    session.add_landmark((x, y), (u, v))
    states.append(session.edited)
    session.remove_landmark(0)
    states.append(session.edited)
    for state in reversed(states[:-1]):
        session.undo()
        assert session.edited == state
    session.undo()
    assert session.edited == states[0]
    for state in states[1:]:
        session.redo()
        assert session.edited == state
    assert session.can_undo == (True, False)


def test_landmarks_are_on_the_outlines_and_bad_ones_are_told():
    session = opened(landmarks=False)
    session.add_landmark((10.0, 0.0), (10.0, 0.0))
    pair = session.edited.landmarks[0]
    for outline, point in ((session.source.boundary(), pair.source), (session.edited.target, pair.target)):
        assert min(pt.geometry.outline.Outline(loop).nearest(np.array([point]))[1][0] for loop in outline.loops) < 1e-9
    session.add_landmark((10.0, 0.0), (-10.0, 0.0))
    assert "same point" in session.shown.error
    session.move_landmark(1, "source", (-10.0, 0.1))
    assert session.shown.error is None


def on_an_outline():
    """A session that knows an outline alone, with five inner vertices in twelve patches or so."""
    return Session.of_outline(examples.load("rabbit")[1])


@pytest.fixture(scope="module")
def outlined():
    return on_an_outline()


def room(session, vertex):
    """How far a vertex is from the next one and from the outline."""
    here = np.array(session.vertices[vertex])
    others = session.shown.model.topology.coordinates[[v.point for v in session.shown.model.topology.vertices]]
    away = np.hypot(*(others - here).T)
    return away[away > 0].min()


def test_inner_vertices_end_where_they_are_dragged_and_the_map_is_certified(outlined):
    session, target = outlined, outlined.edited.target
    angles = np.random.default_rng(5).uniform(0, 2 * np.pi, len(session.vertices))
    assert len(angles) > 2
    for vertex, angle in zip(session.vertices, angles, strict=True):
        before = session.shown.model
        start, way = np.array(session.vertices[vertex]), 0.5 * room(session, vertex)
        session.take(vertex)
        for k in range(1, 6):
            to = start + k / 5 * way * np.array([np.cos(angle), np.sin(angle)])
            session.drag((to[0], to[1]))
            assert session.shown.live
            assert session.shown.error is None
            assert session.vertices[vertex] == (to[0], to[1])
        live = session.shown.model
        session.drop()
        result = session.result
        # What was shown last is what is kept, and no other file says so.
        assert result.succeeded
        np.testing.assert_allclose(result.multipatch.topology.coordinates, live.topology.coordinates, atol=1e-7)
        patch = result.multipatch.patches[vertex.patch].control_points
        np.testing.assert_array_equal(patch[-(vertex.corner % 2), -(vertex.corner // 2)], to)
        assert pt.certify(result.multipatch).injective
        assert result.multipatch.boundary() == before.boundary()
        assert session.edited.target is target
        # Rows hold as they did.
        assert result.rows.to_dict()["residual"] < 1e-12
        assert result.multipatch != before
        session.undo()
        assert session.shown.model == before
        assert session.vertices[vertex] == tuple(start)


def test_several_vertices_are_moved_and_freed():
    session = on_an_outline()
    free = session.result.multipatch
    first, second = list(session.vertices)[:2]
    for vertex in (second, first):
        session.take(vertex)
        to = np.array(session.vertices[vertex]) + 0.3 * room(session, vertex)
        session.drag((to[0], to[1]))
        session.drop()
    places = session.edited.places
    assert set(places) == {first, second}
    assert all(session.vertices[vertex] == place for vertex, place in places.items())
    assert session.result.succeeded
    # The target's points can be dragged on, and vertices stay where they are.
    at = session.handles[5]
    session.grab(at, 0.1)
    session.drag(tuple(place(session, at) + 0.003 * session.edited.target.diameter))
    assert session.shown.error is None
    assert session.vertices[first] == places[first]
    session.drop()
    assert session.result.succeeded
    assert session.vertices[second] == places[second]
    session.undo()
    # Freeing both gives the map that there was, bit by bit.
    session.release(first)
    session.release(second)
    assert session.result.multipatch == free
    with pytest.raises(InputError, match="was not moved"):
        session.release(first)


def test_a_vertex_outside_has_no_map_and_comes_back():
    session = on_an_outline()
    vertex = next(iter(session.vertices))
    home = session.vertices[vertex]
    outside = control_points(session.edited.target).max(axis=0) + 1
    session.take(vertex)
    session.drag(tuple(outside))
    assert "drag them back" in session.shown.error
    assert session.shown.places
    session.drag(home)
    assert session.shown.error is None
    session.drag(tuple(outside))
    session.drop()
    assert session.result is None
    assert "drag them back" in session.shown.error
    session.take(vertex)
    session.drag(home)
    session.drop()
    assert session.result.succeeded
    assert session.shown.error is None


def test_what_a_moved_vertex_gives_does_not_depend_on_the_way():
    ends = []
    for steps in (1, 7):
        session = opened()
        (vertex,) = session.vertices
        start = np.array(session.vertices[vertex])
        session.take(vertex)
        for k in range(1, steps + 1):
            session.drag(tuple(start + 0.1 * k / steps * np.array([1.0, 0.4])))
        session.drop()
        ends.append(session.result.multipatch.topology.coordinates)
    np.testing.assert_allclose(*ends, atol=1e-8)


def test_an_outline_alone_is_parameterized():
    outline = pt.Boundary.from_points([(0, 0), (3, 0), (3, 1), (1, 1), (1, 2), (0, 2)])
    session = Session.of_outline(outline)
    assert session.result.succeeded


words = st.sampled_from(
    [
        "do",
        "grab",
        "drag",
        "drop",
        "take",
        "release",
        "patch",
        "corner",
        "add",
        "move",
        "remove",
        "undo",
        "loop",
        "curve",
        "point",
        "x",
        "y",
        "landmark",
        "on",
    ]
)
values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | words | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(words, inner, max_size=5),
    max_leaves=8,
)


@settings(max_examples=300, deadline=None)
@given(st.text(max_size=40) | st.dictionaries(words, values, max_size=6).map(json.dumps) | values.map(json.dumps))
def test_random_messages_are_refused_or_obeyed(shared, text):
    before = shared.edited
    try:
        obey(shared, text)
    except InputError:
        assert shared.edited == before
    shared.undo()
    json.dumps(View(shared).state(), allow_nan=False)


@pytest.mark.parametrize(
    "message",
    [
        {"do": "grab", "loop": 0, "curve": 0, "point": 10**9},
        {"do": "grab", "loop": True, "curve": 0, "point": 0},
        {"do": "drag", "x": float("nan"), "y": 0},
        {"do": "drag", "x": 10**400, "y": 0},
        {"do": "add", "sx": 0, "sy": 0, "tx": "1", "ty": 0},
        {"do": "move", "landmark": 99, "on": "source", "x": 0, "y": 0},
        {"do": "move", "landmark": 0, "on": "elsewhere", "x": 0, "y": 0},
        {"do": "remove", "landmark": -1},
        {"do": "take", "patch": 0, "corner": 9},
        {"do": "take", "patch": 0, "corner": 0.5},
        {"do": "release", "patch": 0, "corner": 0},
        {"do": ["undo"]},
        {"do": "__class__"},
    ],
)
def test_messages_that_cannot_be_obeyed(shared, message):
    with pytest.raises(InputError):
        obey(shared, json.dumps(message))
