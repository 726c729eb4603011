"""The topography: slices, projections, and what it holds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from qtpy.QtCore import Qt
from qtpy.QtTest import QTest

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.fields import CURVATURE, HEIGHT, topography_signal
from napari_unwrap3d.viewer.views.canvas import UnwrappedCanvas
from viewer.opened import SECONDS, open_atlas, ramp_stack, settle


@pytest.fixture
def canvas(make_napari_viewer: Any, qtbot: Any, small_atlas: Atlas) -> UnwrappedCanvas:
    opened = open_atlas(make_napari_viewer(), small_atlas, qtbot, ramp_stack(small_atlas))
    opened.show_chart("topography")
    opened.depth_bar.show_content("Mask")
    qtbot.waitUntil(lambda: not opened.depth_bar.busy, timeout=SECONDS)
    return opened


def see_field(canvas: UnwrappedCanvas, name: str, qtbot: Any) -> None:
    """Choose a field for every view, and wait for it in the topography."""
    canvas.depth_bar.show_content("Field")
    canvas.colouring.set_field(name)
    settle(canvas, qtbot)
    qtbot.waitUntil(lambda: not canvas.depth_bar.busy, timeout=SECONDS)


def drawn(canvas: UnwrappedCanvas) -> np.ndarray:
    """The slice that napari shows."""
    return np.asarray(canvas.image("topography")._slicing_state._slice.image.view)


def test_slices_and_projections(canvas: UnwrappedCanvas, small_atlas: Atlas) -> None:
    bar, chart = canvas.depth_bar, small_atlas.topography
    zero = int(np.abs(chart.d_um).argmin())
    np.testing.assert_array_equal(drawn(canvas), chart.mask[zero], "it starts at the reference")
    bar.set_depth(0.5)
    layer = int(np.abs(chart.d_um - 0.5).argmin())
    np.testing.assert_array_equal(drawn(canvas), chart.mask[layer])
    assert bar.label.text() == f"d = +{chart.d_um[layer]:.2f} µm"
    QTest.keyClick(bar.slider, Qt.Key.Key_Right)
    np.testing.assert_array_equal(drawn(canvas), chart.mask[layer + 1])
    canvas.model.dims.set_point(0, layer - 2)
    assert bar.slider.value() == layer - 2

    bar.set_range("Maximum", -0.3, 0.8)
    low, high = bar.range.value()
    part = chart.mask[low : high + 1].astype(float)
    assert 2 < len(part) < len(chart.mask)
    np.testing.assert_array_equal(drawn(canvas), part.max(axis=0))
    bar.set_range("Mean", -0.3, 0.8)
    np.testing.assert_allclose(drawn(canvas), part.mean(axis=0), atol=1e-6)
    assert "−" in bar.label.text()
    assert "…" in bar.label.text()
    bar.mode.setCurrentText("Slice")
    np.testing.assert_array_equal(drawn(canvas), chart.mask[layer - 2])


def test_any_channel_of_the_stack_is_shown(
    canvas: UnwrappedCanvas, qtbot: Any, small_atlas: Atlas
) -> None:
    bar = canvas.depth_bar
    titles = [bar.content.itemText(i) for i in range(bar.content.count())]
    assert titles == ["Field", "Mask", "Signal: actin", "Signal: septin"]
    bar.content.setCurrentIndex(3)
    bar.content.textActivated.emit("Signal: septin")
    qtbot.waitUntil(lambda: not bar.busy, timeout=SECONDS)
    expected = topography_signal(small_atlas, ramp_stack(small_atlas), "septin")
    np.testing.assert_array_equal(canvas.image("topography").data, expected)
    np.testing.assert_array_equal(drawn(canvas), expected[bar.slider.value()])
    bar.show_content("Mask")
    np.testing.assert_array_equal(canvas.image("topography").data, small_atlas.topography.mask)


def test_the_field_of_every_view_is_seen_in_depth(
    canvas: UnwrappedCanvas, qtbot: Any, small_atlas: Atlas
) -> None:
    bar, chart, colouring = canvas.depth_bar, small_atlas.topography, canvas.colouring
    image = canvas.image("topography")
    see_field(canvas, HEIGHT, qtbot)
    assert (image.colormap.name, tuple(image.contrast_limits)) == ("viridis", colouring.limits)
    bar.set_depth(0.25)
    layer = bar.slider.value()
    shown = np.isfinite(drawn(canvas))
    assert shown.any()
    assert chart.mask[layer][shown].all(), "height is seen in the cell only"
    np.testing.assert_allclose(drawn(canvas)[shown], chart.d_um[layer], rtol=1e-6)
    # Over a column the highest d of the cell is where its surface lies.
    bar.set_range("Maximum", chart.d_um[0], chart.d_um[-1])
    height = small_atlas.carry(small_atlas.surface.fields[HEIGHT], "surface", "uv")
    step = chart.d_um[1] - chart.d_um[0]
    apart = np.abs(drawn(canvas) - height)
    assert np.isfinite(apart).mean() > 0.99
    assert np.nanpercentile(apart, 95) < step

    see_field(canvas, CURVATURE, qtbot)
    assert (image.colormap.name, tuple(image.contrast_limits)) == ("coolwarm", colouring.limits)
    values = np.asarray(image.data)
    flat = np.flatnonzero(np.isfinite(values))
    points = chart.positions.reshape(-1, 3)[flat[::50]]
    face, weights, distance = small_atlas._surface_locator.closest(points)
    nearest = small_atlas.surface.faces[face, weights.argmax(axis=1)]
    expected = colouring.values("surface")[nearest]
    assert distance.max() < 3 * small_atlas.voxel_um
    assert np.corrcoef(expected, values.ravel()[flat[::50]])[0, 1] > 0.95
    low, high = bar.range.value()
    with np.errstate(all="ignore"):
        part = np.where(np.isfinite(values), values, -np.inf)[low : high + 1].max(axis=0)
    np.testing.assert_array_equal(np.where(np.isnan(drawn(canvas)), -np.inf, drawn(canvas)), part)
    bar.set_range("Mean", -0.3, 0.5)
    low, high = bar.range.value()
    part = np.ma.masked_invalid(values[low : high + 1]).mean(axis=0)
    np.testing.assert_allclose(drawn(canvas), part.filled(np.nan), atol=1e-5)
    colouring.set_limits(-0.5, 0.75)
    assert tuple(image.contrast_limits) == (-0.5, 0.75)
    image.colormap = "turbo"
    assert colouring.colormap.name == "turbo", "it is one for all"

    see_field(canvas, "signal_1", qtbot)
    expected = topography_signal(small_atlas, ramp_stack(small_atlas), "septin")
    np.testing.assert_array_equal(image.data, expected)
    assert tuple(image.contrast_limits) == colouring.limits
    bar.show_content("Mask")
    np.testing.assert_array_equal(image.data, chart.mask)
    assert (image.colormap.name, tuple(image.contrast_limits)) == ("gray", (0, 1))
    colouring.set_colormap("magma")
    assert image.colormap.name == "gray", "a mask is no field"
