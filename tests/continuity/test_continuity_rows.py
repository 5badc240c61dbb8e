"""C1 and vertex rows: they hold on smooth maps, and their redundancy is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import models
import patchtransfer as pt
import real
from patchtransfer.continuity.interfaces import ControlRows, chord_ratios, control_rows
from patchtransfer.continuity.null_space import row_space
from patchtransfer.continuity.rows import C1Rows, ContinuityRows
from patchtransfer.continuity.vertex_rows import overshoot
from patchtransfer.geometry.basis import collocation_matrix
from shapes import bicubic, cut, reparameterized
from strategies import layouts


def cross(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]


def rows_of(mp: pt.MultiPatch) -> ContinuityRows:
    return C1Rows(mp.topology, control_rows(mp.topology))(mp.topology.coordinates)


@pytest.mark.parametrize("name", models.ALL)
def test_spokes_run_counter_clockwise(name):
    mp = models.ALL[name]()
    x = mp.topology.coordinates
    control = control_rows(mp.topology)
    for vertex in mp.vertices:
        spokes = mp.topology.spokes.get(vertex.point, ())
        assert len(spokes) == (vertex.valence if vertex.interior else vertex.valence - 1)
        ways = np.array([x[control[s.interface].curve[-2 if s.at_end else 1]] - x[vertex.point] for s in spokes])
        if len(ways) > 1:
            angle = np.unwrap(np.arctan2(*ways.T[::-1]))
            assert (np.diff(angle) > 0).all()
            assert angle[-1] - angle[0] < 2 * np.pi


@pytest.mark.parametrize("name", models.ALL)
def test_patch_a_is_on_the_left(name):
    mp = models.ALL[name]()
    for r in control_rows(mp.topology):
        value, slope = (collocation_matrix(r.knots, r.degree, [0.3, 0.8], k) for k in (0, 1))
        left, right, tangent = r.derivatives(mp.topology.coordinates, value, slope)
        assert (cross(tangent, left) > 0).all()
        assert (cross(tangent, right) < 0).all()


@given(
    seed=st.integers(0, 10**6),
    turns=st.tuples(*[st.integers(0, 15)] * 4),
    u=st.sampled_from([0.25, 0.4, 0.5]),
    v=st.floats(0.2, 0.8),
)
def test_rows_vanish_on_a_smooth_map_cut_in_four(seed, turns, u, v):
    """Spans differ on the two sides, handedness and domains are mixed."""
    quarters = [q for half in cut(bicubic(seed), 0, u) for q in cut(half, 1, v)]
    mp = models.welded(pt.MultiPatch([reparameterized(q, t) for q, t in zip(quarters, turns, strict=True)]))
    rows = rows_of(mp)
    # All but j = 0 at the four boundary ends.
    assert len(rows) == sum(len(r.curve) for r in control_rows(mp.topology)) - 4
    assert rows.left_out == 4
    assert np.abs(rows.matrix @ mp.topology.coordinates).max() < 1e-12 * mp.diameter


def exact_gluing(r: ControlRows, points: np.ndarray, end: int) -> tuple[np.ndarray, np.ndarray]:
    """(a, b, c) and its derivative for a = det(D_R, C'), b = det(C', D_L), c = det(D_R, D_L): exact on any map."""
    value, slope, bend = (x[None] for x in r.end_basis[end])
    left, right, tangent = (x[0] for x in r.derivatives(points, value, slope))
    left1, right1, tangent1 = (x[0] for x in r.derivatives(points, slope, bend))
    data = np.array([cross(right, tangent), cross(tangent, left), cross(right, left)])
    slopes = [
        cross(right1, tangent) + cross(right, tangent1),
        cross(tangent1, left) + cross(tangent, left1),
        cross(right1, left) + cross(right, left1),
    ]
    return data, np.array(slopes)


@given(name=st.sampled_from(sorted(models.ALL)), seed=st.integers(0, 10**6))
@settings(max_examples=25)
def test_vertex_rows_vanish_with_the_gluing_data_of_any_map(name, seed):
    mp = models.jiggled(models.ALL[name](), seed)
    x = mp.topology.coordinates
    for r in control_rows(mp.topology):
        for end in (0, 1):
            value, slope, bend = (v[None] for v in r.end_basis[end])
            data, slopes = exact_gluing(r, x, end)
            zeroth = r.functional(data[None], value, slope)
            first = r.functional(slopes[None], value, slope) + r.functional(data[None], slope, bend)
            for row in (zeroth, first):
                assert np.abs(row @ x[r.columns]).max() < 1e-12 * np.abs(row).sum() * np.abs(x).max()
            given_data = r.end_gluing(x)[end]
            np.testing.assert_allclose(given_data, 2 * data / (data[0] + data[1]), rtol=1e-9, atol=1e-12)


def test_first_order_row_in_control_points():
    """The closed form with E_j, F_j and the two knot differences of C''."""
    mp = models.jiggled(models.star(5, 3, 3), 3)
    x = mp.topology.coordinates
    rng = np.random.default_rng(0)
    for r in control_rows(mp.topology):
        (a, b, c), (a1, b1, c1) = rng.uniform(0.5, 2, (2, 3))
        value, slope, bend = (v[None] for v in r.end_basis[0])
        first = r.functional(np.array([[a1, b1, c1]]), value, slope) + r.functional(np.array([[a, b, c]]), slope, bend)
        e, f = r.left_scale * (x[r.left] - x[r.curve]), r.right_scale * (x[r.right] - x[r.curve])
        s, t, p, h = x[r.curve], r.knots, r.degree, r.breaks[1]
        closed = a * p / h * (e[1] - e[0]) + a1 * e[0] + b * p / h * (f[1] - f[0]) + b1 * f[0]
        closed -= c * p * (p - 1) / h * ((s[2] - s[1]) / (t[p + 2] - t[2]) - (s[1] - s[0]) / h)
        closed -= c1 * p / h * (s[1] - s[0])
        np.testing.assert_allclose((first @ x[r.columns])[0], closed, atol=1e-9 * np.abs(closed).max())


def smooth_star(valence: int, spans: int, kappa: float) -> pt.MultiPatch:
    """Bicubic patches around a vertex that are C1 along straight spokes but for e_0 and e_1 = -kappa e_0, by design.

    On the spoke along x the control vectors of D_L have the x components cos(θ) (1, -kappa, 0, ...), θ the angle of two
    neighbouring spokes, and y components that make the patch symmetric about its bisector; the other spokes and
    patches are images of these by rotation.
    """
    theta, h = 2 * np.pi / valence, 1 / spans
    knots = np.concatenate([np.zeros(4), np.arange(1, spans) * h, np.ones(4)])
    n = len(knots) - 4
    along = np.array([knots[j + 1 : j + 4].mean() for j in range(n)])
    spoke = np.column_stack([along, np.zeros(n)])
    across = np.column_stack([np.cos(theta) * np.eye(n)[0], np.full(n, np.sin(theta))])
    across[1] -= np.cos(theta) * np.array([kappa, (1 + kappa) * np.tan(theta / 2)])
    mirror = np.array([[np.cos(theta), np.sin(theta)], [np.sin(theta), -np.cos(theta)]])
    net = spoke[:, None] + (spoke @ mirror)[None]
    net[:, 1] = spoke + h / 3 * across
    net[1, :] = net[:, 1] @ mirror
    net[:, 0], net[0, :] = spoke, spoke @ mirror
    patches = []
    for k in range(valence):
        cos, sin = np.cos(k * theta), np.sin(k * theta)
        patches.append(pt.Patch((knots, knots), (3, 3), net @ np.array([[cos, sin], [-sin, cos]])))
    return models.welded(pt.MultiPatch(patches))


@pytest.mark.parametrize(
    ("valence", "spans"),
    [(v, n) for v in (3, 5, 6, 7, 8) for n in (4, 5)] + [(v, n) for v in (3, 6, 8) for n in (2, 3)],
)
def test_rows_vanish_on_a_smooth_star(valence, spans):
    """All rows at once, those of the vertex included: an analytically smooth map whose kink fades as the rows say."""
    kappa = 0.0 if spans >= 4 else overshoot(np.array([0, 0, 0, 0, 1, 2, 2, 2, 2.0]).tobytes(), 3)
    mp = smooth_star(valence, spans, kappa)
    x, rows = mp.topology.coordinates, rows_of(mp)
    assert pt.certify(mp).injective
    # Around an even valence the second rows of this symmetric map depend.
    seconds = valence - (valence % 2 == 0)
    assert sorted(rows.order[rows.vertex >= 0]) == [0] * valence + [1] * seconds
    assert np.abs(rows.matrix @ x).max() < (1e-14 if kappa == 0 else 1e-9)
    # And not on others: with a twist moved, its two interfaces are no longer smooth.
    corner = mp.topology.points[0][1, 1]
    off = x.copy()
    off[corner] += [0.01, 0.0]
    left = np.abs(rows.matrix @ off).max(axis=1) > 1e-4
    assert (rows.order[left] == 1).all()
    if valence % 2 or spans >= 4:
        assert len(set(rows.interface[left])) == left.sum()
        assert left.sum() in ((2,) if valence % 2 else (1, 2))


def second_row(mp: pt.MultiPatch, i: int, end: int, ratio: float) -> np.ndarray | None:
    """Coefficients of all points in A L_1 + B R_1 - s_1 + κ (A L_0 + B R_0 - s_0); None where there is none."""
    t, r = mp.topology, control_rows(mp.topology)[i]
    spans, valences = len(r.breaks) - 1, {v.point: v.valence for v in t.vertices}
    inner = {v.point for v in t.vertices if v.extraordinary}
    step = -1 if end else 1
    here = int(r.curve[::step][0])
    if (len(r.curve) == 3 and {int(r.curve[0]), int(r.curve[-1])} <= inner) or (spans < 4 and valences[here] in (5, 7)):
        return None
    knots = -r.knots[::-1] if end else r.knots
    kappa = 0.0 if spans >= 4 else overshoot(knots.tobytes(), r.degree)
    a, b = ratio * r.left_scale, r.right_scale
    full = np.zeros(t.n_points)
    for j, factor in ((0, kappa), (1, 1.0)):
        for points, weight in ((r.left, a / (a + b)), (r.right, b / (a + b)), (r.curve, -1.0)):
            full[points[::step][j]] += factor * weight
    return full


def few_and_even(mp: pt.MultiPatch, vertex: int) -> bool:
    """Whether the second rows around a vertex are combined: its valence is even, and its spokes have few spans."""
    around = [v for v in mp.topology.vertices if v.extraordinary and v.point == vertex and v.valence % 2 == 0]
    spokes = [r for r in control_rows(mp.topology) if vertex in (int(r.curve[0]), int(r.curve[-1]))]
    return bool(around) and all(len(r.breaks) < 5 for r in spokes)


@pytest.mark.parametrize(("valence", "degree", "spans"), [(6, 3, 3), (6, 3, 2), (8, 3, 3), (6, 2, 1), (6, 3, 4)])
def test_second_rows_around_even_valences_are_combined_on_few_spans(valence, degree, spans):
    """All but one of them, orthonormal combinations of what the spokes ask for; nothing is left to a single spoke."""
    mp = models.jiggled(models.star(valence, degree, spans), 3)
    x, control, rows = mp.topology.coordinates, control_rows(mp.topology), rows_of(mp)
    (vertex,) = {v.point for v in mp.vertices if v.extraordinary}
    ratios = chord_ratios(mp.topology, control, x)
    ends = [(i, 0 if int(r.curve[0]) == vertex else 1) for i, r in enumerate(control)]
    asked = np.array([second_row(mp, i, end, ratios[i]) for i, end in ends])
    found = rows.matrix[(rows.order == 1) & (rows.vertex == vertex)].toarray()
    if spans > 3:
        assert {tuple(row) for row in found.round(12)} <= {tuple(row) for row in asked.round(12)}
        return
    assert len(found) == valence - 1
    factors = np.linalg.lstsq(asked.T, found.T, rcond=None)[0].T
    np.testing.assert_allclose(factors @ asked, found, atol=1e-12)
    np.testing.assert_allclose(factors @ factors.T, np.eye(valence - 1), atol=1e-12)
    # What is left out is what the twists beside the spokes do least for.
    twists = np.unique([[c[::-1][1] if end else c[1] for c in (control[i].left, control[i].right)] for i, end in ends])
    left_out = np.linalg.svd(factors)[2][-1]
    sizes = np.linalg.svd(asked[:, twists], compute_uv=False)
    assert np.linalg.norm(left_out @ asked[:, twists]) == pytest.approx(sizes[-1], abs=1e-12)


VERTEX_MODELS = models.ALL | {
    "single spans": lambda: models.star(5, 3, 1),
    "single spans, valence 3": lambda: models.star(3, 4, 1),
    "many spans": lambda: models.star(5, 3, 4),
    "many spans, even": lambda: models.star(6, 2, 5),
}


@pytest.mark.parametrize("name", VERTEX_MODELS)
def test_vertex_rows_are_the_gluing_identity_and_how_the_kink_fades(name):
    """Those gathered at once against the identity and the residuals of every interface on its own."""
    mp = models.jiggled(VERTEX_MODELS[name](), 2)
    t, x, control = mp.topology, mp.topology.coordinates, control_rows(mp.topology)
    rows, ratios, found = rows_of(mp), chord_ratios(mp.topology, control_rows(mp.topology), x), 0
    extraordinary = {v.point for v in t.vertices if v.extraordinary}
    for i, r in enumerate(control):
        for end in (0, 1):
            if int(r.curve[-end]) not in extraordinary:
                continue
            value, slope, _ = (v[None] for v in r.end_basis[end])
            tangent = np.zeros(t.n_points)
            zeroth = r.functional(r.end_gluing(x)[[end]], value, slope)[0]
            np.add.at(tangent, r.columns, zeroth / np.linalg.norm(zeroth))
            second = None if few_and_even(mp, int(r.curve[-end])) else second_row(mp, i, end, ratios[i])
            for order, full in enumerate((tangent, second)):
                here = (rows.interface == i) & (rows.vertex == int(r.curve[-end])) & (rows.order == order)
                assert here.sum() == (full is not None)
                if full is not None:
                    np.testing.assert_allclose(rows.matrix[here].toarray()[0], full, atol=1e-12)
                    found += 1
    shared = [few_and_even(mp, v) for v in rows.vertex.tolist()]
    assert found == (rows.vertex >= 0).sum() - (np.array(shared) & (rows.order == 1)).sum()


def test_the_papers_row_is_a_special_case():
    """Eq. 12: Bezier, a' = b' = 0, and c' = -2 c(0), as on an edge between two vertices with equal data."""
    mp = models.jiggled(models.star(3, 4, 1), 1)
    x = mp.topology.coordinates
    r = control_rows(mp.topology)[0]
    n, (a, b, c) = r.degree, (0.7, 1.3, 0.9)
    value, slope, bend = (v[None] for v in r.end_basis[0])
    first = r.functional(np.array([[0, 0, -2 * c]]), value, slope) + r.functional(np.array([[a, b, c]]), slope, bend)
    alpha, beta = a / c, b / c
    s, left, right = x[r.curve], x[r.left], x[r.right]
    paper = n * alpha * left[1] + n * beta * right[1] + n * (1 - alpha - beta) * s[1] - (n - 1) * s[2] - s[0]
    # Theirs uses the tangent row once: (s_1 - s_0) = alpha (L_0 - s_0) + beta (R_0 - s_0).
    tangent = alpha * (left[0] - s[0]) + beta * (right[0] - s[0]) - (s[1] - s[0])
    ours = (first @ x[r.columns])[0] / (c * n)
    np.testing.assert_allclose(ours + n * tangent, paper, atol=1e-9)


