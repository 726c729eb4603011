"""Near-equilateral remeshing that keeps the topology: edge flips and tangential relaxation.

Flips equalise the number of neighbours and make the mesh Delaunay; each vertex then
moves, within the surface, towards the area-weighted mean of the faces around it, which
approximates a centroidal Voronoi tessellation.
"""

from __future__ import annotations

from collections.abc import Callable

import numba
import numpy as np
import numpy.typing as npt

from ..progress import Progress
from . import apart
from .mesh import face_neighbors

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Projection = Callable[[Floats], Floats]

# A flip must leave both new normals within about 32° of the old one.
NORMAL_AGREEMENT = 0.85
STEP = 0.7
VALENCE, DELAUNAY = 0, 1


def simplify(vertices: Floats, faces: Ints, target_vertices: int) -> tuple[Floats, Ints]:
    """Quadric decimation to about `target_vertices` (no change if there are fewer)."""
    if target_vertices >= len(vertices):
        return vertices, faces
    reduced, triangles = apart.call(
        "decimated", vertices.astype(np.float32), faces.astype(np.int32), 2 * target_vertices
    )
    return np.asarray(reduced, dtype=np.float64), np.asarray(triangles, dtype=np.int64)


def subdivide(vertices: Floats, faces: Ints) -> tuple[Floats, Ints]:
    """Every face cut into four at the midpoints of its edges."""
    import igl

    finer, triangles = igl.upsample(vertices, faces, 1)
    return np.asarray(finer, dtype=np.float64), np.asarray(triangles, dtype=np.int64)


def relax(
    vertices: Floats,
    faces: Ints,
    progress: Progress,
    *,
    iterations: int = 15,
    project: Projection | None = None,
) -> tuple[Floats, Ints]:
    """Improve the triangles of a closed manifold mesh without changing its topology.

    Parameters
    ----------
    vertices, faces : ndarray, (n, 3) and (m, 3)
    iterations : int
        Rounds of flips and relaxation.
    project : callable, optional
        Maps points (n, 3) back to the surface; called every second round and at the end.

    Returns
    -------
    vertices, faces : ndarray
        Same numbers of vertices and faces.
    """
    points, triangles = vertices.copy(), faces.copy()
    neighbors = face_neighbors(triangles)
    for iteration in range(iterations):
        progress(iteration / iterations, "remeshing")
        if iteration < iterations - 5:
            flip_edges(points, triangles, neighbors, VALENCE)
        flip_edges(points, triangles, neighbors, DELAUNAY)
        _pull(points, triangles, STEP)
        if project is not None and (iteration % 2 == 1 or iteration == iterations - 1):
            points = project(points)
    flip_edges(points, triangles, neighbors, DELAUNAY)
    return points, triangles


def flip_edges(points: Floats, faces: Ints, neighbors: Ints, rule: int, passes: int = 2) -> int:
    """Flip edges in place until a pass changes almost nothing; returns the number of flips.

    Parameters
    ----------
    points, faces : ndarray
    neighbors : ndarray, (m, 3)
        Face across the edge opposite to each corner; kept up to date.
    rule : int
        ``VALENCE``: towards six neighbours per vertex; ``DELAUNAY``: opposite angles sum to
        at most π.
    """
    valence = np.bincount(faces.ravel(), minlength=len(points))
    total = 0
    for _ in range(passes):
        flips = int(_flip_pass(points, faces, neighbors, valence, rule))
        total += flips
        if flips < 20:
            break
    return total


@numba.njit(nogil=True, cache=True)
def _cross(u, v):  # type: ignore[no-untyped-def]
    return (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])


@numba.njit(nogil=True, cache=True)
def _dot(u, v):  # type: ignore[no-untyped-def]
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


@numba.njit(nogil=True, cache=True)
def _edge(points, p, q):  # type: ignore[no-untyped-def]
    return (
        points[q, 0] - points[p, 0],
        points[q, 1] - points[p, 1],
        points[q, 2] - points[p, 2],
    )


@numba.njit(nogil=True, cache=True)
def _angle_parts(points, apex, p, q):  # type: ignore[no-untyped-def]
    """Quantities in proportion to the sine and the cosine of the angle at `apex`."""
    u, v = _edge(points, apex, p), _edge(points, apex, q)
    n = _cross(u, v)
    return np.sqrt(_dot(n, n)), _dot(u, v)


@numba.njit(nogil=True, cache=True)
def _gain(points, valence, a, b, c, d, rule):  # type: ignore[no-untyped-def]
    """How much flipping the edge a-b to c-d improves the mesh."""
    if rule == 0:
        before = (
            (valence[a] - 6) ** 2
            + (valence[b] - 6) ** 2
            + (valence[c] - 6) ** 2
            + (valence[d] - 6) ** 2
        )
        after = (
            (valence[a] - 7) ** 2
            + (valence[b] - 7) ** 2
            + (valence[c] - 5) ** 2
            + (valence[d] - 5) ** 2
        )
        return float(before - after)
    # The angles at c and d sum to more than π where the sine of their sum is negative.
    sine_c, cosine_c = _angle_parts(points, c, a, b)
    sine_d, cosine_d = _angle_parts(points, d, a, b)
    size = np.sqrt((sine_c**2 + cosine_c**2) * (sine_d**2 + cosine_d**2))
    return -(sine_c * cosine_d + cosine_c * sine_d) - 1e-3 * size


