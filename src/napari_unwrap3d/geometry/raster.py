"""Which face of a mesh in (d, v, u) lies outermost over every pixel."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

# Rows next to a pole in which faces are drawn in the plane around it: at least so many, and
# at least so many times the height of the faces.
POLE_ROWS = 8.0
POLE_FACES = 4.0


def outermost_faces(vertices: Floats, faces: Ints, rows: int) -> tuple[Ints, Floats, Floats]:
    """Outermost face over the centre of every pixel of a uv image.

    Faces are flat in (v, u), but near the poles, where that is far from how they lie on the
    sphere, in the plane of polar coordinates around the pole. In between they are drawn
    both ways, which leaves no gap.

    Parameters
    ----------
    vertices : ndarray, (n, 3)
        (d, v, u) of a mesh cut at the seam, u up to 4N.
    faces : ndarray, (m, 3)
    rows : int
        N.

    Returns
    -------
    face : ndarray, (N, 2N)
        −1 where no face covers the pixel's centre.
    weights : ndarray, (N, 2N, 3)
        Barycentric weights of the pixel's centre in the face.
    d : ndarray, (N, 2N)
        NaN where there is no face.
    """
    points = np.ascontiguousarray(vertices)
    triangles = np.ascontiguousarray(faces)
    face = np.full((rows, 2 * rows), -1, np.int64)
    weights = np.zeros((rows, 2 * rows, 3))
    height = np.full((rows, 2 * rows), -np.inf)
    v, u = points[:, 1][triangles], points[:, 2][triangles]
    band = min(max(POLE_ROWS, POLE_FACES * _usual_height(v)), 0.4 * rows)
    wide = np.ptp(u, axis=1) > 0.5 * rows
    from_pole = np.minimum(v, rows - 1 - v).min(axis=1)
    in_image = np.flatnonzero(~wide & (from_pole > 0.5 * band))
    _raster(points, triangles, in_image, face, weights, height)
    polar = wide | (from_pole < band)
    southern = v.mean(axis=1) > 0.5 * (rows - 1)
    for south in (False, True):
        chosen = np.flatnonzero(polar & (southern == south))
        _raster_pole(points, triangles, chosen, south, face, weights, height)
    height[face < 0] = np.nan
    return face, weights, height


def _usual_height(v: Floats) -> float:
    """Rows that all but a few faces span at the most."""
    return float(np.quantile(np.ptp(v, axis=1), 0.99)) if len(v) else 0.0


@numba.njit(nogil=True, cache=True)
def _raster(vertices, faces, chosen, face, weights, height):  # type: ignore[no-untyped-def]
    rows, columns = face.shape
    for f in chosen:
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        va, ua = vertices[a, 1], vertices[a, 2]
        vb, ub = vertices[b, 1], vertices[b, 2]
        vc, uc = vertices[c, 1], vertices[c, 2]
        first = max(int(np.ceil(min(va, vb, vc))), 0)
        last = min(int(np.floor(max(va, vb, vc))), rows - 1)
        for i in range(first, last + 1):
            for j in range(int(np.ceil(min(ua, ub, uc))), int(np.floor(max(ua, ub, uc))) + 1):
                wb, wc = _weights(va, ua, vb, ub, vc, uc, i, j)
                _draw(vertices, f, a, b, c, wb, wc, i, j % columns, face, weights, height)


@numba.njit(nogil=True, cache=True)
def _raster_pole(vertices, faces, chosen, south, face, weights, height):  # type: ignore[no-untyped-def]
    """As :func:`_raster`, in the plane of polar coordinates around a pole."""
    rows, columns = face.shape
    per_column = np.pi / rows
    r = np.empty(3)
    t = np.empty(3)
    x = np.empty(3)
    y = np.empty(3)
    for f in chosen:
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        for k in range(3):
            v = vertices[faces[f, k], 1]
            r[k] = rows - 0.5 - v if south else v + 0.5
            t[k] = vertices[faces[f, k], 2] * per_column
            x[k], y[k] = r[k] * np.cos(t[k]), r[k] * np.sin(t[k])
        longest = 0.0
        for k in range(3):
            p, q = x[k] - x[k - 1], y[k] - y[k - 1]
            longest = max(longest, np.sqrt(p * p + q * q))
        nearest = r.min() - longest
        if nearest > 0:
            # The pole is outside: the corners lie within half a turn of the first.
            low = high = 0.0
            for k in range(1, 3):
                turn = (t[k] - t[0] + np.pi) % (2.0 * np.pi) - np.pi
                low, high = min(low, turn), max(high, turn)
            begin = int(np.ceil((t[0] + low) / per_column))
            end = int(np.floor((t[0] + high) / per_column)) + 1
        else:
            begin, end = 0, columns
        for ring in range(max(int(np.floor(nearest)), 0), min(int(np.ceil(r.max())), rows)):
            i = rows - 1 - ring if south else ring
            for j in range(begin, end):
                angle = j * per_column
                p, q = (ring + 0.5) * np.cos(angle), (ring + 0.5) * np.sin(angle)
                wb, wc = _weights(x[0], y[0], x[1], y[1], x[2], y[2], p, q)
                _draw(vertices, f, a, b, c, wb, wc, i, j % columns, face, weights, height)


@numba.njit(nogil=True, cache=True)
def _weights(pa, qa, pb, qb, pc, qc, p, q):  # type: ignore[no-untyped-def]
    """Barycentric weights of the second and third corner at a point of the plane."""
    area = (pb - pa) * (qc - qa) - (pc - pa) * (qb - qa)
    if area == 0.0:
        return -1.0, -1.0
    wb = ((p - pa) * (qc - qa) - (pc - pa) * (q - qa)) / area
    wc = ((pb - pa) * (q - qa) - (p - pa) * (qb - qa)) / area
    return wb, wc


@numba.njit(nogil=True, cache=True)
def _draw(vertices, f, a, b, c, wb, wc, i, column, face, weights, height):  # type: ignore[no-untyped-def]
    """Keep a face at a pixel that it covers if nothing lies farther out there."""
    wa = 1.0 - wb - wc
    if wa < -1e-12 or wb < -1e-12 or wc < -1e-12:
        return
    d = wa * vertices[a, 0] + wb * vertices[b, 0] + wc * vertices[c, 0]
    if d > height[i, column]:
        height[i, column] = d
        face[i, column] = f
        weights[i, column, 0] = wa
        weights[i, column, 1] = wb
        weights[i, column, 2] = wc
