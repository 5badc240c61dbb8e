"""Models as G+Smo has them, through pygismo; tests that need it are skipped without."""

import pytest

import patchtransfer as pt


def gismo_model(path):
    """The gsMultiPatch in a file."""
    pygismo = pytest.importorskip("pygismo")
    model = pygismo.core.gsMultiPatch()
    pygismo.io.gsFileData(str(path)).getAnyFirst(model)
    return model


def gismo_finds_interfaces(model):
    """The same patches, glued by where they are: the file's interfaces stay behind with its model."""
    found = pytest.importorskip("pygismo").core.gsMultiPatch()
    for k in range(model.nPatches()):
        found.addPatch(model.patch(k))
    assert not gismo_sides(found)
    # Tolerance; not by corners only; no T-junctions.
    found.computeTopology(1e-6, False, False)
    return found


def gismo_sides(model) -> set[frozenset[tuple[int, int]]]:
    """Glued sides of a gsMultiPatch."""
    return {frozenset((s.patchIndex(), s.index()) for s in (f.first(), f.second())) for f in model.interfaces()}


def glued_sides(mp: pt.MultiPatch) -> set[frozenset[tuple[int, int]]]:
    """Glued sides of a model of ours, numbered as G+Smo does."""
    return {frozenset([(f.patch_a, int(f.side_a)), (f.patch_b, int(f.side_b))]) for f in mp.interfaces}
