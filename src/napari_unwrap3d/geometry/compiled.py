"""Calls of compiled libraries that let no other Python thread run until they are done.

Each takes arrays and returns arrays, so that it may also be made in another process; see
:mod:`napari_unwrap3d.geometry.apart`, through which everything here is called.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Found = tuple[Ints, Floats, Floats]

# One query far from the mesh may take a twentieth of a millisecond: so many at a time hold
# other threads up for no longer than 0.1 s.
QUERIES = 2000


def decimated(
    vertices: npt.NDArray[np.float32], faces: npt.NDArray[np.int32], target: int
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int32]]:
    """Quadric decimation to about `target` faces."""
    import fast_simplification

    reduced, triangles = fast_simplification.simplify(vertices, faces, target_count=target)
    return reduced, triangles


def marched(
    values: npt.NDArray[np.float32],
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int32]]:
    """Vertices (n, 3) in index coordinates and faces (m, 3) of the zero set of (z, y, x)."""
    from skimage.measure import marching_cubes

    vertices, faces, _, _ = marching_cubes(values, 0.0, gradient_direction="ascent")
    return vertices, faces


class Tree:
    """libigl's bounding box tree of the faces of a mesh.

    Parameters
    ----------
    vertices : ndarray, (n, 3) float64
    faces : ndarray, (m, 3) int64
    """

    def __init__(self, vertices: Floats, faces: Ints) -> None:
        import igl

        self._mesh = vertices, faces
        self._tree = igl.AABB()
        self._tree.init(vertices, faces)

    def closest(self, points: Floats) -> Found:
        """Face (k,), closest point (k, 3) and squared distance (k,) of points (k, 3)."""
        return _in_parts(self._closest, points)

    def first_hit(self, origin: Floats, direction: Floats) -> Found:
        """Face (k,), t (k,) and (u, v) (k, 2) of rays; face −1 for none."""
        return _in_parts(self._first_hit, origin, direction)

    def _closest(self, points: Floats) -> Found:
        squared, face, closest = self._tree.squared_distance(*self._mesh, points)
        return np.asarray(face, np.int64).ravel(), np.asarray(closest), np.asarray(squared).ravel()

    def _first_hit(self, origin: Floats, direction: Floats) -> Found:
        face, t, uv = self._tree.intersect_ray_first(*self._mesh, origin, direction)
        face, t = np.asarray(face, np.int64).ravel(), np.asarray(t).ravel()
        # Where nothing is hit libigl leaves what was in the memory.
        return face, t, np.where(face[:, None] >= 0, np.reshape(uv, (-1, 2)), 0.0)


def _in_parts(query: Callable[..., Found], *rows: Floats) -> Found:
    """What a query gives for each row of some arrays (n, 3), a part of the rows at a time."""
    count = max(len(rows[0]), 1)
    parts = [query(*(each[i : i + QUERIES] for each in rows)) for i in range(0, count, QUERIES)]
    if len(parts) == 1:
        return parts[0]
    face, first, second = (np.concatenate(found) for found in zip(*parts, strict=True))
    return face, first, second
