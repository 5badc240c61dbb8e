"""Rational models made polynomial: within the tolerance, certified, and all that is not geometry is kept."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import conics
import models
import patchtransfer as pt
import real
from commands import failed, run
from failing import folded_source
from patchtransfer import Block, InputError, Interface, MultiPatch, Patch, Side
from patchtransfer.conversion import spaces
from patchtransfer.geometry.outline import Outline, hausdorff

TURN = st.tuples(st.booleans(), st.booleans(), st.booleans())


def radial_error(mp: MultiPatch, radii) -> float:
    """Of the boundary, from the nearest of circles about the origin."""
    points = [c(np.linspace(*c.domain, 2001)) for loop in mp.boundary().loops for c in loop]
    r = np.hypot(*np.concatenate(points).T)
    return float(np.min([np.abs(r - radius) for radius in radii], axis=0).max())


def is_kept(made: pt.Converted, mp: MultiPatch) -> None:
    """Structure and proof."""
    out = made.multipatch
    assert not out.is_rational
    assert (out.interfaces, out.ids, out.sides, out.blocks) == (mp.interfaces, mp.ids, mp.sides, mp.blocks)
    assert pt.certify(out).injective
    assert made.certificate.injective
    for f in out.interfaces:
        a, b = f.side_a.of(out[f.patch_a].control_points), f.side_b.of(out[f.patch_b].control_points)
        assert np.array_equal(a, b[::-1] if f.reversed else b)
    for before, after in zip(mp, out, strict=True):
        for i, j in ((0, 0), (0, -1), (-1, 0), (-1, -1)):
            off = after.control_points[i, j] - before.control_points[i, j]
            assert np.abs(off).max() <= 4 * np.spacing(np.abs(mp.topology.coordinates).max())


def test_an_annulus_of_24_points_gets_at_most_60():
    mp = conics.annulus()
    assert mp.topology.n_points == 24
    made = pt.to_polynomial(mp, 1e-6)
    assert made.multipatch.topology.n_points <= 60
    off = radial_error(made.multipatch, (0.5, 1.0)) / 8**0.5
    assert off <= made.loss <= min(1e-6, 1.05 * off)
    is_kept(made, mp)
    assert pt.check_continuity(made.multipatch).to_dict()["kink_deg"]["max"] < 1e-9
    assert made.multipatch == mp.to_polynomial()


@settings(max_examples=15, deadline=None)
@given(
    st.integers(3, 6),
    st.floats(0.05, 0.9),
    st.floats(-6, 6).map(lambda x: 10.0**x),
    st.floats(0, 6),
    st.sampled_from([1e-2, 1e-4, 1e-6, 1e-8]),
    st.sampled_from([1, 1, 2, 3]),
    st.data(),
)
def test_annuli_of_any_size_place_and_parameters(patches, inner, scale, angle, tolerance, spans, data):
    plain = conics.annulus(inner, 1.0, patches, spans)
    turns = data.draw(st.lists(TURN, min_size=patches, max_size=patches))
    order = data.draw(st.permutations(range(patches)))
    spun = conics.spun(plain, turns, order)
    mp = conics.moved(spun, scale, angle, np.array([3.0, -1.0]) * scale)
    mp = MultiPatch(mp.patches, mp.interfaces, [7 + k for k in range(patches)]).with_labels({"in": [mp.boundaries[0]]})
    made = pt.to_polynomial(mp, tolerance)
    is_kept(made, mp)
    back = conics.moved(made.multipatch, 1.0, 0.0, np.array([-3.0, 1.0]) * scale)
    off = radial_error(back, (inner * scale, scale)) / Outline(mp.boundary().loops[0]).diameter
    assert off <= made.loss * 1.001 + 1e-14
    assert max(made.loss, made.inside) <= tolerance
    # Neither place nor parameters matter: the same spaces, the same loss.
    same = pt.to_polynomial(plain, tolerance)
    assert made.multipatch.topology.n_points == same.multipatch.topology.n_points


def test_a_disc_keeps_its_straight_corners():
    mp = MultiPatch([conics.disc()])
    for tolerance in (1e-3, 1e-6, 1e-8):
        made = pt.to_polynomial(mp, tolerance)
        is_kept(made, mp)
        assert made.certificate.status == "degenerate"
        assert {(cell.patch, cell.kind) for cell in made.certificate.cells} == {(0, "degenerate")}
        assert radial_error(made.multipatch, (1.0,)) <= tolerance * 8**0.5


@pytest.mark.parametrize("spans", [1, 2])
def test_polynomial_patches_keep_their_map_beside_rational_ones(spans):
    mp = conics.plate(spans)
    assert [patch.weights is None for patch in mp] == [False, False, True]
    made = pt.to_polynomial(mp, 1e-7)
    is_kept(made, mp)
    u = np.linspace(0, 1, 23)
    np.testing.assert_allclose(made.multipatch[2].grid(u, u), mp[2].grid(u, u), rtol=0, atol=1e-14 * mp.diameter)
    # So do straight sides, and nothing is added where nothing bends: across the strips of the arcs.
    assert made.multipatch[2].shape[0] == mp[2].shape[0]
    far = Side.EAST.of(made.multipatch[0].control_points)
    np.testing.assert_array_equal(far[:, 0], 4.0)


def test_inside_the_map_stays_near():
    mp = conics.plate()
    made = pt.to_polynomial(mp, 1e-9).multipatch
    u = np.linspace(0, 1, 33)
    for before, after in zip(mp, made, strict=True):
        off = np.hypot(*np.moveaxis(before.grid(u, u) - after.grid(u, u), 2, 0)).max()
        assert off < 5e-3 * mp.diameter


@pytest.mark.parametrize(
    "weight", [2.0, np.array([[3.0, np.nextafter(3.0, 4)], [3.0, 3.0]])], ids=["equal", "rounding"]
)
def test_equal_weights_are_a_polynomial_already(weight):
    net = np.array([[[0.0, 0], [0, 1]], [[1, 0], [1.2, 1.1]]])
    mp = MultiPatch([Patch((conics.BEZIER[1],) * 2, (1, 1), net, np.ones((2, 2)) * weight)])
    made = pt.to_polynomial(mp)
    assert made.loss == made.inside == 0.0
    assert np.array_equal(made.multipatch[0].control_points, net)
    assert made.multipatch[0].weights is None


def test_a_polynomial_model_is_left_as_it_is():
    mp = models.plate_with_hole(2, 2)
    assert pt.to_polynomial(mp).multipatch is mp


def test_corners_inside_a_side_stay_corners():
    # Two quarter arcs that meet at a knot where the boundary turns by 90 degrees.
    inner = np.array([[2.0, 0], [2, 1], [1, 1], [1, 2], [0, 2]])
    arcs = Patch(
        (conics.BEZIER[1], [0, 0, 0, 0.5, 0.5, 1, 1, 1]),
        (1, 2),
        np.stack([inner, 2 * inner]),
        np.ones((2, 1)) * np.array([1, 0.5**0.5, 1, 0.5**0.5, 1]),
    )
    mp = MultiPatch([arcs])
    made = pt.to_polynomial(mp, 1e-6)
    is_kept(made, mp)
    for side in (Side.WEST, Side.EAST):
        points = side.of(made.multipatch[0].control_points)
        assert np.abs(points - side.of(arcs.control_points)[2]).sum(axis=1).min() < 1e-14


def test_a_refined_arc_gets_no_knots_twice():
    mp = conics.annulus(spans=8)
    made = pt.to_polynomial(mp, 1e-6)
    # Degree 2 -> 3 with simple knots: one function more along each arc.
    assert made.multipatch[0].shape == (mp[0].shape[0], mp[0].shape[1] + 1)


def test_all_that_is_not_geometry_is_kept():
    mp = conics.plate(2)
    block = Block("G+Smo XML", "Function", '<Function type="FunctionExpr" id="4" dim="2">x</Function>')
    labels = {"hole": [(0, "west"), (1, "west")], "far": [(2, Side.EAST)]}
    mp = MultiPatch(mp.patches, mp.interfaces, [3, 1, 8], labels, [block])
    is_kept(pt.to_polynomial(mp, 1e-5), mp)


@pytest.mark.parametrize("tolerance", [0.0, -1.0, np.nan, np.inf])
def test_tolerances_are_positive(tolerance):
    with pytest.raises(InputError, match="above 0"):
        pt.to_polynomial(conics.annulus(), tolerance)


def test_what_cannot_be_reached_is_told(monkeypatch):
    with pytest.raises(InputError, match=r"within the rounding of the coordinates; take at least \d"):
        pt.to_polynomial(conics.annulus(), 1e-16)
    monkeypatch.setattr(spaces, "FINEST", 1)
    with pytest.raises(InputError, match=r"of patch \d comes no nearer than \de?.* with degree 4 and 2 spans"):
        pt.to_polynomial(conics.annulus(), 1e-11)


def test_folded_models_are_refused():
    folded = folded_source()
    weights = np.ones(folded[0].shape)
    weights[0, 0] = 2.0
    first = Patch(folded[0].knots, folded[0].degrees, folded[0].control_points, weights)
    with pytest.raises(InputError, match="not an injective parameterization"):
        pt.to_polynomial(MultiPatch([first, *folded.patches[1:]], []))


def test_transfers_of_what_was_converted(tmp_path):
    mp = conics.annulus()
    pt.write(mp, tmp_path / "source.xml")
    pt.write(conics.annulus(0.3, 1.2).boundary(), tmp_path / "target.xml")
    source, target, out = (tmp_path / name for name in ("source.xml", "target.xml", "out.xml"))
    command = ("transfer", source, target, "-o", out, "--fixed-correspondence", "--json", tmp_path / "r.json")
    assert run(*command).exit_code == 0
    assert pt.read(out).is_rational
    failed(run(*command, "--continuity", "g1"), 2, "rational.*--polynomial")
    done = run(*command, "--polynomial", "1e-6")
    assert done.exit_code == 0
    assert "made polynomial: 48 control points, boundary off by" in done.stderr
    assert "made polynomial" in (tmp_path / "r.json").read_text()
    assert pt.certify(pt.read(out)).injective


def test_the_command_converts_and_tells(tmp_path):
    pt.write(conics.annulus(), tmp_path / "in.mesh")
    done = run("convert", tmp_path / "in.mesh", tmp_path / "out.xml", "--polynomial", "1e-6")
    assert done.exit_code == 0
    assert "degree 2 -> 4" in done.output
    assert "boundary off by" in done.output
    assert not pt.read(tmp_path / "out.xml").is_rational
    refused = run("convert", tmp_path / "in.mesh", tmp_path / "other.xml", "--polynomial", "0")
    failed(refused, 2, "above 0")
    assert not (tmp_path / "other.xml").exists()


REAL = [
    "geopdes/geo_curvedL_3patches.txt",
    "geopdes/geo_plate_with_hole.txt",
    "geopdes/geo_ring.txt",
    "geopdes/geo_ring_1eighth.txt",
    "mfem/disc-nurbs.mesh",
    "mfem/pipe-nurbs-2d.mesh",
    "mfem/square-disc-nurbs.mesh",
    "mfem/square-disc-nurbs-patch.mesh",
    "gismo/unitdisk.xml",
    "gismo/square_with_disk.xml",
    "gismo/rectangle_with_disk_hole.xml",
    "gismo/plate_with_hole.xml",
    "unstructured/5p_circle.xml",
    "unstructured/5p_square_with_disk.xml",
    "unstructured/2p_quarter_square_with_hole.xml",
]


@real.needed
@pytest.mark.parametrize("name", REAL)
def test_real_models(name):
    mp = pt.read(real.path("yeti").parent / "real" / name)
    for tolerance in (1e-3, 1e-6):
        made = pt.to_polynomial(mp, tolerance)
        is_kept(made, mp)
        loops = zip(mp.boundary().loops, made.multipatch.boundary().loops, strict=True)
        off = max(hausdorff(Outline(a), Outline(b)) for a, b in loops) / Outline(mp.boundary().loops[0]).diameter
        # Feet that outlines find are right to some 1e-9.
        assert off <= made.loss + 1e-8
        assert max(made.loss, made.inside) <= tolerance
        assert pt.quality(made.multipatch).scaled_jacobian.min >= pt.quality(mp).scaled_jacobian.min - 0.01


def test_arcs_inside_are_fitted_too():
    inner, outer = conics.ring(0.5, 1.0), conics.ring(1.0, 2.0)
    glued = [Interface(k, Side.EAST, k + 4, Side.WEST, False) for k in range(4)]
    around = [Interface(k + r, Side.NORTH, (k + 1) % 4 + r, Side.SOUTH, False) for r in (0, 4) for k in range(4)]
    mp = MultiPatch([*inner, *outer], [*glued, *around])
    made = pt.to_polynomial(mp, 1e-6)
    is_kept(made, mp)
    points = Side.EAST.of(made.multipatch[0].grid(np.array([0, 1.0]), np.linspace(0, 1, 999)))
    off = float(np.abs(np.hypot(*points.T) - 1).max()) / 32**0.5
    assert off <= made.inside <= 1e-6
