"""Bends across interfaces: known angles, and what is drawn of them."""

import numpy as np
import pytest

import patchtransfer as pt
from patchtransfer import plot
from patchtransfer.plot.kinks import bends

KNOTS = [0, 0, 0, 0.5, 1, 1, 1]


def square(x: float = 0.0) -> pt.Patch:
    g = np.array([0, 0.25, 0.75, 1])
    return pt.Patch((KNOTS, KNOTS), (2, 2), np.stack(np.meshgrid(g + x, g, indexing="ij"), axis=2))


def turned(degrees: float) -> pt.MultiPatch:
    """Two squares; iso-lines of the right one leave the interface at an angle."""
    mp = pt.MultiPatch([square(), square(1)])
    points = [p.control_points.copy() for p in mp.patches]
    turn = np.radians(degrees)
    points[1][1] = points[1][0] + 0.25 * np.array([np.cos(turn), np.sin(turn)])
    return mp.with_control_points(points)


def other_way(mp: pt.MultiPatch) -> pt.MultiPatch:
    """The same shape with the right patch turned by half: its sides have other names."""
    right = mp.patches[1]
    return pt.MultiPatch([mp.patches[0], right.with_control_points(right.control_points[::-1, ::-1])])


@pytest.mark.parametrize("change", [lambda mp: mp, other_way])
@pytest.mark.parametrize("degrees", [0.0, 7.0, -20.0])
def test_bends_are_the_angles_of_iso_lines(degrees, change):
    mp = change(turned(degrees))
    found = bends(mp, mp.interfaces[0], np.linspace(0.1, 0.9, 5))
    np.testing.assert_allclose([b.angle for b in found], abs(degrees), atol=1e-9)
    for bend in found:
        assert bend.point[0] == pytest.approx(1)
        left, right = sorted([bend.into_a, bend.into_b], key=lambda d: d[0])
        np.testing.assert_allclose(left, [-1, 0], atol=1e-12)
        np.testing.assert_allclose(right, [np.cos(np.radians(degrees)), np.sin(np.radians(degrees))], atol=1e-9)


def test_windows_say_the_angle_and_titles_the_kinks():
    models = {"bent": turned(20), "straight": turned(0)}
    figure = plot.kinks(models)
    overview, *windows = figure.axes
    assert len(windows) == 2
    assert [ax.texts[0].get_text() for ax in windows] == ["20.0°", "0.0°"]
    for ax, (title, mp) in zip(windows, models.items(), strict=True):
        kink = pt.check_continuity(mp).kink_deg
        assert ax.get_title() == f"{title}: mean {kink.mean:.1f}°, most {kink.max:.1f}°"
    # All windows show the same place, which is on the interface.
    assert len({ax.get_xlim() for ax in windows}) == 1
    assert sum(windows[0].get_xlim()) / 2 == pytest.approx(1)
    assert [text.get_text() for text in overview.texts] == ["A"]


def test_an_interface_that_is_degenerate_is_drawn():
    mp = turned(0)
    points = [p.control_points.copy() for p in mp.patches]
    points[1][1] = points[1][0]
    assert plot.kinks({"flat": mp.with_control_points(points)}).axes[1].texts[0].get_text() == "degenerate"


def test_only_models_of_the_same_interfaces_are_compared():
    one = pt.MultiPatch([square()])
    for models in ({}, {"a": one}, {"a": turned(1), "b": one}):
        with pytest.raises(pt.InputError, match="same interfaces, and at least one"):
            plot.kinks(models)
    with pytest.raises(pt.InputError, match="places = 0"):
        plot.kinks({"a": turned(1)}, places=0)
