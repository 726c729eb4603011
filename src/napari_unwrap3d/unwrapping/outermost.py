"""From a place in the uv image out to where its normal leaves the surface last."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Ints, Surface, Topography
from ..geometry.locate import SurfaceLocator
from ..geometry.padding import sample_uv_nearest, wrap_uv
from ..geometry.raster import outermost_faces
from .topography import topography_to_world

# Layers searched above and below the height known from the neighbouring pixels.
ABOVE, BELOW = 4, 8


class OutermostSurface:
    """The outermost crossing of the surface with the streamline over each (v, u).

    The image of the outermost face per pixel is drawn once from the surface's mesh in
    (d, u, v). For a single place the streamline, a chain of straight segments between
    layers, is intersected with the surface itself, so the answer lies on the surface.
    """

    def __init__(self, surface: Surface, chart: Topography) -> None:
        self._surface = surface
        self._chart = chart
        rows = chart.shape[1]
        face, weights, height = outermost_faces(chart.cut_vertices, chart.cut_faces, rows)
        self.face = _original_faces(surface, chart, face)
        # Cutting keeps the order of the corners, so the weights carry over as they are.
        self.weights = weights
        self.height_um = height

    def image(self, values: npt.NDArray[np.generic]) -> Floats:
        """A scalar per vertex of the surface as an image (N, 2N) of the outermost surface."""
        corners = np.asarray(values, dtype=np.float64)[self._surface.faces[self.face]]
        image: Floats = np.einsum("ijk,ijk->ij", corners, self.weights)
        image[self.face < 0] = np.nan
        return image

    def locate(self, points: Floats) -> tuple[Ints, Floats, npt.NDArray[np.bool_]]:
        """Face (n,), weights (n, 3) and validity of the crossing over (v, u) (n, 2)."""
        vu = wrap_uv(points, self._chart.shape[1])
        layer = self._start_layer(vu)
        face = np.full(len(points), -1, np.int64)
        weights = np.zeros((len(points), 3))
        last = np.maximum(layer - ABOVE - BELOW, 0)
        todo = np.arange(len(points))
        while len(todo):
            hit, place = self._first_hit(layer[todo], vu[todo])
            face[todo], weights[todo] = hit, place
            layer[todo] -= 1
            todo = todo[(hit < 0) & (layer[todo] > last[todo])]
        missed = np.flatnonzero(face < 0)
        if len(missed):
            self._search_whole_columns(vu, missed, face, weights)
        return face, weights, face >= 0

    def _start_layer(self, vu: Floats) -> Ints:
        """A layer safely above the crossing, from the heights of the pixels around."""
        chart = self._chart
        step = chart.d_um[1] - chart.d_um[0]
        height = np.where(np.isfinite(self.height_um), self.height_um, chart.d_um[-1])
        around = [
            sample_uv_nearest(height, vu + offset)
            for offset in ((0, 0), (0.5, 0.5), (0.5, -0.5), (-0.5, 0.5), (-0.5, -0.5))
        ]
        top = (np.max(around, axis=0) - chart.d_um[0]) / step
        layer: Ints = np.ceil(top).astype(np.int64) + ABOVE
        return np.clip(layer, 1, len(chart.d_um) - 1)

    def _search_whole_columns(self, vu: Floats, missed: Ints, face: Ints, weights: Floats) -> None:
        for top in range(len(self._chart.d_um) - 1, 0, -1):
            if len(missed) == 0:
                return
            hit, place = self._first_hit(np.full(len(missed), top), vu[missed])
            found = hit >= 0
            face[missed[found]], weights[missed[found]] = hit[found], place[found]
            missed = missed[~found]

    def _first_hit(self, layer: Ints, vu: Floats) -> tuple[Ints, Floats]:
        """Face (n,) hit between a layer and the one below, −1 for none, and its weights.

        Where the streamline does not reach both layers there is nothing to hit.
        """
        upper, above = self._position(layer, vu)
        lower, below = self._position(layer - 1, vu)
        whole = above & below
        face = np.full(len(vu), -1, np.int64)
        weights = np.zeros((len(vu), 3))
        face[whole], weights[whole] = self._locator.first_hit(upper[whole], lower[whole])
        return face, weights

    def _position(self, layer: Ints, vu: Floats) -> tuple[Floats, npt.NDArray[np.bool_]]:
        d = self._chart.d_um[layer]
        world, valid = topography_to_world(self._chart, np.column_stack([d, vu]))
        return world, np.asarray(valid)

    @cached_property
    def _locator(self) -> SurfaceLocator:
        return SurfaceLocator(self._surface.vertices, self._surface.faces)


def with_outermost(chart: Topography, outermost: OutermostSurface, cell: Surface) -> Topography:
    """The topography with the fields of what lies outermost over each pixel."""
    fields = {
        "height_um": outermost.height_um,
        "mean_curvature_per_um": outermost.image(cell.fields["mean_curvature_per_um"]),
    }
    return replace(chart, fields=fields)


def _original_faces(surface: Surface, chart: Topography, face: Ints) -> Ints:
    """Faces of the surface from faces of the cut mesh, which leaves out unmapped ones."""
    mapped = np.isfinite(chart.surface[:, 0])[surface.faces].all(axis=1)
    original = np.append(np.flatnonzero(mapped), -1)
    result: Ints = original[face]
    return result
