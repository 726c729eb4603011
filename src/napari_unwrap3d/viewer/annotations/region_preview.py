"""The edges of a box or half-space in the main canvas, before and while it marks something."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ...annotations import Shape
from ...annotations.shapes import edges_in_space
from ..views.markers import CanvasLines
from ..views.placing import chart_of

if TYPE_CHECKING:
    from .annotating import Annotating


class RegionPreview:
    """Edges of a region around the cell.

    Parameters
    ----------
    annotating : Annotating
    """

    def __init__(self, annotating: Annotating) -> None:
        self._annotating = annotating
        self._lines: CanvasLines | None = None

    @property
    def segments(self) -> npt.NDArray[np.floating]:
        """What is drawn, (k, 2, 3) in the viewer's world; empty for nothing."""
        return np.zeros((0, 2, 3)) if self._lines is None else self._lines.segments

    def show(self, region: Shape) -> None:
        """Draw the edges of a region given in µm of the surface."""
        viewer, atlas = self._annotating.viewer, self._annotating.atlas
        if viewer is None or atlas is None or viewer.dims.ndisplay != 3:
            self.hide()
            return
        if self._lines is None:
            self._lines = CanvasLines(viewer.window._qt_viewer)
        vertices = atlas.surface.vertices
        edges = edges_in_space(region, vertices.min(axis=0), vertices.max(axis=0))
        surface = [layer for layer in viewer.layers if chart_of(layer) == "surface"]
        self._lines.show(edges + (surface[0].translate[-3:] if surface else 0.0))

    def hide(self) -> None:
        """Draw nothing."""
        if self._lines is not None:
            self._lines.hide()

    def remove(self) -> None:
        """Leave nothing behind in the canvas."""
        if self._lines is not None:
            self._lines.remove()
            self._lines = None
