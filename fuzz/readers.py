"""Coverage-guided fuzzing of the readers: ``python fuzz/readers.py TARGET [libFuzzer options] CORPUS...``.

Whatever the bytes, a reader gives a value or raises an error of the package, without a warning, within 2 GB and 20
seconds. Models are certified besides, and what is proved must not be refuted by samples.
"""

from __future__ import annotations

import json
import re
import resource
import sys
import tempfile
import warnings
import zipfile
from contextlib import suppress
from pathlib import Path
from random import Random

import atheris
import numpy as np

with atheris.instrument_imports(include=["patchtransfer", "svg"]):
    import svg.path

    import patchtransfer as pt
    from patchtransfer import io
    from patchtransfer.files import json_text
    from patchtransfer.io import (
        airfoil,
        dxf,
        geojson,
        geopdes,
        gismo,
        layout_json,
        mfem,
        npz,
        points,
        splinepy_json,
        svg,
    )

#: Above what a run takes by itself, and above atheris' own tables.
MEMORY = 2 * 2**30
#: Larger models are only read: this is about readers, and hundreds of inputs a second find more than a few.
CERTIFIED_POINTS = 400
LAYOUT_POINTS = 200
#: det J below minus this part of its largest value is clearly negative.
CLEAR = 1e-6

#: Products below lose digits.
UNDERFLOW = 1e-290

#: Numbers and tags.
TOKENS = re.compile(rb"(<[^<>]*>|[-+.0-9][-+.0-9eE/]*)")
NUMBERS = [
    *(b"0 1 2 3 -1 0.5 -0.0 1e-8 1e-200 5e-324 2.2e-308 1e150 -1e150 1e151 1e308 -1e308 1e999 nan inf".split()),
    *(b"1/3 1/0 19 20 1000000 99999999999999999999 0.30000000000000004 1e16 -1e-16".split()),
]

# The sums of an archive's bytes would hide all that is behind them from changed ones.
zipfile.ZipExtFile._update_crc = lambda self, newdata: None

SQUARE = b"0,0\n1,0\n1,1\n0,1\n"


def multipatch(data: bytes) -> None:
    """A G+Smo file, its certificate and its reports."""
    model = gismo.read_multipatch(data)
    assert gismo.read_multipatch(gismo.format_multipatch(model).encode()).patches == model.patches
    check(model)


def geopdes_model(data: bytes) -> None:
    """A GeoPDEs file, told apart from points, and what is written of it."""
    geopdes.looks_like_geopdes(data)
    model = geopdes.read_multipatch(data)
    again = geopdes.read_multipatch(geopdes.format_multipatch(model).encode())
    assert again.interfaces == model.interfaces
    largest = max(np.abs(patch.control_points).max() for patch in model)
    lightest = min(1.0 if patch.weights is None else patch.weights.min() for patch in model)
    # Products of tiny numbers underflow.
    if largest * lightest > UNDERFLOW:
        for patch, other in zip(model, again, strict=True):
            assert np.abs(patch.control_points - other.control_points).max() <= 1e-15 * largest
    check(model)


def mfem_model(data: bytes) -> None:
    """An MFEM mesh, and what is written of it."""
    model = mfem.read_multipatch(data)
    again = mfem.read_multipatch(mfem.format_multipatch(model).encode())
    assert again.patches == model.patches
    assert len(again.interfaces) == len(model.interfaces)
    check(model)


def check(model: pt.MultiPatch) -> None:
    """The certificate and the reports of a small model."""
    if sum(patch.control_points.size for patch in model.patches) > 2 * CERTIFIED_POINTS:
        return
    certificate = pt.certify(model, max_depth=6)
    content = [certificate.to_dict(), pt.quality(model).to_dict(), pt.check_continuity(model).to_dict()]
    json.loads(json_text(content), parse_constant=_refuse)
    if certificate.status == "certified":
        for patch, sign in zip(model.patches, model.topology.orientation, strict=True):
            # Samples of huge models overflow, which says nothing about them.
            with np.errstate(all="ignore"):
                determinants = sign * sampled(patch)
            largest = np.abs(determinants).max()
            assert not np.isfinite(largest) or (determinants >= -CLEAR * largest).all(), "certified, but folded"


def sampled(patch: pt.Patch) -> np.ndarray:
    """Det J on a grid with the ends of all spans."""
    u, v = (np.unique(np.linspace(t[:-1], t[1:], 5)) for t in patch.knots)
    du, dv = patch.grid(u, v, 1, 0), patch.grid(u, v, 0, 1)
    return du[..., 0] * dv[..., 1] - du[..., 1] * dv[..., 0]


