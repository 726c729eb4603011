"""How often a spherical mesh that may fold covers each pixel of its (u, v) image."""

from __future__ import annotations

import numba
import numpy as np

from .mesh import Floats, Ints


def coverage(directions: Floats, faces: Ints, rows: int) -> Ints:
    """Number of faces, flipped ones too, that contain each pixel's centre.

    Parameters
    ----------
    directions : ndarray, (n, 3)
        Unit vectors (z, y, x), the north pole at +z.
    faces : ndarray, (m, 3)
    rows : int
        N.

    Returns
    -------
    ndarray, (N, 2N) int64
    """
    count = np.zeros((rows, 2 * rows), np.int64)
    _count(np.ascontiguousarray(directions), np.ascontiguousarray(faces), count)
    return count


@numba.njit(nogil=True, cache=True)
def _count(points, faces, count):  # type: ignore[no-untyped-def]
    rows, columns = count.shape
    pixel = np.pi / rows
    inverse = np.empty((3, 3))
    for f in range(faces.shape[0]):
        a, b, c = points[faces[f, 0]], points[faces[f, 1]], points[faces[f, 2]]
        sign = _inverse_rows(a, b, c, inverse)
        if sign == 0.0:
            continue
        m0, m1, m2 = a[0] + b[0] + c[0], a[1] + b[1] + c[1], a[2] + b[2] + c[2]
        norm = np.sqrt(m0 * m0 + m1 * m1 + m2 * m2)
        if not norm > 1e-9:
            continue
        m0, m1, m2 = m0 / norm, m1 / norm, m2 / norm
        # The cap around the face: only pixels in it are looked at.
        nearest = 1.0
        for corner in (a, b, c):
            nearest = min(nearest, corner[0] * m0 + corner[1] * m1 + corner[2] * m2)
        radius = np.arccos(max(-1.0, min(1.0, nearest))) + 1e-9
        inclination = np.arccos(max(-1.0, min(1.0, m0)))
        azimuth = np.arctan2(m1, m2)
        first = max(int(np.ceil((inclination - radius) / pixel - 0.5)), 0)
        last = min(int(np.floor((inclination + radius) / pixel - 0.5)), rows - 1)
        for i in range(first, last + 1):
            theta = (i + 0.5) * pixel
            z, flat = np.cos(theta), np.sin(theta)
            around = flat * np.sin(inclination)
            needed = np.cos(radius) - z * m0
            if needed > around:
                continue
            half = np.pi if needed <= -around else np.arccos(needed / around) + 1e-9
            begin = int(np.ceil((azimuth - half + np.pi) / pixel - 0.5))
            end = int(np.floor((azimuth + half + np.pi) / pixel - 0.5))
            if end - begin >= columns:
                begin, end = 0, columns - 1
            for j in range(begin, end + 1):
                phi = (j + 0.5) * pixel - np.pi
                y, x = flat * np.sin(phi), flat * np.cos(phi)
                inside = True
                for k in range(3):
                    weight = inverse[k, 0] * z + inverse[k, 1] * y + inverse[k, 2] * x
                    inside = inside and sign * weight >= 0.0
                count[i, j % columns] += inside


@numba.njit(nogil=True, cache=True)
def _inverse_rows(a, b, c, rows):  # type: ignore[no-untyped-def]
    """Rows b×c, c×a, a×b into `rows`; the sign of the determinant."""
    for k in range(3):
        p = b if k == 0 else (c if k == 1 else a)
        q = c if k == 0 else (a if k == 1 else b)
        rows[k, 0] = p[1] * q[2] - p[2] * q[1]
        rows[k, 1] = p[2] * q[0] - p[0] * q[2]
        rows[k, 2] = p[0] * q[1] - p[1] * q[0]
    return np.sign(a[0] * rows[0, 0] + a[1] * rows[0, 1] + a[2] * rows[0, 2])
