import json
import xml.etree.ElementTree as ET
from itertools import pairwise

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

import models
import patchtransfer as pt
import strategies
import targets
from commands import run
from patchtransfer import InputError, MultiPatch, NotCertifiedError, Patch, examples
from patchtransfer.cli import main
from patchtransfer.mesh.background_mesh import source_mesh
from patchtransfer.motion.morph import morph
from patchtransfer.motion.rigid_blend import RigidBlend, Similarity
from patchtransfer.plot import animation


def moved(mp, f):
    return mp.with_shared_points(f(mp.topology.coordinates))


def strip(cells=8):
    """A tall strip of patches, turned at random."""
    return models.build([models.bilinear((0, k), (1, k), (1, k + 1), (0, k + 1)) for k in range(cells)], 3, 2, 1)


@pytest.fixture(scope="module")
def human():
    source, target, landmarks = examples.load("human")
    return source, pt.transfer(source, target, landmarks).multipatch


def test_a_figure_raises_its_arms(human):
    """30 of 30 frames certified, from the standing figure to raised arms and a step, by either way."""
    a, b = human
    for way in ("auto", "rigid"):
        result = pt.morph(a, b, 30, way=way)
        assert len(result) == len(result.frames) == 30
        assert result.certified
        assert all(frame.certificate.status == "certified" for frame in result.frames)
        # Independently of the certificates that come with the frames.
        assert all(pt.certify(model).injective for model in result[5:25:6])
        assert result[0] == a
        assert result[-1] == b
        assert [frame.way for frame in result.frames[::29]] == ["given", "given"]
        steps = [np.abs(p.topology.coordinates - q.topology.coordinates).max() for p, q in pairwise(result)]
        # No jumps: not at the ends, and not in between.
        assert max(steps) < 3 * np.mean(steps)
        for model in result:
            assert model.interfaces == a.interfaces
            assert all(p.degrees == q.degrees for p, q in zip(model.patches, a.patches, strict=True))


@settings(max_examples=25, deadline=None)
@given(strategies.multipatches(rational=False), st.floats(-3, 3), st.floats(0.2, 5), st.floats(-4, 4))
def test_similar_models_keep_their_shape(mp, angle, scale, shift):
    """A similarity is taken as one: rotation as a rotation, so that every frame is similar to the ends."""
    f = targets.similarity(np.degrees(angle), scale, (shift, -2 * shift))
    result = morph(mp, moved(mp, f), 5)
    assert {frame.way for frame in result.frames[1:-1]} == {"interpolated"}
    x = mp.topology.coordinates
    for t, model in zip(np.linspace(0, 1, 5), result, strict=True):
        y = model.topology.coordinates
        between = targets.similarity(t * np.degrees(angle), scale**t)(x)
        np.testing.assert_allclose(y - y.mean(axis=0), between - between.mean(axis=0), atol=1e-9 * (1 + scale))


def test_far_turns_are_not_interpolated():
    """Bent by 190 degrees to the left, then to the right: in between straight, as long as before."""
    mp = strip()
    a, b = (moved(mp, targets.bend(mp, angle)) for angle in (190, -190))
    result = morph(a, b, 9)
    assert result.certified
    assert {frame.way for frame in result.frames[1:-1]} == {"rigid"}
    middle = result[4].topology.coordinates
    assert np.ptp(middle[:, 1]) > 0.97 * np.ptp(mp.topology.coordinates[:, 1])
    assert np.ptp(middle[:, 0]) < 1.05
    assert min(pt.quality(model).scaled_jacobian.min for model in result) > 0.9
    # The interpolation alone would have failed: that is why.
    x, y = (m.topology.coordinates for m in (a, b))
    similarity = Similarity(x, y)
    assert not pt.certify(a.with_shared_points(similarity.apply((x + similarity.undo(y)) / 2, 0.5))).injective


@pytest.mark.parametrize("way", ["auto", "rigid"])
def test_backwards_is_the_same(way):
    mp = models.o_grid(3, 2)
    a, b = moved(mp, targets.bend(mp, 60)), moved(mp, targets.swirl(mp, (0.4, 0.5), -50, 0.5))
    forth, back = morph(a, b, 6, way=way), morph(b, a, 6, way=way)
    for p, q in zip(forth, reversed(list(back)), strict=True):
        np.testing.assert_allclose(p.topology.coordinates, q.topology.coordinates, atol=1e-10)


