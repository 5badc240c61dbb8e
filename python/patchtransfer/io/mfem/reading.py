"""Reading MFEM NURBS meshes, in both forms."""

from __future__ import annotations

import re
import warnings
from collections import defaultdict

import numpy as np

from ...errors import InputError, InputWarning
from ...geometry.blocks import Block
from ...geometry.boundary import Boundary
from ...geometry.multipatch import MultiPatch
from ...geometry.patch import Patch
from ...geometry.sides import Side
from ...limits import MAX_ALONG, MAX_PATCHES
from ...numeric.arrays import FloatArray
from ..options import DEFAULT, BoundaryOptions
from ..tensor import boundary_of, check_sizes, exchanged, patch_of
from ..text import TextLines, Words
from .dofs import KnotVector, patch_dofs, patch_knots
from .mesh import NAME, CoarseMesh, Comments, pair, read_comments, read_mesh, section

__all__ = ["looks_like_mfem", "read_boundary", "read_multipatch"]

#: Numbers of a spacing function: more than any of MFEM's has.
MAX_PARAMETERS = 100_000


def looks_like_mfem(data: bytes) -> bool:
    """Whether a file starts as MFEM's meshes do."""
    return data[:64].removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"MFEM ")


def read_multipatch(data: bytes) -> MultiPatch:
    """Multi-patch of an MFEM NURBS mesh; see `patchtransfer.read`."""
    lines = TextLines(data)
    _check_kind(lines.next("the kind of mesh"))
    words = Words(lines)
    mesh = read_mesh(words)
    # Ours stand at the top.
    comments = read_comments(lines.comments, len(mesh.elements))
    form = words.next("the section 'patches' or 'knotvectors'")
    if form == "patches":
        patches = _patches(words, len(mesh.elements))
    elif form == "knotvectors":
        patches = _patches_of_dofs(words, mesh)
    else:
        raise InputError(
            f"line {words.number}: section {form[:30]!r} instead of 'patches' or 'knotvectors'; correct it"
        )
    if not words.at_end() and (word := words.next("")) != "mfem_mesh_end":
        lost = f"line {words.number}: what follows from {word[:30]!r} on is not read"
        warnings.warn(lost, InputWarning, stacklevel=3)
    patches = [exchanged(patch) if k in comments.exchanged else patch for k, patch in enumerate(patches)]
    mesh = mesh.exchanged(comments.exchanged)
    blocks = []
    if set(mesh.attributes) != {1}:
        blocks.append(Block(NAME, "element attributes", " ".join(map(str, mesh.attributes))))
    return MultiPatch(patches, mesh.interfaces(), None, _labels(mesh, comments), blocks)


def read_boundary(data: bytes, options: BoundaryOptions = DEFAULT) -> Boundary:
    """Boundary of an MFEM NURBS mesh; see `patchtransfer.read_boundary`."""
    return boundary_of(read_multipatch(data))


def _check_kind(line: str) -> None:
    if re.fullmatch(r"MFEM NURBS mesh v1\.[01]", line):
        return
    if line.startswith("MFEM NURBS NC"):
        raise InputError(
            "a non-conforming mesh, whose patches have hanging nodes; only conforming ones are supported: split the "
            "patches beside each hanging node right across"
        )
    if line.startswith("MFEM NURBS"):
        raise InputError(f"{line[:60]!r} is not known; {NAME} v1.0 and v1.1 are")
    raise InputError(f"{line[:60]!r} is no NURBS mesh; only '{NAME} v1.0' and 'v1.1' hold patches")


def _labels(mesh: CoarseMesh, comments: Comments) -> dict[str, list[tuple[int, Side]]]:
    """Sides by the names of their attributes."""
    sides = mesh.sides()
    labels: dict[str, dict[tuple[int, Side], None]] = defaultdict(dict)
    for attribute, a, b in mesh.boundary:
        # Of an edge inside the first patch's side stands for both.
        side = sides[pair(a, b)][0]
        for name in comments.labels.get(attribute, [f"attribute {attribute}"]):
            labels[name][side] = None
    return {name: list(named) for name, named in labels.items()}


def _knots(words: Words, what: str) -> KnotVector:
    """Degree, number of control points, knots."""
    degree, count = words.integer(f"degree of {what}"), words.integer(f"number of control points of {what}")
    check_sizes([degree], [count], 0, f"line {words.number}, {what}")
    return words.numbers(f"knots of {what}", degree + count + 1), degree


def _patches(words: Words, count: int) -> list[Patch]:
    """Patches with knots and control points of their own."""
    patches, total = [], 0
    for k in range(count):
        where = f"patch {k}"
        section(words, "knotvectors")
        if (directions := words.integer(f"the number of knot vectors of {where}")) != 2:
            raise InputError(f"line {words.number}: {where} has {directions} knot vectors; a planar patch has two")
        knots = [_knots(words, f"knot vector {axis} of {where}") for axis in "uv"]
        degrees, shape = [p for _, p in knots], [len(t) - p - 1 for t, p in knots]
        total = check_sizes(degrees, shape, total, where)
        section(words, "dimension")
        dimension = words.integer(f"the dimension of {where}")
        if dimension not in (2, 3):
            raise InputError(f"line {words.number}: {where} lies in space of dimension {dimension}; it must be 2")
        kind = words.next(f"control points of {where}")
        if kind not in ("controlpoints", "controlpoints_homogeneous", "controlpoints_cartesian"):
            raise InputError(f"line {words.number}: control points of {where} should stand here, got {kind[:30]!r}")
        values = words.numbers(f"control points of {where}", shape[0] * shape[1] * (dimension + 1))
        net = values.reshape(shape[1], shape[0], dimension + 1).transpose(1, 0, 2)
        weighted = kind != "controlpoints_cartesian"
        patches.append(patch_of(where, [t for t, _ in knots], degrees, net[..., :-1], net[..., -1], weighted))
    return patches


