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
    """Larger and smaller singular value (m,) of the linear map of every face."""
    p = _flatten(source, faces)
    q = _flatten(target, faces)
    # J maps the source's edges (columns (p00, 0), (p10, p11)) to the target's.
    p00, p10, p11 = p
    j00 = q[0] / p00
    j01 = (q[1] - j00 * p10) / p11
    j11 = q[2] / p11
    half_trace = 0.5 * (j00**2 + j01**2 + j11**2)
    root = np.sqrt(np.maximum(half_trace**2 - (j00 * j11) ** 2, 0.0))
    larger = np.sqrt(half_trace + root)
    with np.errstate(divide="ignore", invalid="ignore"):
        smaller = np.where(larger > 0, j00 * j11 / larger, 0.0)
    return larger, smaller


def _flatten(vertices: Floats, faces: Ints) -> tuple[Floats, Floats, Floats]:
    """Corners B = (b, 0) and C = (c, h) of every face laid into a plane with A at 0."""
    a, b, c = vertices[faces[:, 0]], vertices[faces[:, 1]], vertices[faces[:, 2]]
    u, v = b - a, c - a
    base = np.maximum(np.linalg.norm(u, axis=1), 1e-300)
    height = np.maximum(np.linalg.norm(np.cross(u, v), axis=1) / base, 1e-300)
    return base, np.einsum("ij,ij->i", u, v) / base, height


def conformal_error(source: Floats, target: Floats, faces: Ints) -> Floats:
    """Q (m,) of every face: the ratio of the singular values, 1 where angles are kept."""
    larger, smaller = singular_values(source, target, faces)
    error: Floats = larger / np.maximum(smaller, 1e-300)
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
    """det[A B C] (m,) of every spherical triangle; positive where it is not flipped."""
    a, b, c = directions[faces[:, 0]], directions[faces[:, 1]], directions[faces[:, 2]]
    determinants: Floats = np.einsum("ij,ij->i", a, np.cross(b, c))
    return determinants


def flipped_faces(directions: Floats, faces: Ints) -> int:
    """Number of spherical triangles that are flipped, degenerate or not finite."""
    return int((~(spherical_determinants(directions, faces) > 0)).sum())