def test_frames_are_filled_anew_where_blends_fail():
    """Strong stretches both ways: the rigid blend folds inside on some frames, its boundary does not."""
    mp, _, _ = examples.load("wrench")
    plan = pt.TransferPlan(mp, "c0")
    a, b = (plan.transfer(*targets.deformed(mp, targets.stretch(f, 0))).multipatch for f in (4, 0.25))
    result = morph(a, b, 10, way="rigid")
    assert result.certified
    assert "filled" in {frame.way for frame in result.frames}


def test_the_rigid_blend_meets_its_ends():
    mp = models.plate_with_hole(3, 2)
    mesh, _ = source_mesh(mp.topology)
    end = targets.bend(mp, 100)(mesh.points)
    blend = RigidBlend(mesh, end)
    np.testing.assert_allclose(blend.at(0), mesh.points, atol=1e-12)
    np.testing.assert_allclose(blend.at(1), end, atol=1e-12)
    # A rotation by more than half a turn cannot be told from its rest; by less it is taken as it is.
    turned = targets.similarity(150, 1.0)(mesh.points)
    half = RigidBlend(mesh, turned).at(0.5)
    expected = targets.similarity(75, 1.0)(mesh.points)
    np.testing.assert_allclose(half - half.mean(axis=0), expected - expected.mean(axis=0), atol=1e-12)


def spiral(mp, turns, pitch):
    """Rolled up by more than a turn, the end inside or outside."""

    def f(x):
        at = x[:, 1] / np.ptp(mp.topology.coordinates[:, 1])
        radius, angle = 3 + x[:, 0] + pitch * turns * (at - 0.5), 2 * np.pi * turns * at
        return np.column_stack([radius * np.cos(angle), -radius * np.sin(angle)])

    return moved(mp, f)


def test_uncertified_frames_are_reported():
    # The end passes from the outside of the roll to its inside: in between the boundary crosses itself.
    mp = strip(20)
    a, b = spiral(mp, 1.1, 1.4), spiral(mp, 1.1, -1.4)
    with pytest.raises(NotCertifiedError, match="is not certified"):
        morph(a, b, 5)
    result = morph(a, b, 5, on_failure="return")
    assert not result.certified
    assert not result.frames[2].certificate.injective
    assert f"{sum(f.certificate.injective for f in result.frames)} of 5 frames certified" in repr(result)
    seen = []
    morph(a, b, 5, on_failure="return", progress=lambda done, n: seen.append((done, n)))
    assert seen[-1] == (5, 5)


def folded(mp):
    points = mp.topology.coordinates.copy()
    points[mp.topology.interior_points] = points[mp.topology.interior_points][::-1]
    return mp.with_shared_points(points)


def test_bad_input():
    mp = models.grid(2, 2, 3, 2)
    other = models.grid(2, 2, 3, 3)
    with pytest.raises(InputError, match="at least 2"):
        morph(mp, mp, 1)
    with pytest.raises(InputError, match="way"):
        morph(mp, mp, 3, way="magic")
    with pytest.raises(InputError, match="on_failure"):
        morph(mp, mp, 3, on_failure="ignore")
    with pytest.raises(InputError, match="4 and 1 patches"):
        morph(mp, models.grid(1, 1, 3, 2))
    with pytest.raises(InputError, match="patch 0 has degrees"):
        morph(mp, other)
    with pytest.raises(InputError, match="second model is not injective"):
        morph(mp, folded(mp))
    with pytest.raises(InputError, match="glued differently"):
        morph(mp, MultiPatch(mp.patches, mp.interfaces[1:]))
    p = mp.patches[0]
    knots = [np.where((k > 0) & (k < 1), 0.4, k) for k in p.knots]
    single = MultiPatch([p])
    with pytest.raises(InputError, match="knots of patch 0"):
        morph(single, MultiPatch([Patch(knots, p.degrees, p.control_points)]))
    with pytest.raises(InputError, match="weights of patch 0"):
        morph(
            single,
            MultiPatch(
                [
                    Patch(
                        p.knots,
                        p.degrees,
                        p.control_points,
                        1 + np.arange(p.shape[0] * p.shape[1]).reshape(p.shape) % 2,
                    )
                ]
            ),
        )
    with pytest.raises(InputError, match="mirrored"):
        morph(single, MultiPatch([p.with_control_points(p.control_points * [-1, 1])]))


def test_separate_parts_are_refused_where_they_must_turn():
    p = models.grid(1, 1, 2, 2).patches[0]
    two = MultiPatch([p, p.with_control_points(p.control_points + np.array([3, 0]))])
    with pytest.raises(InputError, match="2 separate parts"):
        morph(two, two, 3, way="rigid")


