"""A closed genus-0 mesh taken apart to a tetrahedron and put together again on the sphere.

Vertices are removed one by one, each into a neighbour, as in a progressive mesh (Hoppe
1996, doi:10.1145/237170.237216), wherever that keeps the mesh a sphere (the link
condition: the two have exactly two common neighbours). Put back in the opposite order, a
vertex always has room: close enough to its neighbour, between the two edges that open, no
face is flipped (Praun and Hoppe 2003, doi:10.1145/882262.882274).
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from ..errors import NotGenusZeroError
from .area_polish import determinant, tangents

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# No vertex gets more neighbours than this by a removal, and beyond a few it costs.
MOST_NEIGHBORS, FEW_NEIGHBORS = 24, 8
# A vertex with more neighbours than this is removed only when nothing else is left.
USUAL_NEIGHBORS, HOPELESS_NEIGHBORS = 6, 64
TETRAHEDRON = np.array([[1.0, 1, 1], [-1, -1, 1], [-1, 1, -1], [1, -1, -1]]) / np.sqrt(3.0)
# Relaxations of a vertex and of those around it when it is put back.
RELAXATIONS = 2
# A vertex may move where the smallest determinant around it keeps this fraction.
KEPT_DETERMINANT = 0.2


class VertexHierarchy:
    """The mesh without all but four vertices, which come back by :meth:`insert`.

    Attributes
    ----------
    faces : ndarray, (m, 3) int64
        Faces of the vertices that are there now; those of removed vertices are stale.
    star : ndarray, (n, capacity) int64
        The faces around each vertex, the first ``degree[i]`` entries of row i.
    alive : ndarray, (n,) bool
    mass : ndarray, (n,)
        Of each vertex with all that were removed into it.
    positions : ndarray, (n, 3)
        Unit vectors; of the vertices that are there.
    """

    def __init__(self, vertices: Floats, faces: Ints, mass: Floats, seed: int = 0) -> None:
        size = len(vertices)
        self.faces = np.array(faces, dtype=np.int64)
        self.star, self.degree = _stars(self.faces, size)
        self.mass = np.array(mass, dtype=np.float64)
        self._removed = np.empty(size, np.int64)
        self._kept = np.empty(size, np.int64)
        self._start = np.zeros(size + 1, np.int64)
        self._flat = np.empty(HOPELESS_NEIGHBORS // 4 * size + 64, np.int64)
        order = np.random.default_rng(seed).permutation(size)
        self.alive, count = _collapse(
            self.faces,
            self.star,
            self.degree,
            np.ascontiguousarray(vertices),
            order,
            self.mass,
            (self._removed, self._kept, self._start, self._flat),
        )
        self._count = int(count)
        self.positions = np.zeros((size, 3))
        left = np.flatnonzero(self.alive)
        if len(left) != 4:
            raise NotGenusZeroError(
                "The mesh could not be taken apart to a tetrahedron.",
                vertices_left=len(left),
                hint="It must be one closed sphere; see the report of the sealed surface.",
            )
        self.positions[left] = TETRAHEDRON
        a, b, c = self.positions[self.faces[self.star[left[0], 0]]]
        if a @ np.cross(b, c) < 0:
            self.positions[left[:2]] = self.positions[left[1::-1]]

    @property
    def missing(self) -> int:
        """Number of vertices that are not back yet."""
        return self._count

    def insert(self, count: int) -> int:
        """Put `count` vertices back; how many of them found no place without a flip."""
        until = max(self._count - count, 0)
        failed = _insert(
            self.faces,
            self.star,
            self.degree,
            self.positions,
            self.mass,
            self.alive,
            (self._removed, self._kept, self._start, self._flat),
            self._count,
            until,
        )
        self._count = until
        return int(failed)

    def present_faces(self) -> Ints:
        """Indices of the faces of the vertices that are there."""
        rows = np.flatnonzero(self.alive)
        used = np.arange(self.star.shape[1])[None] < self.degree[rows][:, None]
        return np.unique(self.star[rows][used])


def _stars(faces: Ints, size: int) -> tuple[Ints, Ints]:
    """Faces around each vertex as rows of a table with room for growth, and their number."""
    corners = faces.ravel()
    order = np.argsort(corners, kind="stable")
    degree = np.bincount(corners, minlength=size)
    first = np.concatenate([[0], np.cumsum(degree)[:-1]])
    star = np.full((size, max(int(degree.max()), MOST_NEIGHBORS) + 4), -1, np.int64)
    star[corners[order], np.arange(len(order)) - first[corners[order]]] = order // 3
    return star, degree


@numba.njit(nogil=True, cache=True)
def _next(faces, f, i):  # type: ignore[no-untyped-def]
    """The corners after vertex i in face f, in its order."""
    if faces[f, 0] == i:
        return faces[f, 1], faces[f, 2]
    if faces[f, 1] == i:
        return faces[f, 2], faces[f, 0]
    return faces[f, 0], faces[f, 1]


@numba.njit(nogil=True, cache=True)
def _best_neighbor(faces, star, degree, points, i, mark, stamp):  # type: ignore[no-untyped-def]
    """The neighbour that vertex i is best removed into, −1 if into none."""
    for q in range(degree[i]):
        b, _ = _next(faces, star[i, q], i)
        mark[b] = stamp
    best, least = -1, np.inf
    for q in range(degree[i]):
        j, _ = _next(faces, star[i, q], i)
        after = degree[j] + degree[i] - 4
        if after > MOST_NEIGHBORS:
            continue
        common = 0
        for p in range(degree[j]):
            b, _ = _next(faces, star[j, p], j)
            common += b != i and mark[b] == stamp
        if common != 2:
            continue
        cost = 0.0
        for k in range(3):
            cost += (points[i, k] - points[j, k]) ** 2
        cost *= 1 + max(0, after - FEW_NEIGHBORS)
        if cost < least:
            best, least = j, cost
    return best


@numba.njit(nogil=True, cache=True)
def _drop(star, degree, i, f):  # type: ignore[no-untyped-def]
    for p in range(degree[i]):
        if star[i, p] == f:
            degree[i] -= 1
            star[i, p] = star[i, degree[i]]
            return


@numba.njit(nogil=True, cache=True)
def _collapse(faces, star, degree, points, order, mass, record):  # type: ignore[no-untyped-def]
    """Remove vertices in rounds of such that do not touch each other."""
    removed, kept, start, flat = record
    size = len(order)
    alive = np.ones(size, np.bool_)
    mark = np.zeros(size, np.int64)
    locked = np.zeros(size, np.int64)
    left, count, stamp, round_, longest = size, 0, 0, 0, USUAL_NEIGHBORS
    while left > 4:
        round_ += 1
        done = 0
        for i in order:
            if left <= 4:
                break
            if not alive[i] or locked[i] == round_ or degree[i] > longest:
                continue
            stamp += 1
            j = _best_neighbor(faces, star, degree, points, i, mark, stamp)
            if j < 0 or start[count] + degree[i] > len(flat):
                continue
            removed[count], kept[count] = i, j
            filled = start[count]
            for q in range(degree[i]):
                f = star[i, q]
                flat[filled] = f
                filled += 1
                b, c = _next(faces, f, i)
                locked[b] = locked[c] = round_
                if j in (b, c):
                    _drop(star, degree, b, f)
                    _drop(star, degree, c, f)
                else:
                    for k in range(3):
                        if faces[f, k] == i:
                            faces[f, k] = j
                    star[j, degree[j]] = f
                    degree[j] += 1
            count += 1
            start[count] = filled
            alive[i] = False
            mass[j] += mass[i]
            left -= 1
            done += 1
        if done < max(1, left // 50):
            longest += 1
            if longest > HOPELESS_NEIGHBORS and done == 0:
                break
        elif done > left // 5:
            longest = max(USUAL_NEIGHBORS, longest - 1)
    return alive, count


@numba.njit(nogil=True, cache=True)
def smallest_determinant(x, faces, star, degree, i, p):  # type: ignore[no-untyped-def]
    """Smallest determinant around vertex i if it were at p."""
    least = np.inf
    for q in range(degree[i]):
        b, c = _next(faces, star[i, q], i)
        d = determinant(p, x[b], x[c])
        if not d >= least:
            least = d
    return least


@numba.njit(nogil=True, cache=True)
def _relax(x, faces, star, degree, mass, i, p):  # type: ignore[no-untyped-def]
    """Move vertex i towards the centroid of its faces, the larger the more mass they lack."""
    s0 = s1 = s2 = 0.0
    for q in range(degree[i]):
        b, c = _next(faces, star[i, q], i)
        u0, u1, u2 = x[b, 0] - x[i, 0], x[b, 1] - x[i, 1], x[b, 2] - x[i, 2]
        v0, v1, v2 = x[c, 0] - x[i, 0], x[c, 1] - x[i, 1], x[c, 2] - x[i, 2]
        n0, n1, n2 = u1 * v2 - u2 * v1, u2 * v0 - u0 * v2, u0 * v1 - u1 * v0
        area = np.sqrt(n0 * n0 + n1 * n1 + n2 * n2) + 1e-300
        weight = area / (mass[i] / degree[i] + mass[b] / degree[b] + mass[c] / degree[c])
        s0 += weight * (x[i, 0] + x[b, 0] + x[c, 0])
        s1 += weight * (x[i, 1] + x[b, 1] + x[c, 1])
        s2 += weight * (x[i, 2] + x[b, 2] + x[c, 2])
    norm = np.sqrt(s0 * s0 + s1 * s1 + s2 * s2)
    if not norm > 0.0:
        return
    before = smallest_determinant(x, faces, star, degree, i, x[i])
    floor = min(0.999 * before, KEPT_DETERMINANT * before)
    step = 1.0
    for _ in range(8):
        p[0] = x[i, 0] + step * (s0 / norm - x[i, 0])
        p[1] = x[i, 1] + step * (s1 / norm - x[i, 1])
        p[2] = x[i, 2] + step * (s2 / norm - x[i, 2])
        length = np.sqrt(p[0] ** 2 + p[1] ** 2 + p[2] ** 2)
        for k in range(3):
            p[k] /= length
        after = smallest_determinant(x, faces, star, degree, i, p)
        if after > floor and after > 0.0:
            x[i] = p
            return
        step *= 0.5


@numba.njit(nogil=True, cache=True)
def _open_faces(faces, star, degree, mass, record, r):  # type: ignore[no-untyped-def]
    """Undo removal r in the tables; the neighbours a and b between whose edges i lies."""
    removed, kept, start, flat = record
    i, j = removed[r], kept[r]
    mass[j] -= mass[i]
    degree[i] = 0
    a = b = -1
    for q in range(start[r], start[r + 1]):
        f = flat[q]
        if i in (faces[f, 0], faces[f, 1], faces[f, 2]):
            second, third = _next(faces, f, i)
            star[second, degree[second]] = f
            degree[second] += 1
            star[third, degree[third]] = f
            degree[third] += 1
            if second == j:  # (i, j, a)
                a = third
            else:  # (i, b, j)
                b = second
        else:
            for k in range(3):
                if faces[f, k] == j:
                    faces[f, k] = i
            _drop(star, degree, j, f)
        star[i, degree[i]] = f
        degree[i] += 1
    return a, b


@numba.njit(nogil=True, cache=True)
def _place(x, faces, star, degree, i, j, a, b, p):  # type: ignore[no-untyped-def]
    """Put vertex i where the faces around it are least flat; their smallest determinant.

    Along the bisector of the angle that opens at j, at several distances, and at the
    centroid of its neighbours.
    """
    s, t = tangents(x[j])
    at_a = np.arctan2(_along(x[a], t), _along(x[a], s))
    at_b = np.arctan2(_along(x[b], t), _along(x[b], s))
    opening = at_b - at_a
    if opening <= 0.0:
        opening += 2.0 * np.pi
    middle = at_a + 0.5 * opening
    reach = 0.0
    for end in (a, b):
        squared = 0.0
        for k in range(3):
            squared += (x[end, k] - x[j, k]) ** 2
        reach = max(reach, np.sqrt(squared))
    best = -np.inf
    for _ in range(60):
        for k in range(3):
            p[k] = x[j, k] + reach * (np.cos(middle) * s[k] + np.sin(middle) * t[k])
        best = _try(x, faces, star, degree, i, p, best)
        reach *= 0.6
    for k in range(3):
        p[k] = 0.0
    for q in range(degree[i]):
        c, _ = _next(faces, star[i, q], i)
        for k in range(3):
            p[k] += x[c, k]
    return _try(x, faces, star, degree, i, p, best)


@numba.njit(nogil=True, cache=True)
def _along(point, direction):  # type: ignore[no-untyped-def]
    return point[0] * direction[0] + point[1] * direction[1] + point[2] * direction[2]


@numba.njit(nogil=True, cache=True)
def _try(x, faces, star, degree, i, p, best):  # type: ignore[no-untyped-def]
    length = np.sqrt(p[0] ** 2 + p[1] ** 2 + p[2] ** 2)
    if not length > 0.0:
        return best
    for k in range(3):
        p[k] /= length
    value = smallest_determinant(x, faces, star, degree, i, p)
    if value > best:
        x[i] = p
        return value
    return best


@numba.njit(nogil=True, cache=True)
def _insert(faces, star, degree, x, mass, alive, record, begin, until):  # type: ignore[no-untyped-def]
    removed, kept, _, _ = record
    failed = 0
    p = np.empty(3)
    for r in range(begin - 1, until - 1, -1):
        i, j = removed[r], kept[r]
        a, b = _open_faces(faces, star, degree, mass, record, r)
        failed += not _place(x, faces, star, degree, i, j, a, b, p) > 0.0
        alive[i] = True
        for _ in range(RELAXATIONS):
            _relax(x, faces, star, degree, mass, i, p)
            _relax(x, faces, star, degree, mass, j, p)
            for q in range(degree[i]):
                c, _ = _next(faces, star[i, q], i)
                if c != j:
                    _relax(x, faces, star, degree, mass, c, p)
    return failed
