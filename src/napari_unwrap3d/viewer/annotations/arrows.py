"""Arrows in the main canvas: a fitted plane's normal, and the axis of lateral speeds."""

from __future__ import annotations

import math
import weakref
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from qtpy.QtCore import QObject

from ...annotations import Annotations
from ..common.turns import soon
from ..views.layers import KEY, SPACE, UNIT
from ..views.placing import chart_of

if TYPE_CHECKING:
    from napari.components import ViewerModel

    from .annotating import Annotating

AXIS = "axis of lateral speeds"
LENGTH_SHARE = 0.4
# From the middle of the cell, so that the arrow comes out of it.
AXIS_SHARE = 0.75
THICKNESS = 1 / 25


def show_arrow(
    viewer: Any, name: str, start: npt.ArrayLike, arrow: npt.ArrayLike, colour: str
) -> None:
    """Draw an arrow beside the surface's layer, in the place of one of the same name.

    Parameters
    ----------
    viewer : napari.Viewer
    name : str
        Of its layer.
    start, arrow : array-like, (3,)
        (z, y, x) in µm of the surface.
    colour : str
    """
    vector = np.array([[start, arrow]], dtype=float)
    if name in viewer.layers:
        viewer.layers[name].data = vector
        return
    surface = [layer for layer in viewer.layers if chart_of(layer) == "surface"]
    active = viewer.layers.selection.active
    viewer.add_vectors(
        vector,
        name=name,
        translate=surface[0].translate if surface else (0.0, 0.0, 0.0),
        units=(UNIT,) * 3,
        axis_labels=SPACE,
        edge_width=float(np.linalg.norm(vector[0, 1])) * THICKNESS,
        edge_color=colour,
        vector_style="arrow",
        metadata={KEY: {"layer": name, "chart": "", "field": ""}},
    )
    viewer.layers.selection.active = active


def direction_text(direction: tuple[float, float, float]) -> str:
    """A direction in numbers, and how far it leans."""
    z, y, x = direction
    leans = math.degrees(math.acos(min(abs(z), 1.0)))
    return f"(z, y, x) = ({z:.3f}, {y:.3f}, {x:.3f}), {leans:.1f}° from the z axis"


class AxisArrow(QObject):
    """Shows the axis of lateral speeds that was chosen for a cell.

    Parameters
    ----------
    viewer : napari.Viewer
    annotating : Annotating
    """

    def __init__(self, viewer: ViewerModel, annotating: Annotating) -> None:
        super().__init__(annotating)
        self._viewer = weakref.ref(viewer)
        self._annotating = annotating
        self._annotations: Annotations | None = None
        # In a turn of the event loop of its own: napari needs long to add a layer.
        self._timer = soon(self, self._update)

    def show(self, annotations: Annotations) -> None:
        """Show the axis of this cell."""
        self._annotations = annotations
        annotations.turned.connect(self._later)
        self._later()

    def leave(self) -> None:
        """Take the arrow away."""
        self._timer.stop()
        if self._annotations is not None:
            self._annotations.turned.disconnect(self._later)
            self._annotations = None
        self._remove()

    def _later(self) -> None:
        self._timer.start()

    def _update(self) -> None:
        viewer, atlas = self._viewer(), self._annotating.atlas
        if viewer is None or atlas is None or self._annotations is None:
            return
        axis = self._annotations.axis
        if axis is None:
            self._remove()
            return
        vertices = atlas.surface.vertices
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        length = AXIS_SHARE * float((high - low).max())
        show_arrow(viewer, AXIS, (low + high) / 2, length * np.array(axis), "#26c6da")

    def _remove(self) -> None:
        viewer = self._viewer()
        if viewer is not None and AXIS in viewer.layers:
            viewer.layers.remove(AXIS)
