"""Light from behind the viewer's shoulder on the charts' meshes.

napari puts the light there itself, but where z points away from the viewer, which shows a
cell unmirrored, its light comes from behind the mesh. It has no public setting for that,
so the shading of its meshes is reached here, and only here.
"""

from __future__ import annotations

import weakref
from typing import Any

import numpy as np
from qtpy.QtCore import QObject

from ..common.turns import soon
from .layers import KEY


class Lighting(QObject):
    """Keeps the meshes of a viewer lit while its camera turns.

    Parameters
    ----------
    viewer : napari.Viewer
    parent : QObject
    """

    def __init__(self, viewer: Any, parent: QObject) -> None:
        super().__init__(parent)
        self._viewer = weakref.ref(viewer)
        self._timer = soon(self, self.update)
        camera = viewer.scene.camera.events
        # After napari itself has set its light.
        camera.view_direction.connect(self.update, position="last")
        viewer.dims.events.ndisplay.connect(self._later)
        viewer.layers.events.inserted.connect(self._on_inserted)
        for layer in viewer.layers:
            self._listen(layer)
        self._later()

    def update(self, _: Any = None) -> None:
        """Turn the light of every mesh in space."""
        viewer = self._viewer()
        if viewer is None or viewer.dims.ndisplay != 3:
            return
        camera = viewer.scene.camera
        if str(camera.orientation[0]) != "away":
            return
        view, up = np.array(camera.view_direction[::-1]), np.array(camera.up_direction[::-1])
        # From above the left shoulder, but mostly from the front.
        light = 2 * view - up - np.cross(up, view)
        visuals = viewer.window._qt_viewer.canvas.layer_to_visual
        for layer in viewer.layers:
            if KEY in layer.metadata and type(layer).__name__ == "Surface" and layer in visuals:
                visual = visuals[layer]
                # A mirrored layer turns the side that counts as its front.
                own = light * np.sign(np.prod(layer.scale[-3:]))
                visual._light_direction = own
                if visual.node.shading_filter is not None:
                    visual.node.shading_filter.light_dir = own

    def _later(self, _: Any = None) -> None:
        self._timer.start()

    def _on_inserted(self, event: Any) -> None:
        self._listen(event.value)
        self._later()

    def _listen(self, layer: Any) -> None:
        if type(layer).__name__ == "Surface":
            for event in (layer.events.shading, layer.events.data, layer.events.visible):
                event.connect(self._later)

    def close(self) -> None:
        """Listen no longer."""
        self._timer.stop()
        viewer = self._viewer()
        if viewer is not None:
            viewer.scene.camera.events.view_direction.disconnect(self.update)
            viewer.dims.events.ndisplay.disconnect(self._later)
            viewer.layers.events.inserted.disconnect(self._on_inserted)
