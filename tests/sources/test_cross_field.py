"""Cross fields: indices add up to Euler's number, and depend on the shape alone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings

import domains
from outlines import outlines
from patchtransfer import InputError
from patchtransfer.proof.certificate import check_boundary
from patchtransfer.sources.auto_layout.cross_field import EdgeIsometry, compute_cross_field
from patchtransfer.sources.auto_layout.mesh import corner_valences, generate_mesh, sample_simply
from patchtransfer.sources.auto_layout.sampling import sample_outline
from shapes import SQUARE, loop

DOMAINS = {
    "square": loop(SQUARE),
    "L": domains.L,
    "skew L": domains.SKEW_L,
    "ring": domains.ring(),
    "disk": domains.disk(),
    "ellipse": domains.disk(radii=(1.7, 1.0)),
    "pentagon": domains.pentagon(),
    "plate": domains.plate(),
}
#: Indices of inner vertices that are not regular.
SINGULAR = {"disk": [1] * 4, "ellipse": [1] * 4, "pentagon": [-1], "plate": [-1] * 4}


def mesh_of(boundary):
    outline = sample_simply(boundary)
    return generate_mesh(outline, corner_valences(outline))


def balance(mesh, field):
    """Sum of 4 - valence inside and 2 - k on the outline."""
    n = len(mesh.outline.points)
    return field.index[n:].sum() + (2 - field.index[:n]).sum()


def inner_indices(mesh, field):
    inner = field.index[len(mesh.outline.points) :]
    return sorted(inner[inner != 0].tolist())


@pytest.mark.parametrize("name", DOMAINS)
def test_indices(name):
    mesh = mesh_of(DOMAINS[name])
    field = compute_cross_field(mesh)
    assert balance(mesh, field) == 4 * (2 - len(DOMAINS[name].loops))
    assert inner_indices(mesh, field) == SINGULAR.get(name, [])
    corners = mesh.corner_valence > 0
    on_outline = field.index[: len(corners)]
    assert np.array_equal(on_outline[corners], mesh.corner_valence[corners])
    assert (on_outline[~corners] == 2).all()


@settings(max_examples=12)
@given(outlines)
def test_indices_add_up_on_any_outline(boundary):
    # Strongly curved sides may cross.
    assume(check_boundary(boundary.loops).simple)
    mesh = mesh_of(boundary)
    assert balance(mesh, compute_cross_field(mesh)) == 4 * (2 - len(boundary.loops))


def test_a_cross_follows_the_outline():
    """One arm of the cross along every straight side of a turned square."""
    mesh = mesh_of(domains.mapped(loop(SQUARE), domains.rotation(20)))
    turn = np.exp(4j * (compute_cross_field(mesh).theta - np.radians(20)))
    assert abs(turn - 1).max() < 1e-6


@pytest.mark.parametrize(
    "matrix", [domains.rotation(37), 1e-3 * np.eye(2), 1e3 * np.eye(2)], ids=["rotated", "small", "large"]
)
@pytest.mark.parametrize("name", ["skew L", "plate", "ellipse", "pentagon"])
def test_indices_are_those_of_the_moved_outline(name, matrix):
    mesh, moved = mesh_of(DOMAINS[name]), mesh_of(domains.mapped(DOMAINS[name], matrix))
    before, after = compute_cross_field(mesh), compute_cross_field(moved)
    n = len(mesh.outline.points)
    assert np.array_equal(after.index[:n], before.index[:n])
    assert inner_indices(moved, after) == inner_indices(mesh, before)


def test_averaging_over_the_identity_changes_nothing():
    mesh = mesh_of(DOMAINS["skew L"])
    identity = EdgeIsometry(np.arange(len(mesh.edges)), 1.0, False)
    plain, averaged = compute_cross_field(mesh), compute_cross_field(mesh, [identity])
    assert abs(np.exp(4j * plain.theta) - np.exp(4j * averaged.theta)).max() < 1e-9


def test_corners_are_rounded_to_the_nearest_number_of_quads():
    outline = sample_outline(domains.SKEW_L)
    corner = ~np.isnan(outline.corner_angle)
    assert corner_valences(outline)[corner].tolist() == [1, 1, 1, 3, 1, 1]
    # The regular octagon's 135 degrees: exactly between one and two.
    angle = 2 * np.pi * np.arange(8) / 8
    octagon = sample_outline(loop(np.column_stack([np.cos(angle), np.sin(angle)])))
    corner = ~np.isnan(octagon.corner_angle)
    assert set(corner_valences(octagon)[corner]) == {2}
    assert set(corner_valences(octagon, -0.2)[corner]) == {1}


@pytest.mark.parametrize(
    ("wish", "message"),
    [
        ({(1, 0): 2}, "no loop 1"),
        ({(0, 6): 2}, "loop 0 has 6 corners"),
        ({(0, 5): 0}, "corner 5 of loop 0 needs at least one patch"),
        ({(0, 5): 1.5}, "corner 5 of loop 0 needs at least one patch"),
    ],
)
def test_wishes_that_cannot_be(wish, message):
    with pytest.raises(InputError, match=message):
        corner_valences(sample_outline(domains.SKEW_L), 0.0, wish)
