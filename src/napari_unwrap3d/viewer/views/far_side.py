"""What lies on the far side of the cell is not drawn: lines seen through it only confuse."""

from __future__ import annotations

import weakref
from typing import TYPE_CHECKING, Any

import numpy as np
from qtpy.QtCore import QObject

from ...charts import Floats
from ..common.turns import soon
from .placing import chart_of

if TYPE_CHECKING:
    from napari.layers import Layer

# How far behind the middle of the cell is still shown, in parts of its size.
BEHIND = 0.06


class FarSide(QObject):
    """Cuts layers at a plane through the middle of the cell that faces the camera.

    Lines lie on the surface: drawn with depth half of each would be within the cell's mesh, so
    they are drawn over it, and this hides those behind it.

    Parameters
    ----------
    viewer : napari.Viewer
    """

    def __init__(self, viewer: Any, parent: QObject) -> None:
        super().__init__(parent)
        self._viewer = weakref.ref(viewer)
        self._layers: list[Layer] = []
        self._timer = soon(self, self._update)
        viewer.scene.camera.events.view_direction.connect(self._later)
        viewer.dims.events.ndisplay.connect(self._later)

    def add(self, layer: Layer) -> None:
        """Hide what of a layer in (…, z, y, x) is on the far side."""
        self._layers.append(layer)
        layer.experimental_clipping_planes = [{"enabled": False}]
        self._later()

    def remove(self, layer: Layer) -> None:
        """Leave a layer alone."""
        if layer in self._layers:
            self._layers.remove(layer)

    def in_front(self, points: Floats) -> np.ndarray[Any, np.dtype[np.bool_]]:
        """Which points (n, 3) of the world, (z, y, x), are shown."""
        plane = self._plane()
        if plane is None:
            return np.ones(len(points), bool)
        position, normal = plane
        shown: np.ndarray[Any, np.dtype[np.bool_]] = (points - position) @ normal >= 0
        return shown

    def _plane(self) -> tuple[Floats, Floats] | None:
        """Of the world, with its normal towards the camera; None where all is shown."""
        viewer = self._viewer()
        if viewer is None or viewer.dims.ndisplay != 3:
            return None
        extent = next(
            (layer.extent.world for layer in viewer.layers if chart_of(layer) == "surface"), None
        )
        if extent is None:
            return None
        low, high = extent[:, -3:]
        normal = -np.asarray(viewer.scene.camera.view_direction, float)
        behind = BEHIND * float((high - low).max())
        return (low + high) / 2 - behind * normal, normal

    def _later(self, _: Any = None) -> None:
        if self._layers:
            self._timer.start()

    def _update(self) -> None:
        plane = self._plane()
        for layer in self._layers:
            if plane is None:
                layer.experimental_clipping_planes[0].enabled = False
                continue
            position, normal = plane
            own = layer.experimental_clipping_planes[0]
            own.update(
                {
                    "position": tuple(position - layer.translate[-3:]),
                    "normal": tuple(normal),
                    "enabled": True,
                }
            )

    def close(self) -> None:
        """Listen no longer."""
        self._timer.stop()
        self._layers.clear()
        viewer = self._viewer()
        if viewer is not None:
            viewer.scene.camera.events.view_direction.disconnect(self._later)
            viewer.dims.events.ndisplay.disconnect(self._later)
