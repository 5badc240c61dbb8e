"""NumPy's .npz: everything of a model to the bit, and no archive that takes more than it says."""

from __future__ import annotations

import io
import json
import pickle
import zipfile

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import models
import patchtransfer as pt
from patchtransfer import Boundary, InputError, MultiPatch, Side
from patchtransfer.geometry.blocks import Block
from patchtransfer.io import npz, safe_npz
from strategies import boundaries, multipatches, patches

quick = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
MODEL = models.grid(2, 1, 2, 2)


@st.composite
def labelled(draw):
    """Models with names of sides and blocks of any text, halves of letters too."""
    mp = draw(multipatches())
    sides = st.tuples(st.integers(0, len(mp) - 1), st.sampled_from(Side))
    names = st.text(st.characters(), min_size=1).filter(str.strip)
    labels = draw(st.dictionaries(names, st.lists(sides, unique=True), max_size=3))
    blocks = draw(st.lists(st.builds(Block, *[st.text(st.characters())] * 3), max_size=2))
    return MultiPatch(mp.patches, mp.interfaces, mp.ids, labels, blocks)


def arrays(data: bytes) -> dict[str, np.ndarray]:
    with np.load(io.BytesIO(data), allow_pickle=False) as found:
        return dict(found)


def saved(found: dict[str, np.ndarray], save=np.savez) -> bytes:
    stream = io.BytesIO()
    save(stream, **found)
    return stream.getvalue()


def changed(**other) -> bytes:
    """The archive of a model with other arrays; None takes one out."""
    found = arrays(npz.format_multipatch(MODEL)) | other
    return saved({name: array for name, array in found.items() if array is not None})


@quick
@given(labelled())
def test_a_model_survives_with_labels_blocks_and_interfaces(mp):
    data = npz.format_multipatch(mp)
    assert npz.read_multipatch(data) == mp
    assert npz.format_multipatch(npz.read_multipatch(data)) == data


@quick
@given(patches(), st.integers(-(2**62), 2**62))
def test_any_patch_survives_to_the_bit(patch, id_):
    mp = MultiPatch([patch], (), [id_])
    assert npz.read_multipatch(npz.format_multipatch(mp)) == mp


@quick
@given(boundaries(), st.lists(st.text()))
def test_a_boundary_survives_with_its_notes(boundary, notes):
    noted = Boundary(boundary.loops, notes)
    back = npz.read_boundary(npz.format_boundary(noted))
    assert back == noted
    assert back.notes == tuple(notes)


def test_numbers_that_begin_like_the_end_of_a_line():
    """10 is a line feed."""
    knots = np.concatenate([np.zeros(3), np.arange(1, 8), np.full(3, 8.0)])
    points = np.zeros((10, 2, 2))
    points[:, :, 0], points[:, 1, 1] = np.arange(10)[:, None], 1
    mp = MultiPatch([pt.Patch((knots, [0, 0, 1, 1]), (2, 1), points)])
    assert npz.read_multipatch(npz.format_multipatch(mp)) == mp


def test_touching_patches_stay_apart():
    apart = MultiPatch(MODEL.patches, ())
    assert npz.read_multipatch(npz.format_multipatch(apart)).interfaces == ()


