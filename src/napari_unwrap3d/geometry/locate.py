"""Finding the face, and the place in it, for points on a sphere or near a surface."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt
from scipy import sparse

from ..errors import NotLocatedError
from .compiled import Tree
from .mesh import face_neighbors

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# Weights may be this negative for a direction on an edge, through rounding.
ON_EDGE = 1e-13
# Rounds of smoothing that take the steps of the mesh out of a label's border, and by how
# much a vertex's own label stays ahead.
LABEL_SMOOTHINGS = 3
LABEL_MARGIN = 0.05


class SphericalLocator:
    """Exact point location on a triangulated unit sphere without flipped faces.

    A direction d lies in the spherical triangle ABC where the weights
    ``[A B C]⁻¹ d`` are all non-negative; divided by their sum they are the barycentric
    weights of the point of the flat triangle that the ray through d meets. The face is
    found by walking from face to face towards the most negative weight.
    """

    def __init__(self, directions: Floats, faces: Ints) -> None:
        a, b, c = directions[faces[:, 0]], directions[faces[:, 1]], directions[faces[:, 2]]
        rows = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
        determinant = np.einsum("ij,ij->i", a, rows[:, 0])
        self._inverse = rows / determinant[:, None, None]
        self._neighbors = face_neighbors(faces)
        centre = a + b + c
        self._centre = centre / np.linalg.norm(centre, axis=1, keepdims=True)

    def locate(self, directions: Floats) -> tuple[Ints, Floats]:
        """Face (n,) and barycentric weights (n, 3) of directions (n, 3).

        Raises
        ------
        NotLocatedError
            A direction lies in no face.
        """
        points = np.ascontiguousarray(directions, dtype=np.float64)
        if not np.isfinite(points).all():
            raise NotLocatedError(
                "Directions are NaN or infinite.", count=int((~np.isfinite(points)).any(1).sum())
            )
        face = np.full(len(points), -1, np.int64)
        weights = np.zeros((len(points), 3))
        if len(points) == 0:
            return face, weights
        # Walks are short when each starts next to where the last one ended.
        order = _along_a_spiral(points)
        start = int(np.argmax(self._centre @ points[order[0]]))
        _walk(self._inverse, self._neighbors, points, order, start, face, weights)
        for i in np.flatnonzero(face < 0):
            face[i], weights[i] = self._search(points[i])
        return face, weights / weights.sum(axis=1, keepdims=True)

    def _search(self, direction: Floats) -> tuple[int, Floats]:
        """Look at every face; for the rare direction whose walk went in circles."""
        weights = self._inverse @ direction
        smallest = np.where(self._centre @ direction > 0, weights.min(axis=1), -np.inf)
        best = int(np.argmax(smallest))
        if smallest[best] < -1e-9:
            raise NotLocatedError(
                "A direction lies in no face of the sphere.",
                smallest_weight=float(smallest[best]),
                hint="The spherical map has flipped faces.",
            )
        return best, np.maximum(weights[best], 0.0)


def _along_a_spiral(directions: Floats, bands: int = 64) -> Ints:
    """Order of directions (n, 3) along bands of latitude, there and back."""
    band = np.floor((directions[:, 0] + 1.0) * 0.5 * bands)
    azimuth = np.arctan2(directions[:, 1], directions[:, 2])
    return np.lexsort((np.where(band % 2 == 0, azimuth, -azimuth), band))


@numba.njit(nogil=True, cache=True)
def _walk(inverse, neighbors, points, order, start, face, weights):  # type: ignore[no-untyped-def]
    current = start
    limit = 4 * int(np.sqrt(inverse.shape[0])) + 100
    for i in order:
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        for _ in range(limit):
            lowest = 0
            value = 1e300
            for k in range(3):
                w = (
                    inverse[current, k, 0] * x
                    + inverse[current, k, 1] * y
                    + inverse[current, k, 2] * z
                )
                weights[i, k] = w
                if w < value:
                    value = w
                    lowest = k
            if value >= -ON_EDGE:
                face[i] = current
                break
            current = neighbors[current, lowest]


class SurfaceLocator:
    """Closest points and ray hits on a triangle mesh (libigl's bounding box tree).

    Many queries are made some thousands at a time, so that other threads go on in between.
    """

    def __init__(self, vertices: Floats, faces: Ints) -> None:
        self._vertices = np.ascontiguousarray(vertices, dtype=np.float64)
        self._faces = np.ascontiguousarray(faces, dtype=np.int64)
        self._tree = Tree(self._vertices, self._faces)

    def closest(self, points: npt.ArrayLike) -> tuple[Ints, Floats, Floats]:
        """Face (n,), barycentric weights (n, 3) and distance (n,) of the closest points."""
        query = np.ascontiguousarray(points, dtype=np.float64).reshape(-1, 3)
        if len(query) == 0:
            return np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0)
        face, closest, squared = self._tree.closest(query)
        weights = barycentric(self._vertices[self._faces[face]], closest)
        return face, weights, np.sqrt(np.maximum(squared, 0.0))

    def first_hit(self, start: Floats, end: Floats) -> tuple[Ints, Floats]:
        """First face hit by each segment from start (n, 3) to end (n, 3), −1 for none.

        Returns
        -------
        face : ndarray, (n,)
        weights : ndarray, (n, 3)
            Barycentric weights of the hit; (1, 0, 0) where there is none.
        """
        origin = np.ascontiguousarray(start, dtype=np.float64)
        direction = np.ascontiguousarray(end - start, dtype=np.float64)
        face, t, uv = self._tree.first_hit(origin, direction)
        face = np.where((face >= 0) & (t <= 1.0 + 1e-9), face, -1)
        weights = np.column_stack([1.0 - uv.sum(axis=1), uv])
        return face, weights


def barycentric(corners: Floats, points: Floats) -> Floats:
    """Barycentric weights (n, 3) of points (n, 3) in the planes of triangles (n, 3, 3)."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    normal = np.cross(b - a, c - a)
    squared = np.maximum(np.einsum("ij,ij->i", normal, normal), 1e-300)
    wb = np.einsum("ij,ij->i", np.cross(points - a, c - a), normal) / squared
    wc = np.einsum("ij,ij->i", np.cross(b - a, points - a), normal) / squared
    return np.stack([1.0 - wb - wc, wb, wc], axis=1)


def interpolate(
    values: npt.NDArray[np.generic], faces: Ints, face: Ints, weights: Floats
) -> Floats:
    """Values (n,) or (n, k) given at vertices, at places given by face and weights."""
    corners = np.asarray(values, dtype=np.float64)[faces[face]]
    result: Floats = np.einsum("ij...,ij->i...", corners, weights)
    return result


class LabelInterpolator:
    """Labels (n,) given at vertices, at any places on the mesh.

    Indicators smoothed over a few edges, but agreeing with the labels at the vertices, are
    interpolated, and the largest wins: borders lose the steps of the mesh, and lines of
    one vertex stay (after Whitaker 2000, "Reducing aliasing artifacts in iso-surfaces of
    binary volumes", here on a mesh).
    """

    def __init__(self, labels: npt.NDArray[np.integer], faces: Ints) -> None:
        self._names, index = np.unique(labels, return_inverse=True)
        self._smooth = _smoothed_indicators(index.ravel(), faces)
        self._faces = faces

    def at(self, face: Ints, weights: Floats) -> npt.NDArray[np.integer]:
        """Labels at places given by face (k,) and weights (k, 3)."""
        rows = np.repeat(np.arange(len(face)), 3)
        places = sparse.csr_array(
            (weights.ravel(), (rows, self._faces[face].ravel())),
            shape=(len(face), self._smooth.shape[0]),
        )
        votes = sparse.csr_array(places @ self._smooth)
        winners: npt.NDArray[np.integer] = self._names[largest_column(votes)]
        return winners


def _smoothed_indicators(index: Ints, faces: Ints) -> sparse.csr_array:
    """Indicator (n, labels) of every label, smoothed but largest for a vertex's own label."""
    size = len(index)
    half = sparse.coo_array(
        (np.ones(3 * len(faces)), (faces.ravel(), np.roll(faces, 1, axis=1).ravel())),
        shape=(size, size),
    ).tocsr()
    joined = half.maximum(half.T)
    degree = np.maximum(np.asarray(joined.sum(axis=1)).ravel(), 1.0)
    averaging = sparse.csr_array(sparse.diags_array(1.0 / degree) @ joined)
    indicator = sparse.csr_array((np.ones(size), (np.arange(size), index)))
    smooth = indicator
    for _ in range(LABEL_SMOOTHINGS):
        smooth = sparse.csr_array((smooth + averaging @ smooth) * 0.5)
        own = np.asarray(smooth.multiply(indicator).sum(axis=1)).ravel()
        missing = smooth.max(axis=1).toarray().ravel() - own
        lost = np.flatnonzero(missing > 0.0)
        raised = (missing[lost] + LABEL_MARGIN, (lost, index[lost]))
        smooth = sparse.csr_array(smooth + sparse.csr_array(raised, shape=smooth.shape))
    return smooth


def largest_column(votes: sparse.csr_array) -> Ints:
    """Column of the largest entry in every row of a matrix without empty rows."""
    rows = np.repeat(np.arange(votes.shape[0]), np.diff(votes.indptr))
    order = np.lexsort((-votes.indices, votes.data, rows))
    last: Ints = order[votes.indptr[1:] - 1]
    return np.asarray(votes.indices[last], dtype=np.int64)
