"""The line of a kymograph: drawn and edited in the second canvas, shown on the 3D surface."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Any

import numpy as np
from napari.layers import Shapes
from qtpy.QtCore import QObject

from ..charts import Floats
from .canvas import UnwrappedCanvas, canvas_of, open_canvas
from .layers import IMAGE, KEY, SPACE, UNIT
from .placing import chart_of
from .turns import soon

NAME = "kymograph line"
COLOUR = "#ffeb3b"
KINDS = ("path", "line")
# Of the image's height, and of the cell's size.
WIDTH_2D, WIDTH_3D = 1 / 90, 1 / 90


class LineLayers:
    """One line, as a shape in the uv image and as paths in space.

    Parameters
    ----------
    viewer : napari.Viewer
    parent : QObject
        The layers are used as long as it lives.
    moved : callable
        The line was drawn, moved, edited or deleted, perhaps not to its end yet.
    """

    def __init__(self, viewer: Any, parent: QObject, moved: Callable[[], object]) -> None:
        self._viewer = weakref.ref(viewer)
        self._drawn: Shapes | None = None
        self._in_space: Shapes | None = None
        self._finished = soon(parent, self._keep_newest)
        self._moved = soon(parent, moved)

    @property
    def corners(self) -> Floats | None:
        """(v, u) of the line (k, 2) in pixels; None without one."""
        if self._drawn is None:
            return None
        shapes = zip(self._drawn.data, self._drawn.shape_type, strict=True)
        lines = [np.asarray(data, np.float64) for data, kind in shapes if kind in KINDS]
        if not lines or not np.ptp(lines[-1], axis=0).max() > 0:
            return None
        return lines[-1]

    def draw(self) -> Shapes | None:
        """Let the person draw a line in the uv image; None where there is no image."""
        viewer = self._viewer()
        canvas = None if viewer is None else canvas_of(viewer)
        image = None if canvas is None else canvas.image("uv")
        if canvas is None or image is None:
            return None
        canvas.show_chart("uv")
        if self._drawn is None or self._drawn not in canvas.model.layers:
            self._make(canvas, len(image.data))
        layer = self._drawn
        canvas.show_tools()
        canvas.model.layers.selection.active = layer
        if layer is not None:
            layer.mode = "add_polyline"
        return layer

    def set_corners(self, corners: Floats) -> None:
        """Put a line in the place of what was drawn."""
        layer = self.draw()
        if layer is not None:
            layer.add(np.asarray(corners, np.float64), shape_type="path", edge_color=COLOUR)
            self._keep_newest()

    def _make(self, canvas: UnwrappedCanvas, rows: int) -> None:
        self._forget_drawn()
        layer = self._drawn = Shapes(
            ndim=2,
            name=NAME,
            edge_width=rows * WIDTH_2D,
            edge_color=COLOUR,
            axis_labels=IMAGE,
            metadata={KEY: {"layer": NAME, "chart": "", "field": ""}},
        )
        layer.events.data.connect(self._on_data)
        # While a corner is dragged there is no other event.
        layer.events.set_data.connect(self._on_drawn)
        canvas.add_chart_layer(layer, "uv")

    def _on_data(self, event: Any) -> None:
        if str(getattr(event, "action", "")) == "added":
            self._finished.start()
        self._moved.start()

    def _on_drawn(self, _: Any = None) -> None:
        self._moved.start()

    def _keep_newest(self) -> None:
        """A new line takes the place of the one before."""
        layer = self._drawn
        if layer is not None and len(layer.data) > 1:
            layer.selected_data = set(range(len(layer.data) - 1))
            layer.remove_selected()
        self._moved.start()

    # In space ----------------------------------------------------------------------------

    def show_in_space(self, places: Floats | None) -> None:
        """Show the line in the 3D canvas.

        Parameters
        ----------
        places : ndarray, (n, 3), optional
            In µm of the surface; NaN breaks the line. None takes it away.
        """
        viewer = self._viewer()
        if viewer is None:
            return
        pieces = [] if places is None else finite_pieces(places)
        layer = self._in_space
        if layer is not None and layer not in viewer.layers:
            layer = self._in_space = None
        if not pieces:
            if layer is not None:
                layer.data = []
            return
        width = float(np.ptp(np.concatenate(pieces), axis=0).max()) * WIDTH_3D
        if layer is None:
            surface = [other for other in viewer.layers if chart_of(other) == "surface"]
            active = viewer.layers.selection.active
            layer = self._in_space = Shapes(
                ndim=3,
                name=NAME,
                translate=surface[0].translate if surface else (0.0, 0.0, 0.0),
                units=(UNIT,) * 3,
                axis_labels=SPACE,
                metadata={KEY: {"layer": NAME, "chart": "", "field": ""}},
            )
            viewer.add_layer(layer)
            viewer.layers.selection.active = active
        layer.data = []
        layer.add(pieces, shape_type="path", edge_width=width, edge_color=COLOUR)

    # The end ----------------------------------------------------------------------------

    def _forget_drawn(self) -> None:
        if self._drawn is not None:
            self._drawn.events.data.disconnect(self._on_data)
            self._drawn.events.set_data.disconnect(self._on_drawn)
            self._drawn = None

    def close(self) -> None:
        """Take both layers away."""
        viewer, drawn = self._viewer(), self._drawn
        self._forget_drawn()
        canvas = None if viewer is None else open_canvas(viewer)
        for model, layer in ((canvas and canvas.model, drawn), (viewer, self._in_space)):
            if model is not None and layer is not None and layer in model.layers:
                model.layers.remove(layer)
        self._in_space = None


def finite_pieces(places: Floats) -> list[Floats]:
    """The parts of a line (n, 3) between its NaN, of two points or more."""
    good = np.isfinite(places).all(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]])))
    return [places[start:stop] for start, stop in edges.reshape(-1, 2) if stop - start > 1]
