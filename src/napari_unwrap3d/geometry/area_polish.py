"""Bringing the areas of the faces of a spherical mesh to given values, vertex by vertex."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

KEPT_DETERMINANT = 0.2


class VertexStars:
    """The faces around each vertex: ``faces[start[i]:start[i + 1]]`` for vertex i."""

    def __init__(self, faces: Ints, size: int) -> None:
        order = np.argsort(faces.ravel(), kind="stable")
        self.faces = order // 3
        self.start = np.concatenate([[0], np.cumsum(np.bincount(faces.ravel(), minlength=size))])


def polish_areas(
    directions: Floats, faces: Ints, stars: VertexStars, target: Floats, sweeps: int
) -> Floats:
    """Gauss–Newton steps on each vertex for the sum of squared log(area / target) around it.

    Parameters
    ----------
    directions : ndarray, (n, 3)
        Unit vectors.
    faces : ndarray, (m, 3)
    target : ndarray, (m,)
        Wanted shares of the area, summing to 1.
    sweeps : int

    Returns
    -------
    ndarray, (n, 3)
        Unit vectors; no face is flipped that was not.
    """
    result = directions.copy()
    corners = result[faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    total = 0.5 * np.linalg.norm(cross, axis=1).sum()
    _sweep(result, faces, stars.start, stars.faces, np.log(target * total), sweeps)
    return result


@numba.njit(nogil=True, cache=True)
def _around(x, faces, star, log_target, i, p, least, out):  # type: ignore[no-untyped-def]
    """Energy around vertex i if it were at p; −1 if a determinant falls below `least`.

    `out` (9,) receives the gradient (3) and the upper triangle of the normal matrix (6).
    """
    energy = 0.0
    for k in range(9):
        out[k] = 0.0
    for q in range(len(star)):
        f = star[q]
        a = faces[f, 0]
        b, c = faces[f, 1], faces[f, 2]
        if b == i:
            a, b, c = b, c, a
        elif c == i:
            a, b, c = c, a, b
        u0, u1, u2 = x[b, 0] - p[0], x[b, 1] - p[1], x[b, 2] - p[2]
        v0, v1, v2 = x[c, 0] - p[0], x[c, 1] - p[1], x[c, 2] - p[2]
        n0, n1, n2 = u1 * v2 - u2 * v1, u2 * v0 - u0 * v2, u0 * v1 - u1 * v0
        if not p[0] * n0 + p[1] * n1 + p[2] * n2 > least[q]:
            return -1.0
        double = np.sqrt(n0 * n0 + n1 * n1 + n2 * n2)
        r = np.log(0.5 * double) - log_target[f]
        energy += r * r
        e0, e1, e2 = x[c, 0] - x[b, 0], x[c, 1] - x[b, 1], x[c, 2] - x[b, 2]
        scale = 1.0 / (double * double)
        g0 = (n1 * e2 - n2 * e1) * scale
        g1 = (n2 * e0 - n0 * e2) * scale
        g2 = (n0 * e1 - n1 * e0) * scale
        out[0] += r * g0
        out[1] += r * g1
        out[2] += r * g2
        out[3] += g0 * g0
        out[4] += g0 * g1
        out[5] += g0 * g2
        out[6] += g1 * g1
        out[7] += g1 * g2
        out[8] += g2 * g2
    return energy


@numba.njit(nogil=True, cache=True)
def _form(m, s, t):  # type: ignore[no-untyped-def]
    """The normal matrix in `m` between two vectors."""
    return (
        m[3] * s[0] * t[0]
        + m[4] * (s[0] * t[1] + s[1] * t[0])
        + m[5] * (s[0] * t[2] + s[2] * t[0])
        + m[6] * s[1] * t[1]
        + m[7] * (s[1] * t[2] + s[2] * t[1])
        + m[8] * s[2] * t[2]
    )


@numba.njit(nogil=True, cache=True)
def tangents(p):  # type: ignore[no-untyped-def]
    """Two orthonormal vectors perpendicular to a unit vector."""
    s = (0.0, p[2], -p[1]) if abs(p[0]) < 0.6 else (-p[2], 0.0, p[0])
    n = np.sqrt(s[0] ** 2 + s[1] ** 2 + s[2] ** 2)
    s = (s[0] / n, s[1] / n, s[2] / n)
    t = (p[1] * s[2] - p[2] * s[1], p[2] * s[0] - p[0] * s[2], p[0] * s[1] - p[1] * s[0])
    return s, t


@numba.njit(nogil=True, cache=True)
def determinant(a, b, c):  # type: ignore[no-untyped-def]
    """A · ((b − a) × (c − a)): as a · (b × c), but exact to rounding for tiny faces too."""
    u0, u1, u2 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    v0, v1, v2 = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    return a[0] * (u1 * v2 - u2 * v1) + a[1] * (u2 * v0 - u0 * v2) + a[2] * (u0 * v1 - u1 * v0)


@numba.njit(nogil=True, cache=True)
def _sweep(x, faces, start, around, log_target, sweeps):  # type: ignore[no-untyped-def]
    n = x.shape[0]
    m = np.empty(9)
    p = np.empty(3)
    least = np.empty(64)
    for _ in range(sweeps):
        for i in range(n):
            star = around[start[i] : start[i + 1]]
            if len(star) > 64:
                continue
            p[:] = x[i]
            for q in range(len(star)):
                f = star[q]
                det = determinant(x[faces[f, 0]], x[faces[f, 1]], x[faces[f, 2]])
                least[q] = KEPT_DETERMINANT * det
            energy = _around(x, faces, star, log_target, i, p, least, m)
            if energy < 0.0:
                continue
            s, t = tangents(p)
            gs = m[0] * s[0] + m[1] * s[1] + m[2] * s[2]
            gt = m[0] * t[0] + m[1] * t[1] + m[2] * t[2]
            hss, hst, htt = _form(m, s, s), _form(m, s, t), _form(m, t, t)
            trace = hss + htt
            hss += 1e-3 * trace
            htt += 1e-3 * trace
            det = hss * htt - hst * hst
            if not det > 0.0:
                continue
            ds = -(gs * htt - gt * hst) / det
            dt = -(gt * hss - gs * hst) / det
            for _ in range(5):
                for k in range(3):
                    p[k] = x[i, k] + ds * s[k] + dt * t[k]
                norm = np.sqrt(p[0] ** 2 + p[1] ** 2 + p[2] ** 2)
                for k in range(3):
                    p[k] /= norm
                after = _around(x, faces, star, log_target, i, p, least, m)
                if 0.0 <= after < energy:
                    x[i] = p
                    break
                ds *= 0.4
                dt *= 0.4
