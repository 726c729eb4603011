"""What lies under the mouse: the first face of a mesh along a line of sight."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .locate import SphericalLocator, SurfaceLocator, interpolate

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# How far outside of the mesh's box a line of sight starts, relative to its diagonal.
OUTSIDE = 1.01
# How far lines of sight to vertices pass beside them, and how much nearer a face that hides
# a vertex is, both relative to the diagonal. A line through a vertex may slip between faces.
ASIDE, BEFORE = 1e-7, 1e-5


class Hits(NamedTuple):
    """Where lines of sight meet a mesh first; lines that miss it are left out.

    Attributes
    ----------
    line : ndarray, (k,) int64
        The line of each hit.
    face : ndarray, (k,) int64
    weights : ndarray, (k, 3)
        Barycentric weights of the hit in the face.
    points : ndarray, (k, 3)
    """

    line: Ints
    face: Ints
    weights: Floats
    points: Floats


class RayPicker:
    """Finds the face of a mesh that is seen along a line.

    Building it takes a second for 300 000 faces; a pick some hundredths of a millisecond.

    Parameters
    ----------
    vertices : ndarray, (n, 3)
    faces : ndarray, (m, 3)
    locator : SurfaceLocator, optional
        That of the same mesh, where there is one already.
    """

    def __init__(
        self,
        vertices: npt.ArrayLike,
        faces: npt.ArrayLike,
        locator: SurfaceLocator | None = None,
    ) -> None:
        self.vertices = np.ascontiguousarray(vertices, dtype=np.float64)
        self.faces = np.ascontiguousarray(faces, dtype=np.int64)
        self._locator = locator or SurfaceLocator(self.vertices, self.faces)
        low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        self._centre = (low + high) / 2
        self._diagonal = max(float(np.linalg.norm(high - low)), 1e-9)

    def pick(self, origin: npt.ArrayLike, direction: npt.ArrayLike) -> tuple[int, Floats] | None:
        """Face and barycentric weights (3,) of what is seen first, None for nothing.

        Parameters
        ----------
        origin : array-like, (3,)
            Any point of the line of sight.
        direction : array-like, (3,)
            Away from the viewer, of any length.
        """
        hits = self.pick_many(np.reshape(origin, (1, 3)), np.reshape(direction, (1, 3)))
        return (int(hits.face[0]), hits.weights[0]) if len(hits.line) else None

    def pick_many(self, origins: npt.ArrayLike, directions: npt.ArrayLike) -> Hits:
        """The first hits of many lines of sight.

        Parameters
        ----------
        origins, directions : array-like, (k, 3)
            As in :meth:`pick`.
        """
        origin = np.asarray(origins, dtype=np.float64)
        along = _unit(np.asarray(directions, dtype=np.float64))
        # A line of sight may be given by a point behind the mesh, or within it.
        middle = origin + _dot(self._centre - origin, along) * along
        reach = OUTSIDE * self._diagonal
        face, weights = self._locator.first_hit(middle - reach * along, middle + reach * along)
        line = np.flatnonzero(face >= 0)
        face, weights = face[line], weights[line]
        return Hits(line, face, weights, interpolate(self.vertices, self.faces, face, weights))

    def visible(self, vertices: Ints, directions: Floats) -> npt.NDArray[np.bool_]:
        """Whether vertices (k,) are seen along lines of sight (k, 3): nothing is before them."""
        along = _unit(np.asarray(directions, dtype=np.float64))
        own = self.vertices[vertices]
        aside = _unit(np.cross(along, np.roll(along, 1, axis=1) + np.array([0.3, 0.5, 0.7])))
        hits = self.pick_many(own + ASIDE * self._diagonal * aside, along)
        before = _dot(own[hits.line] - hits.points, along[hits.line])[:, 0]
        touches = (self.faces[hits.face] == vertices[hits.line][:, None]).any(axis=1)
        hidden = np.zeros(len(vertices), bool)
        hidden[hits.line] = ~touches & (before > BEFORE * self._diagonal)
        return ~hidden


class SpherePicker:
    """Finds the face of a triangulated unit sphere that is seen along a line.

    Its locator is quick to build, and other threads go on meanwhile.

    Parameters
    ----------
    directions : ndarray, (n, 3)
        Unit vectors: the vertices.
    faces : ndarray, (m, 3)
    """

    def __init__(self, directions: Floats, faces: Ints) -> None:
        self._locator = SphericalLocator(directions, faces)

    def pick(self, origin: npt.ArrayLike, direction: npt.ArrayLike) -> tuple[int, Floats] | None:
        """Face and barycentric weights (3,) of what is seen first, None for nothing.

        Parameters are those of :meth:`RayPicker.pick`.
        """
        along = np.asarray(direction, dtype=np.float64)
        along = along / np.linalg.norm(along)
        start = np.asarray(origin, dtype=np.float64)
        nearest = start - (start @ along) * along
        inside = 1.0 - float(nearest @ nearest)
        if inside <= 0.0:
            return None
        face, weights = self._locator.locate((nearest - np.sqrt(inside) * along)[None])
        return int(face[0]), weights[0]


def _unit(vectors: Floats) -> Floats:
    unit: Floats = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return unit


def _dot(one: Floats, other: Floats) -> Floats:
    product: Floats = (one * other).sum(axis=1, keepdims=True)
    return product
