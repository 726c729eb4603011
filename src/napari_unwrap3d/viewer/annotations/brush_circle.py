"""The brush's circle on the mesh under the pointer, while something is drawn with."""

from __future__ import annotations

import weakref
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from qtpy.QtCore import QObject

from ...charts import Floats
from ...geometry.brush import ring
from ..views.markers import CanvasLines

if TYPE_CHECKING:
    from napari.components import ViewerModel
    from napari.layers import Layer

    from .painting import SurfacePainter

ROUND = ("brush", "erase")


class BrushCircle(QObject):
    """Shows how far the brush reaches, on the fold of the surface that it would touch.

    Parameters
    ----------
    viewer : napari.Viewer
    painter : SurfacePainter
        Knows the tool, the radius, and what lies under the pointer.
    """

    def __init__(self, viewer: ViewerModel, painter: SurfacePainter) -> None:
        super().__init__(painter)
        self._viewer = weakref.ref(viewer)
        self._painter = painter
        self._lines: CanvasLines | None = None
        self._mouse: tuple[Any, Any] | None = None
        viewer.mouse_move_callbacks.append(self._on_move)
        viewer.events.mouse_over_canvas.connect(self._on_over)
        painter.annotating.chosen.connect(self._on_chosen)

    @property
    def segments(self) -> npt.NDArray[np.floating]:
        """What is drawn, (k, 2, 3) in the viewer's world; empty for nothing."""
        return np.zeros((0, 2, 3)) if self._lines is None else self._lines.segments

    def show(self, layer: Layer, face: int, point: Floats) -> None:
        """Draw the circle around a point of a face, in the layer's own coordinates."""
        viewer = self._viewer()
        if viewer is None:
            return
        if self._lines is None:
            self._lines = CanvasLines(viewer.window._qt_viewer)
        scale = np.asarray(layer.scale[-3:])
        radius = self._painter.annotating.radius_um / float(np.mean(np.abs(scale)))
        circle = ring(point, self._painter.normal(layer, face), radius)
        self._lines.show(circle * scale + layer.translate[-3:])

    def hide(self) -> None:
        """Draw nothing."""
        if self._lines is not None:
            self._lines.hide()

    def _on_move(self, viewer: ViewerModel, event: Any) -> None:
        self._mouse = None
        if len(event.dims_displayed) == 3:
            self._mouse = np.array(event.position), np.array(event.view_direction)
        self._update()

    def _update(self) -> None:
        annotating, hit = self._painter.annotating, None
        if self._mouse is not None and annotating.tool in ROUND and annotating.current:
            hit = self._painter.pick(*self._mouse)
        if hit is None:
            self.hide()
        else:
            self.show(hit.layer, hit.face, hit.point)

    def _on_over(self, event: Any) -> None:
        if not event.value:
            self._mouse = None
            self.hide()

    def _on_chosen(self) -> None:
        """Another tool or radius."""
        self._update()

    def close(self) -> None:
        """Leave nothing behind in the viewer."""
        viewer = self._viewer()
        if viewer is not None and self._on_move in viewer.mouse_move_callbacks:
            viewer.mouse_move_callbacks.remove(self._on_move)
            viewer.events.mouse_over_canvas.disconnect(self._on_over)
        if self._lines is not None:
            self._lines.remove()
            self._lines = None
