"""One field, colormap and limits for every view."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from qtpy.QtCore import Qt
from qtpy.QtTest import QTest

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.fields import CURVATURE, HEIGHT
from napari_unwrap3d.viewer.views.canvas import UnwrappedCanvas
from napari_unwrap3d.viewer.views.layers import KEY
from viewer.opened import open_atlas, ramp_stack, settle

MESHES = ("surface", "sealed surface", "reference", "sphere", "topographic surface")
SHOWN = (*MESHES, "uv", "topography")


def coloured(viewer: Any, canvas: UnwrappedCanvas) -> list[Any]:
    return [*(viewer.layers[name] for name in MESHES), canvas.image("uv")]


def choose(canvas: UnwrappedCanvas, field: str, qtbot: Any) -> None:
    """Pick a field in the box as a user does."""
    box = canvas.colour_bar.field_box
    row = box.findData(field)
    assert row >= 0
    box.setCurrentIndex(row)
    box.activated.emit(row)
    settle(canvas, qtbot)


def same_colours(layers: list[Any]) -> tuple[str, tuple[float, float]]:
    """Colormap and limits of all; fails where they differ."""
    names = {layer.colormap.name for layer in layers}
    limits = {tuple(np.round(layer.contrast_limits, 9)) for layer in layers}
    assert len(names) == len(limits) == 1, (names, limits)
    return names.pop(), limits.pop()


def test_a_field_is_chosen_once_and_seen_everywhere(
    make_napari_viewer: Any, qtbot: Any, small_atlas: Atlas
) -> None:
    viewer = make_napari_viewer()
    canvas = open_atlas(viewer, small_atlas, qtbot, ramp_stack(small_atlas), SHOWN)
    layers = coloured(viewer, canvas)
    name, (low, high) = same_colours(layers)
    assert name == "coolwarm"
    assert low == -high
    changes: list[int] = []
    canvas.colouring.changed.connect(lambda: changes.append(1))

    choose(canvas, HEIGHT, qtbot)
    height = small_atlas.surface.fields[HEIGHT]
    assert canvas.colouring.field == HEIGHT
    assert same_colours(layers)[0] == "viridis"
    np.testing.assert_allclose(viewer.layers["surface"].vertex_values, height, rtol=1e-5)
    np.testing.assert_allclose(
        canvas.image("uv").data, small_atlas.carry(height, "surface", "uv"), rtol=1e-4, atol=1e-6
    )
    flat = viewer.layers["topographic surface"]
    np.testing.assert_allclose(flat.vertex_values, flat.data[0][:, 0], atol=1e-5)
    assert {layer.metadata[KEY]["field"] for layer in layers} == {HEIGHT}
    np.testing.assert_array_equal(canvas.colouring.values("uv"), canvas.image("uv").data)
    assert canvas.colour_bar.unit.text() == "µm"
    assert changes

    choose(canvas, "signal_0", qtbot)
    assert same_colours(layers)[0] == "magma"
    z = viewer.layers["surface"].data[0][:, 0]
    values = viewer.layers["surface"].vertex_values
    known = values > 0
    assert np.corrcoef(z[known], values[known])[0, 1] > 0.95, "it is brighter along z"


def test_napari_s_own_controls_change_all_views(
    make_napari_viewer: Any, qtbot: Any, small_atlas: Atlas
) -> None:
    viewer = make_napari_viewer()
    canvas = open_atlas(viewer, small_atlas, qtbot, names=SHOWN)
    layers = coloured(viewer, canvas)
    viewer.layers["reference"].colormap = "turbo"
    canvas.image("uv").contrast_limits = (-0.25, 1.5)
    assert same_colours(layers) == ("turbo", (-0.25, 1.5))
    bar = canvas.colour_bar
    assert bar.colormap_box.currentData() == "turbo"
    assert float(bar.low.text()) == -0.25
    assert canvas.image("topography").colormap.name == "gray", "it shows no field"

    bar.high.selectAll()
    QTest.keyClicks(bar.high, "0.75")
    QTest.keyClick(bar.high, Qt.Key.Key_Return)
    assert same_colours(layers) == ("turbo", (-0.25, 0.75))
    bar.low.selectAll()
    QTest.keyClicks(bar.low, "2")
    QTest.keyClick(bar.low, Qt.Key.Key_Return)
    assert same_colours(layers) == ("turbo", (-0.25, 0.75)), "limits do not cross"
    assert float(bar.low.text()) == -0.25

    row = bar.colormap_box.findData("gray")
    bar.colormap_box.setCurrentIndex(row)
    bar.colormap_box.activated.emit(row)
    assert same_colours(layers)[0] == "gray"
    # What was chosen for a field is there again; Reset gives its own.
    choose(canvas, HEIGHT, qtbot)
    choose(canvas, CURVATURE, qtbot)
    assert same_colours(layers) == ("gray", (-0.25, 0.75))
    QTest.mouseClick(bar.reset_button, Qt.MouseButton.LeftButton)
    name, (low, high) = same_colours(layers)
    assert name == "coolwarm"
    assert low == -high


def test_a_field_that_fails_is_told_and_the_old_one_stays(
    make_napari_viewer: Any,
    qtbot: Any,
    small_atlas: Atlas,
    errors: list[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    viewer = make_napari_viewer()
    canvas = open_atlas(viewer, small_atlas, qtbot, ramp_stack(small_atlas))

    def fail(*_: Any, **__: Any) -> None:
        raise ZeroDivisionError("no light")

    monkeypatch.setattr("napari_unwrap3d.fields.sample_signal", fail)
    choose(canvas, "signal_1", qtbot)
    assert errors == ["no light"]
    assert canvas.colouring.field == CURVATURE
    assert canvas.colour_bar.field_box.currentData() == CURVATURE
