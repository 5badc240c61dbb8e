"""C¹ fields and the biharmonic equation: exactness, orders with and without AS-G1, the null space by a second route."""

import numpy as np
import pytest
from hypothesis import given, reject, settings
from hypothesis import strategies as st

import models
import patchtransfer as pt
import real
import strategies
import targets
from patchtransfer import examples, iga
from patchtransfer.iga.biharmonic import sine_hessian
from patchtransfer.iga.manufactured import Wave

sine = Wave()
sine_gradient = sine.gradient


def star(valence: int, seed: int | None = 1) -> pt.MultiPatch:
    """Bilinear quadrilaterals around a vertex."""
    angle = np.pi * np.arange(2 * valence) / valence
    radius = np.where(np.arange(2 * valence) % 2 == 0, 1.0, np.cos(np.pi / valence))
    ring = radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    corners = [(ring[2 * k - 1], ring[2 * k], ring[(2 * k + 1) % (2 * valence)]) for k in range(valence)]
    return models.build([models.bilinear((0.05, -0.03), *c) for c in corners], 1, 1, seed)


def bilinear(layout: pt.QuadLayout) -> pt.MultiPatch:
    """The layout's own quadrilaterals."""
    maps = [models.bilinear(*layout.vertices[quad]) for quad in layout.quads]
    return models.build(maps, 1, 1)


def raised(mp: pt.MultiPatch) -> pt.MultiPatch:
    """The same geometry in degree 3 with a C¹ knot in the middle."""
    middle = [0.5, 0.5]
    patches = [p.elevate(4 - 1 - p.degrees[0]).insert_knots(0, middle).insert_knots(1, middle) for p in mp.patches]
    return models.welded(pt.MultiPatch(patches, mp.interfaces))


def perturbed(mp: pt.MultiPatch, size: float) -> pt.MultiPatch:
    """Inner control points moved at random, the boundary as it was."""
    points, inner = mp.topology.coordinates.copy(), mp.topology.interior_points
    points[inner] += size * np.random.default_rng(0).uniform(-1, 1, (len(inner), 2))
    return mp.with_shared_points(points)


#: Of total degree 4: x⁴ + x² y² − y³ + x.
QUARTIC = {
    "f": lambda x, y: 24.0 + 8 + 0 * x,
    "exact": lambda x, y: x**4 + x**2 * y**2 - y**3 + x,
    "gradient": lambda x, y: (4 * x**3 + 2 * x * y**2 + 1, 2 * x**2 * y - 3 * y**2),
    "hessian": lambda x, y: (12 * x**2 + 2 * y**2, 4 * x * y, 2 * x**2 - 6 * y),
}


@pytest.mark.parametrize("valence", [3, 4, 5, 6])
@pytest.mark.parametrize("divisions", [1, 2, 3])
def test_polynomials_are_reproduced_around_a_vertex(valence, divisions):
    """Any polynomial of the field's degree is a C¹ spline on bilinear patches."""
    # On few large spans the rational integrands need more nodes than the default.
    result = iga.biharmonic(star(valence), **QUARTIC, degree=4, divisions=divisions, quadrature=12)
    assert result.errors.max < 1e-10
    assert result.errors.h2 < 1e-8
    assert result.c1_residual < 1e-13
    assert result.as_g1_residual < 1e-14


@given(strategies.layouts(), st.integers(3, 4), st.integers(1, 2))
@settings(max_examples=15, deadline=None)
def test_null_space_is_whole_on_any_layout(layout, degree, divisions):
    # Edges that are nearly, but not quite, straight through a vertex have conditions that nearly vanish.
    try:
        mp = bilinear(pt.QuadLayout(np.round(layout.vertices, 1), layout.quads))
    except pt.InputError:
        reject()
    space = iga.SplineSpace(mp, degree, divisions=divisions, smoothness=degree - 2)
    fields = iga.C1Space(space, mp)
    basis = fields.basis.toarray()
    assert np.abs(fields.rows @ basis).max() < 1e-11 * np.abs(basis).max()
    # A second route: the rank of all rows at once.
    sigma = np.linalg.svd(fields.rows.toarray(), compute_uv=False)
    rank = int((sigma > 1e-9).sum())
    assert basis.shape[1] == space.size - rank
    assert np.linalg.matrix_rank(basis, tol=1e-9) == basis.shape[1]
    # Fields inside have no value and slope on the boundary, and the others together have no field without.
    assert np.abs(fields.inside.toarray()[fields.outer]).max(initial=0.0) == 0
    outside = fields.boundary.toarray()[fields.outer]
    assert np.linalg.matrix_rank(outside, tol=1e-9) == outside.shape[1]
    low, high = fields.rank_gap
    assert low < 1e-12
    assert high > 1e-8


