"""A mouse that draws in a window with a small cell."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import mouse
import numpy as np
from qtpy.QtCore import QPoint, QPointF, Qt
from qtpy.QtGui import QWheelEvent
from qtpy.QtWidgets import QApplication

from napari_unwrap3d.textured import COVER
from napari_unwrap3d.viewer.annotations.widget import AnnotationWidget
from viewer.opened import SECONDS, open_atlas

LEFT, NONE = mouse.LEFT, mouse.NO_KEYS
MESHES = ("surface", "reference")
TURNS = 20


class Hand:
    """A window with the small cell and an annotation, and a mouse."""

    def __init__(
        self, viewer: Any, atlas: Any, qtbot: Any, names: Iterable[str] = ("uv", "topography")
    ) -> None:
        self.viewer, self.atlas, self.qtbot = viewer, atlas, qtbot
        self.canvas = open_atlas(viewer, atlas, qtbot, names=(*MESHES, *names))
        self.widget = AnnotationWidget(viewer)
        viewer.window.add_dock_widget(self.widget, name="Annotations")
        self.annotating = self.widget.annotating
        self.annotations = atlas.annotations
        self.widget.list.name_box.setEditText("drawn")
        self.widget.list.add_button.click()
        for name in MESHES:
            viewer.layers[name].visible = name == "surface"
        qtbot.waitUntil(self._ready, timeout=SECONDS)

    def _ready(self) -> bool:
        return (
            self.annotating.layers.layer("drawn", "uv") is not None
            and self.annotating.painter.ready(self.viewer.layers["surface"])
            and all(self.texture(name) is not None for name in MESHES)
        )

    def texture(self, name: str) -> Any:
        return self.annotating.texturing.texture_of(self.viewer.layers[name])

    @property
    def main(self) -> Any:
        return self.viewer.window._qt_viewer.canvas.native

    @property
    def second(self) -> Any:
        return self.canvas.qt_viewer.canvas.native

    @property
    def uv(self) -> Any:
        return self.annotating.layers.layer("drawn", "uv")

    def labels(self) -> Any:
        return np.array(self.annotations.labels("drawn"))

    def choose(self, tool: str, label: int = 1) -> None:
        self.widget.label_box.setValue(label)
        self.widget.tools[tool].click()

    def show(self, chart: str) -> Any:
        """Look at a chart of the second canvas; the layer to draw on."""
        self.canvas.show_chart(chart)
        layers = self.annotating.layers
        self.qtbot.waitUntil(lambda: layers.layer("drawn", chart) is not None, timeout=SECONDS)
        return layers.layer("drawn", chart)

    def lay_out(self) -> None:
        """Let the window find its sizes, and the second canvas fit its image to them."""
        same, last = 0, None
        while same < TURNS:
            QApplication.processEvents()
            now = self.second.size(), self.canvas._fit_timer.isActive()
            same, last = (same + 1 if now == last and not now[1] else 0), now

    def zoom_out(self) -> None:
        """Turn the wheel over the second canvas, so that there is room beside the image."""
        camera = self.canvas.model.scene.camera
        before = camera.zoom
        middle = QPointF(self.second.rect().center())
        for _ in range(3):
            event = QWheelEvent(
                middle,
                QPointF(self.second.mapToGlobal(middle.toPoint())),
                QPoint(0, 0),
                QPoint(0, -120),
                Qt.MouseButton.NoButton,
                NONE,
                Qt.ScrollPhase.NoScrollPhase,
                False,
            )
            QApplication.sendEvent(self.second, event)
        self.qtbot.waitUntil(lambda: camera.zoom < 0.9 * before)
        self.lay_out()

    def share(self, native: Any, down: float, right: float) -> tuple[float, float]:
        """Where on a canvas in 2D a place is, as shares (x, y)."""
        camera = (self.viewer if native is self.main else self.canvas.model).scene.camera
        x = (right - camera.center[-1]) * camera.zoom / native.width() + 0.5
        y = (down - camera.center[-2]) * camera.zoom / native.height() + 0.5
        return x, y

    def assert_everywhere(self) -> None:
        """Every view shows the labels of the annotation."""
        self.settle()
        for (name, chart), layer in self.annotating.layers._layers.items():
            assert (layer.data == self.annotations.image(name, chart)).all(), chart
        direct = self.annotations.image("drawn", "direct")
        uv = self.annotations.image("drawn", "uv")
        for label in np.unique(self.labels())[1:]:
            shown = covered(self, "surface", label) == (direct == label)
            assert shown[(direct == label) | (direct == 0)].all()
            shown = covered(self, "reference", label) == (uv == label)
            assert shown[(uv == label) | (uv == 0)].all()

    def look_at(self, point: Any, outwards: Any) -> None:
        """Turn the main view so that a point of the surface is in its middle, up close."""
        camera = self.viewer.scene.camera
        camera.center = tuple(point)
        helper = np.eye(3)[np.abs(outwards).argmin()]
        up = np.cross(outwards, helper)
        camera.set_view_direction(tuple(-np.asarray(outwards)), tuple(up))
        camera.zoom = 60.0

    def drag(self, native: Any, places: Iterable[tuple[float, float]], keys: Any = NONE) -> None:
        """Press, move and release at shares (x, y) of a canvas."""
        model = self.viewer if native is self.main else self.canvas.model
        mouse.drag(native, places, partial(follow, model, self.qtbot), keys)
        self.settle()

    def settle(self) -> None:
        """Let what was drawn arrive everywhere."""
        for layer in self.annotating.layers._layers.values():
            self.qtbot.waitUntil(lambda layer=layer: not layer._pending)
        painter = self.annotating.painter
        self.qtbot.waitUntil(lambda: painter._lassoing is None, timeout=SECONDS)
        timer = self.annotating.texturing._timer
        self.qtbot.waitUntil(lambda: not timer.isActive())


def follow(model: Any, qtbot: Any, move: Callable[[], None]) -> None:
    """Move until a viewer has noticed."""
    before = tuple(model.cursor.position)

    def moved() -> bool:
        if tuple(model.cursor.position) == before:
            move()
        return tuple(model.cursor.position) != before

    qtbot.waitUntil(moved)


def covered(hand: Hand, name: str, label: int = 1) -> Any:
    """Which pixels of a layer's texture have the colour of a label, over the field."""
    texture = hand.texture(name)
    skin, base = texture._skin, texture._base.reshape(*texture._skin.covered.shape, 3)
    colour = np.array(hand.annotating.style("drawn")[0][label][:3])
    expected = base + COVER * (255 * colour - base)
    shown = texture.pixels[:, : 2 * skin.rows].astype(float)
    changed = np.abs(shown - base).max(axis=2) > 1
    assert (np.abs(shown - expected).max(axis=2)[changed] <= 1).all()
    return changed
