"""Mean curvature from a smoothed signed distance, Gaussian curvature by angle deficit.

Convex is positive: a sphere of radius r has H = 1/r and K = 1/r².
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt
from scipy import ndimage

from .parallel import ranges, run_blocks

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# Faces smaller than this fraction of the mean are collapsed: their angles mean nothing.
COLLAPSED = 1e-10
POINTS_PER_BLOCK = 8192


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
    smooth = np.asarray(ndimage.gaussian_filter(distance, smoothing), np.float32)
    places = np.ascontiguousarray(points, dtype=np.float64)
    blocks = ranges(len(places), POINTS_PER_BLOCK)
    parts = run_blocks(lambda part: _half_divergence(smooth, places[part]), blocks)
    return np.concatenate([np.empty(0), *parts])


@numba.njit(nogil=True, cache=True)
def _half_divergence(level, points):  # type: ignore[no-untyped-def]
    """½ div (∇ level / |∇ level|) at points (n, 3), trilinear between the voxels around."""
    out = np.empty(len(points))
    low = np.empty(3, np.int64)
    part = np.empty(3)
    voxel = np.empty(3, np.int64)
    for n in range(len(points)):
        for axis in range(3):
            place = min(max(points[n, axis], 0.0), level.shape[axis] - 1.0)
            low[axis] = min(int(place), level.shape[axis] - 2)
            part[axis] = place - low[axis]
        total = 0.0
        for corner in range(8):
            weight = 0.5
            for axis in range(3):
                up = (corner >> axis) & 1
                voxel[axis] = low[axis] + up
                weight *= part[axis] if up else 1.0 - part[axis]
            total += weight * _divergence(level, voxel)
        out[n] = total
    return out


@numba.njit(nogil=True, cache=True)
def _divergence(level, voxel):  # type: ignore[no-untyped-def]
    """Divergence of the unit gradient at a voxel, by central differences; `voxel` is kept."""
    total = 0.0
    for axis in range(3):
        here = voxel[axis]
        above, below = min(here + 1, level.shape[axis] - 1), max(here - 1, 0)
        voxel[axis] = above
        after = _unit_slope(level, voxel, axis)
        voxel[axis] = below
        total += (after - _unit_slope(level, voxel, axis)) / (above - below)
        voxel[axis] = here
    return total


@numba.njit(nogil=True, cache=True)
def _unit_slope(level, voxel, wanted):  # type: ignore[no-untyped-def]
    """One component of the unit gradient at a voxel."""
    squared, slope = 0.0, 0.0
    i, j, k = voxel[0], voxel[1], voxel[2]
    for axis in range(3):
        here = voxel[axis]
        above, below = min(here + 1, level.shape[axis] - 1), max(here - 1, 0)
        if axis == 0:
            change = level[above, j, k] - level[below, j, k]
        elif axis == 1:
            change = level[i, above, k] - level[i, below, k]
        else:
            change = level[i, j, above] - level[i, j, below]
        difference = change / (above - below)
        squared += difference * difference
        if axis == wanted:
            slope = difference
    return slope / max(np.sqrt(squared), 1e-6)
