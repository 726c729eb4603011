"""The nodes of a grid that lie next to a triangle mesh, and the vertex nearest to each."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


def nearest_vertices(
    index: Floats,
    vertices: Floats,
    faces: Ints,
    shape: tuple[int, int, int],
    reach: float,
    margin: tuple[int, int, int],
    positions: npt.NDArray[np.floating] | None = None,
    *,
    periodic: bool = False,
) -> npt.NDArray[np.int32]:
    """For every node next to a mesh the nearest corner of a face that passes there.

    Parameters
    ----------
    index : ndarray, (n, 3)
        The vertices in indices of the grid; faces with one that is NaN are left out.
    vertices : ndarray, (n, 3)
        The vertices in space, where distances are measured.
    faces : ndarray, (m, 3)
    shape : tuple of int
        Of the grid.
    reach : float
        How far from a face's plane a node may lie.
    margin : tuple of int
        How many nodes beyond the box around a face it may lie, for every axis.
    positions : ndarray, (*shape, 3), optional
        Of the nodes in space, NaN where there is none; their indices unless given.
    periodic : bool
        Whether the last axis is.

    Returns
    -------
    ndarray, `shape`, int32
        −1 for nodes that are not next to the mesh.
    """
    known = np.asarray(np.isfinite(index).all(axis=1))
    # Zeros are free until they are written, and most of the grid never is.
    owner, best = np.zeros(shape, np.int32), np.zeros(shape, np.float32)
    given = np.zeros((0, 0, 0, 3), np.float32) if positions is None else positions
    triangles = faces[known[faces].all(axis=1)]
    _visit(index, vertices, triangles, reach, np.array(margin), given, periodic, owner, best)
    owner -= 1
    return owner


@numba.njit(nogil=True, cache=True)
def _visit(index, vertices, faces, reach, margin, positions, periodic, owner, best):  # type: ignore[no-untyped-def]
    shape = owner.shape
    regular = positions.shape[0] == 0
    low, high = np.empty(3), np.empty(3)
    for f in range(len(faces)):
        a, b, c = vertices[faces[f, 0]], vertices[faces[f, 1]], vertices[faces[f, 2]]
        nz = (b[1] - a[1]) * (c[2] - a[2]) - (b[2] - a[2]) * (c[1] - a[1])
        ny = (b[2] - a[2]) * (c[0] - a[0]) - (b[0] - a[0]) * (c[2] - a[2])
        nx = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        size = np.sqrt(nz * nz + ny * ny + nx * nx)
        if size == 0.0:
            continue
        _box(index, faces[f], shape, periodic, low, high)
        first = np.ceil(low - margin).astype(np.int64)
        last = np.floor(high + margin).astype(np.int64)
        for i in range(max(first[0], 0), min(last[0], shape[0] - 1) + 1):
            for j in range(max(first[1], 0), min(last[1], shape[1] - 1) + 1):
                begin, end = first[2], last[2]
                if not periodic:
                    begin, end = max(begin, 0), min(end, shape[2] - 1)
                elif end - begin >= shape[2]:
                    begin, end = 0, shape[2] - 1
                for column in range(begin, end + 1):
                    k = column % shape[2]
                    z, y, x = float(i), float(j), float(k)
                    if not regular:
                        z, y, x = (
                            positions[i, j, k, 0],
                            positions[i, j, k, 1],
                            positions[i, j, k, 2],
                        )
                    away = (z - a[0]) * nz + (y - a[1]) * ny + (x - a[2]) * nx
                    if not abs(away) <= reach * size:
                        continue
                    for corner in faces[f]:
                        p, q, r = vertices[corner]
                        squared = (z - p) ** 2 + (y - q) ** 2 + (x - r) ** 2
                        if owner[i, j, k] == 0 or squared < best[i, j, k]:
                            owner[i, j, k] = corner + 1
                            best[i, j, k] = squared


@numba.njit(nogil=True, cache=True)
def _box(index, face, shape, periodic, low, high):  # type: ignore[no-untyped-def]
    """The box around a face in indices; on a periodic axis around its first corner."""
    for axis in range(3):
        start = index[face[0], axis]
        low[axis] = high[axis] = start
        for k in range(1, 3):
            value = index[face[k], axis]
            if periodic and axis == 2:
                value = start + (value - start + 0.5 * shape[2]) % shape[2] - 0.5 * shape[2]
            low[axis], high[axis] = min(low[axis], value), max(high[axis], value)
    if periodic and high[2] - low[2] > 0.25 * shape[2]:
        # So wide is only a face around a pole.
        low[2], high[2] = 0.0, float(shape[2] - 1)
        if low[1] < 0.5 * shape[1]:
            low[1] = 0.0
        else:
            high[1] = float(shape[1] - 1)