def test_numpy_reads_the_arrays_and_compressed_ones_are_read(tmp_path):
    pt.write(MODEL, tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz", allow_pickle=False) as found:
        points = found["control_points"]
        assert np.array_equal(points, np.concatenate([p.control_points.reshape(-1, 2) for p in MODEL]))
        np.savez_compressed(tmp_path / "b.npz", **found)
    assert pt.read(tmp_path / "b.npz") == MODEL
    # By content, whatever it is called.
    (tmp_path / "b.npz").rename(tmp_path / "b.xml")
    assert pt.read(tmp_path / "b.xml") == MODEL
    assert pt.read_boundary(tmp_path / "b.xml") == MODEL.boundary()


def test_other_byte_orders_and_sizes_of_numbers_are_read():
    found = arrays(npz.format_multipatch(MODEL))
    swapped = {k: a.astype(a.dtype.newbyteorder(">")) for k, a in found.items()}
    small = swapped | {
        "degrees": found["degrees"].astype(np.uint8),
        "control_points": np.asfortranarray(found["control_points"]),
    }
    assert npz.read_multipatch(saved(small)) == MODEL


def texts(**other) -> np.ndarray:
    return np.frombuffer(json.dumps({"kind": "multipatch"} | other).encode(), np.uint8)


TEXTS = {"format": "a", "kind": "b", "text": "c"}
N = len(MODEL.patches[0].control_points.reshape(-1, 2)) * 2
FAULTS = {
    "version": (changed(patchtransfer=np.int64(2)), "version 2.*update patchtransfer"),
    "other file": (changed(patchtransfer=None), "not a file that patchtransfer wrote"),
    "missing": (changed(knots=None), "'knots' is missing"),
    "kind of numbers": (changed(knots=np.zeros(3, int)), "'knots' holds int64"),
    "complex": (changed(more=np.zeros(3, complex)), "'more.npy' is not an array of numbers"),
    "texts": (changed(patchtransfer=np.array("1")), "not an array of numbers"),
    "degree": (changed(degrees=np.full((2, 2), 20)), "20 as degree, at most 19"),
    "degree 0": (changed(degrees=np.zeros((2, 2), int)), "not positive"),
    "huge degree": (changed(degrees=np.full((2, 2), 2**63, np.uint64)), "18 digits"),
    "counts": (changed(counts=np.full((2, 2), 4000)), r"'knots' has shape .* needed is \(16012,\)"),
    "many": (changed(counts=np.full((2, 2), 5001)), "5001 control points in one direction"),
    "no patches": (changed(degrees=np.zeros((0, 2), int), rational=np.zeros(0, bool)), "as many"),
    "shape": (changed(control_points=np.zeros((N, 3))), rf"\({N}, 3\), needed is \({N}, 2\)"),
    "NaN": (changed(control_points=np.full((N, 2), np.nan)), "'control_points' holds NaN"),
    "large": (changed(control_points=np.full((N, 2), -1e200)), "above 1e.150"),
    "knots": (changed(knots=np.arange(28.0)), "knot vector is not clamped"),
    "sides": (changed(interfaces=np.array([[0, 5, 1, 1, 0]])), "a side is not 1, 2, 3 or 4"),
    "patch": (changed(interfaces=np.array([[0, 1, 7, 1, 0]])), "there is no patch 7"),
    "ids": (changed(ids=np.array([3, 3])), "distinct ids"),
    "JSON": (changed(texts=np.frombuffer(b"{", np.uint8)), "texts: not an object"),
    "no kind": (changed(texts=np.frombuffer(b"{}", np.uint8)), "texts: not an object"),
    "deep": (changed(texts=np.frombuffer(b"[" * 100_000, np.uint8)), "texts: not an object"),
    "labels": (changed(texts=texts(labels={"a": [[0]]})), "labels are not"),
    "label's side": (changed(texts=texts(labels={"a": [[0, 9]]})), "not one of 1, 2, 3, 4"),
    "label's patch": (changed(texts=texts(labels={"a": [[True, 1]]})), "labels are not"),
    "blocks": (changed(texts=texts(blocks=[["a", "b"]])), "blocks are not"),
    "no blocks": (changed(texts=texts(blocks=3)), "blocks are not"),
    "field of a block": (changed(texts=texts(blocks=[TEXTS | {"d": 1}])), "blocks are not"),
    "number in a block": (changed(texts=texts(blocks=[TEXTS | {"text": 1}])), "blocks are not"),
    "many interfaces": (changed(interfaces=np.ones((5, 5), int)), "5 interfaces .*, at most 4"),
    "few ids": (changed(ids=np.array([3])), "1 ids for 2 patches"),
    "pickle": (saved({"a": np.array([{}], dtype=object)}), "not an array of numbers"),
}  # fmt: skip


@pytest.mark.parametrize("case", FAULTS)
def test_faults_are_named(case):
    data, message = FAULTS[case]
    with pytest.raises(InputError, match=message):
        npz.read_multipatch(data)


def test_a_boundary_is_no_model_and_its_loops_must_add_up():
    data = npz.format_boundary(MODEL.boundary())
    with pytest.raises(InputError, match="holds only a boundary; use read_boundary"):
        npz.read_multipatch(data)
    for loops in ([2], [-1, 7], [0, 6]):
        with pytest.raises(InputError, match="do not add up to 6"):
            npz.read_boundary(saved(arrays(data) | {"loops": np.array(loops)}))


# --- hostile archives -----------------------------------------------------------------------------


class Bomb:
    def __reduce__(self):
        return print, ("unpickled",)


def archive(members: dict[str, bytes], method: int = zipfile.ZIP_DEFLATED, comment: bytes = b"") -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method) as made:
        made.comment = comment
        for name, content in members.items():
            made.writestr(name, content)
    return stream.getvalue()


