"""Draw a triangle mesh into an image: orthographic, shaded, with hidden parts hidden.

A z-buffer in numba, so that a picture of 10⁵ faces takes a fraction of a second, needs
no OpenGL and no display, and is the same on every machine. Lengths keep their scale: the
projection is orthographic, and the image knows its extent in the unit of the vertices.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
import numpy.typing as npt

from ..charts import Floats, Ints
from ..geometry.mesh import vertex_normals

# Rows are the directions of (depth, down, right) in (z, y, x): right-handed like the
# data's axes, so nothing is mirrored. Depth points away from the viewer.
VIEWS: dict[str, Floats] = {
    "z": np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]]),
    "y": np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]),
    "x": np.array([[0.0, 0, -1], [-1, 0, 0], [0, 1, 0]]),
}

LIGHT = np.array([-0.80, -0.45, -0.40]) / np.linalg.norm([-0.80, -0.45, -0.40])
OVERSAMPLING = 2
MARGIN = 0.03


@dataclass(frozen=True, eq=False)
class Rendering:
    """What a view of a mesh shows at the p pixels where there is something to see.

    Attributes
    ----------
    seen : ndarray, (rows, columns) bool
        Where the mesh is; the p pixels are its True ones, row by row.
    corners : ndarray, (p, 3) int64
        Vertices of the face that is seen.
    face : ndarray, (p,) int64
    weights : ndarray, (p, 3) float32
        Barycentric weights of the pixel's centre in that face.
    shade : ndarray, (p,) float32
        Brightness by Lambert's law, 0..1.
    extent : (left, right, bottom, top)
        In the unit of the vertices along the view's right and down, as imshow takes it.
    """

    seen: npt.NDArray[np.bool_]
    corners: Ints
    face: Ints
    weights: npt.NDArray[np.float32]
    shade: npt.NDArray[np.float32]
    extent: tuple[float, float, float, float]

    def interpolate(self, values: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
        """Values per vertex (n,) at the pixels (p,)."""
        return _interpolate(np.asarray(values, np.float32), self.corners, self.weights)

    def image(self, colours: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
        """RGB (p, 3) in 0..1, shaded, with smooth edges: RGBA at half the resolution."""
        rgba = np.zeros((*self.seen.shape, 4), np.float32)
        rgba[self.seen, :3] = _lit(np.asarray(colours, np.float32), self.shade)
        rgba[self.seen, 3] = 1.0
        pooled = _pooled(rgba)
        pooled[..., :3] /= np.maximum(pooled[..., 3:], 1e-6)
        return np.clip(pooled, 0.0, 1.0)


def _interpolate(
    values: npt.NDArray[np.float32], corners: Ints, weights: npt.NDArray[np.float32]
) -> npt.NDArray[np.float32]:
    total: npt.NDArray[np.float32] = sum(values[corners[:, i]] * weights[:, i] for i in range(3))  # type: ignore[assignment]
    return total


def render(
    vertices: Floats,
    faces: Ints,
    view: npt.NDArray[Any] | str = "z",
    pixels: int = 600,
    extent: tuple[float, float, float, float] | None = None,
    normals: Floats | None = None,
) -> Rendering:
    """Project a mesh and find what is seen at each pixel.

    Parameters
    ----------
    vertices : ndarray, (n, 3)
    faces : ndarray, (m, 3)
        Counter-clockwise seen from outside; faces seen from behind are not drawn.
    view : ndarray (3, 3), or "z", "y", "x"
        Rows are the directions of depth (away from the viewer), down and right.
    pixels : int
        The longer side of the final image; it is computed at twice that.
    extent : (left, right, bottom, top), optional
        What to show; by default all of the mesh with a narrow margin.
    normals : ndarray, (n, 3), optional
        Unit normals of the vertices, where they are known already.

    Returns
    -------
    Rendering
    """
    rotation = VIEWS[view] if isinstance(view, str) else np.asarray(view, dtype=float)
    seen = np.ascontiguousarray(vertices @ rotation.T)
    if extent is None:
        extent = extent_of(seen)
    left, right, bottom, top = extent
    scale = OVERSAMPLING * pixels / max(right - left, bottom - top)
    rows = OVERSAMPLING * max(round((bottom - top) * scale / OVERSAMPLING), 1)
    columns = OVERSAMPLING * max(round((right - left) * scale / OVERSAMPLING), 1)
    # The extent that whole pixels cover, about the same middle.
    top, left = (top + bottom - rows / scale) / 2, (left + right - columns / scale) / 2
    extent = (left, left + columns / scale, top + rows / scale, top)
    seen[:, 1] = (seen[:, 1] - top) * scale - 0.5
    seen[:, 2] = (seen[:, 2] - left) * scale - 0.5
    face = np.full((rows, columns), -1, dtype=np.int64)
    weights = np.zeros((rows, columns, 3), dtype=np.float32)
    _rasterise(seen, np.ascontiguousarray(faces), face, weights)
    where = face >= 0
    found, weight = face[where], weights[where]
    corners = faces[found]
    # Brightness is interpolated between the vertices, as Gouraud did.
    normals = vertex_normals(vertices, faces) if normals is None else normals
    towards = normals @ (rotation.T @ LIGHT)
    shade = np.clip(_interpolate(towards.astype(np.float32), corners, weight), 0.0, 1.0)
    return Rendering(where, corners, found, weight, shade, extent)


def extent_of(seen: Floats) -> tuple[float, float, float, float]:
    """(left, right, bottom, top) around projected vertices (depth, down, right)."""
    low, high = seen[:, 1:].min(axis=0), seen[:, 1:].max(axis=0)
    margin = MARGIN * float((high - low).max()) or 1.0
    (top, left), (bottom, right) = low - margin, high + margin
    return float(left), float(right), float(bottom), float(top)


def _lit(
    colours: npt.NDArray[np.float32], shade: npt.NDArray[np.float32]
) -> npt.NDArray[np.float32]:
    """Ambient and diffuse light, and a little white where the light falls straight on."""
    light = (0.55 + 0.48 * shade)[:, None]
    shine = 0.10 * (shade**30)[:, None]
    lit: npt.NDArray[np.float32] = np.minimum(colours * light, 1.0) * (1 - shine) + shine
    return lit


def _pooled(image: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    n = OVERSAMPLING
    total = np.zeros((image.shape[0] // n, image.shape[1] // n, image.shape[2]), np.float32)
    for row in range(n):
        for column in range(n):
            total += image[row::n, column::n]
    return total * np.float32(1 / n**2)


@numba.njit(cache=True)
def _rasterise(points: Any, faces: Any, face: Any, weights: Any) -> None:
    """Write the nearest front face of every pixel; `points` are (depth, row, column)."""
    rows, columns = face.shape
    nearest = np.full((rows, columns), np.inf)
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ya, xa, yb, xb, yc, xc = (
            points[a, 1],
            points[a, 2],
            points[b, 1],
            points[b, 2],
            points[c, 1],
            points[c, 2],
        )
        area = (yb - ya) * (xc - xa) - (xb - xa) * (yc - ya)
        if area >= 0.0:  # seen from behind, or edge-on
            continue
        first_row = max(int(np.ceil(min(ya, yb, yc))), 0)
        last_row = min(int(np.floor(max(ya, yb, yc))), rows - 1)
        first_column = max(int(np.ceil(min(xa, xb, xc))), 0)
        last_column = min(int(np.floor(max(xa, xb, xc))), columns - 1)
        for row in range(first_row, last_row + 1):
            for column in range(first_column, last_column + 1):
                wb = ((row - ya) * (xc - xa) - (column - xa) * (yc - ya)) / area
                wc = ((yb - ya) * (column - xa) - (xb - xa) * (row - ya)) / area
                wa = 1.0 - wb - wc
                if wa < -1e-9 or wb < -1e-9 or wc < -1e-9:
                    continue
                depth = wa * points[a, 0] + wb * points[b, 0] + wc * points[c, 0]
                if depth < nearest[row, column]:
                    nearest[row, column] = depth
                    face[row, column] = f
                    weights[row, column, 0] = wa
                    weights[row, column, 1] = wb
                    weights[row, column, 2] = wc
