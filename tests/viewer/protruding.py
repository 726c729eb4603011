"""A window with the protrusions of the small cell and their table, and a person's mouse."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from typing import Any

import mouse
import numpy as np
from qtpy.QtCore import QPoint, Qt
from qtpy.QtTest import QTest
from scipy.ndimage import distance_transform_edt

from napari_unwrap3d.protrusions.editing import NAME
from napari_unwrap3d.viewer.files.project import autosave_of
from napari_unwrap3d.viewer.protrusions.table import ProtrusionTable
from viewer.hand import follow
from viewer.opened import SECONDS, open_atlas, settle

LEFT, NO_KEYS, SHIFT = mouse.LEFT, mouse.NO_KEYS, Qt.KeyboardModifier.ShiftModifier


class Protruding:
    """The surface alone in 3D, one chart below, and the table beside them."""

    def __init__(self, viewer: Any, atlas: Any, qtbot: Any) -> None:
        self.viewer, self.atlas, self.qtbot = viewer, atlas, qtbot
        self.autosave = autosave_of(viewer)
        self.canvas = open_atlas(viewer, atlas, qtbot, names=("surface", "uv", "topography"))
        self.dock = ProtrusionTable(viewer)
        viewer.window.add_dock_widget(self.dock, name="Protrusions table", area="right")
        self.instances = self.dock.instances
        self.annotating = self.instances.annotating
        qtbot.waitUntil(self._ready, timeout=SECONDS)
        self.rest()

    def _ready(self) -> bool:
        return self.layer("uv") is not None and self.texture is not None

    @property
    def found(self) -> Any:
        return self.instances.found

    @property
    def texture(self) -> Any:
        return self.annotating.texturing.texture_of(self.viewer.layers["surface"])

    @property
    def labels(self) -> Any:
        return np.array(self.atlas.annotations.labels(NAME))

    @property
    def main(self) -> Any:
        return self.viewer.window._qt_viewer.canvas.native

    @property
    def second(self) -> Any:
        return self.canvas.qt_viewer.canvas.native

    def layer(self, chart: str) -> Any:
        return self.annotating.layers.layer(NAME, chart)

    def show(self, chart: str) -> Any:
        self.canvas.show_chart(chart)
        self.qtbot.waitUntil(lambda: self.layer(chart) is not None, timeout=SECONDS)
        return self.layer(chart)

    def rest(self) -> None:
        """Until everything is measured, unwrapped and drawn."""
        instances, square = self.instances, self.dock.square
        self.qtbot.waitUntil(lambda: not instances.busy and not square.busy, timeout=SECONDS)
        settle(self.canvas, self.qtbot)
        timer = self.annotating.texturing._timer
        self.qtbot.waitUntil(lambda: not timer.isActive(), timeout=SECONDS)

    def press(self, name: str) -> None:
        button = self.dock.edit_bar.buttons[name]
        assert button.isEnabled(), button.toolTip()
        QTest.mouseClick(button, LEFT)
        self.rest()

    def row(self, label: int) -> int:
        """The row in which a protrusion is shown, −1 where it is not."""
        source = self.dock.model.index(self.dock.model.ids.index(label), 0)
        return int(self.dock.rows.mapFromSource(source).row())

    def click_row(self, label: int, keys: Any = NO_KEYS) -> None:
        rows, table = self.dock.rows, self.dock.table
        index = rows.index(self.row(label), 0)
        table.scrollTo(index)
        QTest.mouseClick(table.viewport(), LEFT, keys, table.visualRect(index).center())
        self.rest()

    def selected_rows(self) -> set[int]:
        rows = self.dock.table.selectionModel().selectedRows()
        return {self.dock.model.ids[self.dock.rows.mapToSource(row).row()] for row in rows}

    def click(self, native: Any, point: QPoint, keys: Any = NO_KEYS) -> None:
        mouse.move(native, point)
        QTest.mouseClick(native, LEFT, keys, point)
        self.rest()

    def click_image(self, pixel: Any, keys: Any = NO_KEYS) -> None:
        """Click a pixel (v, u) of the second canvas."""
        camera, native = self.canvas.model.scene.camera, self.second
        away = (np.asarray(pixel, float) - camera.center[-2:]) * camera.zoom
        middle = native.width() / 2, native.height() / 2
        self.click(native, QPoint(*np.rint(away[::-1] + middle).astype(int).tolist()), keys)

    def drag(self, native: Any, places: Iterable[tuple[float, float]]) -> None:
        """Press, move and release at shares (x, y) of a canvas."""
        model = self.viewer if native is self.main else self.canvas.model
        mouse.drag(native, places, partial(follow, model, self.qtbot))

    def pixel_of(self, label: int, chart: str = "uv") -> Any:
        """A pixel well inside of a protrusion."""
        inside = distance_transform_edt(self.atlas.annotations.image(NAME, chart) == label)
        return np.unravel_index(inside.argmax(), inside.shape)

    def centre(self) -> QPoint:
        return self.main.rect().center()
