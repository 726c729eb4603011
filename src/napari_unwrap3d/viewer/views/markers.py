"""Marks drawn over a canvas that are no layers: nobody can select, paint or save them.

napari has no public way to draw in its scene beside layers, so its scene is used here,
and only here.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from vispy.scene.visuals import create_visual_node
from vispy.visuals import LineVisual, MarkersVisual

ABOVE_ALL = 1_000_000
SIZE = 13
COLOUR = (1.0, 0.85, 0.0, 1.0)
RIM = (0.0, 0.0, 0.0, 1.0)
LINE, LINE_RIM = 2.0, 4.0


class _UnboundedMarkersVisual(MarkersVisual):
    """Markers that do not count when a camera looks for what there is to see."""

    def _compute_bounds(self, axis: int, view: Any) -> None:
        return None


class _UnboundedLineVisual(LineVisual):
    """Lines of the same kind."""

    def _compute_bounds(self, axis: int, view: Any) -> None:
        return None


_Markers = create_visual_node(_UnboundedMarkersVisual)
_Line = create_visual_node(_UnboundedLineVisual)


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


class CanvasLines:
    """Straight segments in the canvas of a viewer in 3D, seen through everything.

    Parameters
    ----------
    qt_viewer : napari.qt.QtViewer
    """

    def __init__(self, qt_viewer: Any) -> None:
        self._dims = qt_viewer.viewer.dims
        self.segments: npt.NDArray[np.floating] = np.zeros((0, 2, 3))
        # Bright in a dark rim, to be seen on any colour.
        self._visuals = []
        for order, (width, colour) in enumerate(((LINE_RIM, RIM), (LINE, COLOUR))):
            visual = _Line(
                pos=np.zeros((2, 3), np.float32),
                color=colour,
                width=width,
                connect="segments",
                parent=qt_viewer.canvas.view.scene,
            )
            visual.order = ABOVE_ALL + order
            visual.set_gl_state("translucent", depth_test=False)
            visual.visible = False
            self._visuals.append(visual)

    def show(self, segments: npt.ArrayLike) -> None:
        """Draw segments (k, 2, 3), given in the last three axes of the viewer's world."""
        self.segments = np.asarray(segments, dtype=float)
        # The scene has x first.
        order = [axis - (self._dims.ndim - 3) for axis in self._dims.displayed[::-1]]
        places = self.segments.reshape(-1, 3)[:, order].astype(np.float32)
        for visual in self._visuals:
            visual.set_data(pos=places, connect="segments")
            visual.visible = True

    def hide(self) -> None:
        """Draw nothing."""
        self.segments = np.zeros((0, 2, 3))
        for visual in self._visuals:
            if visual.visible:
                visual.visible = False

    def remove(self) -> None:
        """Take the lines out of the scene."""
        for visual in self._visuals:
            visual.parent = None
