"""Following a field of directions by arc length, compiled (midpoint rule)."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

Field = npt.NDArray[np.float32]


def blend_directions(
    distance: Field, smooth: Field, outer: Field, inner: Field, near: float
) -> Field:
    """Unit outward directions: the distance's gradient near the surface, harmonic away.

    Parameters
    ----------
    distance : ndarray, (z, y, x) float32
        Signed distance in voxels; its magnitude sets the weight ``exp(−|distance| / near)``.
    smooth : ndarray, (z, y, x) float32
        Smoothed signed distance, whose gradient is used near the surface.
    outer, inner : ndarray float32
        Harmonic functions on every second voxel, growing away from the surface.
    near : float
        In voxels.

    Returns
    -------
    ndarray, (z, y, x, 3) float32
    """
    away_outside = np.stack([np.gradient(outer, axis=axis) for axis in range(3)], axis=-1)
    away_inside = -np.stack([np.gradient(inner, axis=axis) for axis in range(3)], axis=-1)
    return np.asarray(_blend(distance, smooth, away_outside, away_inside, np.float32(near)))


@numba.njit(nogil=True, cache=True)
def _blend(distance, smooth, away_outside, away_inside, near):  # type: ignore[no-untyped-def]
    nz, ny, nx = distance.shape
    field = np.empty((nz, ny, nx, 3), np.float32)
    for i in range(nz):
        for j in range(ny):
            for k in range(nx):
                h0 = smooth[min(i + 1, nz - 1), j, k] - smooth[max(i - 1, 0), j, k]
                h1 = smooth[i, min(j + 1, ny - 1), k] - smooth[i, max(j - 1, 0), k]
                h2 = smooth[i, j, min(k + 1, nx - 1)] - smooth[i, j, max(k - 1, 0)]
                d = distance[i, j, k]
                if d > 0:
                    a0, a1, a2 = _at_half(away_outside, i, j, k)
                else:
                    a0, a1, a2 = _at_half(away_inside, i, j, k)
                weight = np.exp(-abs(d) / near)
                here = np.sqrt(h0 * h0 + h1 * h1 + h2 * h2)
                away = np.sqrt(a0 * a0 + a1 * a1 + a2 * a2)
                if away < 1e-30:
                    weight, away = np.float32(1.0), np.float32(1.0)
                if here < 1e-9:
                    here = np.float32(1.0)
                p, q = weight / here, (np.float32(1.0) - weight) / away
                f0, f1, f2 = p * h0 + q * a0, p * h1 + q * a1, p * h2 + q * a2
                n = max(np.sqrt(f0 * f0 + f1 * f1 + f2 * f2), np.float32(1e-9))
                field[i, j, k, 0], field[i, j, k, 1], field[i, j, k, 2] = f0 / n, f1 / n, f2 / n
    return field


@numba.njit(nogil=True, cache=True, inline="always")
def _at_half(vectors, i, j, k):  # type: ignore[no-untyped-def]
    """Vectors known on every second voxel, at voxel (i, j, k): the mean of 1 to 8 of them."""
    nz, ny, nx, _ = vectors.shape
    a, b, c = i // 2, j // 2, k // 2
    z, y, x = min(a + i % 2, nz - 1), min(b + j % 2, ny - 1), min(c + k % 2, nx - 1)
    s0, s1, s2 = np.float32(0.0), np.float32(0.0), np.float32(0.0)
    for p in (a, z):
        for q in (b, y):
            for r in (c, x):
                s0 += vectors[p, q, r, 0]
                s1 += vectors[p, q, r, 1]
                s2 += vectors[p, q, r, 2]
    return s0, s1, s2


@numba.njit(nogil=True, cache=True)
def _value(values, z, y, x):  # type: ignore[no-untyped-def]
    nz, ny, nx = values.shape
    z = min(max(z, 0.0), nz - 1.0)
    y = min(max(y, 0.0), ny - 1.0)
    x = min(max(x, 0.0), nx - 1.0)
    a, b, c = min(int(z), nz - 2), min(int(y), ny - 2), min(int(x), nx - 2)
    fz, fy, fx = z - a, y - b, x - c
    low = (values[a, b, c] * (1 - fx) + values[a, b, c + 1] * fx) * (1 - fy) + (
        values[a, b + 1, c] * (1 - fx) + values[a, b + 1, c + 1] * fx
    ) * fy
    high = (values[a + 1, b, c] * (1 - fx) + values[a + 1, b, c + 1] * fx) * (1 - fy) + (
        values[a + 1, b + 1, c] * (1 - fx) + values[a + 1, b + 1, c + 1] * fx
    ) * fy
    return low * (1 - fz) + high * fz


@numba.njit(nogil=True, cache=True, inline="always")
def _direction(field, z, y, x):  # type: ignore[no-untyped-def]
    nz, ny, nx, _ = field.shape
    one = np.float32(1)
    z = min(max(z, np.float32(0)), np.float32(nz - 1.01))
    y = min(max(y, np.float32(0)), np.float32(ny - 1.01))
    x = min(max(x, np.float32(0)), np.float32(nx - 1.01))
    a, b, c = int(z), int(y), int(x)
    fz, fy, fx = z - a, y - b, x - c
    gz, gy, gx = one - fz, one - fy, one - fx
    w0, w1, w2, w3 = gz * gy * gx, gz * gy * fx, gz * fy * gx, gz * fy * fx
    w4, w5, w6, w7 = fz * gy * gx, fz * gy * fx, fz * fy * gx, fz * fy * fx
    p0, p1, p2, p3 = field[a, b, c], field[a, b, c + 1], field[a, b + 1, c], field[a, b + 1, c + 1]
    q0, q1 = field[a + 1, b, c], field[a + 1, b, c + 1]
    q2, q3 = field[a + 1, b + 1, c], field[a + 1, b + 1, c + 1]
    u = p0[0] * w0 + p1[0] * w1 + p2[0] * w2 + p3[0] * w3
    u += q0[0] * w4 + q1[0] * w5 + q2[0] * w6 + q3[0] * w7
    v = p0[1] * w0 + p1[1] * w1 + p2[1] * w2 + p3[1] * w3
    v += q0[1] * w4 + q1[1] * w5 + q2[1] * w6 + q3[1] * w7
    w = p0[2] * w0 + p1[2] * w1 + p2[2] * w2 + p3[2] * w3
    w += q0[2] * w4 + q1[2] * w5 + q2[2] * w6 + q3[2] * w7
    n = one / max(np.sqrt(u * u + v * v + w * w), np.float32(1e-6))
    return u * n, v * n, w * n


@numba.njit(nogil=True, cache=True)
def trace_into(field, start, step, core, radius, nodes, first, way):  # type: ignore[no-untyped-def]
    """Trace a streamline from each start and write its nodes into a stack of layers.

    Parameters
    ----------
    field : ndarray, (z, y, x, 3) float32
    start : ndarray, (n, 3) float32
        Index coordinates.
    step : float
        Signed arc length in voxels between two layers.
    core : ndarray, (3,), and radius : float
        Streamlines stop at this ball; its radius may be 0.
    nodes : ndarray, (D, n, 3) float32
        Written at layers ``first, first + way, …`` to the end of the stack; a streamline
        that stopped repeats its last node.

    Returns
    -------
    ndarray, (n,) int64
        Number of layers before each streamline stopped.
    """
    layers = nodes.shape[0]
    n = start.shape[0]
    reached = np.zeros(n, np.int64)
    h = np.float32(step)
    half = np.float32(0.5 * step)
    limit = np.float32(radius * radius)
    for i in range(n):
        z, y, x = start[i, 0], start[i, 1], start[i, 2]
        layer = first
        stopped = False
        while 0 <= layer < layers:
            if not stopped:
                u, v, w = _direction(field, z, y, x)
                u, v, w = _direction(field, z + half * u, y + half * v, x + half * w)
                nz, ny, nx = z + h * u, y + h * v, x + h * w
                away = (nz - core[0]) ** 2 + (ny - core[1]) ** 2 + (nx - core[2]) ** 2
                if away < limit:
                    stopped = True
                else:
                    z, y, x = nz, ny, nx
                    reached[i] += 1
            nodes[layer, i, 0], nodes[layer, i, 1], nodes[layer, i, 2] = z, y, x
            layer += way
    return reached


@numba.njit(nogil=True, cache=True)
def trace_to_surface(field, distance, start, step, limit):  # type: ignore[no-untyped-def]
    """Arc length from each point to the surface, and where it arrives.

    Parameters
    ----------
    field : ndarray, (z, y, x, 3) float32
        Unit directions, outward.
    distance : ndarray, (z, y, x) float32
        Changes sign at the surface, positive outside.
    start : ndarray, (n, 3) float64
    step, limit : float
        Arc length of a step, and after which to give up, in voxels.

    Returns
    -------
    length : ndarray, (n,)
        Signed, outward positive; NaN where the surface was not reached.
    landing : ndarray, (n, 3)
    """
    n = start.shape[0]
    length = np.full(n, np.nan)
    landing = start.copy()
    for i in range(n):
        z, y, x = np.float32(start[i, 0]), np.float32(start[i, 1]), np.float32(start[i, 2])
        value = _value(distance, z, y, x)
        sign = 1.0 if value > 0 else -1.0
        h = np.float32(-sign * step)
        half = np.float32(0.5) * h
        total = 0.0
        while total < limit:
            u, v, w = _direction(field, z, y, x)
            u, v, w = _direction(field, z + half * u, y + half * v, x + half * w)
            nz, ny, nx = z + h * u, y + h * v, x + h * w
            after = _value(distance, nz, ny, nx)
            if after * sign <= 0:
                part = value / (value - after) if value != after else 0.0
                length[i] = sign * (total + part * step)
                landing[i, 0] = z + part * h * u
                landing[i, 1] = y + part * h * v
                landing[i, 2] = x + part * h * w
                break
            z, y, x, value = nz, ny, nx, after
            total += step
    return length, landing
