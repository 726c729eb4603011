"""Trilinear and nearest sampling of volumes, compiled.

Positions are in index coordinates; positions outside are clamped to the border.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt


def sample_linear(
    volume: npt.NDArray[np.floating], points: npt.NDArray[np.floating]
) -> npt.NDArray[np.float32]:
    """Trilinear interpolation of a (z, y, x) volume at points (n, 3), as float32 (n,)."""
    data = np.ascontiguousarray(volume, dtype=np.float32)
    flat = np.ascontiguousarray(points).reshape(-1, 3)
    out = np.empty(len(flat), np.float32)
    _sample_linear(data, flat, out)
    return out.reshape(points.shape[:-1])


def sample_nearest(
    volume: npt.NDArray[np.generic], points: npt.NDArray[np.floating]
) -> npt.NDArray[np.generic]:
    """Value of the nearest voxel of a (z, y, x) volume at points (..., 3)."""
    index = np.floor(points + 0.5).astype(np.int64)
    limit = np.array(volume.shape) - 1
    z, y, x = np.moveaxis(np.clip(index, 0, limit), -1, 0)
    values: npt.NDArray[np.generic] = np.asarray(volume)[z, y, x]
    return values


@numba.njit(nogil=True, cache=True)
def _sample_linear(volume, points, out):  # type: ignore[no-untyped-def]
    nz, ny, nx = volume.shape
    for i in range(points.shape[0]):
        z = min(max(points[i, 0], 0.0), nz - 1.0)
        y = min(max(points[i, 1], 0.0), ny - 1.0)
        x = min(max(points[i, 2], 0.0), nx - 1.0)
        a, b, c = min(int(z), nz - 2), min(int(y), ny - 2), min(int(x), nx - 2)
        fz, fy, fx = z - a, y - b, x - c
        low = (volume[a, b, c] * (1 - fx) + volume[a, b, c + 1] * fx) * (1 - fy) + (
            volume[a, b + 1, c] * (1 - fx) + volume[a, b + 1, c + 1] * fx
        ) * fy
        high = (volume[a + 1, b, c] * (1 - fx) + volume[a + 1, b, c + 1] * fx) * (1 - fy) + (
            volume[a + 1, b + 1, c] * (1 - fx) + volume[a + 1, b + 1, c + 1] * fx
        ) * fy
        out[i] = low * (1 - fz) + high * fz


@numba.njit(nogil=True, cache=True)
def sample_placed(volume, origin, scale, points, out):  # type: ignore[no-untyped-def]
    """Trilinear interpolation at points (n, 3) float32 in µm, into `out` (n,), no copies made.

    Parameters
    ----------
    volume : ndarray, (z, y, x) float32
    origin, scale : ndarray, (3,) float32
        Index coordinates are ``(point − origin) · scale``.
    """
    nz, ny, nx = volume.shape
    zero, one = np.float32(0), np.float32(1)
    for i in range(points.shape[0]):
        z = min(max((points[i, 0] - origin[0]) * scale[0], zero), np.float32(nz - 1))
        y = min(max((points[i, 1] - origin[1]) * scale[1], zero), np.float32(ny - 1))
        x = min(max((points[i, 2] - origin[2]) * scale[2], zero), np.float32(nx - 1))
        a, b, c = min(int(z), nz - 2), min(int(y), ny - 2), min(int(x), nx - 2)
        fz, fy, fx = z - np.float32(a), y - np.float32(b), x - np.float32(c)
        gy, gx = one - fy, one - fx
        low = (volume[a, b, c] * gx + volume[a, b, c + 1] * fx) * gy + (
            volume[a, b + 1, c] * gx + volume[a, b + 1, c + 1] * fx
        ) * fy
        high = (volume[a + 1, b, c] * gx + volume[a + 1, b, c + 1] * fx) * gy + (
            volume[a + 1, b + 1, c] * gx + volume[a + 1, b + 1, c + 1] * fx
        ) * fy
        out[i] = low * (one - fz) + high * fz


@numba.njit(nogil=True, cache=True)
def value_at(volume, z, y, x):  # type: ignore[no-untyped-def]
    """Trilinear interpolation of a (z, y, x) volume at one place inside of it."""
    nz, ny, nx = volume.shape
    a, b, c = min(int(z), nz - 2), min(int(y), ny - 2), min(int(x), nx - 2)
    fz, fy, fx = z - a, y - b, x - c
    low = (volume[a, b, c] * (1 - fx) + volume[a, b, c + 1] * fx) * (1 - fy) + (
        volume[a, b + 1, c] * (1 - fx) + volume[a, b + 1, c + 1] * fx
    ) * fy
    high = (volume[a + 1, b, c] * (1 - fx) + volume[a + 1, b, c + 1] * fx) * (1 - fy) + (
        volume[a + 1, b + 1, c] * (1 - fx) + volume[a + 1, b + 1, c + 1] * fx
    ) * fy
    return low * (1 - fz) + high * fz
