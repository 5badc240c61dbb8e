"""Every public name's values show themselves on one short line: notebooks and error messages hold them."""

import inspect
import types

import numpy as np
import pytest

import conics
import patchtransfer as pt
from models import grid, o_grid
from patchtransfer import batch, iga
from shapes import circle

#: Characters of a line that a terminal or a notebook shows without wrapping much.
LINE = 120


@pytest.fixture(scope="module")
def shown() -> dict[str, list[object]]:
    """Values of every public class, by the class's public name."""
    mp = o_grid()
    result = pt.transfer(mp, mp.boundary())
    frozen = result.freeze()
    morph = pt.morph(mp, mp, 3)
    x = mp.topology.coordinates[mp.topology.boundary_points[0]]
    deformer = pt.Deformer(mp)
    smooth = grid(2, 1, 3, 2, None).reduce_continuity(1)
    solver = iga.PoissonSolver(mp)
    solved = iga.poisson(mp, f=lambda x, y: 0 * x, exact=lambda x, y: x * y, gradient=lambda x, y: (y, x))
    held = mp.with_labels({"a": mp.boundaries[:1]})
    space = iga.SplineSpace(smooth)
    plate = iga.biharmonic(smooth, gluing="nearest")
    rounds = pt.Boundary([[circle()]])
    folded = mp.patches[0].with_control_points(mp.patches[0].control_points * [-1, 1] + np.arange(5)[:, None, None])
    bad = pt.certify(pt.MultiPatch([folded]))
    crossing = pt.BSplineCurve([0, 0, 1, 2, 3, 4, 4], 1, [[0, 0], [2, 2], [2, 0], [0, 2], [0, 0]])
    corner = pt.QuadLayout([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2, 3]])
    many = pt.Boundary([[circle()]] * 300)
    shelf = pt.Library({"a long name of a model " * 20: mp})
    chosen = shelf.transfer(mp.boundary())
    return {
        "Block": [pt.Block("G+Smo XML", "Function", "x" * 500)],
        "Bounds": [pt.Bounds(-1e-300, 1.25, (99, 1 / 3, 2 / 3)), result.quality.proved.max_condition_number],
        "Boundary": [rounds, mp.boundary(), many],
        "BSplineCurve": [circle(), crossing, mp.patches[0]],
        "batch.BatchOptions": [batch.BatchOptions(), batch.BatchOptions(method="paper", keep_uncertified=True)],
        "batch.BatchRow": [
            batch.BatchRow("folder/" * 40 + "a.svg", "failed", False, error="what\nwent wrong " * 30),
            batch.BatchRow("a.svg", "certified", True),
        ],
        "Certificate": [result.certificate, result.certificate.boundary, bad, *bad.cells],
        "Conformed": [pt.conform(mp)],
        "Converted": [pt.to_polynomial(conics.annulus(), 1e-3), pt.to_polynomial(mp)],
        "ContinuityReport": [result.continuity, result.continuity.kink_deg],
        "Deformer": [deformer],
        "DeformResult": [deformer.deform([[*x, *x]])],
        "iga.BiharmonicResult": [plate],
        "iga.C1Space": [iga.C1Space(space, smooth, gluing="nearest")],
        "iga.ElasticityResult": [iga.elasticity(held, {"a": (0.0, 0.0)})],
        "iga.ErrorNorms": [solved.errors],
        "iga.Field": [solved.field],
        "iga.LinearSystem": [solver.system(mp)],
        "iga.PoissonResult": [solved],
        "iga.PoissonSolver": [solver],
        "iga.SplineSpace": [space],
        "iga.Univariate": [space.bases[0][0]],
        "Interface": list(mp.interfaces),
        "Morph": [morph, *morph.frames],
        "Library": [shelf],
        "LibraryResult": [chosen],
        "LowerBounds": [result.dilatation.least],
        "MultiPatch": [mp, mp.topology, mp.vertices[0], mp.loops[0][0]],
        "PaperOptions": [pt.PaperOptions(), pt.PaperOptions("dirichlet", literal_rows=True, boundary_weight=1.0)],
        "Parameterization": [pt.parameterize(rounds)],
        "Patch": [mp.patches[0], pt.Patch([[0, 0, 1, 1]] * 2, (1, 1), np.ones((2, 2, 2)), np.ones((2, 2)))],
        "ProvedQuality": [result.quality.proved],
        "Quality": [result.quality, result.quality.scaled_jacobian],
        "QuadLayout": [corner, pt.QuadLayout.abstract([[0, 1, 2, 3]])],
        "Similarity": [result.dilatation],
        "Ranked": list(chosen.candidates),
        "Side": list(pt.Side),
        "TransferPlan": [pt.TransferPlan(mp)],
        "TransferResult": [result, result.registration, result.rows],
        "Frozen": [frozen],
        "Filled": [frozen.fill(frozen.boundary)],
        "InnerProduct": [frozen.inner_product],
        "OutlineMap": [frozen.outline(mp.boundary())],
    }


def public_classes() -> set[str]:
    """All public classes but errors and what is a function or a module."""
    found = {}
    for module, names in ((pt, pt.__all__), (iga, iga.__all__), (batch, batch.__all__)):
        prefix = "" if module is pt else f"{module.__name__.removeprefix('patchtransfer.')}."
        found |= {f"{prefix}{name}": getattr(module, name) for name in names}
    return {
        name
        for name, value in found.items()
        if inspect.isclass(value) and not issubclass(value, Exception) and not isinstance(value, types.GenericAlias)
    }


def test_every_public_class_shows_itself_on_one_line(shown):
    assert set(shown) == public_classes()
    for name, values in shown.items():
        for value in values:
            text = repr(value)
            assert "\n" not in text, f"{name}: {text}"
            assert len(text) <= LINE, f"{name}: {len(text)} characters: {text}"
            # Python's own says where a value lies in memory, and nothing of it.
            assert " object at 0x" not in text, name


def test_a_patch_says_its_degrees_size_and_kind():
    patch = pt.Patch(([0, 0, 0, 1, 1, 1], [0, 0, 1, 1]), (2, 1), np.zeros((3, 2, 2)))
    assert repr(patch) == "<Patch: degrees 2 x 1, 3 x 2 control points, B-spline>"
    rational = pt.Patch(patch.knots, patch.degrees, patch.control_points, np.ones((3, 2)))
    assert repr(rational) == "<Patch: degrees 2 x 1, 3 x 2 control points, NURBS>"
    assert repr(batch.BatchOptions(method="paper")) == "BatchOptions(method='paper')"
    assert repr(pt.Boundary([[circle()]])) == "<Boundary: 1 loop of 1 curve>"
