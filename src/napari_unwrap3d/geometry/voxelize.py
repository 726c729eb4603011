"""Exact voxelisation of a closed mesh: the winding number at every voxel centre.

Every column of voxels is a ray; each crossing with a triangle changes the winding
number by the sign of the crossing. Summing the signed crossings along the column
gives the winding number everywhere, for any closed mesh, self-intersecting or not.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# The mesh is shifted by an irrational-looking fraction of a voxel, so that no column passes
# exactly through an edge or a vertex, and no flat face exactly through voxel centres.
SHIFT = (1.2345e-4, 2.3456e-4, 3.4567e-4)


def winding_number(
    vertices: npt.ArrayLike, faces: npt.ArrayLike, shape: tuple[int, int, int]
) -> npt.NDArray[np.int16]:
    """Winding number of a closed mesh around every voxel centre.

    Parameters
    ----------
    vertices : array-like, (n, 3) float
        Positions in index coordinates of the grid: voxel (i, j, k) is centred at (i, j, k).
    faces : array-like, (m, 3) int
        Triangles with positive signed volume.
    shape : (int, int, int)
        Shape of the grid.

    Returns
    -------
    ndarray, `shape`, int16
        1 inside a simple closed mesh, 0 outside; other values where it overlaps itself.
    """
    points = np.asarray(vertices, dtype=np.float64) + SHIFT
    corners = points[np.asarray(faces)]
    face, row, column = _covered_columns(corners[:, :, :2], shape)
    a, b, c = corners[face, 0], corners[face, 1], corners[face, 2]
    w0 = _cross2(b, c, row, column)
    w1 = _cross2(c, a, row, column)
    w2 = _cross2(a, b, row, column)
    area = w0 + w1 + w2
    sign = np.sign(area)
    hit = (w0 * sign >= 0) & (w1 * sign >= 0) & (w2 * sign >= 0) & (area != 0)
    depth = (w0 * a[:, 2] + w1 * b[:, 2] + w2 * c[:, 2])[hit] / area[hit]
    first = np.clip(np.ceil(depth).astype(np.int64), 0, shape[2])
    column_index = (row[hit] * shape[1] + column[hit]) * (shape[2] + 1) + first
    # Where the mesh's normal points against the column, the column enters the solid.
    crossings = np.bincount(
        column_index, weights=-sign[hit], minlength=shape[0] * shape[1] * (shape[2] + 1)
    )
    steps = crossings.astype(np.int16).reshape(shape[0], shape[1], shape[2] + 1)
    return np.cumsum(steps, axis=2, dtype=np.int16)[:, :, :-1]


def voxelize(
    vertices: npt.ArrayLike, faces: npt.ArrayLike, shape: tuple[int, int, int]
) -> npt.NDArray[np.bool_]:
    """Voxels whose centre is inside a closed mesh; see :func:`winding_number`."""
    return winding_number(vertices, faces, shape) > 0


def _covered_columns(corners: Floats, shape: tuple[int, int, int]) -> tuple[Ints, Ints, Ints]:
    """All pairs of a face and a column inside the face's bounding box."""
    low = np.maximum(np.ceil(corners.min(axis=1)).astype(np.int64), 0)
    high = np.minimum(np.floor(corners.max(axis=1)).astype(np.int64), np.array(shape[:2]) - 1)
    extent = np.maximum(high - low + 1, 0)
    count = extent[:, 0] * extent[:, 1]
    face = np.repeat(np.arange(len(corners)), count)
    offset = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    width = extent[face, 1]
    return face, low[face, 0] + offset // width, low[face, 1] + offset % width


def _cross2(p: Floats, q: Floats, row: Ints, column: Ints) -> Floats:
    """Twice the signed area of the triangle (column, p, q) in the plane of the columns."""
    area: Floats = (p[:, 0] - row) * (q[:, 1] - column) - (q[:, 0] - row) * (p[:, 1] - column)
    return area
