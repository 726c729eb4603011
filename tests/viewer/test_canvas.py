"""The second canvas: its charts, its layers, its zooms, and its end."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from napari.layers import Labels
from qtpy.QtCore import QPoint, QPointF, Qt
from qtpy.QtGui import QWheelEvent
from qtpy.QtTest import QTest
from qtpy.QtWidgets import QApplication, QDockWidget

from napari_unwrap3d import requested
from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.viewer.views.canvas import DOCK_NAME, UnwrappedCanvas, canvas_of, open_canvas
from napari_unwrap3d.viewer.views.placing import chart_of
from viewer.opened import SECONDS, open_atlas, settle

LEFT = Qt.MouseButton.LeftButton


def press(button: Any) -> None:
    QTest.mouseClick(button, LEFT)


def turn_wheel(canvas: UnwrappedCanvas, steps: int) -> None:
    """Turn the mouse wheel in the middle of the canvas."""
    native = canvas.qt_viewer.canvas.native
    middle = QPointF(native.rect().center())
    event = QWheelEvent(
        middle,
        QPointF(native.mapToGlobal(middle.toPoint())),
        QPoint(0, 0),
        QPoint(0, 120 * steps),
        Qt.MouseButton.NoButton,
        Qt.KeyboardModifier.NoModifier,
        Qt.ScrollPhase.NoScrollPhase,
        False,
    )
    QApplication.sendEvent(native, event)


def zoom_in(canvas: UnwrappedCanvas, qtbot: Any) -> float:
    """Turn the wheel until something comes of it; returns the zoom."""
    camera = canvas.model.scene.camera
    whole = camera.zoom

    def nearer() -> bool:
        if camera.zoom <= 2 * whole:
            turn_wheel(canvas, 2)
        return bool(camera.zoom > 2 * whole)

    qtbot.waitUntil(nearer, timeout=SECONDS)
    return float(camera.zoom)


def visible(canvas: UnwrappedCanvas) -> set[str]:
    return {layer.name for layer in canvas.model.layers if layer.visible}


def rows(canvas: UnwrappedCanvas) -> set[str]:
    """Names of the layers that the list shows."""
    layers = list(reversed(canvas.model.layers))
    return {layer.name for i, layer in enumerate(layers) if not canvas.layer_list.isRowHidden(i)}


def test_it_opens_with_the_uv_chart_and_keeps_pixels_to_itself(
    make_napari_viewer: Any, qtbot: Any, small_atlas: Atlas
) -> None:
    viewer = make_napari_viewer()
    assert open_canvas(viewer) is None
    canvas = open_atlas(viewer, small_atlas, qtbot)
    assert canvas_of(viewer) is canvas
    assert [str(unit) for unit in viewer.layers.units] == ["micrometer"] * 3
    assert viewer.dims.axis_labels == ("z", "y", "x")
    assert {str(unit) for unit in canvas.model.layers.units} == {"pixel"}
    assert canvas.model.dims.axis_labels == ("d", "v", "u")
    assert not {chart_of(layer) for layer in viewer.layers} & {"uv", "direct", "plane"}
    assert visible(canvas) == {"uv"}
    docks = viewer.window._qt_window.findChildren(QDockWidget)
    (dock,) = [each for each in docks if each.windowTitle() == DOCK_NAME]
    floatable = QDockWidget.DockWidgetFeature.DockWidgetFloatable
    assert not dock.features() & floatable, "undocked it would lose its OpenGL context"


def test_each_chart_has_its_layers_and_its_zoom(
    make_napari_viewer: Any, qtbot: Any, small_atlas: Atlas
) -> None:
    viewer = make_napari_viewer(show=True)
    canvas = open_atlas(viewer, small_atlas, qtbot)
    shown: list[str] = []
    canvas.chart_changed.connect(shown.append)
    labels = Labels(np.zeros(small_atlas.uv.shape, np.uint8), name="drawn")
    other = Labels(np.zeros(small_atlas.topography.shape, np.uint8), name="deep")
    canvas.add_chart_layer(labels, "uv")
    canvas.add_chart_layer(other, "topography")
    qtbot.waitUntil(lambda: rows(canvas) == {"uv", "drawn"}, timeout=SECONDS)
    assert visible(canvas) == {"uv", "drawn"}
    labels.visible = False
    camera = canvas.model.scene.camera
    near = zoom_in(canvas, qtbot)

    press(canvas.chart_buttons["topography"])
    assert canvas.chart == "topography"
    assert canvas.depth_bar.isVisible()
    assert visible(canvas) == {"topography", "deep"}
    qtbot.waitUntil(lambda: rows(canvas) == {"topography", "deep"}, timeout=SECONDS)
    assert canvas.model.layers.selection.active.name == "topography"
    assert camera.zoom < near

    press(canvas.chart_buttons["uv"])
    assert visible(canvas) == {"uv"}, "what was hidden stays so"
    assert camera.zoom == pytest.approx(near)
    press(canvas.fit_button)
    assert camera.zoom < near
    np.testing.assert_allclose(camera.center[-2:], (31.5, 63.5))
    assert shown == ["topography", "uv"]


def test_the_whole_image_stays_in_view_until_it_is_zoomed(
    make_napari_viewer: Any, qtbot: Any, small_atlas: Atlas
) -> None:
    viewer = make_napari_viewer(show=True)
    canvas = open_atlas(viewer, small_atlas, qtbot)
    camera = canvas.model.scene.camera

    def fits() -> bool:
        size = np.array(canvas.model.canvas.size) / camera.zoom
        return bool((size >= (64, 128)).all() and (size <= (1.1 * 64, 1.1 * 128)).any())

    qtbot.waitUntil(fits, timeout=SECONDS)
    width = canvas.model.canvas.size[1]
    press(canvas.tools_button)
    qtbot.waitUntil(lambda: canvas.model.canvas.size[1] < width and fits(), timeout=SECONDS)
    near = zoom_in(canvas, qtbot)
    press(canvas.tools_button)
    qtbot.waitUntil(lambda: canvas.model.canvas.size[1] == width, timeout=SECONDS)
    assert camera.zoom > 0.5 * near
    assert not fits()


def test_direct_and_plane_are_computed_when_asked(
    make_napari_viewer: Any,
    qtbot: Any,
    small_atlas: Atlas,
    plane_atlas: Atlas,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    refusal = {"reason": "Two faces fold.", "hint": "Use the direct chart."}
    direct = plane_atlas.direct
    monkeypatch.setattr(
        requested,
        "ON_REQUEST",
        {
            "direct": requested.Requested(lambda *_: (direct, {}), ("direct",)),
            "plane": requested.Requested(lambda *_: (None, refusal), ("plane",)),
        },
    )
    viewer = make_napari_viewer(show=True)
    atlas = small_atlas.replaced(on_request={}, quality={})
    canvas = open_atlas(viewer, atlas, qtbot)
    press(canvas.chart_buttons["plane"])
    assert canvas.notice.isVisible()
    assert not atlas.has("plane"), "looking at it computes nothing"
    press(canvas.notice.button)
    qtbot.waitUntil(lambda: "Two faces fold" in canvas.notice.text.text(), timeout=SECONDS)
    press(canvas.notice.button)
    assert canvas.chart == "direct", "where the plane is refused, direct is offered"
    assert canvas.notice.button.text() == "Compute"
    press(canvas.notice.button)
    qtbot.waitUntil(lambda: canvas.image("direct") is not None, timeout=SECONDS)
    settle(canvas, qtbot)
    qtbot.waitUntil(canvas.qt_viewer.isVisible, timeout=SECONDS)
    assert visible(canvas) == {"direct"}
    curvature = atlas.surface.fields["mean_curvature_per_um"]
    expected = atlas.carry(curvature, "surface", "direct")
    np.testing.assert_allclose(canvas.image("direct").data, expected, rtol=1e-4, atol=1e-6)


def test_two_viewers_have_two_canvases_and_closing_leaves_nothing(
    make_napari_viewer: Any, qtbot: Any, small_atlas: Atlas
) -> None:
    first, second = make_napari_viewer(), make_napari_viewer()
    canvases = [open_atlas(viewer, small_atlas, qtbot) for viewer in (first, second)]
    assert canvases[0] is not canvases[1]
    canvases[0].colouring.set_colormap("viridis")
    assert canvases[1].colouring.colormap.name == "coolwarm"
    canvases[1].show_chart("topography")
    assert canvases[0].chart == "uv"
    models = [canvas.model for canvas in canvases]
    first.close()
    assert open_canvas(first) is None
    assert len(models[0].layers) == 0
    assert {layer.name for layer in models[1].layers} >= {"uv", "topography"}


def test_keys_work_in_the_canvas_that_has_the_focus(
    make_napari_viewer: Any, qtbot: Any, small_atlas: Atlas
) -> None:
    viewer = make_napari_viewer(show=True)
    canvas = open_atlas(viewer, small_atlas, qtbot)
    control = Qt.KeyboardModifier.ControlModifier
    main, second = viewer.window._qt_viewer.canvas.native, canvas.qt_viewer.canvas.native
    assert viewer.dims.ndisplay == 3
    QTest.keyClick(main, Qt.Key.Key_Y, control)
    assert viewer.dims.ndisplay == 2
    QTest.keyClick(second, Qt.Key.Key_Y, control)
    assert (viewer.dims.ndisplay, canvas.model.dims.ndisplay) == (2, 2)
    canvas.model.scene.camera.zoom = 20
    zoom = viewer.scene.camera.zoom
    QTest.keyClick(second, Qt.Key.Key_R, control)
    assert canvas.model.scene.camera.zoom < 10
    assert viewer.scene.camera.zoom == zoom


def test_the_theme_follows_the_window_and_help_says_what_keys_do(
    make_napari_viewer: Any, qtbot: Any, small_atlas: Atlas
) -> None:
    viewer = make_napari_viewer()
    canvas = open_atlas(viewer, small_atlas, qtbot)
    viewer.theme = "light"
    assert canvas.model.theme == "light"
    # Its help says what buttons and keys do.
    for words in ("drag", "wheel", "Ctrl", "3D"):
        assert words in canvas.help_button.toolTip()
