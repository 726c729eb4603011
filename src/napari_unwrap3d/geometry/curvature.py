"""Mean curvature from a smoothed signed distance, Gaussian curvature by angle deficit.

Convex is positive: a sphere of radius r has H = 1/r and K = 1/r².
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from .interpolate import sample_linear

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# Faces smaller than this fraction of the mean are collapsed: their angles mean nothing.
COLLAPSED = 1e-10


def corner_angles(vertices: Floats, faces: Ints) -> Floats:
    """Interior angles (m, 3) in radians of every face."""
    corners = vertices[faces]
    u = np.roll(corners, -1, axis=1) - corners
    v = np.roll(corners, 1, axis=1) - corners
    sine = np.linalg.norm(np.cross(u, v), axis=2)
    angles: Floats = np.arctan2(sine, np.einsum("ijk,ijk->ij", u, v))
    return angles


def angle_deficit(vertices: Floats, faces: Ints) -> Floats:
    """Integrated Gaussian curvature (n,): 2π minus the angles around each vertex.

    Sums to 2πχ over a closed mesh (Gauss–Bonnet). Paper, Step 1.
    """
    angles = corner_angles(vertices, faces)
    around = np.bincount(faces.ravel(), angles.ravel(), minlength=len(vertices))
    return 2.0 * np.pi - np.asarray(around, np.float64)


def total_absolute_curvature(vertices: Floats, faces: Ints) -> float:
    """Total |K| over 4π: 1 for a convex closed surface, more for every dent and bump.

    Vertices next to a collapsed face are left out.
    """
    corners = vertices[faces]
    double_area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    keep = np.ones(len(vertices), bool)
    keep[faces[double_area < COLLAPSED * double_area.mean()]] = False
    return float(np.abs(angle_deficit(vertices, faces)[keep]).sum() / (4.0 * np.pi))


def mean_curvature(
    distance: npt.NDArray[np.float32], points: Floats, *, smoothing: float = 2.0
) -> Floats:
    """Mean curvature H = ½ div n at points, per voxel edge.

    Parameters
    ----------
    distance : ndarray, (z, y, x) float32
        Signed distance in voxels, negative inside.
    points : ndarray, (n, 3)
        Index coordinates.
    smoothing : float
        Gaussian σ in voxels of the distance before n = ∇Φ / |∇Φ| is formed.

    Returns
    -------
    ndarray, (n,)
        Divide by the voxel's edge in µm to get 1/µm. Paper, "Surface curvature
        measurement", with the sign chosen so that convex is positive.
    """
    smooth = ndimage.gaussian_filter(distance, smoothing)
    normal = np.stack(np.gradient(smooth))
    normal /= np.maximum(np.sqrt(np.einsum("i...,i...->...", normal, normal)), 1e-6)
    divergence = sum(np.gradient(normal[axis], axis=axis) for axis in range(3))
    return 0.5 * sample_linear(np.asarray(divergence), points).astype(np.float64)