@numba.njit(nogil=True, cache=True)
def _keeps_orientation(points, a, b, c, d):  # type: ignore[no-untyped-def]
    """Whether the faces (c, a, d) and (d, b, c) face the way (a, b, c) and (b, a, d) did."""
    first = _cross(_edge(points, a, b), _edge(points, a, c))
    second = _cross(_edge(points, b, a), _edge(points, b, d))
    old = (first[0] + second[0], first[1] + second[1], first[2] + second[2])
    left = _cross(_edge(points, c, a), _edge(points, c, d))
    right = _cross(_edge(points, d, b), _edge(points, d, c))
    size = NORMAL_AGREEMENT * np.sqrt(_dot(old, old))
    return _dot(left, old) > size * np.sqrt(_dot(left, left)) and _dot(right, old) > size * np.sqrt(
        _dot(right, right)
    )


@numba.njit(nogil=True, cache=True)
def _corner_of(faces, face, vertex):  # type: ignore[no-untyped-def]
    for k in range(3):
        if faces[face, k] == vertex:
            return k
    return -1


@numba.njit(nogil=True, cache=True)
def _are_adjacent(faces, neighbors, start, c, d):  # type: ignore[no-untyped-def]
    """Whether c and d are joined by an edge, walking around c from one of its faces."""
    face = start
    while True:
        k = _corner_of(faces, face, c)
        if faces[face, (k + 1) % 3] == d or faces[face, (k + 2) % 3] == d:
            return True
        face = neighbors[face, (k + 1) % 3]
        if face == start:
            return False


@numba.njit(nogil=True, cache=True)
def _replace_neighbor(neighbors, face, old, new):  # type: ignore[no-untyped-def]
    for k in range(3):
        if neighbors[face, k] == old:
            neighbors[face, k] = new
            return


@numba.njit(nogil=True, cache=True)
def _flip_pass(points, faces, neighbors, valence, rule):  # type: ignore[no-untyped-def]
    flips = 0
    for f in range(faces.shape[0]):
        for k in range(3):
            g = neighbors[f, k]
            if g <= f:
                continue
            c, a, b = faces[f, k], faces[f, (k + 1) % 3], faces[f, (k + 2) % 3]
            j = (_corner_of(faces, g, b) + 2) % 3
            d = faces[g, j]
            if valence[a] <= 3 or valence[b] <= 3 or c == d:
                continue
            if _gain(points, valence, a, b, c, d, rule) <= 0:
                continue
            if not _keeps_orientation(points, a, b, c, d):
                continue
            if _are_adjacent(faces, neighbors, f, c, d):
                continue
            beside_a, beside_b = neighbors[f, (k + 1) % 3], neighbors[f, (k + 2) % 3]
            across_b, across_a = neighbors[g, (j + 1) % 3], neighbors[g, (j + 2) % 3]
            faces[f, 0], faces[f, 1], faces[f, 2] = c, a, d
            faces[g, 0], faces[g, 1], faces[g, 2] = d, b, c
            neighbors[f, 0], neighbors[f, 1], neighbors[f, 2] = across_b, g, beside_b
            neighbors[g, 0], neighbors[g, 1], neighbors[g, 2] = beside_a, f, across_a
            _replace_neighbor(neighbors, across_b, g, f)
            _replace_neighbor(neighbors, beside_a, f, g)
            valence[a] -= 1
            valence[b] -= 1
            valence[c] += 1
            valence[d] += 1
            flips += 1
            break
    return flips


@numba.njit(nogil=True, cache=True)
def _pull(points, faces, step):  # type: ignore[no-untyped-def]
    """Move every vertex towards the mean of its faces, without the normal part, in place."""
    n = points.shape[0]
    normal = np.zeros((n, 3))
    target = np.zeros((n, 3))
    total = np.zeros(n)
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        cross = _cross(_edge(points, a, b), _edge(points, a, c))
        area = np.sqrt(_dot(cross, cross))
        for j in range(3):
            centre = area * (points[a, j] + points[b, j] + points[c, j]) / 3.0
            for vertex in (a, b, c):
                normal[vertex, j] += cross[j]
                target[vertex, j] += centre
        for vertex in (a, b, c):
            total[vertex] += area
    for i in range(n):
        squared = normal[i, 0] ** 2 + normal[i, 1] ** 2 + normal[i, 2] ** 2
        if total[i] <= 0 or squared <= 0:
            continue
        along = 0.0
        for j in range(3):
            target[i, j] = target[i, j] / total[i] - points[i, j]
            along += target[i, j] * normal[i, j] / squared
        for j in range(3):
            points[i, j] += step * (target[i, j] - along * normal[i, j])


def level_set_projection(level: npt.NDArray[np.float32]) -> Projection:
    """Newton steps onto the zero set of a smooth function, in index coordinates.

    Parameters
    ----------
    level : ndarray, (z, y, x)
        Of about unit slope near its zero set.
    """
    from .interpolate import sample_linear

    gradient = [np.ascontiguousarray(g, dtype=np.float32) for g in np.gradient(level)]

    def project(points: Floats) -> Floats:
        for _ in range(2):
            value = sample_linear(level, points)
            slope = np.stack([sample_linear(g, points) for g in gradient], axis=1)
            norm2 = np.maximum(np.einsum("ij,ij->i", slope, slope), 1e-4)
            limit = 0.5 / np.sqrt(norm2)
            points = points - np.clip(value / norm2, -limit, limit)[:, None] * slope
        return points

    return project
