"""Figures: files written whole and reproducibly, no global state, folded places in a colour of their own."""

import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from matplotlib.colors import to_hex

import patchtransfer as pt
from patchtransfer import plot
from patchtransfer.plot.palette import LIGHT

KNOTS = [0, 0, 0, 0.5, 1, 1, 1]
PNG = b"\x89PNG\r\n\x1a\n"


def square(x: float = 0.0) -> pt.Patch:
    g = np.array([0, 0.25, 0.75, 1])
    points = np.stack(np.meshgrid(g + x, g, indexing="ij"), axis=2)
    return pt.Patch((KNOTS, KNOTS), (2, 2), points)


@pytest.fixture
def model() -> pt.MultiPatch:
    return pt.MultiPatch([square(), square(1)])


@pytest.fixture
def star() -> pt.MultiPatch:
    at = np.pi / 3 * np.arange(7)
    ring = np.array([np.cos(at), np.sin(at)]).T
    patches = []
    for k in (0, 2, 4):
        corners = [[[0, 0], ring[k + 2]], [ring[k], ring[k + 1]]]
        patches.append(pt.Patch(([0, 0, 1, 1],) * 2, (1, 1), corners))
    return pt.MultiPatch(patches)


def collections(figure):
    return [c for ax in figure.axes for c in ax.collections if c.get_array() is not None]


def test_iso_lines_cover_the_model_and_carry_the_scaled_jacobian(model):
    figure = plot.multipatch(model, iso_lines=3)
    thin, thick = [c for c in figure.axes[0].collections if c.get_array() is not None]
    x = np.unique(np.concatenate(thin.get_segments())[:, 0].round(9))
    assert {round(k / 6, 9) for k in range(1, 6)} <= set(x)
    np.testing.assert_allclose(thin.get_array(), 1)
    ends = np.concatenate(thick.get_segments())
    np.testing.assert_allclose([ends.min(axis=0), ends.max(axis=0)], [[0, 0], [2, 1]], atol=1e-15)
    # Every iso-line once: two patches, two directions, five lines of length one.
    lengths = [np.hypot(*np.diff(s, axis=0).T).sum() for s in thin.get_segments()]
    assert sum(lengths) == pytest.approx(20)


def test_folded_places_have_a_colour_of_their_own(model):
    points = [p.control_points.copy() for p in model.patches]
    points[0][1, 1] = [0.9, 0.9]
    worst = pt.quality(model.with_control_points(points)).scaled_jacobian.min
    assert worst < 0
    lines = collections(plot.multipatch(model.with_control_points(points)))
    for colors in (c.cmap(c.norm(np.array([-0.5, 0.0, 1e-6]))) for c in lines):
        np.testing.assert_allclose(colors[0], colors[1])
        assert to_hex(colors[0]) == LIGHT.folded
        assert abs(colors[2] - colors[1]).max() > 0.5
    assert min(c.get_array().min() for c in lines) < 0


def test_extraordinary_vertices_are_marked(star, model):
    (marks,) = [line for line in plot.multipatch(star).axes[0].lines if line.get_marker() == "o"]
    np.testing.assert_allclose(marks.get_xydata(), [[0, 0]], atol=1e-15)
    assert plot.multipatch(star).axes[0].get_legend() is not None
    assert plot.multipatch(model).axes[0].get_legend() is None


def test_draws_into_given_axes(model):
    from matplotlib.figure import Figure

    ax = Figure().subplots()
    assert plot.multipatch(model, ax, colorbar=False) is ax.figure
    assert plot.boundary(model.boundary(), ax) is ax.figure
    assert len(ax.figure.axes) == 1
    with pytest.raises(pt.InputError, match="iso_lines = 0"):
        plot.multipatch(model, iso_lines=0)


def test_transfer_has_three_panels_and_one_colour_bar(star):
    bigger = star.with_control_points([3 * p.control_points for p in star.patches])
    figure = plot.transfer(star, bigger.boundary(), bigger, caption="minimum 0.87")
    assert len(figure.axes) == 4
    assert [ax.get_title() for ax in figure.axes[:3]] == ["source", "target", "result"]
    scales = [np.ptp(ax.get_xlim()) for ax in figure.axes[:3]]
    assert scales[1:] == pytest.approx([3 * scales[0]] * 2)


def test_registration_colours_matched_joints_alike(star):
    source = star.boundary()
    image = star.with_control_points([2 * p.control_points for p in star.patches]).boundary()
    joints = [[*curve.start, *(2 * curve.start)] for curve in source.loops[0]]
    figure = plot.registration(source, image, joints, target=image)
    left, right = ([c for c in ax.collections if len(c.get_offsets()) == 6] for ax in figure.axes)
    np.testing.assert_array_equal(left[0].get_facecolors(), right[0].get_facecolors())
    assert len(np.unique(left[0].get_facecolors(), axis=0)) == 6
    np.testing.assert_allclose(right[0].get_offsets(), 2 * np.array(left[0].get_offsets()))
    for ax, scale in zip(figure.axes, (1, 2), strict=True):
        assert [text.get_text() for text in ax.texts] == list("123456")
        # Numbers stand outside the loop.
        assert all(np.dot(text.xy, text.xyann) > 0 for text in ax.texts), scale
    with pytest.raises(pt.InputError, match=r"\(r, 4\)"):
        plot.registration(source, image, np.zeros((3, 2)))


