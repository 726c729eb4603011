"""A sphere's mesh flattened onto an N × 2N image: location, signed areas, and coverage.

u is periodic and each pole, one point of the mesh, is a whole border of the image. Within
the face that holds it the image is spanned by the straight lines from the pole to the
face's edges, each of which becomes a column.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from .locate import SurfaceLocator
from .padding import wrap_uv

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# Rounding of a determinant of differences that are exact.
ROUNDING = 4.0 * np.finfo(float).eps


class Pixels(NamedTuple):
    """What lies over the pixel centres.

    Attributes
    ----------
    covering : ndarray, (N, 2N) int64
        Number of faces over the centre; half-open, so that a centre on an edge has one.
    face : ndarray, (N, 2N) int64
        The last of them, −1 for none.
    weights : ndarray, (N, 2N, 3)
        Barycentric weights of the centre in it.
    """

    covering: Ints
    face: Ints
    weights: Floats


class FlatSphere:
    """The flattened mesh.

    Parameters
    ----------
    vertices : ndarray, (n, 2)
        (v, u) in pixels.
    faces : ndarray, (m, 3)
        Of a closed mesh of genus 0.
    turns : ndarray, (m, 3) int64
        A corner lies at u + 2N · turns.
    pole_faces : ndarray, (2,)
        The faces that hold the north and the south pole.
    pole_weights : ndarray, (2, 3)
        Barycentric weights of the poles in them.
    rows : int
        N.
    """

    def __init__(
        self,
        vertices: Floats,
        faces: Ints,
        turns: Ints,
        pole_faces: Ints,
        pole_weights: Floats,
        rows: int,
    ) -> None:
        self.vertices, self.faces, self.turns = vertices, faces, turns
        self.pole_faces, self.pole_weights, self.rows = pole_faces, pole_weights, rows
        self._polar = np.stack([self._ring(pole) for pole in (0, 1)])
        self._points, self._triangles, self._turns = self._triangulated()
        # The face of every triangle, then twelve for the poles, two for every edge of theirs.
        kept = np.delete(np.arange(len(faces)), pole_faces)
        self._face_of = np.concatenate([kept, np.repeat(pole_faces, 6)])
        self._first_polar = len(kept)
        self._locator: SurfaceLocator | None = None
        self._located: tuple[Ints, Ints] | None = None

    def _ring(self, pole: int) -> Floats:
        """(v, u) of the corners of a polar face (4, 2), the first one again at the end."""
        face = self.pole_faces[pole]
        ring = self.vertices[self.faces[face]].copy()
        ring[:, 1] += 2.0 * self.rows * self.turns[face]
        full = (-2.0, 2.0)[pole] * self.rows
        return np.concatenate([ring, [[ring[0, 0], ring[0, 1] + full]]])

    def _triangulated(self) -> tuple[Floats, Ints, Ints]:
        """Points, triangles and their turns: the faces, and two triangles for each polar edge."""
        points, triangles, turns = [self.vertices], [], []
        for pole in (0, 1):
            face = self.pole_faces[pole]
            ring, turn = self.faces[face], self.turns[face]
            first = len(self.vertices) + 3 * pole
            points.append(np.column_stack([np.full(3, self._border(pole)), self.vertices[ring, 1]]))
            last = np.append(turn, turn[0] + (-1, 1)[pole])
            for k in range(3):
                a, b = turn[k], last[k + 1]
                after = (k + 1) % 3
                triangles += [
                    (ring[k], ring[after], first + after),
                    (ring[k], first + after, first + k),
                ]
                turns += [(a, b, b), (a, b, a)]
        keep = np.ones(len(self.faces), bool)
        keep[self.pole_faces] = False
        return (
            np.concatenate(points),
            np.concatenate([self.faces[keep], np.array(triangles, np.int64)]),
            np.concatenate([self.turns[keep], np.array(turns, np.int64)]),
        )

    def _border(self, pole: int) -> float:
        """V of a pole."""
        return (-0.5, self.rows - 0.5)[pole]

    # What must hold ----------------------------------------------------------------

    def areas(self) -> tuple[Floats, Floats]:
        """Signed area (m + 10,) in pixels² of every triangle, and by how much it may err.

        Positive where the mesh's outside is up. The last twelve are those around the poles.
        """
        corner = self._points[self._triangles]
        turned = 2.0 * self.rows * (self._turns[:, 1:] - self._turns[:, :1])
        dv = corner[:, 1:, 0] - corner[:, :1, 0]
        du = corner[:, 1:, 1] - corner[:, :1, 1] + turned
        one, other = du[:, 0] * dv[:, 1], dv[:, 0] * du[:, 1]
        return 0.5 * (one - other), 0.5 * ROUNDING * (np.abs(one) + np.abs(other))

    def flipped(self) -> Ints:
        """The faces that are flipped, degenerate or not finite, sorted."""
        area, error = self.areas()
        bad = ~(area > error)
        return np.asarray(np.unique(self._face_of[bad]), np.int64)

    def corners(self) -> tuple[Ints, Floats]:
        """Faces (k,) but the polar ones, and (v, u) of their corners (k, 3, 2) in one piece."""
        faces = self._face_of[: self._first_polar]
        corner = self.vertices[self.faces[faces]]
        corner[:, :, 1] += 2.0 * self.rows * self.turns[faces]
        return faces, corner

    def pixels(self) -> Pixels:
        """Which face covers the centre of every pixel, and how many do."""
        rows = self.rows
        shape = (rows, 2 * rows)
        count, owner = np.zeros(shape, np.int64), np.full(shape, -1, np.int64)
        turn = np.zeros(shape, np.int64)
        _scan(self._points, self._triangles, self._turns, count, owner, turn)
        i, j = np.indices(shape)
        points = np.stack([i, j + 2 * rows * turn], axis=-1).reshape(-1, 2).astype(float)
        face = np.full(owner.size, -1, np.int64)
        weights = np.zeros((owner.size, 3))
        seen = np.flatnonzero(owner.ravel() >= 0)
        face[seen], weights[seen] = self._place(owner.ravel()[seen], points[seen])
        return Pixels(count, face.reshape(shape), weights.reshape(*shape, 3))

    # The map -----------------------------------------------------------------------

    def at(self, face: Ints, weights: Floats) -> Floats:
        """(v, u) (k, 2), −½ ≤ u < 2N − ½, of places given by face (k,) and weights (k, 3)."""
        corner = self.vertices[self.faces[face]]
        corner[:, :, 1] += 2.0 * self.rows * self.turns[face]
        points = np.einsum("ijk,ij->ik", corner, weights)
        for pole in (0, 1):
            inside = np.flatnonzero(face == self.pole_faces[pole])
            points[inside] = self._from_pole(pole, weights[inside])
        points[:, 0] = points[:, 0].clip(-0.5, self.rows - 0.5)
        return wrap_uv(points, self.rows)

    def _from_pole(self, pole: int, weights: Floats) -> Floats:
        """(v, u) of places in a polar face: along the line from the pole to an edge."""
        at_pole = self.pole_weights[pole]
        ratio = weights / at_pole
        first = (ratio.argmin(axis=1) + 1) % 3
        remaining = ratio.min(axis=1)
        row = np.arange(len(weights))
        share = weights - remaining[:, None] * at_pole
        a, b = share[row, first], share[row, (first + 1) % 3]
        along = b / np.maximum(a + b, 1e-300)
        start, step = self._polar[pole][first], np.diff(self._polar[pole], axis=0)[first]
        edge = start + along[:, None] * step
        v = self._border(pole) + (1.0 - remaining) * (edge[:, 0] - self._border(pole))
        return np.column_stack([v, edge[:, 1]])

    def locate(self, points: Floats) -> tuple[Ints, Floats]:
        """Face (k,) and barycentric weights (k, 3) of (v, u) (k, 2) by exact location."""
        wrapped = wrap_uv(points, self.rows)
        if self._locator is None:
            self._locator = self._make_locator()
        assert self._located is not None
        triangle, turn = self._located
        found, _, _ = self._locator.closest(np.column_stack([wrapped, np.zeros(len(wrapped))]))
        wrapped[:, 1] += 2.0 * self.rows * turn[found]
        return self._place(triangle[found], wrapped)

    def _make_locator(self) -> SurfaceLocator:
        """A tree of all triangles, those over the seam at both ends of the image."""
        columns = 2.0 * self.rows
        corner = self._points[self._triangles]
        corner[:, :, 1] += columns * self._turns
        home = np.floor((corner[:, :, 1].min(axis=1) + 0.5) / columns).astype(np.int64)
        beyond = corner[:, :, 1].max(axis=1) - columns * home > columns - 0.5
        triangle = np.concatenate([np.arange(len(corner)), np.flatnonzero(beyond)])
        turn = np.concatenate([home, home[beyond] + 1])
        soup = np.zeros((3 * len(triangle), 3))
        soup[:, :2] = corner[triangle].reshape(-1, 2)
        soup[:, 1] -= columns * np.repeat(turn, 3)
        self._located = triangle, turn
        return SurfaceLocator(soup, np.arange(len(soup)).reshape(-1, 3))

    def _place(self, triangle: Ints, points: Floats) -> tuple[Ints, Floats]:
        """Faces and weights of points (k, 2) that lie in triangles (k,), where these lie."""
        corner = self._points[self._triangles[triangle]]
        corner[:, :, 1] += 2.0 * self.rows * self._turns[triangle]
        weights = _planar_weights(corner, points)
        for index in range(6):
            first = self._first_polar + 2 * index
            inside = np.flatnonzero((triangle == first) | (triangle == first + 1))
            weights[inside] = self._in_polar(index // 3, index % 3, points[inside])
        return self._face_of[triangle], weights

    def _in_polar(self, pole: int, edge: int, points: Floats) -> Floats:
        """Barycentric weights in a polar face of points (k, 2) over one of its edges."""
        (v0, u0), (v1, u1) = self._polar[pole][edge : edge + 2]
        along = ((points[:, 1] - u0) / (u1 - u0)).clip(0.0, 1.0)
        border = self._border(pole)
        out = ((points[:, 0] - border) / (v0 + along * (v1 - v0) - border)).clip(0.0, 1.0)
        weights = (1.0 - out)[:, None] * self.pole_weights[pole]
        weights[:, edge] += out * (1.0 - along)
        weights[:, (edge + 1) % 3] += out * along
        return np.asarray(weights)


def _planar_weights(corner: Floats, points: Floats) -> Floats:
    """Barycentric weights (k, 3), none negative, of points (k, 2) in triangles (k, 3, 2)."""
    a, b = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    c = points - corner[:, 0]
    area = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    area = np.where(area == 0.0, 1e-300, area)
    second = (c[:, 0] * b[:, 1] - c[:, 1] * b[:, 0]) / area
    third = (a[:, 0] * c[:, 1] - a[:, 1] * c[:, 0]) / area
    weights = np.stack([1.0 - second - third, second, third], axis=1).clip(0.0, 1.0)
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


@numba.njit(nogil=True, cache=True)
def _scan(points, triangles, turns, count, owner, turn):  # type: ignore[no-untyped-def]
    """Count the triangles over every pixel centre, row by row, in place.

    Where an edge crosses a row is computed in the same way for both its triangles, and each
    covers the centres from its left edge up to, but without, its right one.
    """
    rows, columns = count.shape
    for f in range(len(triangles)):
        v = points[triangles[f], 0]
        first = max(int(np.ceil(v.min())), 0)
        last = min(int(np.floor(v.max())), rows - 1)
        for i in range(first, last + 1):
            begin, end, crossed = 0, 0, 0
            for k in range(3):
                a, b = triangles[f, k], triangles[f, (k + 1) % 3]
                s, t = turns[f, k], turns[f, (k + 1) % 3]
                if a > b:
                    a, b, s, t = b, a, t, s
                if (points[a, 0] <= i) == (points[b, 0] <= i):
                    continue
                part = (i - points[a, 0]) / (points[b, 0] - points[a, 0])
                step = points[b, 1] - points[a, 1] + columns * (t - s)
                column = int(np.ceil(points[a, 1] + part * step)) + columns * s
                if crossed == 0:
                    begin = end = column
                begin, end = min(begin, column), max(end, column)
                crossed += 1
            for j in range(begin, end):
                count[i, j % columns] += 1
                owner[i, j % columns] = f
                turn[i, j % columns] = j // columns
