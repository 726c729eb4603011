"""What is shown in the 3D canvas: a switch for each thing, above it."""

from __future__ import annotations

import itertools
import weakref
from typing import TYPE_CHECKING, Any

import numpy as np
from qtpy.QtCore import QEvent, QObject, Qt
from qtpy.QtWidgets import QDockWidget, QHBoxLayout, QLabel, QPushButton, QWidget

from ..common.notice import small_button
from .layers import CELL_AT_T, KEY, SPACE
from .sources import is_source

if TYPE_CHECKING:
    from napari.layers import Layer

DOCK_NAME = "Shown in 3D"
STACK = "stack"
MARGIN = 0.05
# Layer → what its switch says, and what it is.
SWITCHES = {
    STACK: ("Stack", "The images, as they were recorded."),
    "mask": ("Mask", "The cell, voxel by voxel."),
    "surface": ("Surface", "The surface of the cell."),
    CELL_AT_T: ("Cell at t", "The surface of the cell at the timepoint that is shown."),
    "sealed surface": ("Sealed", "The surface with its handles and holes closed."),
    "reference": ("Reference", "The smooth cortex, without protrusions."),
    "sphere": ("Sphere", "The reference on a sphere, with its areas kept."),
    "sphere (conformal)": ("Conformal", "The reference on a sphere, with its angles kept."),
    "topographic surface": ("Topography", "The surface over the (u, v) plane: height is d."),
}
CELL = ("surface", "sealed surface", CELL_AT_T)
# Marks on the cell, sealed or not: the parts that were closed, and the points.
ON_CELL = ("sealed places", "points")
ALONE = "Double-click: show it alone."


class ShownBar(QWidget):
    """A switch for each thing in the 3D canvas. Double-click shows one alone.

    Parameters
    ----------
    viewer : napari.Viewer
    """

    def __init__(self, viewer: Any, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._viewer = weakref.ref(viewer)
        self._watched: list[Layer] = []
        row = QHBoxLayout(self)
        row.setContentsMargins(6, 2, 6, 2)
        row.setSpacing(2)
        row.addWidget(QLabel("Show"))
        self.buttons: dict[str, QPushButton] = {}
        for name, (title, tip) in SWITCHES.items():
            button = small_button(title, f"{tip}\n{ALONE}", checkable=True)
            button.clicked.connect(lambda on, name=name: self.show_layers(name, on))
            button.installEventFilter(self)
            row.addWidget(button)
            self.buttons[name] = button
        row.addStretch(1)
        self.fit_button = small_button("Fit", "Bring all of what is switched on into view.")
        self.fit_button.clicked.connect(self.fit)
        row.addWidget(self.fit_button)
        for event in (viewer.layers.events.inserted, viewer.layers.events.removed):
            event.connect(self._on_layers)
        self._on_layers()

    def layers(self, name: str) -> list[Layer]:
        """The layers that a switch is for."""
        viewer = self._viewer()
        if viewer is None:
            return []
        if name == STACK:
            return [layer for layer in viewer.layers if is_source(layer) and _is_image(layer)]
        return [layer for layer in viewer.layers if _layer_name(layer) == name]

    def show_layers(self, name: str, shown: bool) -> None:
        """Show or hide one thing."""
        for layer in self.layers(name):
            layer.visible = shown
        if name in CELL:
            on = any(layer.visible for each in CELL for layer in self.layers(each))
            for layer in [layer for each in ON_CELL for layer in self.layers(each)]:
                layer.visible = on

    def show_alone(self, name: str) -> None:
        """Show one thing only, as large as it fits."""
        for each in SWITCHES:
            self.show_layers(each, each == name)
        self.fit()

    def fit(self) -> None:
        """Turn nothing, but bring all that is shown into view."""
        viewer = self._viewer()
        if viewer is not None:
            fit_visible(viewer)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """A double-click on a switch."""
        if event.type() == QEvent.Type.MouseButtonDblClick:
            for name, button in self.buttons.items():
                if button is watched and button.isEnabled():
                    self.show_alone(name)
                    return True
        return super().eventFilter(watched, event)

    def _on_layers(self, _: Any = None) -> None:
        viewer = self._viewer()
        if viewer is None:
            return
        for layer in self._watched:
            layer.events.visible.disconnect(self._update)
        self._watched = list(viewer.layers)
        for layer in self._watched:
            layer.events.visible.connect(self._update)
        self._update()

    def _update(self, _: Any = None) -> None:
        for name, button in self.buttons.items():
            layers = self.layers(name)
            button.setEnabled(bool(layers))
            button.setChecked(any(layer.visible for layer in layers))
        self.buttons[CELL_AT_T].setVisible(self.buttons[CELL_AT_T].isEnabled())

    def close_bar(self) -> None:
        """Listen no longer."""
        viewer = self._viewer()
        if viewer is not None:
            for event in (viewer.layers.events.inserted, viewer.layers.events.removed):
                event.disconnect(self._on_layers)
        for layer in self._watched:
            layer.events.visible.disconnect(self._update)
        self._watched.clear()


def _layer_name(layer: Layer) -> str:
    return str(layer.metadata.get(KEY, {}).get("layer", ""))


def _is_image(layer: Layer) -> bool:
    return type(layer).__name__ == "Image"


def fit_visible(viewer: Any) -> None:
    """Bring all visible layers into view, without turning the camera.

    napari's own fit fails when a layer has fewer axes than another, such as a mesh beside a
    stack with channels.
    """
    boxes = [layer.extent.world[:, -3:] for layer in viewer.layers if _is_shown(layer)]
    if not boxes:
        return
    low, high = np.min(boxes, axis=(0, 1)), np.max(boxes, axis=(0, 1))
    center, camera = (low + high) / 2, viewer.scene.camera
    if viewer.dims.ndisplay == 3:
        up = np.asarray(camera.up_direction)
        right = np.cross(camera.view_direction, up)
        corners = np.array(list(itertools.product(*zip(low, high, strict=True)))) - center
        size = np.array([np.ptp(corners @ up), np.ptp(corners @ right)])
    else:
        size, center[0] = (high - low)[1:], 0.0
    camera.center = tuple(center)
    camera.zoom = (1 - MARGIN) * float((np.asarray(viewer.canvas.size) / size).min())


def show_cell(viewer: Any) -> None:
    """Fit the view, and select the surface: its controls are of use, those of the source not."""
    fit_visible(viewer)
    surface = next((each for each in viewer.layers if _layer_name(each) == "surface"), None)
    if surface is not None:
        viewer.layers.selection.active = surface


def _is_shown(layer: Layer) -> bool:
    return bool(layer.visible) and layer.ndim >= len(SPACE)


def hide_sources(viewer: Any) -> None:
    """Hide the recorded images, which would lie over the charts in 3D."""
    for layer in viewer.layers:
        if is_source(layer):
            layer.visible = False


def add_shown_bar(viewer: Any) -> ShownBar:
    """Put the switches above the 3D canvas."""
    bar = ShownBar(viewer)
    dock = viewer.window.add_dock_widget(bar, name=DOCK_NAME, area="top", allowed_areas=["top"])
    dock.setFeatures(QDockWidget.DockWidgetFeature.NoDockWidgetFeatures)
    dock.setTitleBarWidget(QWidget())
    dock.setMinimumHeight(28)
    viewer.window._qt_window.resizeDocks([dock], [30], Qt.Orientation.Vertical)
    return bar
