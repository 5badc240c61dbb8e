"""What lines are coloured by, and with what: one scale for all pictures, which the colour-blind can read."""

import re

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

import patchtransfer as pt
from patchtransfer import plot
from patchtransfer.plot.palette import CLASSES, DARK, LIGHT, colours_of_patches
from patchtransfer.plot.quantities import QUANTITIES
from patchtransfer.web.report import render

#: How the colour-blind see linear RGB (Machado, Oliveira, Fernandes 2009, severity 1).
SEEN = {
    "normal": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}
KNOTS = [0, 0, 0, 1, 1, 1]


def linear(colour: str) -> np.ndarray:
    c = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def lab(colour: str, seen) -> np.ndarray:
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    xyz = to_xyz @ np.clip(np.array(seen) @ linear(colour), 0, 1) / [0.95047, 1, 1.08883]
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("palette", [LIGHT, DARK], ids=["light", "dark"])
@pytest.mark.parametrize("seen", SEEN.values(), ids=SEEN.keys())
def test_classes_differ_for_the_colour_blind(palette, seen):
    """A just noticeable difference is 2.3: by six of them above 0.7, and by four anywhere."""
    shades = [lab(colour, seen) for colour in palette.classes()[1:]]
    apart = {(j, k): float(np.sqrt(((shades[j] - shades[k]) ** 2).sum())) for k in range(len(shades)) for j in range(k)}
    steps = [apart[k, k + 1] for k in range(len(shades) - 1)]
    assert min(apart.values()) > 8
    assert min(steps) > 10
    assert min(steps[CLASSES.index(0.8) - 1 :]) > 14


@pytest.mark.parametrize(("palette", "ground"), [(LIGHT, "#ffffff"), (DARK, "#15181c")], ids=["light", "dark"])
def test_lines_stand_out_from_the_ground(palette, ground):
    weights = np.array([0.2126, 0.7152, 0.0722])
    below = float(weights @ linear(ground))
    for colour in palette.classes():
        low, high = sorted((below, float(weights @ linear(colour))))
        assert (high + 0.05) / (low + 0.05) > 3


def test_pages_and_figures_have_the_same_colours():
    page = render("index.html.j2", title="", source="", entries=[], done=0, command=None)
    light, dark = page.split("prefers-color-scheme: dark", 1)
    for text, palette in ((light, LIGHT), (dark, DARK)):
        for k, colour in enumerate(palette.classes()):
            assert f"--q{k}:{colour};" in text
    colormap, norm = QUANTITIES["scaled_jacobian"].scale()
    assert to_hex(colormap(norm(0.0))) == LIGHT.folded
    # Both steps of a class lie about its colour.
    for k, (low, high) in enumerate(zip(CLASSES, (*CLASSES[1:], 1.0), strict=True), 1):
        steps = [linear(to_hex(colormap(norm(low + part * (high - low))))) for part in (0.25, 0.75)]
        middle = linear(LIGHT.classes()[k])
        assert (np.minimum(*steps) - 0.02 <= middle).all()
        assert (middle <= np.maximum(*steps) + 0.02).all()


def test_neighbours_have_different_tints():
    pairs = [(k, m) for k in range(12) for m in (k + 1, k + 3, k + 4) if m < 12]
    tints = colours_of_patches(12, pairs)
    assert all(tints[a] != tints[b] for a, b in pairs)
    assert set(tints) <= set(range(len(LIGHT.patches)))


def moved(mp: pt.MultiPatch, x: float) -> pt.Patch:
    return mp.patches[0].with_control_points(mp.patches[0].control_points + np.array([x, 0]))


def rectangle(width: float, height: float, shear: float = 0.0) -> pt.MultiPatch:
    u, v = np.meshgrid([0, 0.5, 1], [0, 0.5, 1], indexing="ij")
    return pt.MultiPatch([pt.Patch((KNOTS, KNOTS), (2, 2), np.stack([width * u + shear * v, height * v], axis=-1))])


def drawn(figure: Figure) -> np.ndarray:
    found = [c.get_array() for c in figure.axes[0].collections if c.get_array() is not None]
    return np.concatenate(found)


def test_quantities_are_those_of_affine_maps():
    """A rectangle of 3 to 1, sheared or not, against the unit square."""
    square, long = rectangle(1, 1), rectangle(3, 1)
    np.testing.assert_allclose(drawn(plot.multipatch(long, color="condition")), (3**2 + 1) / 3)
    np.testing.assert_allclose(drawn(plot.multipatch(long, color="dilatation", source=square)), 3)
    np.testing.assert_allclose(drawn(plot.multipatch(long, color="stretch", source=square)), 1)
    sheared = rectangle(1, 1, shear=1)
    np.testing.assert_allclose(drawn(plot.multipatch(sheared)), np.sqrt(0.5))
    # Of the shear the stretches are the golden ratio and its inverse.
    golden = ((1 + np.sqrt(5)) / 2) ** 2
    np.testing.assert_allclose(drawn(plot.multipatch(sheared, color="dilatation", source=square)), golden)


def test_stretch_tells_what_grew_from_what_shrank():
    """Two squares of which one becomes three times as wide: areas 3 and 1 where the mean is 2."""
    square = rectangle(1, 1)
    pair = pt.MultiPatch([square.patches[0], moved(square, 1)])
    wide = pt.MultiPatch([rectangle(3, 1).patches[0], moved(square, 3)])
    values = drawn(plot.multipatch(wide, color="stretch", source=pair))
    np.testing.assert_allclose(sorted(set(values.round(6))), np.sqrt([1 / 2, 3 / 2]), atol=1e-5)


def test_folds_are_folds_in_every_quantity():
    square = rectangle(1, 1)
    points = square.patches[0].control_points.copy()
    points[1, 1] = [1.6, 1.6]
    folded = square.with_control_points([points])
    for color in QUANTITIES:
        figure = plot.multipatch(folded, color=color, source=square)
        assert drawn(figure).min() <= 0
        assert "folded" in [text.get_text() for text in figure.axes[1].texts]
        assert not plot.multipatch(square, color=color, source=square).axes[1].texts


def test_none_and_patch_leave_lines_grey_without_a_bar(tmp_path):
    mp = rectangle(2, 1)
    for color in (None, "patch"):
        figure = plot.multipatch(mp, color=color)
        assert len(figure.axes) == 1
        assert not [c for c in figure.axes[0].collections if c.get_array() is not None]
    fills = [c for c in plot.multipatch(mp, color="patch").axes[0].collections if type(c).__name__ == "PolyCollection"]
    assert [to_hex(c) for f in fills for c in f.get_facecolors()] == [LIGHT.patches[0]]


def test_what_cannot_be_coloured_says_what_can():
    mp = rectangle(1, 1)
    with pytest.raises(pt.InputError, match=re.escape("color = 'area' is unknown; use one of patch, scaled_jacobian")):
        plot.multipatch(mp, color="area")
    for color in ("stretch", "dilatation"):
        with pytest.raises(pt.InputError, match="another model: give it as source="):
            plot.multipatch(mp, color=color)
    with pytest.raises(pt.InputError, match="1 and 2 patches"):
        plot.multipatch(mp, color="dilatation", source=pt.MultiPatch([mp.patches[0], moved(mp, 1)]))