def header(shape: str, descr: str = "'<f8'") -> bytes:
    text = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}".encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text


def refused(data: bytes, message: str) -> None:
    with pytest.raises(InputError, match=message):
        safe_npz.arrays_of(data)


def test_nothing_is_unpickled(capsys):
    refused(archive({"a.npy": header("(1,)", "'|O'") + pickle.dumps([Bomb()])}), "not an array of numbers")
    refused(archive({"a.npy": pickle.dumps(Bomb())}), "not an array")
    assert capsys.readouterr().out == ""


def test_what_unpacks_to_more_than_a_file_may_have_is_not_unpacked():
    refused(archive({"a.npy": bytes(100 * 2**20)}), "unpacks to more than 64 MB")
    refused(archive({f"{k}.npy": bytes(40 * 2**20) for k in range(2)}), "unpacks to more than 64 MB")


def test_a_stated_size_that_is_too_small_is_not_exceeded():
    """The packed bytes unpack to 40 MB, the archive says 200 bytes: no more is unpacked."""
    import tracemalloc

    data = archive({"a.npy": header("(9,)") + bytes(40 * 2**20)})
    size = (40 * 2**20 + len(header("(9,)"))).to_bytes(4, "little")
    tracemalloc.start()
    refused(data.replace(size, (200).to_bytes(4, "little")), "damaged|bytes, not those")
    assert tracemalloc.get_traced_memory()[1] < 2**20
    tracemalloc.stop()


@pytest.mark.parametrize("shape", ["(1000000000000,)", "(-1,)", "(4294967296, 4294967296)", "(0, -1)", "(3,)"])
def test_shapes_that_the_numbers_do_not_fill_are_refused(shape):
    refused(archive({"a.npy": header(shape) + bytes(16)}), "not those of its shape|not an array")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"PK\x03\x04", "cut off"),
        (npz.format_multipatch(MODEL)[:-7], "cut off"),
        (archive({}, comment=b"hello"), "comment"),
        (archive({f"{k}": b"" for k in range(3000)}), "list of the archive's members"),
        (archive({"a.npy": b""}, zipfile.ZIP_LZMA), "packed in a way"),
        (archive({"a.npy": b"\x93NUMPY\x09\x00"}), "not an array"),
        (archive({"a.npy": header("(" * 2000)}), "not an array"),
        (archive({"a.npy": header("(1,)", "'<f7'") + bytes(7)}), "no kind of number"),
        (archive({"a.npy": header("(1,)", "'<a8'") + bytes(8)}), "not an array"),
        (archive({"a.npy": header("*__import__('os').getcwd()")}), "not an array"),
    ],
)  # fmt: skip
def test_damaged_archives(data, message):
    refused(data, message)


@settings(max_examples=100, deadline=None)
@given(st.data())
def test_changed_bytes_give_a_model_or_an_error_of_the_package(data):
    content = bytearray(npz.format_multipatch(MODEL))
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    cut = data.draw(st.integers(0, 1)) * data.draw(st.integers(1, 200))
    try:
        npz.read_multipatch(bytes(content[: len(content) - cut]))
    except pt.TransferError:
        return