def _patches_of_dofs(words: Words, mesh: CoarseMesh) -> list[Patch]:
    """Patches from knot vectors, weights and points that they share."""
    count = words.count("knot vectors", 2 * MAX_PATCHES, "split the model")
    knots = patch_knots(mesh, [_knots(words, f"knot vector {k}") for k in range(count)])
    shapes = [(len(u) - p - 1, len(v) - q - 1) for (u, p), (v, q) in knots]
    total = 0
    for k, ((_, p), (_, q)) in enumerate(knots):
        total = check_sizes((p, q), shapes[k], total, f"patch {k}")
    dofs, size = patch_dofs(mesh, shapes)
    weights = _weights(words, size, count)
    points = _points(words, size, {degree for both in knots for _, degree in both})
    return [
        patch_of(f"patch {k}", [u, v], [p, q], points[index], weights[index], False)
        for k, (((u, p), (v, q)), index) in enumerate(zip(knots, dofs, strict=True))
    ]


def _weights(words: Words, size: int, vectors: int) -> FloatArray:
    """The section of weights, behind those of how MFEM refines, which are named and left."""
    while (name := words.next("the section 'weights'")) not in ("weights", "unitweights", "autoweights"):
        at = words.number
        if name == "periodic":
            raise _periodic(words, name)
        if name == "mesh_elements":
            raise InputError(f"line {at}: holds a part of a mesh ('mesh_elements'); save the whole mesh")
        if name == "refinements":
            words.numbers(name, 2)
        elif name == "knotvector_refinements":
            for _ in range(vectors):
                words.numbers(name, words.count(f"factors of {name}", MAX_ALONG, "correct the number"))
        elif name == "spacing":
            if not (functions := words.count("spacing functions", vectors, "correct the number")):
                continue
            for _ in range(functions):
                words.numbers(name, 2)
                sizes = [words.count("parameters of a spacing function", MAX_PARAMETERS, "correct it") for _ in "ir"]
                words.numbers(name, sum(sizes))
        else:
            raise InputError(f"line {at}: section 'weights' should stand here, got {name[:30]!r}; correct it")
        lost = f"line {at}: section {name!r} says how MFEM refines the mesh; it is not kept"
        warnings.warn(lost, InputWarning, stacklevel=5)
    return words.numbers("weights", size) if name == "weights" else np.ones(size)


def _periodic(words: Words, name: str) -> InputError:
    where = words.number
    lists = [
        [words.integer(name) for _ in range(words.count("periodic boundaries", 4 * MAX_PATCHES, "correct it"))]
        for _ in range(2)
    ]
    glued = ", ".join(f"{a} to {b}" for a, b in list(zip(*lists, strict=False))[:3])
    return InputError(
        f"line {where}: a periodic mesh (section {name!r} glues boundary attributes {glued}) is not supported; "
        "save the mesh before its boundaries are connected"
    )


def _points(words: Words, size: int, degrees: set[int]) -> FloatArray:
    """Points (size, 2 or 3) of the degrees of freedom, the section ``FiniteElementSpace``."""
    newer = False
    if (name := words.next("the section 'FiniteElementSpace'")) == "MFEM":
        newer = True
        section(words, "FiniteElementSpace")
        section(words, "v1.0")
    elif name != "FiniteElementSpace":
        raise InputError(f"line {words.number}: section 'FiniteElementSpace' should stand here, got {name[:30]!r}")
    section(words, "FiniteElementCollection:")
    _check_degree(words, words.next("the finite elements of the points"), degrees)
    section(words, "VDim:")
    dimension = words.integer("VDim")
    if dimension not in (2, 3):
        raise InputError(f"line {words.number}: points of {dimension} coordinates; planar ones have 2")
    section(words, "Ordering:")
    if (ordering := words.integer("Ordering")) not in (0, 1):
        raise InputError(f"line {words.number}: Ordering {ordering} is neither 0 nor 1; correct it")
    if newer:
        _end_of_space(words)
    values = words.numbers("points of the degrees of freedom", dimension * size)
    return values.reshape(size, dimension) if ordering else values.reshape(dimension, size).T


def _check_degree(words: Words, collection: str, degrees: set[int]) -> None:
    """Refuse points of other splines than the knot vectors'."""
    found = re.fullmatch(r"NURBS([0-9]{0,4})", collection)
    if not found:
        raise InputError(
            f"line {words.number}: points in {collection[:30]!r} are not NURBS; save the NURBS mesh itself"
        )
    # Without a number, or with 0 digits, each knot vector has its own degree.
    if found[1] and {int(found[1])} != degrees:
        mesh = " and ".join(map(str, sorted(degrees)))
        raise InputError(
            f"line {words.number}: points of degree {found[1]} on knot vectors of degree {mesh} are not supported; "
            "elevate the mesh in MFEM first"
        )


def _end_of_space(words: Words) -> None:
    word = words.next("the end of FiniteElementSpace")
    if word == "NURBS_periodic":
        raise _periodic(words, word)
    if word != "End:":
        raise InputError(
            f"line {words.number}: {word[:30]!r}, points on other splines than the mesh's, is not supported"
        )
    for name in ("MFEM", "FiniteElementSpace", "v1.0"):
        section(words, name)
