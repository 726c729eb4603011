"""Calls of compiled libraries that let no other Python thread run until they are done.

Functions take and return arrays, so that they may also be called in another process; see
:mod:`napari_unwrap3d.geometry.apart`, through which they are called. Trees do a part of their
work at a time instead.
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
# The tree of so many faces takes 0.03 s to build.
FACES = 40_000


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
    """The faces of a mesh in libigl's trees of bounding boxes, one for every block of faces.

    Parameters
    ----------
    vertices : ndarray, (n, 3) float64
    faces : ndarray, (m, 3) int64
    """

    def __init__(self, vertices: Floats, faces: Ints) -> None:
        parts = blocks(vertices[faces].mean(axis=1))
        self._blocks = [Block(vertices, faces, part) for part in parts]

    def closest(self, points: Floats) -> Found:
        """Face (k,), closest point (k, 3) and squared distance (k,) of points (k, 3)."""
        return _in_parts(self._closest, points)

    def first_hit(self, origin: Floats, direction: Floats) -> Found:
        """Face (k,), t (k,) and (u, v) (k, 2) of rays; face −1 for none."""
        return _in_parts(self._first_hit, origin, direction)

    def _closest(self, points: Floats) -> Found:
        first, *others = self._blocks
        face, closest, squared = first.closest(points)
        for block in others:
            nearer = np.flatnonzero(block.at_least(points) < squared)
            if len(nearer):
                found = block.closest(points[nearer])
                better = found[2] < squared[nearer]
                for whole, part in zip((face, closest, squared), found, strict=True):
                    whole[nearer[better]] = part[better]
        return face, closest, squared

    def _first_hit(self, origin: Floats, direction: Floats) -> Found:
        first, *others = self._blocks
        face, t, uv = first.first_hit(origin, direction)
        for block in others:
            found = block.first_hit(origin, direction)
            better = (found[0] >= 0) & ((face < 0) | (found[1] < t))
            for whole, part in zip((face, t, uv), found, strict=True):
                whole[better] = part[better]
        return face, t, uv


class Block:
    """Some faces of a mesh in one tree."""

    def __init__(self, vertices: Floats, faces: Ints, part: Ints) -> None:
        import igl

        self._part = part
        self._mesh = vertices, np.ascontiguousarray(faces[part])
        corners = vertices[self._mesh[1]].reshape(-1, 3)
        self._low, self._high = corners.min(axis=0), corners.max(axis=0)
        self._tree = igl.AABB()
        self._tree.init(*self._mesh)

    def at_least(self, points: Floats) -> Floats:
        """Squared distance (k,) to the box around the faces, which are no nearer."""
        apart = np.maximum(np.maximum(self._low - points, points - self._high), 0.0)
        squared: Floats = np.einsum("ij,ij->i", apart, apart)
        return squared

    def closest(self, points: Floats) -> Found:
        """See :meth:`Tree.closest`."""
        squared, face, closest = self._tree.squared_distance(*self._mesh, points)
        return self._part[np.ravel(face)], np.reshape(closest, (-1, 3)), np.ravel(squared)

    def first_hit(self, origin: Floats, direction: Floats) -> Found:
        """See :meth:`Tree.first_hit`."""
        face, t, uv = self._tree.intersect_ray_first(*self._mesh, origin, direction)
        hit = np.ravel(face) >= 0
        face = np.where(hit, self._part[np.ravel(face)], -1)
        # Where nothing is hit libigl leaves what was in the memory.
        return face, np.ravel(t), np.where(hit[:, None], np.reshape(uv, (-1, 2)), 0.0)


def blocks(centres: Floats) -> list[Ints]:
    """Numbers of the points of compact groups of at most :data:`FACES`, cut at medians."""
    done: list[Ints] = []
    waiting = [np.arange(len(centres))]
    while waiting:
        part = waiting.pop()
        if len(part) <= FACES:
            done.append(part)
            continue
        axis = int(np.argmax(np.ptp(centres[part], axis=0)))
        order = part[np.argsort(centres[part, axis], kind="stable")]
        waiting += [np.sort(order[len(order) // 2 :]), np.sort(order[: len(order) // 2])]
    return done


def _in_parts(query: Callable[..., Found], *rows: Floats) -> Found:
    """What a query gives for each row of some arrays (n, 3), a part of the rows at a time."""
    count = max(len(rows[0]), 1)
    parts = [query(*(each[i : i + QUERIES] for each in rows)) for i in range(0, count, QUERIES)]
    if len(parts) == 1:
        return parts[0]
    face, first, second = (np.concatenate(found) for found in zip(*parts, strict=True))
    return face, first, second
