"""Fill the holes of a mesh with triangles between the vertices of their rims."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..errors import NotWatertightError
from .mesh import Floats, Ints, edges_with_faces, face_areas, half_edges

# The triangulation takes time and memory with the square of a rim's length.
MAXIMUM_RIM = 512


def boundary_loops(faces: npt.ArrayLike) -> list[Ints]:
    """The rims of the holes, each as its vertices in the order a filling runs along it.

    The faces must be wound consistently and every vertex must have one fan, so that
    at most one rim passes through it.
    """
    faces = np.asarray(faces, dtype=np.int64)
    edges = edges_with_faces(faces)
    rim = edges.slots[edges.first[edges.valence == 1]]
    # The face inside runs start → end, so its partner in the filling runs end → start.
    follow = {int(b): int(a) for a, b in half_edges(faces).reshape(-1, 2)[rim]}
    loops = []
    while follow:
        start, following = follow.popitem()
        loop = [start]
        while following != start:
            loop.append(following)
            following = follow.pop(following)
        loops.append(np.array(loop, dtype=np.int64))
    return loops


def fill_holes(
    vertices: Floats, faces: Ints, largest_fraction: float
) -> tuple[Floats, Ints, Ints, dict[str, float]]:
    """Close every hole that is small against the surface.

    A rim is triangulated without new vertices so that the sum of squared edge lengths
    is least, which keeps the area small and the triangles compact. Where every such
    triangulation would use an edge that the mesh already has, a vertex at the rim's
    centroid closes the hole instead.

    Parameters
    ----------
    vertices : ndarray, (n, 3)
    faces : ndarray, (m, 3)
        Wound consistently, one fan per vertex.
    largest_fraction : float
        The largest area of a filling, as a fraction of the area of the mesh.

    Returns
    -------
    vertices : ndarray, (n + k, 3)
    faces : ndarray, (m + f, 3)
    origin : ndarray, (k,) int64
        For each new vertex, a vertex of the rim that it stands for.
    counts : dict
        ``holes``, ``triangles`` and ``area_um2`` of the fillings.

    Raises
    ------
    NotWatertightError
        A hole is too large to be closed without inventing surface.
    """
    loops = boundary_loops(faces)
    taken = edges_with_faces(faces).vertices
    keys = taken[:, 0] * len(vertices) + taken[:, 1]
    total = float(face_areas(vertices, faces).sum())
    patches: list[Ints] = []
    centres: list[Floats] = []
    origin: list[int] = []
    areas: list[float] = []
    for loop in loops:
        _refuse_long(loop, loops)
        local = _triangulate(vertices[loop], _existing_chords(loop, keys, len(vertices)))
        if local is None:
            centre = len(vertices) + len(centres)
            centres.append(vertices[loop].mean(axis=0))
            origin.append(int(loop[0]))
            patch = np.stack([loop, np.roll(loop, -1), np.full_like(loop, centre)], axis=1)
        else:
            patch = loop[local]
        patches.append(patch)
        areas.append(float(face_areas(np.concatenate([vertices, *_rows(centres)]), patch).sum()))
    if areas and max(areas) > largest_fraction * total:
        raise NotWatertightError(
            "The mesh has a hole that is too large to be closed without inventing surface.",
            holes=len(loops),
            boundary_edges=sum(len(loop) for loop in loops),
            largest_hole_um2=max(areas),
            fraction_of_area=max(areas) / total,
            hint=f"Holes up to {largest_fraction:.0%} of the area are closed. Close it in a mesh "
            "editor, or start from the mask or the stack instead.",
        )
    counts = {
        "holes": len(loops),
        "triangles": sum(len(patch) for patch in patches),
        "area_um2": float(sum(areas)),
    }
    return (
        np.concatenate([vertices, *_rows(centres)]),
        np.concatenate([faces, *patches]),
        np.array(origin, dtype=np.int64),
        counts,
    )


def _rows(points: list[Floats]) -> list[Floats]:
    return [np.stack(points)] if points else []


def _refuse_long(loop: Ints, loops: list[Ints]) -> None:
    if len(loop) > MAXIMUM_RIM:
        raise NotWatertightError(
            "The mesh has a hole with a rim too long to be closed.",
            rim_edges=len(loop),
            holes=len(loops),
            hint=f"Rims up to {MAXIMUM_RIM} edges are closed. Close it in a mesh editor, or "
            "start from the mask or the stack instead.",
        )


def _existing_chords(loop: Ints, keys: Ints, stride: int) -> npt.NDArray[np.bool_]:
    """Which pairs (i, j) of the rim are joined by an edge of the mesh, off the rim."""
    low, high = np.minimum.outer(loop, loop), np.maximum.outer(loop, loop)
    joined: npt.NDArray[np.bool_] = np.isin(low * stride + high, keys)
    n = len(loop)
    gap = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    joined[(gap <= 1) | (gap == n - 1)] = False
    return joined


def _triangulate(points: Floats, forbidden: npt.NDArray[np.bool_]) -> Ints | None:
    """Triangles (n − 2, 3) of a polygon with the least sum of squared edge lengths.

    Dynamic programming over the sub-polygons i..j (Klincsek 1980); None when every
    triangulation uses a forbidden chord.
    """
    n = len(points)
    square = ((points[:, None] - points[None]) ** 2).sum(axis=2)
    square[forbidden] = np.inf
    cost = np.zeros((n, n))
    split = np.zeros((n, n), dtype=np.int64)
    for gap in range(2, n):
        for i in range(n - gap):
            j = i + gap
            k = slice(i + 1, j)
            total = cost[i, k] + cost[k, j] + square[i, k] + square[k, j] + square[i, j]
            best = int(total.argmin())
            cost[i, j], split[i, j] = total[best], i + 1 + best
    if not np.isfinite(cost[0, n - 1]):
        return None
    triangles, todo = [], [(0, n - 1)]
    while todo:
        i, j = todo.pop()
        if j - i >= 2:
            middle = int(split[i, j])
            triangles.append((i, middle, j))
            todo += [(i, middle), (middle, j)]
    return np.array(triangles, dtype=np.int64)
