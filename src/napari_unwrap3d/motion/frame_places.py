"""Places of a timepoint's surface in the charts of the common space."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from ..atlas import Atlas
from ..charts import Floats, Ints
from ..fields import HEIGHT
from ..places import Place, Places
from ..unwrapping.topography import topography_to_world
from .shown_frames import ShownFrame

FRAME = "frame"


class FramePlaces(Places):
    """Finds places of one frame: on its mesh, and what of it lies over a (v, u).

    Parameters
    ----------
    atlas : Atlas
        Of the common space.
    shown : ShownFrame
    """

    def __init__(self, atlas: Atlas, shown: ShownFrame) -> None:
        super().__init__(atlas)
        self.shown = shown

    def at_pixel(self, chart: str, point: npt.ArrayLike) -> Place | None:
        """See :meth:`Places.at_pixel`; with the place of the frame that lies outermost there.

        A point of the topography is where it is, whatever the timepoint.
        """
        place = super().at_pixel(chart, point)
        if place is None or place.uv is None:
            return place
        if chart == "topography":
            return replace(place, on_frame=place.position)
        return self._with_frame(place, place.uv)

    def on_mesh(self, chart: str, corners: Ints, weights: Floats) -> Place:
        """See :meth:`Places.on_mesh`; "frame" is the mesh of the frame."""
        if chart != FRAME:
            place = super().on_mesh(chart, corners, weights)
            return place if place.uv is None else self._with_frame(place, place.uv)
        frame = self.shown.frame
        position = weights @ frame.surface.vertices[corners]
        dvu = self._unrolled(frame.topography[corners], weights)
        if dvu is None:
            return Place(position=position, on_frame=position)
        rows, columns = self.atlas.uv.shape
        v, u = np.floor(dvu[1:] + 0.5).astype(int)
        place = self._under_uv(dvu[1:], (int(np.clip(v, 0, rows - 1)), int(u) % columns))
        return replace(place, topography=dvu, on_frame=position)

    def _with_frame(self, place: Place, uv: Floats) -> Place:
        """Where the surface of the frame is over a (v, u): at its own d."""
        heights = self.shown.frame.uv[HEIGHT]
        v, u = np.floor(uv + 0.5).astype(int)
        d = heights[int(np.clip(v, 0, len(heights) - 1)), u % heights.shape[1]]
        dvu = np.array([d, *uv], dtype=np.float64)
        world, valid = topography_to_world(self.atlas.topography, dvu[None])
        if not np.isfinite(d) or not valid[0]:
            return replace(place, topography=None)
        return replace(place, topography=dvu, on_frame=world[0])
