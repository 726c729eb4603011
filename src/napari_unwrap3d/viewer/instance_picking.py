"""A click on a protrusion, in any view, selects it.

Only a click that moves nothing: a drag turns or moves the view as ever. While a brush or
another tool is in hand, clicks are the tool's.
"""

from __future__ import annotations

import weakref
from collections.abc import Iterator
from typing import Any

import numpy as np
from qtpy.QtCore import QEvent, QObject, Qt
from qtpy.QtWidgets import QMainWindow

from ..protrusions.editing import NAME
from .canvas import canvas_of, open_canvas
from .instances import Instances
from .painting import LOOK
from .placing import chart_of

ADDING = ("Shift", "Control")
# A hand is not quite still while it clicks.
STILL_PIXELS = 4.0
MOVES = "pan_zoom"


class InstancePicking(QObject):
    """Selects what is clicked in the two canvases of a viewer.

    Parameters
    ----------
    viewer : napari.Viewer
    instances : Instances
    """

    def __init__(self, viewer: Any, instances: Instances) -> None:
        super().__init__(instances)
        self._viewer, self._instances = weakref.ref(viewer), instances
        self._models: list[Any] = []
        instances.changed.connect(self._begin)
        viewer.window._qt_window.installEventFilter(self)
        self._begin()

    def _begin(self) -> None:
        """Listen once there is something to click, and a second canvas."""
        viewer = self._viewer()
        if viewer is None or self._models or self._instances.found is None:
            return
        self._models = [viewer, canvas_of(viewer).model]
        for model in self._models:
            model.mouse_drag_callbacks.append(self._on_press)
        # Not as a key of napari's: that of the layer that is active goes before.
        for native in self._natives():
            native.installEventFilter(self)

    def _natives(self) -> list[Any]:
        """The two canvases."""
        viewer = self._viewer()
        canvas = None if viewer is None else open_canvas(viewer)
        if viewer is None or canvas is None:
            return []
        return [each.canvas.native for each in (viewer.window._qt_viewer, canvas.qt_viewer)]

    def _on_press(self, model: Any, event: Any) -> Iterator[None]:
        if event.button != 1 or not self._may_pick(model):
            return
        start, still = np.asarray(event.pos, dtype=float), True
        yield
        while event.type == "mouse_move":
            still &= bool(np.linalg.norm(np.asarray(event.pos) - start) <= STILL_PIXELS)
            yield
        if still:
            self._pick(model, event)

    def _may_pick(self, model: Any) -> bool:
        instances = self._instances
        if instances.found is None or instances.reason() or instances.annotating.tool != LOOK:
            return False
        active = model.layers.selection.active
        return str(getattr(active, "mode", MOVES)) == MOVES

    def _pick(self, model: Any, event: Any) -> None:
        if self._instances.pointing:
            vertex = _vertex_of(self._place_at(model, event))
            if vertex is not None:
                self._instances.point(vertex)
            return
        label = self._label_at(model, event)
        adding = any(key in ADDING for key in event.modifiers)
        if label in self._instances.hidden:
            label = 0
        if label and adding:
            self._instances.toggle(label)
        elif label:
            self._instances.select([label])
        elif label == 0 and not adding:
            self._instances.clear()

    def _label_at(self, model: Any, event: Any) -> int | None:
        """The protrusion that was clicked, 0 for the cortex, None beside the cell."""
        viewer = self._viewer()
        canvas = None if viewer is None else open_canvas(viewer)
        if canvas is None:
            return None
        if model is viewer and viewer.dims.ndisplay != 3:
            return self._in_slice(viewer, event)
        if model is not viewer:
            # What is seen is what counts; where nothing is, the place that the pixel shows.
            layer = self._instances.annotating.layers.layer(NAME, canvas.chart)
            shown = None if layer is None else _at(layer.data, event.position)
            if shown:
                return shown
        return self._on_surface(self._place_at(model, event))

    def _place_at(self, model: Any, event: Any) -> Any:
        """The place of the cell that was clicked, None beside it."""
        viewer = self._viewer()
        canvas = None if viewer is None else open_canvas(viewer)
        if canvas is None:
            return None
        if model is not viewer:
            return canvas.cursor.unwrapped_place(event)
        return canvas.cursor.place_in_3d(viewer, event) if viewer.dims.ndisplay == 3 else None

    def _in_slice(self, viewer: Any, event: Any) -> int | None:
        """In a slice of the stack a protrusion is all of its voxels."""
        found = self._instances.found
        mask = next((layer for layer in viewer.layers if chart_of(layer) == "mask"), None)
        if found is None or mask is None:
            return None
        return _at(found.volume.data, mask.world_to_data(event.position))

    def _on_surface(self, place: Any) -> int | None:
        edits = self._instances.edits
        if place is None or edits is None:
            return None
        vertex = _vertex_of(place)
        return 0 if vertex is None else int(edits.annotations.labels(NAME)[vertex])

    def close(self) -> None:
        """Listen no longer."""
        models, self._models = self._models, []
        for model in models:
            if self._on_press in model.mouse_drag_callbacks:
                model.mouse_drag_callbacks.remove(self._on_press)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Escape over a canvas; the window closes."""
        kind = event.type()
        if kind == QEvent.Type.KeyPress and event.key() == Qt.Key.Key_Escape:
            self._instances.clear()
        elif kind == QEvent.Type.Close and isinstance(watched, QMainWindow):
            self.close()
        return super().eventFilter(watched, event)


def _vertex_of(place: Any) -> int | None:
    """The vertex of the surface next to a place; None where that is not on the surface."""
    if place is None or place.corners is None or place.weights is None:
        return None
    return int(place.corners[int(np.argmax(place.weights))])


def _at(image: Any, position: Any) -> int | None:
    """The value of a pixel or voxel, None outside."""
    index = tuple(int(i) for i in np.floor(np.asarray(position, float)[-image.ndim :] + 0.5))
    if not all(0 <= i < n for i, n in zip(index, image.shape, strict=True)):
        return None
    return int(image[index])