@pytest.mark.parametrize("bend", 10.0 ** -np.arange(2, 17, 2))
def test_edges_that_are_nearly_straight(bend):
    """Found by hypothesis: conditions as weak as the bend amplify rounding, or are left out."""
    vertices = np.array([[0, 0], [0, 1], [0, 2], [0, 3], [1, 0], [1, 1 - bend / 3], [1, 2], [1, 3 + bend]])
    mp = bilinear(pt.QuadLayout(vertices, [[0, 4, 5, 1], [1, 5, 6, 2], [2, 6, 7, 3]]))
    result = iga.biharmonic(mp, **QUARTIC, degree=4, divisions=2, quadrature=12)
    assert result.errors.max < 1e-6
    assert result.c1_residual < 1e-7


@pytest.mark.parametrize("valence", [3, 5])
def test_gradients_agree_on_both_sides_of_interfaces(valence):
    """Checked in the plane, not on the rows that the space is made from."""
    mp = star(valence)
    space = iga.SplineSpace(mp, 3, divisions=2, smoothness=1)
    basis = iga.C1Space(space, mp).basis
    u = iga.Field(space, basis @ np.random.default_rng(1).uniform(-1, 1, basis.shape[1]))
    t = np.linspace(0, 1, 7)
    for f in mp.interfaces:
        sides = []
        for k, side, reverse in ((f.patch_a, f.side_a, False), (f.patch_b, f.side_b, f.reversed)):
            at = [np.array([float(side.at_end)])] * 2
            at[side.axis] = t
            slopes = np.stack([u.grid(k, *at, 1, 0), u.grid(k, *at, 0, 1)], axis=-1)
            jacobian = np.stack([mp.patches[k].grid(*at, 1, 0), mp.patches[k].grid(*at, 0, 1)], axis=-1)
            gradient = np.linalg.solve(jacobian.swapaxes(2, 3), slopes[..., None]).reshape(-1, 2)
            sides.append(gradient[:: -1 if reverse else 1])
        assert np.abs(sides[0] - sides[1]).max() < 1e-11 * np.abs(sides[0]).max()


def orders(mp, degree, divisions, **options):
    found = [iga.biharmonic(mp, degree=degree, divisions=d, **options).errors for d in divisions]
    return [np.log2(getattr(found[-2], norm) / getattr(found[-1], norm)) for norm in ("l2", "h1", "h2")], found[-1]


@pytest.mark.parametrize("valence", [3, 5])
@pytest.mark.parametrize("degree", [3, 4])
def test_orders_with_analysis_suitable_interfaces_and_without(valence, degree):
    """p + 1, p, p − 1 in L², H¹, H² on an AS-G1 model; no convergence on the same domain without."""
    mp = raised(star(valence))
    with_g1, fine = orders(mp, degree, (4, 8))
    np.testing.assert_allclose(with_g1, [degree + 1, degree, degree - 1], atol=0.3)
    moved = perturbed(mp, 0.01)
    assert pt.certify(moved).injective
    np.testing.assert_array_equal(
        moved.topology.coordinates[mp.topology.boundary_points], mp.topology.coordinates[mp.topology.boundary_points]
    )
    without, stalled = orders(moved, degree, (4, 8), gluing="nearest")
    assert max(without) < 0.5
    assert stalled.l2 > 1000 * fine.l2
    assert stalled.h2 > 30 * fine.h2


@pytest.mark.parametrize("name", ["rabbit", "human"])
def test_orders_on_transferred_samples(name):
    """Valences 3 and 5, and chords of constant speed ratio, where a quadratic c would lock the fields."""
    source, target, landmarks = examples.load(name)
    source = source.reduce_continuity(1)
    smooth = pt.transfer(source, target, landmarks, continuity="g1").multipatch
    plain = pt.transfer(source, target, landmarks, continuity="c1").multipatch
    for degree in (3, 4):
        found, fine = orders(smooth, degree, (4, 8))
        rates = np.array(found)
        low = np.array([degree + 1, degree, degree - 1]) - 0.5
        # On so few spans the coarse errors may still fall faster.
        assert (rates > low).all(), rates
        assert (rates < low + 2).all(), rates
        # The same boundary without exact G1.
        assert iga.biharmonic(plain, degree=degree, divisions=8, gluing="nearest").errors.l2 > 1000 * fine.l2


