"""The line of a kymograph: drawn and edited in the second canvas, shown on the 3D surface."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Any

import numpy as np
from napari.layers import Shapes, Vectors
from qtpy.QtCore import QObject

from ...charts import Floats
from ..common.turns import soon
from ..views.canvas import UnwrappedCanvas, canvas_of, open_canvas
from ..views.layers import IMAGE, KEY, SPACE, UNIT
from ..views.placing import chart_of

NAME, WAY = "kymograph line", "kymograph line: its way"
COLOUR = "#ffeb3b"
KINDS = ("path", "line")
# Of the image's height, and of the cell's size.
WIDTH_2D, WIDTH_3D = 1 / 90, 1 / 90
MINIMUM_UM = 0.1


class LineLayers:
    """One line, as a shape in the uv image and as segments in space.

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
        self._along: Shapes | None = None
        self._in_space: Vectors | None = None
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
        self._along = _layer(WAY, rows * WIDTH_2D / 2)
        layer = self._drawn = _layer(NAME, rows * WIDTH_2D)
        canvas.add_chart_layer(self._along, "uv")
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

    # The way that is measured --------------------------------------------------------

    def show_in_image(self, places: Floats | None) -> None:
        """Show in the uv image which way the line takes, over the seam and on great circles.

        Parameters
        ----------
        places : ndarray, (n, 2), optional
            (v, u) in pixels; NaN breaks the line. None takes it away.
        """
        if self._along is not None:
            self._along.data = []
            pieces = [] if places is None else finite_pieces(places)
            if pieces:
                self._along.add(pieces, shape_type="path", edge_color=COLOUR)

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
        segments = np.zeros((0, 2, 3)) if places is None else segments_of(places)
        layer = self._in_space
        if layer is not None and layer in viewer.layers:
            layer.data = segments
        elif len(segments):
            surface = [other for other in viewer.layers if chart_of(other) == "surface"]
            active = viewer.layers.selection.active
            size = float(np.ptp(segments[:, 0], axis=0).max())
            # A path of a Shapes layer takes a tenth of a second to move.
            self._in_space = Vectors(
                segments,
                name=NAME,
                edge_width=max(size, MINIMUM_UM) * WIDTH_3D,
                length=1,
                edge_color=COLOUR,
                vector_style="line",
                opacity=1.0,
                translate=surface[0].translate if surface else (0.0, 0.0, 0.0),
                units=(UNIT,) * 3,
                axis_labels=SPACE,
                metadata={KEY: {"layer": NAME, "chart": "", "field": ""}},
            )
            viewer.add_layer(self._in_space)
            viewer.layers.selection.active = active

    # The end ----------------------------------------------------------------------------

    def _forget_drawn(self) -> None:
        if self._drawn is not None:
            self._drawn.events.data.disconnect(self._on_data)
            self._drawn.events.set_data.disconnect(self._on_drawn)
            self._drawn = None

    def forget(self) -> None:
        """Let go of the layers where they are."""
        self._forget_drawn()
        self._in_space = self._along = None

    def close(self) -> None:
        """Take the layers away."""
        viewer = self._viewer()
        canvas = None if viewer is None else open_canvas(viewer)
        second = None if canvas is None else canvas.model
        layers = (second, self._drawn), (second, self._along), (viewer, self._in_space)
        self.forget()
        for model, layer in layers:
            if model is not None and layer is not None and layer in model.layers:
                model.layers.remove(layer)


def finite_pieces(places: Floats) -> list[Floats]:
    """The parts of a line (n, 3) between its NaN, of two points or more."""
    good = np.isfinite(places).all(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]])))
    return [places[start:stop] for start, stop in edges.reshape(-1, 2) if stop - start > 1]


def segments_of(places: Floats) -> Floats:
    """The parts of a line (n, 3) as (m, 2, 3): where each begins, and the way to its end."""
    ways = np.diff(places, axis=0)
    segments = np.stack([places[:-1], ways], axis=1)
    return segments[np.isfinite(ways).all(axis=1)]


def _layer(name: str, width: float) -> Shapes:
    return Shapes(
        ndim=2,
        name=name,
        edge_width=width,
        edge_color=COLOUR,
        opacity=1.0,
        axis_labels=IMAGE,
        metadata={KEY: {"layer": name, "chart": "", "field": ""}},
    )
