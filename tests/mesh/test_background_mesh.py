import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import real
from patchtransfer import InputError, MultiPatch, Patch, _core
from patchtransfer.mesh.background_mesh import TriangleMesh, source_mesh, target_mesh

BEZIER = [0.0] * 4 + [1.0] * 4


def circle(n, radius=1.0, centre=(0.0, 0.0)):
    t = 2 * np.pi * np.arange(n) / n
    return np.asarray(radius)[..., None] * np.stack([np.cos(t), np.sin(t)], axis=1) + centre


def signed_area(polygon):
    x, y = polygon.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def square_patch(**moved):
    grid = np.linspace(0, 1, 4)
    net = np.stack(np.meshgrid(grid, grid, indexing="ij"), axis=2)
    for index, point in moved.items():
        net[int(index[1]), int(index[2])] = point
    return net


def edge_set(triangles):
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    return {frozenset(e) for e in edges.tolist()}


@st.composite
def domains(draw):
    """A star-shaped polygon, a round hole, and points between the two."""
    n = draw(st.integers(5, 30))
    radii = np.array(draw(st.lists(st.floats(0.9, 2.0), min_size=n, max_size=n)))
    hole = circle(draw(st.integers(3, 10)), 0.2)[::-1]
    seed = draw(st.integers(0, 10**6))
    rng = np.random.default_rng(seed)
    # The polygon contains the circle of radius 0.9 cos(π/5) > 0.7.
    angle, radius = rng.uniform(0, 2 * np.pi, 40), rng.uniform(0.25, 0.7, 40)
    interior = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    scale = 10.0 ** draw(st.integers(-30, 30))
    return scale * circle(n, radii), scale * hole, scale * interior


@given(domains())
def test_constrained_delaunay_properties(domain):
    outer, hole, interior = domain
    points = np.concatenate([interior, outer, hole])
    n, m = len(interior), len(interior) + len(outer)
    loops = [np.arange(n, m), np.arange(m, len(points))]
    out, triangles = _core.triangulate(points, loops)
    np.testing.assert_array_equal(out, points)
    mesh = TriangleMesh(out, triangles, tuple(loops))
    assert (mesh.areas() > 0).all()
    np.testing.assert_allclose(mesh.areas().sum(), signed_area(outer) + signed_area(hole), rtol=1e-12)
    edges = edge_set(triangles)
    assert len(points) - len(edges) + len(triangles) == 0  # an annulus
    for loop in loops:
        assert {frozenset(e) for e in zip(loop.tolist(), np.roll(loop, -1).tolist(), strict=True)} <= edges


@given(domains(), st.floats(0.01, 0.2))
def test_target_mesh_respects_its_limits(domain, relative):
    outer, hole, _ = domain
    area = signed_area(outer) + signed_area(hole)
    mesh = target_mesh([outer, hole], max_area=relative * area)
    assert (mesh.areas() > 0).all()
    assert mesh.areas().max() <= relative * area * (1 + 1e-9)
    np.testing.assert_allclose(mesh.areas().sum(), area, rtol=1e-10)
    np.testing.assert_array_equal(mesh.points[: len(outer) + len(hole)], np.concatenate([outer, hole]))
    assert [loop[0] for loop in mesh.loops] == [0, len(outer)]
    for loop, polygon in zip(mesh.loops, (outer, hole), strict=True):
        np.testing.assert_allclose(signed_area(mesh.points[loop]), signed_area(polygon), rtol=1e-10)


def test_target_mesh_angles():
    mesh = target_mesh([circle(40), circle(12, 0.3)[::-1]], min_angle=25)
    edges = np.roll(mesh.points[mesh.triangles], -1, axis=1) - mesh.points[mesh.triangles]
    towards, away = edges, -np.roll(edges, 1, axis=1)
    cosine = (towards * away).sum(axis=2) / np.linalg.norm(towards, axis=2) / np.linalg.norm(away, axis=2)
    assert np.degrees(np.arccos(cosine)).min() > 25


