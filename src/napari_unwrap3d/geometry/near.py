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
    layers: tuple[Ints, Ints] | None = None,
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
        How far from a face a node may lie, to within the face's own size.
    margin : tuple of int
        How many nodes beyond the box around a face it may lie, for every axis.
    positions : ndarray, (*shape, 3), optional
        Of the nodes in space; their indices unless given.
    layers : two ndarrays, shape[1:], optional
        The first and the last node along the first axis that there is; all unless given.
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
    first = np.zeros(shape[1:], np.int64) if layers is None else layers[0]
    last = np.full(shape[1:], shape[0] - 1) if layers is None else layers[1]
    bounds = np.stack([first, last], axis=-1)
    _visit(
        index, vertices, triangles, reach, np.array(margin), given, bounds, periodic, owner, best
    )
    owner -= 1
    return owner


@numba.njit(nogil=True, cache=True)
def _visit(  # type: ignore[no-untyped-def]
    index, vertices, faces, reach, margin, positions, bounds, periodic, owner, best
):
    shape = owner.shape
    regular = positions.shape[0] == 0
    low, high = np.empty(3), np.empty(3)
    for f in range(len(faces)):
        a, b, c = faces[f]
        az, ay, ax = vertices[a]
        bz, by, bx = vertices[b]
        cz, cy, cx = vertices[c]
        nz = (by - ay) * (cx - ax) - (bx - ax) * (cy - ay)
        ny = (bx - ax) * (cz - az) - (bz - az) * (cx - ax)
        nx = (bz - az) * (cy - ay) - (by - ay) * (cz - az)
        limit = reach * np.sqrt(nz * nz + ny * ny + nx * nx)
        if limit == 0.0:
            continue
        # Nowhere is a triangle farther from its corners than its longest edge over √3.
        longest = (az - bz) ** 2 + (ay - by) ** 2 + (ax - bx) ** 2
        longest = max(longest, (bz - cz) ** 2 + (by - cy) ** 2 + (bx - cx) ** 2)
        longest = max(longest, (cz - az) ** 2 + (cy - ay) ** 2 + (cx - ax) ** 2)
        farthest = reach * reach + longest / 3.0
        _box(index, a, b, c, shape, periodic, low, high)
        first_j = max(int(np.ceil(low[1] - margin[1])), 0)
        last_j = min(int(np.floor(high[1] + margin[1])), shape[1] - 1)
        begin = int(np.ceil(low[2] - margin[2]))
        end = int(np.floor(high[2] + margin[2]))
        if not periodic:
            begin, end = max(begin, 0), min(end, shape[2] - 1)
        elif end - begin >= shape[2]:
            begin, end = 0, shape[2] - 1
        for i in range(int(np.ceil(low[0] - margin[0])), int(np.floor(high[0] + margin[0])) + 1):
            for j in range(first_j, last_j + 1):
                for column in range(begin, end + 1):
                    k = column % shape[2]
                    if i < bounds[j, k, 0] or i > bounds[j, k, 1]:
                        continue
                    z, y, x = float(i), float(j), float(k)
                    if not regular:
                        z = np.float64(positions[i, j, k, 0])
                        y = np.float64(positions[i, j, k, 1])
                        x = np.float64(positions[i, j, k, 2])
                    if not abs((z - az) * nz + (y - ay) * ny + (x - ax) * nx) <= limit:
                        continue
                    to_a = (z - az) ** 2 + (y - ay) ** 2 + (x - ax) ** 2
                    to_b = (z - bz) ** 2 + (y - by) ** 2 + (x - bx) ** 2
                    to_c = (z - cz) ** 2 + (y - cy) ** 2 + (x - cx) ** 2
                    nearest, squared = a, to_a
                    if to_b < squared:
                        nearest, squared = b, to_b
                    if to_c < squared:
                        nearest, squared = c, to_c
                    if squared > farthest:
                        continue
                    if owner[i, j, k] == 0 or squared < best[i, j, k]:
                        owner[i, j, k] = nearest + 1
                        best[i, j, k] = squared


@numba.njit(nogil=True, cache=True)
def _box(index, a, b, c, shape, periodic, low, high):  # type: ignore[no-untyped-def]
    """The box around a face in indices; on a periodic axis around its first corner."""
    for axis in range(3):
        start = index[a, axis]
        low[axis] = high[axis] = start
        for corner in (b, c):
            value = index[corner, axis]
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
