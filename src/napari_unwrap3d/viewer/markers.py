"""Marks drawn over a canvas that are no layers: nobody can select, paint or save them.

napari has no public way to draw in its scene beside layers, so its scene is used here,
and only here.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from vispy.scene.visuals import create_visual_node
from vispy.visuals import MarkersVisual

ABOVE_ALL = 1_000_000
SIZE = 13
COLOUR = (1.0, 0.85, 0.0, 1.0)
RIM = (0.0, 0.0, 0.0, 1.0)


class _UnboundedMarkersVisual(MarkersVisual):
    """Markers that do not count when a camera looks for what there is to see."""

    def _compute_bounds(self, axis: int, view: Any) -> None:
        return None


_Markers = create_visual_node(_UnboundedMarkersVisual)


class CanvasMarks:
    """Some marks of one size in the canvas of a viewer, wherever they are in depth.

    Parameters
    ----------
    qt_viewer : napari.qt.QtViewer
    """

    def __init__(self, qt_viewer: Any) -> None:
        self._dims = qt_viewer.viewer.dims
        self._visual = _Markers(parent=qt_viewer.canvas.view.scene)
        self._visual.order = ABOVE_ALL
        self._visual.set_gl_state("translucent", depth_test=False)
        self._visual.visible = False
        self.positions: npt.NDArray[np.floating] = np.zeros((0, 0))

    def show(self, positions: npt.ArrayLike) -> None:
        """Mark places in the viewer's world.

        Parameters
        ----------
        positions : array-like, (k, n)
            In the last n axes of the viewer. In a slice, a place further from it than
            half a step is left out.
        """
        places = np.atleast_2d(np.asarray(positions, dtype=float))
        world = np.tile(np.asarray(self._dims.point, dtype=float), (len(places), 1))
        world[:, -places.shape[1] :] = places
        hidden = list(self._dims.not_displayed)
        step = np.array([each.step for each in self._dims.range])[hidden]
        away = np.abs(world[:, hidden] - np.asarray(self._dims.point)[hidden])
        kept = world[(away <= step / 2 + 1e-9).all(axis=1)]
        self.positions = kept
        if not len(kept):
            self.hide()
            return
        # The scene has x first.
        shown = kept[:, list(self._dims.displayed)[::-1]]
        self._visual.set_data(
            shown.astype(np.float32), size=SIZE, face_color=COLOUR, edge_color=RIM, edge_width=1.5
        )
        self._visual.visible = True

    def hide(self) -> None:
        """Mark nothing."""
        self.positions = np.zeros((0, 0))
        if self._visual.visible:
            self._visual.visible = False

    @property
    def visible(self) -> bool:
        return bool(self._visual.visible)

    def remove(self) -> None:
        """Take the marks out of the scene."""
        self._visual.parent = None