@pytest.mark.parametrize(
    ("loops", "kwargs", "message"),
    [
        ([[[0, 0], [1, 1], [1, 0], [0, 1]]], {}, "cross.*point 0 of loop 0"),
        ([circle(8)[::-1]], {}, "loop 0"),
        ([circle(8), circle(8, 0.5)], {}, "loop 1"),
        ([circle(8), circle(8, 0.5, (3, 0))[::-1]], {}, "loop 1"),
        ([circle(8), circle(8, 0.5, (1, 0))[::-1]], {}, "cross"),
        ([[[0, 0], [2, 0], [1, 0], [1, 1]]], {}, r"lies on the polygon edge.*\(1, 0\)"),
        ([[[0, 0], [0, 0], [1, 0], [1, 1]]], {}, "coincide"),
        ([[[0, 0], [np.nan, 0], [1, 1]]], {}, "not finite"),
        ([[[0, 0], [1, 0]]], {}, "only 2 points"),
        ([], {}, "at least one polygon"),
        ([circle(8)], {"min_angle": 40}, "min_angle"),
        ([circle(8)], {"max_area": 0.0}, "max_area"),
    ],
)
def test_target_mesh_errors(loops, kwargs, message):
    with pytest.raises(InputError, match=message):
        target_mesh(loops, **kwargs)


def test_source_mesh_of_two_patches():
    left = square_patch()
    right = left[::-1] * [-1, 1] + [2, 0]  # left-handed numbering would also do: orientation is normalised
    source = MultiPatch([Patch([BEZIER] * 2, (3, 3), left), Patch([BEZIER] * 2, (3, 3), right[::-1])])
    mesh, warnings = source_mesh(source.topology)
    assert not warnings
    assert len(mesh.points) == source.topology.n_points == 28
    assert len(mesh.loops) == 1
    np.testing.assert_array_equal(mesh.boundary, source.topology.boundary_points)
    np.testing.assert_array_equal(mesh.interior, source.topology.interior_points)
    np.testing.assert_allclose(mesh.areas().sum(), 2)


def test_valid_patch_without_a_triangulation():
    # Raising the middle of the bottom row over the row above leaves det J > 0, but the control net folds.
    net = square_patch(_10=(1 / 3, 0.36), _20=(2 / 3, 0.36))
    patch = Patch([BEZIER] * 2, (3, 3), net)
    u = np.linspace(0, 1, 101)
    du, dv = patch.grid(u, u, 1, 0), patch.grid(u, u, 0, 1)
    assert (du[..., 0] * dv[..., 1] - du[..., 1] * dv[..., 0]).min() > 0
    source = MultiPatch([patch])
    mesh, warnings = source_mesh(source.topology)
    assert len(warnings) == 2
    assert "point 5 lies outside the polygon" in warnings[0]
    assert "cell (0, 0) of patch 0" in warnings[1]
    assert len(mesh.triangles) == 18
    assert (mesh.areas() > 0).all()
    assert set(mesh.triangles.ravel()) == set(range(16))


@pytest.mark.parametrize("mirrored", [False, True])
def test_split_of_nets_that_are_not_folded(mirrored):
    # A ring cut open whose ends overlap: no cell is folded, but the boundary polygon crosses itself.
    t, r = np.linspace(0, 2.2 * np.pi, 12), np.array([1.0, 1.4, 1.7, 2.0])
    net = r[:, None, None] * np.stack([np.cos(t), np.sin(t)], axis=1)
    knots = (BEZIER, [0.0] * 4 + list(range(1, 9)) + [9.0] * 4)
    if mirrored:
        net = net[::-1]
    mesh, warnings = source_mesh(MultiPatch([Patch(knots, (3, 3), net)]).topology)
    assert len(warnings) == 1
    assert "cross" in warnings[0]
    assert len(mesh.triangles) == 2 * 3 * 11
    chord = 0.5 * np.sin(np.diff(t)).sum()
    np.testing.assert_allclose(mesh.areas().sum(), (r[-1] ** 2 - r[0] ** 2) * chord)


def test_control_point_on_the_polygon_is_reported():
    _, warnings = source_mesh(MultiPatch([Patch([BEZIER] * 2, (3, 3), square_patch(_11=(0.5, 0.0)))]).topology)
    assert "lies on the polygon edge" in warnings[0]


@real.needed
@pytest.mark.parametrize("name", ["disc", "turtle", "yeti"])
def test_real_models(name):
    io = pytest.importorskip("patchtransfer.io")
    if not hasattr(io, "read"):
        pytest.skip("the readers are not part of this build")
    topology = real.model(name).topology
    mesh, warnings = source_mesh(topology)
    assert (mesh.areas() > 0).all()
    assert set(mesh.triangles.ravel()) == set(range(topology.n_points))
    if not warnings:
        np.testing.assert_array_equal(mesh.boundary, topology.boundary_points)
        polygon_area = sum(signed_area(mesh.points[loop]) for loop in mesh.loops)
        np.testing.assert_allclose(mesh.areas().sum(), polygon_area, rtol=1e-9)
