"""A sphere's mesh with (d, v, u) at its vertices, opened at the poles to a cylinder.

u is periodic, so that it grows by a turn around each pole: the face that holds the pole
is replaced by three quadrilaterals that reach from its edges to the border of the image,
where the pole, one point of the surface, becomes a whole row.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse import csgraph

from ..errors import MapError
from .mesh import face_neighbors

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

NORTH, SOUTH = 0, 1
# Faces are counter-clockwise seen from outside in (z, y, x), where u runs clockwise around
# the north pole: the turns that a face's u makes when the pole is in it.
POLE_TURNS = (-1, 1)
# No vertex is nearer to a pole than this many rows, and the pole no nearer to the border of
# its face than this weight: u is undefined at the pole itself.
NEAREST_ROWS = 1e-3
SMALLEST_WEIGHT = 0.02


@dataclass(frozen=True)
class Cylinder:
    """A mesh that is opened at its poles, and how its faces lie around the seam.

    Attributes
    ----------
    points : ndarray, (n + 6, 3)
        (d, v, u) of the mesh's n vertices, then of the three copies of each pole.
    faces : ndarray, (m + 10, 3)
        All faces but the two polar ones, in their order, then the twelve triangles around
        the poles.
    turns : ndarray, (m + 10, 3) int64
        A corner lies at u + 2N · turns.
    lengths : ndarray, (m + 10, 3)
        Lengths of the edges opposite to the corners, the short way around the seam.
    pole_faces : ndarray, (2,) int64
        The faces of the mesh that hold the north and the south pole.
    pole_weights : ndarray, (2, 3)
        Barycentric weights of the poles in them.
    face_turns : ndarray, (m, 3) int64
        As `turns`, for the faces of the mesh.
    """

    points: Floats
    faces: Ints
    turns: Ints
    lengths: Floats
    pole_faces: Ints
    pole_weights: Floats
    face_turns: Ints


def open_at_poles(image: Floats, faces: Ints, rows: int) -> Cylinder:
    """Open a closed mesh of genus 0 at the outermost place of each pole.

    Parameters
    ----------
    image : ndarray, (n, 3)
        Finite (d, v, u) per vertex, all in pixels; u modulo 2N.
    faces : ndarray, (m, 3)
        Counter-clockwise seen from outside.
    rows : int
        N.

    Raises
    ------
    MapError
        No face holds a pole: the mesh does not go around the reference.
    """
    image = image.copy()
    image[:, 1] = image[:, 1].clip(NEAREST_ROWS - 0.5, rows - 0.5 - NEAREST_ROWS)
    jumps = _jumps(image[:, 2], faces, rows)
    lengths = _lengths(image, faces, jumps, rows)
    residue = jumps.sum(axis=1)
    poles = np.array([_polar_face(image, faces, residue, rows, pole) for pole in (NORTH, SOUTH)])
    residue[poles] = 0
    jumps += _balancing(faces, residue, poles)
    turns = np.zeros_like(jumps)
    turns[:, 1] = jumps[:, 0]
    turns[:, 2] = jumps[:, 0] + jumps[:, 1]
    weights = np.array([_pole_weights(image[faces[face]], rows) for face in poles])
    kept = np.ones(len(faces), bool)
    kept[poles] = False
    points, polar, polar_turns = _borders(image, faces[poles], jumps[poles], weights, rows)
    return Cylinder(
        points=points,
        faces=np.concatenate([faces[kept], polar]),
        turns=np.concatenate([turns[kept], polar_turns]),
        lengths=np.concatenate([lengths[kept], _plain_lengths(points, polar, polar_turns, rows)]),
        pole_faces=poles,
        pole_weights=weights,
        face_turns=turns,
    )


def _jumps(u: Floats, faces: Ints, rows: int) -> Ints:
    """Turns (m, 3) that make each step from a corner to the next at most half a turn.

    Computed once per edge, so that both faces of an edge agree also where it is half a turn.
    """
    following = np.roll(faces, -1, axis=1)
    low, high = np.minimum(faces, following), np.maximum(faces, following)
    turn = -np.rint((u[high] - u[low]) / (2.0 * rows)).astype(np.int64)
    return np.where(faces == low, turn, -turn)


def _lengths(image: Floats, faces: Ints, jumps: Ints, rows: int) -> Floats:
    """Length (m, 3) of the edge opposite to each corner."""
    step = np.roll(image[faces], -1, axis=1) - image[faces]
    step[:, :, 2] += 2.0 * rows * jumps
    return np.asarray(np.roll(np.linalg.norm(step, axis=2), -1, axis=1))


def corners(points: Floats, faces: Ints, turns: Ints, rows: int) -> Floats:
    """Positions (m, 3, k) of the corners of every face, whose last coordinate is u."""
    placed: Floats = points[faces]
    placed[:, :, -1] += 2.0 * rows * turns
    return placed


def _plain_lengths(points: Floats, faces: Ints, turns: Ints, rows: int) -> Floats:
    placed = corners(points, faces, turns, rows)
    following = np.roll(placed, -1, axis=1)
    return np.asarray(np.linalg.norm(np.roll(placed, -2, axis=1) - following, axis=2))


def _polar_face(image: Floats, faces: Ints, residue: Ints, rows: int, pole: int) -> int:
    """The outermost of the faces that hold a pole the right way round."""
    found = np.flatnonzero(residue == POLE_TURNS[pole])
    southern = image[faces[found], 1].mean(axis=1) > 0.5 * (rows - 1)
    found = found[southern == (pole == SOUTH)]
    if len(found) == 0:
        raise MapError(
            f"No face of the surface holds the {('north', 'south')[pole]} pole.",
            hint="The surface does not go around the reference.",
        )
    height = [_pole_weights(image[faces[f]], rows) @ image[faces[f], 0] for f in found]
    return int(found[np.argmax(height)])


def _pole_weights(triangle: Floats, rows: int) -> Floats:
    """Barycentric weights (3,) of the pole in a face, in the plane around the pole."""
    v, angle = triangle[:, 1], triangle[:, 2] * np.pi / rows
    radius = v + 0.5 if v.mean() < 0.5 * (rows - 1) else rows - 0.5 - v
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    opposite = np.roll(x, -1) * np.roll(y, -2) - np.roll(x, -2) * np.roll(y, -1)
    weights = np.maximum(opposite / opposite.sum(), SMALLEST_WEIGHT)
    return np.asarray(weights / weights.sum())


def _balancing(faces: Ints, residue: Ints, poles: Ints) -> Ints:
    """Turns (m, 3) to add to the edges so that no face but the polar ones winds.

    Where the surface overhangs a pole, its streamline is crossed there and back: u is made
    to jump by a turn along a chain of faces from each such crossing to one of the other
    way round.
    """
    extra = np.zeros_like(faces)
    left = residue.copy()
    if not left.any():
        return extra
    graph = _dual_graph(face_neighbors(faces), poles)
    for start in np.flatnonzero(left > 0):
        distance, before = csgraph.dijkstra(
            graph, unweighted=True, indices=start, return_predecessors=True
        )
        while left[start] > 0:
            end = int(np.where(left < 0, distance, np.inf).argmin())
            _add_along(extra, faces, before, int(start), end)
            left[start] -= 1
            left[end] += 1
    return extra


def _dual_graph(neighbours: Ints, poles: Ints) -> sparse.csr_array:
    """Which faces lie side by side, without the polar ones."""
    face = np.repeat(np.arange(len(neighbours)), 3)
    other = neighbours.ravel()
    kept = ~(np.isin(face, poles) | np.isin(other, poles))
    size = (len(neighbours),) * 2
    return sparse.csr_array((np.ones(int(kept.sum())), (face[kept], other[kept])), shape=size)


def _add_along(extra: Ints, faces: Ints, before: Ints, start: int, end: int) -> None:
    """Take a turn from `start` to `end` through the edges between, in place."""
    here = end
    while here != start:
        there = int(before[here])
        following = np.roll(faces[there], -1).tolist()
        for k in range(3):
            a, b = faces[here, k], faces[here, (k + 1) % 3]
            if b in faces[there] and following[faces[there].tolist().index(b)] == a:
                extra[here, k] += 1
                extra[there, faces[there].tolist().index(b)] -= 1
                break
        here = there


def _borders(
    image: Floats, polar: Ints, jumps: Ints, weights: Floats, rows: int
) -> tuple[Floats, Ints, Ints]:
    """The points with three copies of each pole, and the triangles to them with their turns."""
    copies, triangles, turns = [], [], []
    for pole in (NORTH, SOUTH):
        ring = polar[pole]
        first = len(image) + 3 * pole
        copy = image[ring].copy()
        copy[:, 0] = weights[pole] @ image[ring, 0]
        copy[:, 1] = (-0.5, rows - 0.5)[pole]
        copies.append(copy)
        for k in range(3):
            after, turn = (k + 1) % 3, int(jumps[pole, k])
            triangles += [
                (ring[k], ring[after], first + after),
                (ring[k], first + after, first + k),
            ]
            turns += [(0, turn, turn), (0, turn, 0)]
    return np.concatenate([image, *copies]), np.array(triangles), np.array(turns)
