"""Patches of a surface that a person marks: under a brush, or inside a lasso."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt
from scipy import sparse

from .mesh import edges_with_faces
from .picking import RayPicker

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# A path along edges is longer than the straight one: by up to 15 % on a mesh of equilateral
# triangles, 41 % on one of right ones. What is farther is on another fold of the surface.
DETOUR = 1.45
RING_SIDES = 64
# Lines of sight that differ by less run side by side.
PARALLEL = 1e-9


class Brush:
    """Finds the vertices under a round brush on a mesh.

    A vertex counts when it lies in the ball around the brush's centre and can be reached
    from there along the surface without a detour: a ball alone would mark both sides of a
    fold, and the near side of a neighbouring protrusion.

    Parameters
    ----------
    vertices : ndarray, (n, 3)
        In µm.
    faces : ndarray, (m, 3)
    """

    def __init__(self, vertices: npt.ArrayLike, faces: npt.ArrayLike) -> None:
        self._vertices = np.ascontiguousarray(vertices, dtype=np.float64)
        self._faces = np.ascontiguousarray(faces, dtype=np.int64)
        size = len(self._vertices)
        a, b = edges_with_faces(self._faces).vertices.T
        length = np.linalg.norm(self._vertices[a] - self._vertices[b], axis=1)
        graph = sparse.coo_array((np.maximum(length, 1e-300), (a, b)), shape=(size, size)).tocsr()
        graph = sparse.csr_array(graph + graph.T)
        self._first = graph.indptr.astype(np.int64)
        self._next, self._length = graph.indices.astype(np.int64), graph.data
        # Kept between calls, so that a dab costs what it covers and not the whole mesh.
        self._distance = np.full(size, np.inf)
        self._marked = np.zeros(size, np.bool_)

    def vertices(self, face: Ints, points: Floats, radius: float) -> Ints:
        """The vertices under a brush at some points of the surface.

        Parameters
        ----------
        face : ndarray, (k,) int64
            The face that each point lies in.
        points : ndarray, (k, 3)
            In µm.
        radius : float
            In µm. However small, the corner of the face next to each point is marked.

        Returns
        -------
        ndarray, int64
            Sorted, each vertex once.
        """
        corners = self._faces[np.asarray(face, np.int64)]
        found = _dab(
            self._vertices,
            self._first,
            self._next,
            self._length,
            corners,
            np.ascontiguousarray(points, np.float64),
            float(radius),
            DETOUR * float(radius),
            self._distance,
            self._marked,
        )
        return np.sort(found)


def ring(centre: Floats, normal: Floats, radius: float) -> Floats:
    """A circle (k, 2, 3) of straight segments around a point (3,), across a direction (3,)."""
    helper = np.eye(3)[np.abs(normal).argmin()]
    one = np.cross(normal, helper)
    one /= np.linalg.norm(one)
    other = np.cross(normal, one)
    other /= np.linalg.norm(other)
    turn = np.linspace(0.0, 2.0 * np.pi, RING_SIDES + 1)[:, None]
    corners = centre + radius * (np.cos(turn) * one + np.sin(turn) * other)
    return np.stack([corners[:-1], corners[1:]], axis=1)


@numba.njit(nogil=True, cache=True)
def _push(heap, key, vertex):  # type: ignore[no-untyped-def]
    heap.append((key, vertex))
    i = len(heap) - 1
    while i > 0 and heap[(i - 1) // 2][0] > heap[i][0]:
        heap[i], heap[(i - 1) // 2] = heap[(i - 1) // 2], heap[i]
        i = (i - 1) // 2


@numba.njit(nogil=True, cache=True)
def _pop(heap):  # type: ignore[no-untyped-def]
    top = heap[0]
    last = heap.pop()
    if len(heap) > 0:
        heap[0] = last
        i = 0
        while True:
            child = 2 * i + 1
            if child >= len(heap):
                break
            if child + 1 < len(heap) and heap[child + 1][0] < heap[child][0]:
                child += 1
            if heap[i][0] <= heap[child][0]:
                break
            heap[i], heap[child] = heap[child], heap[i]
            i = child
    return top


@numba.njit(nogil=True, cache=True)
def _far(vertices, vertex, point):  # type: ignore[no-untyped-def]
    total = 0.0
    for k in range(3):
        total += (vertices[vertex, k] - point[k]) ** 2
    return np.sqrt(total)


@numba.njit(nogil=True, cache=True)
def _dab(vertices, first, following, length, corners, points, radius, limit, distance, marked):  # type: ignore[no-untyped-def]
    found = [np.int64(0) for _ in range(0)]
    for j in range(len(points)):
        heap = [(0.0, np.int64(0)) for _ in range(0)]
        touched = [np.int64(0) for _ in range(0)]
        nearest = corners[j, 0]
        for k in range(3):
            vertex = corners[j, k]
            away = _far(vertices, vertex, points[j])
            if away < _far(vertices, nearest, points[j]):
                nearest = vertex
            if away <= radius and away < distance[vertex]:
                if distance[vertex] == np.inf:
                    touched.append(vertex)
                distance[vertex] = away
                _push(heap, away, vertex)
        if not marked[nearest]:
            marked[nearest] = True
            found.append(nearest)
        while len(heap) > 0:
            away, vertex = _pop(heap)
            if away > distance[vertex]:
                continue
            if not marked[vertex]:
                marked[vertex] = True
                found.append(vertex)
            for i in range(first[vertex], first[vertex + 1]):
                other = following[i]
                reached = away + length[i]
                if reached > limit or reached >= distance[other]:
                    continue
                if _far(vertices, other, points[j]) > radius:
                    continue
                if distance[other] == np.inf:
                    touched.append(other)
                distance[other] = reached
                _push(heap, reached, other)
        for vertex in touched:
            distance[vertex] = np.inf
    for vertex in found:
        marked[vertex] = False
    result = np.empty(len(found), np.int64)
    for i in range(len(found)):
        result[i] = found[i]
    return result


def lasso(picker: RayPicker, outline: npt.ArrayLike, directions: npt.ArrayLike) -> Ints:
    """The vertices that a person sees inside an outline drawn on the screen.

    Parameters
    ----------
    picker : RayPicker
    outline : array-like, (k, 3)
        A point of the line of sight through each corner of the outline.
    directions : array-like, (k, 3)
        The lines' directions away from the viewer; all the same unless the view is in
        perspective.

    Returns
    -------
    ndarray, int64
        Sorted; of every line of sight only what lies in front.
    """
    origins = np.asarray(outline, dtype=np.float64)
    along = np.asarray(directions, dtype=np.float64)
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    if len(origins) < 3:
        return np.zeros(0, np.int64)
    middle = along.mean(axis=0)
    middle /= np.linalg.norm(middle)
    eye = None if np.abs(along - middle).max() < PARALLEL else _eye(origins, along)
    flat, _ = _on_screen(origins, middle, eye)
    places, before = _on_screen(picker.vertices, middle, eye)
    inside = np.flatnonzero(before & _in_polygon(places, flat))
    lines = np.broadcast_to(middle, (len(inside), 3))
    if eye is not None:
        lines = picker.vertices[inside] - eye
    return inside[picker.visible(inside, lines)]


def _eye(origins: Floats, along: Floats) -> Floats:
    """The point (3,) nearest to all lines."""
    across = np.eye(3) - along[:, :, None] * along[:, None, :]
    eye: Floats = np.linalg.solve(across.sum(axis=0), np.einsum("kij,kj->i", across, origins))
    return eye


def _on_screen(
    points: Floats, middle: Floats, eye: Floats | None
) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Places (n, 2) on a plane across the view, and whether they are before the viewer."""
    helper = np.eye(3)[np.abs(middle).argmin()]
    right = np.cross(middle, helper)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(middle, right)], axis=1)
    if eye is None:
        return points @ axes, np.ones(len(points), bool)
    seen = points - eye
    depth = seen @ middle
    before = np.asarray(depth > 0.0)
    return seen @ axes / np.where(before, depth, 1.0)[:, None], before


@numba.njit(nogil=True, cache=True)
def _in_polygon(points, corners):  # type: ignore[no-untyped-def]
    """Whether points (n, 2) lie in a closed polygon (k, 2), by the even-odd rule."""
    inside = np.zeros(len(points), np.bool_)
    count = len(corners)
    for i in range(len(points)):
        x, y = points[i, 0], points[i, 1]
        within = False
        for k in range(count):
            ax, ay = corners[k, 0], corners[k, 1]
            bx, by = corners[(k + 1) % count, 0], corners[(k + 1) % count, 1]
            if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
                within = not within
        inside[i] = within
    return inside