@pytest.mark.parametrize("name", models.ALL)
def test_chord_ratios_agree_across_regular_vertices(name):
    mp = models.ALL[name]()
    t = mp.topology
    ratios = chord_ratios(t, control_rows(t), t.coordinates)
    for chord in t.directed_chords:
        oriented = [ratios[i] if forward else 1 / ratios[i] for i, forward in chord]
        np.testing.assert_allclose(oriented, oriented[0], rtol=1e-12)
        sampled = np.mean([log_speed_ratio(mp, i) if forward else -log_speed_ratio(mp, i) for i, forward in chord])
        assert np.exp(sampled) == pytest.approx(oriented[0], rel=0.02)


def log_speed_ratio(mp: pt.MultiPatch, interface: int) -> float:
    """Mean of log(|D_R| / |D_L|) over an interface, by differences of points on unit domains."""
    f = mp.interfaces[interface]
    speeds = []
    for k, side in ((f.patch_a, f.side_a), (f.patch_b, f.side_b)):
        patch = mp.patches[k]
        ends = [(t[0], t[-1]) for t in patch.knots]
        a, b = ends[1 - side.axis]
        across = np.array([b, b + 1e-6 * (a - b)] if side.at_end else [a, a + 1e-6 * (b - a)])
        along = np.linspace(*ends[side.axis], 400)
        points = patch.grid(along, across) if side.axis == 0 else patch.grid(across, along).swapaxes(0, 1)
        speeds.append(
            np.linalg.norm(points[:, 1] - points[:, 0], axis=1)[:: -1 if f.reversed and k == f.patch_b else 1]
        )
    return float(np.log(speeds[1] / speeds[0]).mean())


