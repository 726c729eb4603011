"""The place under the pointer is marked and read out in both canvases."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from qtpy.QtCore import QEvent, QPoint
from qtpy.QtTest import QTest
from qtpy.QtWidgets import QApplication

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.viewer.views.canvas import UnwrappedCanvas
from napari_unwrap3d.viewer.views.showing import ShownBar
from viewer.opened import SECONDS, open_atlas

Window = tuple[Any, UnwrappedCanvas]


@pytest.fixture
def window(make_napari_viewer: Any, qtbot: Any, small_atlas: Atlas) -> Window:
    """The surface alone in 3D, and uv."""
    viewer = make_napari_viewer(show=True)
    names = ("surface", "reference", "sphere", "uv", "topography")
    canvas = open_atlas(viewer, small_atlas, qtbot, names=names)
    viewer.window._qt_window.findChild(ShownBar).show_alone("surface")
    return viewer, canvas


def to_screen(viewer: Any, qt_viewer: Any, world: Any) -> QPoint:
    """Where a place (v, u), or one in 3D, is drawn in a canvas."""
    view = qt_viewer.canvas.view
    shown = np.asarray(world, dtype=float)[::-1]
    x, y, _, w = view.scene.node_transform(view.canvas.scene).map(
        [*shown, *[0] * (3 - len(shown)), 1]
    )
    return QPoint(round(x / w), round(y / w))


def hover(qt_viewer: Any, place: Callable[[], QPoint], found: Any, qtbot: Any) -> None:
    """Move the pointer to a place until it has been noticed there; the view may still be fitted."""
    native = qt_viewer.canvas.native

    def noticed() -> bool:
        point = place()
        QTest.mouseMove(native, point + QPoint(3, 0))
        QTest.mouseMove(native, point)
        return bool(found())

    qtbot.waitUntil(noticed, timeout=SECONDS)


def leave(canvas: UnwrappedCanvas, qtbot: Any) -> None:
    """Leave the second canvas; the display's own pointer is still there and may be told again."""

    def left() -> bool:
        QApplication.sendEvent(canvas.qt_viewer.canvas.native, QEvent(QEvent.Type.Leave))
        return canvas.cursor.place is None

    qtbot.waitUntil(left, timeout=SECONDS)


def test_leaving_is_noticed_and_a_place_in_uv_is_marked_on_the_surface(
    window: Window, qtbot: Any, small_atlas: Atlas
) -> None:
    # Leaving is noticed even if entering was not.
    viewer, canvas = window
    leave(canvas, qtbot)
    middle = canvas.qt_viewer.canvas.native.rect().center()
    hover(canvas.qt_viewer, lambda: middle, lambda: canvas.cursor.place is not None, qtbot)
    leave(canvas, qtbot)
    # A place in uv is marked on the surface.
    cursor = canvas.cursor
    before = [list(viewer.layers), list(canvas.model.layers), viewer.layers.selection.active]
    target = np.array([20.0, 45.0])

    def found() -> bool:
        place = cursor.place
        return place is not None and np.hypot(*(place.uv - target)) < 1

    hover(canvas.qt_viewer, lambda: to_screen(viewer, canvas.qt_viewer, target), found, qtbot)
    expected, _ = small_atlas.map([cursor.place.uv], "uv", "surface")
    (mark,) = cursor.marks_3d.positions
    assert np.linalg.norm(mark - expected[0]) < 1.5 * small_atlas.voxel_um
    text = canvas.status.text()
    assert "µm" in text
    assert f"v {cursor.place.uv[0]:.0f}" in text
    assert "Mean curvature" in text
    viewer.layers["sphere"].visible = True
    viewer.layers["reference"].visible = True
    cursor.show(cursor.place)
    assert len(cursor.marks_3d.positions) == 3
    after = [list(viewer.layers), list(canvas.model.layers), viewer.layers.selection.active]
    assert after == before, "marks are no layers"

    leave(canvas, qtbot)
    assert not cursor.marks_3d.visible
    assert not cursor.marks_unwrapped.visible
    assert canvas.status.text() == ""


def test_a_place_on_the_surface_is_marked_in_every_chart_and_in_its_slice(
    window: Window, qtbot: Any, small_atlas: Atlas
) -> None:
    viewer, canvas = window
    cursor = canvas.cursor
    surface = small_atlas.surface
    # The vertex nearest to the viewer, who looks along z.
    vertex = int(np.argmin(surface.vertices[:, 0]))
    world = surface.vertices[vertex]
    main = viewer.window._qt_viewer

    def found() -> bool:
        place = cursor.place
        near = 3 * small_atlas.voxel_um
        return place is not None and np.linalg.norm(place.position - world) < near

    hover(main, lambda: to_screen(viewer, main, world), found, qtbot)
    place = cursor.place
    expected, _ = small_atlas.map([place.position], "surface", "uv")
    (mark,) = cursor.marks_unwrapped.positions
    np.testing.assert_allclose(mark[-2:], place.uv)
    assert np.hypot(*(place.uv - expected[0])) < 1.5
    canvas.show_chart("topography")
    assert cursor.place is None, "the chart changed under the pointer"
    cursor.show(place)
    np.testing.assert_allclose(cursor.marks_unwrapped.positions[0][-2:], place.uv)
    hover(main, lambda: QPoint(2, 2), lambda: cursor.place is None, qtbot)
    assert not cursor.marks_unwrapped.visible
    # In a slice, only a place in it is marked.
    place = cursor._places.at_pixel("uv", (20, 45))
    viewer.dims.ndisplay = 2
    viewer.dims.set_point(0, place.position[0])
    cursor.show(place)
    assert cursor.marks_3d.visible
    viewer.dims.set_point(0, place.position[0] + 10 * small_atlas.voxel_um)
    cursor.show(place)
    assert not cursor.marks_3d.visible


@pytest.mark.parametrize("name", ["sphere", "reference"])
def test_every_mesh_can_be_picked(
    window: Window, qtbot: Any, small_atlas: Atlas, name: str
) -> None:
    viewer, canvas = window
    viewer.window._qt_window.findChild(ShownBar).show_alone(name)
    main, layer = viewer.window._qt_viewer, viewer.layers[name]
    vertices = getattr(small_atlas, name).vertices
    vertex = vertices[int(np.argmin(vertices[:, 0]))]
    at = to_screen(viewer, main, vertex * layer.scale + layer.translate)
    moves = 0

    def found() -> bool:
        # A mesh that is shown for the first time is made ready at the first move.
        nonlocal moves
        moves += 1
        QTest.mouseMove(main.canvas.native, at + QPoint(moves % 2, 0))
        place = canvas.cursor.place
        near = 0.1 * np.ptp(vertices)
        return place is not None and np.linalg.norm(getattr(place, name) - vertex) < near

    qtbot.waitUntil(found, timeout=SECONDS)
