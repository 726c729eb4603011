"""Following a field of directions by arc length, compiled (midpoint rule)."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from .parallel import ranges, run_blocks

Field = npt.NDArray[np.float32]

# Streamlines that take every step together: a layer of them is written in one go.
BUNDLE = 256
PLANES_PER_BLOCK = 16


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
    field = np.empty((*distance.shape, 3), np.float32)

    def blend(planes: slice) -> None:
        away = away_outside, away_inside, np.float32(near)
        _blend(distance, smooth, *away, planes.start, planes.stop, field)

    run_blocks(blend, ranges(len(field), PLANES_PER_BLOCK))
    return field


@numba.njit(nogil=True, cache=True)
def _blend(distance, smooth, away_outside, away_inside, near, begin, stop, field):  # type: ignore[no-untyped-def]
    """Planes begin … stop − 1 of the field, in place."""
    nz, ny, nx = distance.shape
    for i in range(begin, stop):
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
    """Unit direction at a place given in float32, all in single precision."""
    nz, ny, nx, _ = field.shape
    one = np.float32(1)
    z = min(max(z, np.float32(0)), np.float32(nz - 1.01))
    y = min(max(y, np.float32(0)), np.float32(ny - 1.01))
    x = min(max(x, np.float32(0)), np.float32(nx - 1.01))
    a, b, c = int(z), int(y), int(x)
    fz, fy, fx = z - np.float32(a), y - np.float32(b), x - np.float32(c)
    gz, gy, gx = one - fz, one - fy, one - fx
    p, q, r, s = gz * gy, gz * fy, fz * gy, fz * fy
    u, v, w = np.float32(0), np.float32(0), np.float32(0)
    d, e, f = a + 1, b + 1, c + 1
    for i, j, k, weight in (
        (a, b, c, p * gx),
        (a, b, f, p * fx),
        (a, e, c, q * gx),
        (a, e, f, q * fx),
        (d, b, c, r * gx),
        (d, b, f, r * fx),
        (d, e, c, s * gx),
        (d, e, f, s * fx),
    ):
        u += field[i, j, k, 0] * weight
        v += field[i, j, k, 1] * weight
        w += field[i, j, k, 2] * weight
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
    h, half = np.float32(step), np.float32(0.5 * step)
    limit = np.float32(radius * radius)
    core_z, core_y, core_x = np.float32(core[0]), np.float32(core[1]), np.float32(core[2])
    here = np.empty((BUNDLE, 3), np.float32)
    going = np.empty(BUNDLE, np.bool_)
    for begin in range(0, n, BUNDLE):
        size = min(BUNDLE, n - begin)
        here[:size] = start[begin : begin + size]
        going[:size] = True
        layer = first
        while 0 <= layer < layers:
            for i in range(size):
                if going[i]:
                    z, y, x = here[i, 0], here[i, 1], here[i, 2]
                    u, v, w = _direction(field, z, y, x)
                    u, v, w = _direction(field, z + half * u, y + half * v, x + half * w)
                    z, y, x = z + h * u, y + h * v, x + h * w
                    away = (z - core_z) ** 2 + (y - core_y) ** 2 + (x - core_x) ** 2
                    going[i] = not away < limit
                    if going[i]:
                        here[i, 0], here[i, 1], here[i, 2] = z, y, x
                        reached[begin + i] += 1
                for k in range(3):
                    nodes[layer, begin + i, k] = here[i, k]
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