def check_row_space(mp: pt.MultiPatch, complete: bool) -> None:
    """The basis against dense linear algebra, and redundancy against the count that theory gives."""
    t = mp.topology
    rows = rows_of(mp)
    space = row_space(rows, t.interior_points, t.coordinates)
    assert space.contradictory == ()
    dense = space.rows.matrix.toarray()[:, t.interior_points]
    sigma = np.linalg.svd(dense, compute_uv=False) if dense.size else np.zeros(0)
    rank = int((sigma > 1e-9).sum())
    assert space.basis.shape == (len(t.interior_points), len(t.interior_points) - rank)
    assert space.redundant == len(space.rows) - rank
    regular = sum(v.interior and v.valence == 4 for v in t.vertices)
    extraordinary = sum(v.extraordinary for v in t.vertices)
    if complete:
        assert space.redundant == 3 * regular + 2 * extraordinary
    assert np.abs(dense @ space.basis.toarray()).max(initial=0.0) < 1e-13
    values = np.linalg.svd(space.basis.toarray(), compute_uv=False)
    assert values[0] < 10 * values[-1]
    there = space.project(t.coordinates)
    assert space.residual(there) < 1e-12 * mp.diameter
    assert np.array_equal(there[t.boundary_points], t.coordinates[t.boundary_points])
    np.testing.assert_allclose(space.project(there), there, atol=1e-12 * mp.diameter)


@pytest.mark.parametrize("name", models.ALL)
def test_row_space_of_the_models(name):
    check_row_space(models.ALL[name](), complete=True)


@given(layout=layouts(), degree=st.integers(2, 3), spans=st.integers(2, 3), seed=st.integers(0, 10**6))
@settings(max_examples=20, deadline=None)
def test_row_space_of_random_layouts(layout, degree, spans, seed):
    mp = layout.multipatch(degree, spans)
    assume(len(mp.interfaces) > 0)
    check_row_space(models.jiggled(mp, seed, 0.003), complete=True)


@pytest.mark.parametrize(("valence", "degree"), [(3, 2), (5, 2), (7, 2), (3, 3), (5, 3), (6, 3), (8, 3)])
def test_row_space_of_single_spans(valence, degree):
    check_row_space(models.star(valence, degree, 1), complete=True)


@real.needed
@pytest.mark.parametrize("name", ["yeti", "turtle", "disc"])
def test_row_space_of_real_models(name):
    check_row_space(real.model(name), complete=True)
