"""Which face of a mesh in (d, v, u) lies outermost over every pixel."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


def outermost_faces(vertices: Floats, faces: Ints, rows: int) -> tuple[Ints, Floats, Floats]:
    """Outermost face over the centre of every pixel of a uv image.

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
        Barycentric weights in (v, u).
    d : ndarray, (N, 2N)
        NaN where there is no face.
    """
    face = np.full((rows, 2 * rows), -1, np.int64)
    weights = np.zeros((rows, 2 * rows, 3))
    height = np.full((rows, 2 * rows), -np.inf)
    _raster(np.ascontiguousarray(vertices), np.ascontiguousarray(faces), face, weights, height)
    height[face < 0] = np.nan
    return face, weights, height


@numba.njit(nogil=True, cache=True)
def _raster(vertices, faces, face, weights, height):  # type: ignore[no-untyped-def]
    rows, columns = face.shape
    for f in range(faces.shape[0]):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        va, ua = vertices[a, 1], vertices[a, 2]
        vb, ub = vertices[b, 1], vertices[b, 2]
        vc, uc = vertices[c, 1], vertices[c, 2]
        if max(ua, ub, uc) - min(ua, ub, uc) > rows:
            continue
        area = (vb - va) * (uc - ua) - (vc - va) * (ub - ua)
        if area == 0.0:
            continue
        for i in range(
            max(int(np.ceil(min(va, vb, vc))), 0), min(int(np.floor(max(va, vb, vc))), rows - 1) + 1
        ):
            for j in range(int(np.ceil(min(ua, ub, uc))), int(np.floor(max(ua, ub, uc))) + 1):
                wb = ((i - va) * (uc - ua) - (vc - va) * (j - ua)) / area
                wc = ((vb - va) * (j - ua) - (i - va) * (ub - ua)) / area
                wa = 1.0 - wb - wc
                if wa < -1e-12 or wb < -1e-12 or wc < -1e-12:
                    continue
                column = j % columns
                d = wa * vertices[a, 0] + wb * vertices[b, 0] + wc * vertices[c, 0]
                if d > height[i, column]:
                    height[i, column] = d
                    face[i, column] = f
                    weights[i, column, 0] = wa
                    weights[i, column, 1] = wb
                    weights[i, column, 2] = wc
