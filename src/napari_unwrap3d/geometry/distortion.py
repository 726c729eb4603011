"""How much a map between two meshes with the same faces stretches angles and areas.

Paper, "Quantification of geometric deformation errors for meshes".
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .mesh import face_areas

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


def singular_values(source: Floats, target: Floats, faces: Ints) -> tuple[Floats, Floats]:
    """Larger and smaller singular value (m,) of the linear map of every face.

    A target that is collapsed to a line has a smaller value of 0, to a point two of them.
    """
    u, v = _edges(source, faces)
    base = np.maximum(np.linalg.norm(u, axis=1), 1e-300)
    along = np.einsum("ij,ij->i", u, v) / base
    height = np.maximum(np.linalg.norm(np.cross(u, v), axis=1) / base, 1e-300)
    # Images of the unit vectors along the source's first edge and across it, in its plane.
    first, second = _edges(target, faces)
    first = first / base[:, None]
    second = (second - along[:, None] * first) / height[:, None]
    half_trace = 0.5 * np.einsum("ij,ij->i", first, first)
    half_trace += 0.5 * np.einsum("ij,ij->i", second, second)
    determinant = np.linalg.norm(np.cross(first, second), axis=1)
    root = np.sqrt(np.maximum(half_trace**2 - determinant**2, 0.0))
    larger = np.sqrt(half_trace + root)
    return larger, determinant / np.maximum(larger, 1e-300)


def _edges(vertices: Floats, faces: Ints) -> tuple[Floats, Floats]:
    """Vectors from the first corner of every face to the second and to the third."""
    first = vertices[faces[:, 0]]
    return vertices[faces[:, 1]] - first, vertices[faces[:, 2]] - first


def conformal_error(source: Floats, target: Floats, faces: Ints) -> Floats:
    """Q (m,) of every face: the ratio of the singular values, 1 where angles are kept.

    Infinite where a face is collapsed to a point.
    """
    larger, smaller = singular_values(source, target, faces)
    error: Floats = np.where(larger > 0, larger / np.maximum(smaller, 1e-300), np.inf)
    return error


def area_distortion(source: Floats, target: Floats, faces: Ints) -> Floats:
    """λ (m,) of every face: its share of the source's area over its share of the target's."""
    a, b = face_areas(source, faces), face_areas(target, faces)
    distortion: Floats = (a / a.sum()) / np.maximum(b / b.sum(), 1e-300)
    return distortion


def mean_conformal_error(source: Floats, target: Floats, faces: Ints) -> float:
    """Mean of Q, weighted by the source's area."""
    weights = face_areas(source, faces)
    return float(weights @ conformal_error(source, target, faces) / weights.sum())


def mean_log_area_distortion(source: Floats, target: Floats, faces: Ints) -> float:
    """Mean over the faces of |log λ|; 0 for an equiareal map."""
    return float(np.abs(np.log(np.maximum(area_distortion(source, target, faces), 1e-300))).mean())


def spherical_determinants(directions: Floats, faces: Ints) -> Floats:
    """det[A B C] (m,) of every spherical triangle; positive where it is not flipped.

    From the edges, A · ((B − A) × (C − A)), so that tiny triangles keep their sign.
    """
    a, b, c = directions[faces[:, 0]], directions[faces[:, 1]], directions[faces[:, 2]]
    determinants: Floats = np.einsum("ij,ij->i", a, np.cross(b - a, c - a))
    return determinants


def flipped_faces(directions: Floats, faces: Ints) -> int:
    """Number of spherical triangles that are flipped, degenerate or not finite."""
    return int((~(spherical_determinants(directions, faces) > 0)).sum())
