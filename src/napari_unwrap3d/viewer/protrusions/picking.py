"""A click on a protrusion, in any view, selects it; while a brush is in hand, it is the brush's."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...protrusions.editing import NAME
from ..annotations.painting import LOOK
from ..views.canvas import canvas_of, open_canvas
from ..views.clicking import Clicks
from ..views.placing import chart_of
from .instances import Instances


class InstancePicking(Clicks):
    """Selects what is clicked in the two canvases of a viewer.

    Parameters
    ----------
    viewer : napari.Viewer
    instances : Instances
    """

    def __init__(self, viewer: Any, instances: Instances) -> None:
        super().__init__(viewer, instances)
        self._instances = instances
        instances.changed.connect(self._begin)
        self._begin()

    def _begin(self) -> None:
        """Listen once there is something to click, and a second canvas."""
        viewer = self._viewer()
        if viewer is None or self._models or self._instances.found is None:
            return
        canvas = canvas_of(viewer)
        self.listen(viewer, viewer.window._qt_viewer.canvas.native)
        self.listen(canvas.model, canvas.qt_viewer.canvas.native)

    def may_pick(self, model: Any) -> bool:
        """Whether there is a protrusion to click, and no tool is in hand."""
        instances = self._instances
        if instances.found is None or instances.reason() or instances.annotating.tool != LOOK:
            return False
        return super().may_pick(model)

    def pick(self, model: Any, event: Any, adding: bool) -> None:
        """Select what was clicked, or point at it where a person is asked to."""
        if self._instances.pointing:
            vertex = _vertex_of(self._place_at(model, event))
            if vertex is not None:
                self._instances.point(vertex)
            return
        label = self._label_at(model, event)
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

    def clear(self) -> None:
        """Select nothing."""
        self._instances.clear()


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
