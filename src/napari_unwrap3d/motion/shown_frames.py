"""A frame with what views need of it: its mesh cut for a texture, and what is drawn on it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Frame, Ints
from ..files.texture import texture_corners
from ..geometry.padding import sample_uv_nearest
from ..geometry.raster import outermost_faces
from ..textured import Laid, Sheet, lay
from ..unwrapping.topographic_surface import cut_at_seam


@dataclass(frozen=True, eq=False)
class ShownFrame:
    """A frame, and its mesh as it is shown: cut where the uv image begins again.

    Attributes
    ----------
    frame : Frame
    laid : Laid
        How the uv image lies on the mesh.
    vertices : ndarray, (p, 3) float32
        µm, with copies along the seam at the end.
    faces : ndarray, (m, 3) int32
    """

    frame: Frame
    laid: Laid
    vertices: npt.NDArray[np.float32]
    faces: npt.NDArray[np.int32]

    @property
    def rows(self) -> int:
        """Rows of the uv image."""
        return self.laid.rows

    def sampled(self, image: npt.NDArray[np.generic]) -> npt.NDArray[np.float32]:
        """An image (N, 2N) at the vertices (n,) of the frame's surface; NaN without an image."""
        place = self.frame.topography[:, 1:]
        known = ~self.frame.outside
        found = np.full(len(place), np.nan, np.float32)
        found[known] = sample_uv_nearest(image, place[known])
        return found

    def pixels_under(self, vertices: Ints) -> tuple[Ints, Ints]:
        """Rows and columns of the pixels over some vertices, and over the faces between them.

        Parameters
        ----------
        vertices : ndarray, (k,)
            Of the frame's surface.
        """
        places, faces, origin = self.cut
        chosen = np.zeros(len(self.frame.surface.vertices), bool)
        chosen[vertices] = True
        between = faces[chosen[origin[faces]].all(axis=1)]
        drawn, _, _ = outermost_faces(places, between, self.rows)
        marked = drawn >= 0
        own = np.flatnonzero(chosen & ~self.frame.outside)
        index = np.arange(marked.size).reshape(marked.shape)
        marked.ravel()[sample_uv_nearest(index, self.frame.topography[own, 1:])] = True
        rows, columns = np.nonzero(marked)
        return rows, columns

    @cached_property
    def cut(self) -> tuple[Floats, Ints, Ints]:
        """``S^t(d, u, v)`` cut at the seam: (d, v, u), faces, and the vertex each is a copy of."""
        return cut_at_seam(self.frame.topography, self.frame.surface.faces, self.rows)


def shown_frame(frame: Frame) -> ShownFrame:
    """Cut the mesh of a frame, so that its uv image is a texture of it.

    Whatever the frame, the texture has the same pixels: what is drawn in (u, v) is on the
    surface of every timepoint with nothing to be done.
    """
    rows = next(iter(frame.uv.values())).shape[0]
    surface = frame.surface
    place = frame.topography[:, 1:].copy()
    place[frame.outside] = np.nan
    corners = texture_corners(place, surface.faces, rows)
    laid = lay(corners, surface.faces, Sheet.whole(rows))
    return ShownFrame(
        frame=frame,
        laid=laid,
        vertices=surface.vertices[laid.origin].astype(np.float32),
        faces=laid.faces.astype(np.int32),
    )
