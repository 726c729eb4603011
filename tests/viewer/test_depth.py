"""The topography: slices, projections, and what it holds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from qtpy.QtCore import Qt
from qtpy.QtTest import QTest

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.fields import topography_signal
from napari_unwrap3d.viewer.canvas import UnwrappedCanvas
from viewer.opened import SECONDS, open_atlas, ramp_stack


@pytest.fixture
def canvas(make_napari_viewer: Any, qtbot: Any, small_atlas: Atlas) -> UnwrappedCanvas:
    opened = open_atlas(make_napari_viewer(), small_atlas, qtbot, ramp_stack(small_atlas))
    opened.show_chart("topography")
    return opened


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
    assert titles == ["Mask", "Signal: actin", "Signal: septin"]
    bar.content.setCurrentIndex(2)
    bar.content.textActivated.emit("Signal: septin")
    qtbot.waitUntil(lambda: not bar.busy, timeout=SECONDS)
    expected = topography_signal(small_atlas, ramp_stack(small_atlas), "septin")
    np.testing.assert_array_equal(canvas.image("topography").data, expected)
    np.testing.assert_array_equal(drawn(canvas), expected[bar.slider.value()])
    bar.show_content("Mask")
    np.testing.assert_array_equal(canvas.image("topography").data, small_atlas.topography.mask)