def test_rational_models_are_interpolated():
    r = 0.5**0.5
    points = np.array([[[1, 0], [2, 0]], [[1, 1], [2, 2]], [[0, 1], [0, 2]]], float)
    ring = Patch(([0, 0, 0, 1, 1, 1], [0, 0, 1, 1]), (2, 1), points, [[1, 1], [r, r], [1, 1]])
    a = MultiPatch([ring])
    b = MultiPatch([ring.with_control_points(points * [1.5, 1])])
    assert morph(a, b, 4).certified


# --- command line and animations ------------------------------------------------------------------


@pytest.fixture
def files(tmp_path):
    mp = models.grid(2, 1, 2, 2)
    pt.write(mp, tmp_path / "a.xml")
    pt.write(moved(mp, targets.bend(mp, 50)), tmp_path / "b.xml")
    return tmp_path


def test_command(files):
    out = files / "out"
    result = run("morph", files / "a.xml", files / "b.xml", "-n", 4, "-o", out, "--gif")
    assert result.exit_code == 0, result.output
    assert "4 of 4 frames certified" in result.output
    names = [f"frame-{i:03}" for i in range(4)]
    kept = {"morph.gif", "morph.pvd", "report.json"}
    assert {p.name for p in out.iterdir()} == kept | {f"{n}.{kind}" for n in names for kind in ("xml", "vtu")}
    assert pt.read(out / "frame-000.xml").patches == pt.read(files / "a.xml").patches
    assert all(pt.certify(pt.read(out / f"{n}.xml")).injective for n in names)
    report = json.loads((out / "report.json").read_text())
    assert report["certified"] is True
    assert [f["file"] for f in report["frames"]] == [f"{n}.xml" for n in names]
    assert report["frames"][1]["way"] == "interpolated"
    series = ET.parse(out / "morph.pvd").findall("./Collection/DataSet")
    assert [s.get("file") for s in series] == [f"{n}.vtu" for n in names]
    assert float(series[-1].get("timestep")) == 1.0
    from PIL import Image

    with Image.open(out / "morph.gif") as picture:
        assert picture.n_frames == 6  # there and back
        assert min(picture.size) > 100


def test_command_with_bad_models(files):
    pt.write(models.grid(1, 1, 2, 2), files / "other.xml")
    out = files / "out"
    result = run("morph", files / "a.xml", files / "other.xml", "-o", out)
    assert result.exit_code == 2
    assert "patches" in result.output
    assert not out.exists()
    assert run("morph", files / "a.xml", files / "missing.xml", "-o", out).exit_code == 2
    assert run("morph", files / "a.xml", files / "b.xml", "-n", 1, "-o", out).exit_code == 2


def test_mp4(files, monkeypatch):
    model = pt.read(files / "a.xml")
    pytest.importorskip("imageio_ffmpeg")
    animation.animate([model, model], files / "m.mp4", dpi=40)
    assert (files / "m.mp4").read_bytes()[4:8] == b"ftyp"


def test_mp4_without_ffmpeg(files, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    monkeypatch.setenv("PATH", "")
    result = run("morph", files / "a.xml", files / "b.xml", "-o", files / "out", "--mp4")
    assert result.exit_code == 2
    assert "needs ffmpeg" in result.output
    assert not (files / "out").exists()


def test_bad_animations(files):
    model = pt.read(files / "a.xml")
    with pytest.raises(InputError, match="unknown format"):
        animation.animate([model], files / "m.avi")
    with pytest.raises(InputError, match="at least one frame"):
        animation.animate([], files / "m.gif")


def test_interrupted_while_writing_says_so(tmp_path, monkeypatch):
    """Frames that are written stay whole, the report does not claim the folder, and the message says so."""
    mp, _, _ = examples.load("star")
    pt.write(mp, tmp_path / "a.xml")
    write, done = pt.io.write, []

    def interrupted(model, path):
        if len(done) == 3:
            raise KeyboardInterrupt
        done.append(path)
        write(model, path)

    monkeypatch.setattr(pt.io, "write", interrupted)
    out = tmp_path / "out"
    out.mkdir()
    (out / "report.json").write_text("{}")
    found = CliRunner().invoke(main, ["morph", *[str(tmp_path / "a.xml")] * 2, "-n", "3", "-o", str(out)])
    assert found.exit_code == 130
    assert "holds a part of the files" in found.output
    assert sorted(p.name for p in out.iterdir()) == ["frame-000.vtu", "frame-000.xml", "frame-001.xml"]