def npz_model(data: bytes) -> None:
    """Arrays of NumPy."""
    with suppress(pt.TransferError):
        model = npz.read_multipatch(data)
        assert npz.read_multipatch(npz.format_multipatch(model)) == model
        splinepy_json.format_multipatch(model)
    boundary = npz.read_boundary(data)
    assert len(npz.read_boundary(npz.format_boundary(boundary)).loops) == len(boundary.loops)


def splinepy_model(data: bytes) -> None:
    """Splines of splinepy in JSON."""
    with suppress(pt.TransferError):
        model = splinepy_json.read_multipatch(data)
        assert splinepy_json.read_multipatch(splinepy_json.format_multipatch(model).encode()).patches == model.patches
    splinepy_json.read_boundary(data)


def xml_boundary(data: bytes) -> None:
    """Curves or patches of a G+Smo file as a boundary."""
    boundary = gismo.read_boundary(data)
    assert gismo.read_boundary(gismo.format_boundary(boundary).encode()).loops


def csv_boundary(data: bytes) -> None:
    """Outlines as points."""
    points.looks_like_points(data)
    points.read_boundary(data)


def svg_boundary(data: bytes) -> None:
    """Paths and shapes."""
    svg.read_boundary(data)


def dxf_boundary(data: bytes) -> None:
    """Drawings of lines, arcs and splines."""
    dxf.read_boundary(data)


def json_boundary(data: bytes) -> None:
    """GeoJSON polygons."""
    geojson.looks_like_geojson(data)
    geojson.read_boundary(data)


def dat_boundary(data: bytes) -> None:
    """Airfoils."""
    airfoil.looks_like_airfoil(data)
    airfoil.read_boundary(data)


def landmarks(data: bytes) -> None:
    """Pairs of points."""
    rows = points.read_landmarks(data)
    assert rows.shape[1] == 4
    assert np.isfinite(rows).all()


def layout(data: bytes) -> None:
    """A quad layout and the model made of it."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "square.csv").write_bytes(SQUARE)
        given = layout_json.parse_layout(data, Path(folder), io.read_boundary)
        if len(given.quads) * (given.degree + given.spans) ** 2 <= LAYOUT_POINTS:
            arguments = given.vertices, given.quads, given.boundary, given.degree, given.spans
            pt.from_layout(*arguments, assignment=given.assignment)
        else:
            pt.QuadLayout(given.vertices, given.quads)


READERS = (
    multipatch,
    geopdes_model,
    mfem_model,
    npz_model,
    splinepy_model,
    xml_boundary,
    csv_boundary,
    svg_boundary,
    dxf_boundary,
    json_boundary,
    dat_boundary,
    landmarks,
    layout,
)
TARGETS = {f.__name__: f for f in READERS}


def _refuse(name: str) -> None:
    raise AssertionError(f"{name} in JSON")


def mutated(data: bytes, max_size: int, seed: int) -> bytes:
    """Half of the time change bytes, else one number or tag: most changed bytes only spoil the syntax."""
    random = Random(seed)
    tokens = TOKENS.split(data)
    places = range(1, len(tokens), 2)
    if not places or random.random() < 0.5:
        return atheris.Mutate(data, max_size)
    for _ in range(random.choice((1, 1, 2, 4))):
        i, j = random.choice(places), random.choice(places)
        kind = random.randrange(4)
        if kind == 0 and not tokens[i].startswith(b"<"):
            tokens[i] = random.choice(NUMBERS)
        elif kind == 1:
            tokens[i] = tokens[j]
        elif kind == 2:
            tokens[i] = b""
        else:
            # A piece of the file twice: a curve, a row, a group.
            a, b = min(i, j), max(i, j)
            tokens[i] += b" " + b"".join(tokens[a : min(b, a + 40)])
    return b"".join(tokens)[:max_size]


def main() -> None:
    """Fuzz the target that the first argument names."""
    name = sys.argv.pop(1)
    target = TARGETS[name]
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    warnings.simplefilter("error")
    warnings.simplefilter("ignore", pt.InputWarning)

    def one(data: bytes) -> None:
        try:
            target(data)
        except pt.TransferError:
            # What bad files are for.
            return

    # Libraries that are loaded on demand take seconds, which are not the first input's.
    for seed in sorted((Path(__file__).parent / "corpus" / name).iterdir()):
        one(seed.read_bytes())
    atheris.Setup(sys.argv, one, custom_mutator=mutated)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