@real.needed
def test_orders_on_a_published_model():
    """An O-grid with four vertices of valence 3, curved and AS-G1; the solution scaled to its size."""
    mp = real.model("disc")
    s = 1 / mp.diameter
    problem = {
        "f": lambda x, y: 4 * (np.pi * s) ** 4 * sine(s * x, s * y),
        "exact": lambda x, y: sine(s * x, s * y),
        "gradient": lambda x, y: tuple(s * d for d in sine_gradient(s * x, s * y)),
        "hessian": lambda x, y: tuple(s**2 * d for d in sine_hessian(s * x, s * y)),
    }
    found = [iga.biharmonic(mp, **problem, degree=3, divisions=d) for d in (2, 4)]
    assert found[0].as_g1_residual < 1e-14
    rates = [np.log2(getattr(found[0].errors, n) / getattr(found[1].errors, n)) for n in ("l2", "h1", "h2")]
    np.testing.assert_allclose(rates, [4, 3, 2], atol=0.2)


def test_a_clamped_plate_bends_towards_its_load():
    """u = (1 − x²)² (1 − y²)² on a square of four patches: zero value and slope on the boundary."""
    cells = [(a, b) for a in (-1, 0) for b in (-1, 0)]
    mp = models.build([models.bilinear((a, b), (a + 1, b), (a + 1, b + 1), (a, b + 1)) for a, b in cells], 1, 1)

    def load(x, y):
        p, q = (1 - x**2) ** 2, (1 - y**2) ** 2
        return 24 * q + 2 * (12 * x**2 - 4) * (12 * y**2 - 4) + 24 * p

    result = iga.biharmonic(mp, load, degree=4, divisions=2)
    assert result.errors is None
    for k, patch in enumerate(mp.patches):
        t = np.linspace(0, 1, 7)
        x, y = np.moveaxis(patch.grid(t, t), 2, 0)
        np.testing.assert_allclose(result.field.grid(k, t, t), (1 - x**2) ** 2 * (1 - y**2) ** 2, atol=1e-9)


def test_refusals_say_what_to_do():
    mp = star(3)
    with pytest.raises(pt.InputError, match=r"degree 3 with smoothness 2: .* 1 to degree - 2"):
        iga.biharmonic(mp, degree=3, smoothness=2)
    with pytest.raises(pt.InputError, match="degree 2"):
        iga.biharmonic(mp, degree=2)
    with pytest.raises(pt.InputError, match="3 of 3 interfaces are not analysis-suitable G1, the worst is interface"):
        iga.biharmonic(perturbed(raised(mp), 0.01))
    with pytest.raises(pt.InputError, match='"exact" or "nearest"'):
        iga.biharmonic(mp, gluing="any")
    with pytest.raises(pt.InputError, match="needs its gradient"):
        iga.biharmonic(mp, lambda x, y: 0.0, exact=lambda x, y: x)
    with pytest.raises(pt.InputError, match="needs its right-hand side"):
        iga.biharmonic(mp, exact=lambda x, y: x)
    with pytest.raises(pt.InputError, match=r"boundary gradient on .* side of patch 0: NaN"):
        iga.biharmonic(mp, lambda x, y: 0.0, lambda x, y: x, gradient=lambda x, y: (x, np.full_like(x, np.nan)))
    flat = pt.Patch(([0, 0, 1, 1],) * 2, (1, 1), [[[0, 0], [0, 1]], [[1, 0], [1, 1]]], [[1.0, 2.0], [1.0, 2.0]])
    other = pt.Patch(([0, 0, 1, 1],) * 2, (1, 1), [[[1, 0], [1, 1]], [[2, 0], [2, 1]]], [[1.0, 2.0], [1.0, 2.0]])
    with pytest.raises(pt.InputError, match="rational"):
        iga.biharmonic(pt.MultiPatch([flat, other]))
    with pytest.raises(pt.InputError, match="patch 0 is rational"):
        iga.biharmonic(pt.MultiPatch([flat]))


def test_a_kink_inside_a_patch_is_refused():
    mp = pt.MultiPatch([p.insert_knots(0, [0.5]) for p in models.grid(1, 1, 1, 1).patches])
    with pytest.raises(pt.InputError, match=r"patch 0: C¹ fields need .* one continuous derivative"):
        iga.biharmonic(mp, degree=3)


@pytest.mark.parametrize("name", ["plate with hole p3", "annulus p3", "o-grid p3", "quartic, C2"])
@given(seed=st.integers(0, 10**6), exponent=st.floats(-12, -3))
@settings(max_examples=6, deadline=None)
def test_symmetric_models_that_change_a_little_have_no_doubtful_ranks(name, seed, exponent):
    """Gluing data are as small as the change, the conditions of the fields are not."""
    mp = models.SPACES[name]()
    target, landmarks = targets.deformed(mp, targets.waves(mp, 10**exponent, seed), same_cuts=True)
    smooth = pt.transfer(mp, target, landmarks, "g1").multipatch
    degree = max(smooth.patches[0].degrees)
    fields = iga.C1Space(iga.SplineSpace(smooth, degree, divisions=2, smoothness=degree - 2), smooth)
    low, high = fields.rank_gap
    assert low < 1e-9
    assert high > 1e-6