@pytest.mark.parametrize(("suffix", "magic"), [(".png", PNG), (".svg", b"<?xml"), (".PDF", b"%PDF")])
def test_files_are_reproducible(tmp_path, model, suffix, magic):
    first, second = tmp_path / f"a{suffix}", tmp_path / f"b{suffix}"
    for path in (first, second):
        plot.savefig(plot.multipatch(model), path)
    assert first.read_bytes().startswith(magic)
    assert first.read_bytes() == second.read_bytes()
    assert not re.search(rb"20\d\d-\d\d-\d\dT|CreationDate", first.read_bytes())
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([first.name, second.name])


def test_refuses_what_cannot_be_written_and_leaves_nothing(tmp_path, model):
    figure = plot.multipatch(model)
    with pytest.raises(pt.InputError, match=r"unknown figure format '.gif'; use .png, .svg or .pdf"):
        plot.savefig(figure, tmp_path / "a.gif")
    with pytest.raises(pt.InputError, match="does not exist; create it first"):
        plot.savefig(figure, tmp_path / "missing" / "a.png")
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(pt.InputError, match="this is a folder"):
        plot.savefig(figure, tmp_path / "folder.png")
    assert [p.name for p in tmp_path.iterdir()] == ["folder.png"]


def test_threads_draw_the_same_picture(model):
    expected = plot.png(model)
    with ThreadPoolExecutor(4) as pool:
        assert all(image == expected for image in pool.map(lambda _: plot.png(model), range(8)))


def test_no_global_state():
    """Importing loads no matplotlib, drawing no pyplot; settings stay as they were."""
    code = """
import sys, patchtransfer as pt
assert not any(m.split(".")[0] == "matplotlib" for m in sys.modules)
mp = pt.MultiPatch([pt.Patch(([0, 0, 1, 1],) * 2, (1, 1), [[[0, 0], [0, 1]], [[1, 0], [1, 1]]])])
import matplotlib
def settings():  # asking for the backend would choose one
    return {k: matplotlib.rcParams[k] for k in matplotlib.rcParams if k != "backend"}
before = settings()
assert pt.plot.png(mp)
assert settings() == before
assert "matplotlib.pyplot" not in sys.modules
import patchtransfer.measure.quality
assert callable(pt.quality) and pt.quality(mp).scaled_jacobian.min == 1
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_a_boundary_that_does_not_close_can_be_looked_at():
    """Two squares that touch in a corner have no simple boundary loops."""
    patches = [square(), pt.Patch((KNOTS, KNOTS), (2, 2), square(1).control_points + np.array([0, 1]))]
    touching = pt.MultiPatch(patches, [])
    corner = pt.Patch((KNOTS, KNOTS), (2, 2), np.flip(square(1).control_points, 1) * [1, -1] + [0, 1])
    glued = pt.MultiPatch([patches[0], corner])
    for mp in (touching, glued):
        assert len(collections(plot.multipatch(mp, colorbar=False))) == 2


def test_dilatation_is_drawn_with_ellipses_of_its_ratio(tmp_path):
    """A stretch by 3 along x: one colour, and ellipses three times as long as wide."""
    a = pt.MultiPatch([square(), square(1)])
    b = a.with_control_points([p.control_points * [3.0, 1.0] for p in a.patches])
    figure = plot.dilatation(a, b, title="stretched")
    ax = figure.axes[0]
    meshes = [c for c in ax.collections if type(c).__name__ == "QuadMesh"]
    assert len(meshes) == 2
    for mesh in meshes:
        np.testing.assert_allclose(mesh.get_array(), np.log(3))
    (ellipses,) = (c for c in ax.collections if type(c).__name__ == "PolyCollection")
    for path in ellipses.get_paths():
        width, height = np.ptp(path.vertices, axis=0)
        assert width == pytest.approx(3 * height)
    plot.savefig(figure, tmp_path / "d.png")
    with pytest.raises(pt.InputError, match="2 and 1 patches"):
        plot.dilatation(a, pt.MultiPatch([square()]))


def test_slope_difference_draws_angles_of_both_models():
    """Known angles: the right square's first column is turned about the interface by 20 degrees before, not after."""
    after = pt.MultiPatch([square(), square(1)])
    points = [p.control_points.copy() for p in after.patches]
    turn = np.radians(20)
    points[1][1] = points[1][0] + 0.25 * np.array([np.cos(turn), np.sin(turn)])
    before = after.with_control_points(points)
    figure = plot.slope_difference(before, after)
    (ax,) = figure.axes
    red, blue = ax.lines
    np.testing.assert_allclose(red.get_ydata(), 20)
    np.testing.assert_allclose(blue.get_ydata(), 0, atol=1e-9)
    np.testing.assert_allclose(red.get_xdata(), [1, 2, 3, 4])
    assert ax.get_title() == "patch 0 east - patch 1 west"
    assert len(plot.slope_difference(before, after, [0]).axes) == 1


def test_slope_difference_refuses_other_models(model, star):
    with pytest.raises(pt.InputError, match="same interfaces"):
        plot.slope_difference(model, star)
    with pytest.raises(pt.InputError, match="at least one"):
        plot.slope_difference(pt.MultiPatch([square()]), pt.MultiPatch([square()]))
    with pytest.raises(pt.InputError, match="interface 3 does not exist; there are 1"):
        plot.slope_difference(model, model, [3])
