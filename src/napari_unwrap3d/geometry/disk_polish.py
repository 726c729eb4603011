"""Bringing the areas of the faces of a planar mesh to given values, vertex by vertex."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from .area_polish import VertexStars

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

KEPT_DETERMINANT = 0.2
MOST_FACES = 64


def polish_disk(
    points: Floats,
    faces: Ints,
    stars: VertexStars,
    target: Floats,
    on_circle: npt.NDArray[np.bool_],
    chosen: Ints,
) -> Floats:
    """Gauss–Newton steps on each vertex for the sum of squared log(area / target) around it.

    Parameters
    ----------
    points : ndarray, (n, 2)
    faces : ndarray, (m, 3)
        Of positive determinant.
    target : ndarray, (m,)
        Wanted shares of the area, summing to 1.
    on_circle : ndarray, (n,) bool
        Vertices that stay on the unit circle and slide along it.
    sweeps : int

    Returns
    -------
    ndarray, (n, 2)
        No face is flipped.
    """
    result = points.copy()
    a, b, c = (result[faces[:, k]] for k in range(3))
    p, q = b - a, c - a
    total = float((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum())
    _sweep(result, faces, stars.start, stars.faces, np.log(target * total), on_circle, chosen)
    return result


@numba.njit(nogil=True, cache=True)
def _double_area(x, faces, f, i, p):  # type: ignore[no-untyped-def]
    """Twice the area of a face with vertex i at p, and its gradient there."""
    b, c = faces[f, 1], faces[f, 2]
    if b == i:
        b, c = faces[f, 2], faces[f, 0]
    elif c == i:
        b, c = faces[f, 0], faces[f, 1]
    u0, u1 = x[b, 0] - p[0], x[b, 1] - p[1]
    v0, v1 = x[c, 0] - p[0], x[c, 1] - p[1]
    return u0 * v1 - u1 * v0, x[b, 1] - x[c, 1], x[c, 0] - x[b, 0]


@numba.njit(nogil=True, cache=True)
def _around(x, faces, star, log_target, i, p, least, out):  # type: ignore[no-untyped-def]
    """Energy around vertex i if it were at p; −1 if a determinant falls below `least`.

    `out` (5,) receives the gradient (2) and the upper triangle of the normal matrix (3).
    """
    energy = 0.0
    for k in range(5):
        out[k] = 0.0
    for q in range(len(star)):
        double, g0, g1 = _double_area(x, faces, star[q], i, p)
        if not double > least[q]:
            return -1.0
        r = np.log(double) - log_target[star[q]]
        energy += r * r
        g0 /= double
        g1 /= double
        out[0] += r * g0
        out[1] += r * g1
        out[2] += g0 * g0
        out[3] += g0 * g1
        out[4] += g1 * g1
    return energy


@numba.njit(nogil=True, cache=True)
def _step(m, p, slides):  # type: ignore[no-untyped-def]
    """The Gauss–Newton step; along the circle for a vertex that slides on it."""
    if slides:
        t0, t1 = -p[1], p[0]
        curved = m[2] * t0 * t0 + 2.0 * m[3] * t0 * t1 + m[4] * t1 * t1
        if not curved > 0.0:
            return 0.0, 0.0
        along = -(m[0] * t0 + m[1] * t1) / curved
        return along * t0, along * t1
    trace = m[2] + m[4]
    h00, h11 = m[2] + 1e-3 * trace, m[4] + 1e-3 * trace
    det = h00 * h11 - m[3] * m[3]
    if not det > 0.0:
        return 0.0, 0.0
    return -(m[0] * h11 - m[1] * m[3]) / det, -(m[1] * h00 - m[0] * m[3]) / det


@numba.njit(nogil=True, cache=True)
def _sweep(x, faces, start, around, log_target, on_circle, chosen):  # type: ignore[no-untyped-def]
    m = np.empty(5)
    p = np.empty(2)
    least = np.empty(MOST_FACES)
    for i in chosen:
        star = around[start[i] : start[i + 1]]
        if len(star) > MOST_FACES:
            continue
        p[:] = x[i]
        for q in range(len(star)):
            least[q] = KEPT_DETERMINANT * _double_area(x, faces, star[q], i, p)[0]
        energy = _around(x, faces, star, log_target, i, p, least, m)
        if energy < 0.0:
            continue
        d0, d1 = _step(m, p, on_circle[i])
        if d0 == 0.0 and d1 == 0.0:
            continue
        for _ in range(6):
            p[0], p[1] = x[i, 0] + d0, x[i, 1] + d1
            if on_circle[i]:
                norm = np.sqrt(p[0] * p[0] + p[1] * p[1])
                p[0] /= norm
                p[1] /= norm
            after = _around(x, faces, star, log_target, i, p, least, m)
            if 0.0 <= after < energy:
                x[i] = p
                break
            d0 *= 0.4
            d1 *= 0.4
