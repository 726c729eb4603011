"""Harmonic functions in the shells outside and inside a solid.

Streamlines of a harmonic function cannot cross or end, which is what a coordinate
system normal to a surface needs far from it.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from ..progress import Progress

# Grids from coarse to fine, as strides of the full grid; each starts from the last one.
STRIDES = (16, 8, 4, 2)
# Sweeps between two looks at the change, and at the most. The change is relative to the
# value: far from `one` the function is tiny, and there too its direction must be right.
BLOCK = 20
MOST_SWEEPS = 1200
SMALLEST_CHANGE = 3e-4


def harmonic_between(
    zero: npt.NDArray[np.bool_], one: npt.NDArray[np.bool_], progress: Progress
) -> npt.NDArray[np.float32]:
    """Harmonic function that is 0 on `zero` and 1 on `one`, on every second voxel.

    Parameters
    ----------
    zero, one : ndarray, (z, y, x) bool
        Disjoint; the border of the grid belongs to one of them.

    Returns
    -------
    ndarray, (ceil(z/2), ceil(y/2), ceil(x/2)) float32
        By successive over-relaxation, coarse to fine.
    """
    values: npt.NDArray[np.float32] | None = None
    previous = STRIDES[0]
    for level, stride in enumerate(STRIDES):
        z = np.ascontiguousarray(zero[::stride, ::stride, ::stride])
        o = np.ascontiguousarray(one[::stride, ::stride, ::stride])
        if not (z.any() and o.any()):
            continue
        start = o.astype(np.float32)
        if values is not None:
            free = ~(z | o)
            grown = _refine(values, z.shape, previous // stride)
            start[free] = grown[free]
        omega = np.float32(2.0 / (1.0 + np.pi / max(z.shape)))
        for _ in range(MOST_SWEEPS // BLOCK):
            progress(level / len(STRIDES), "harmonic field")
            if _relax(start, z | o, BLOCK, omega) < SMALLEST_CHANGE:
                break
        values, previous = start, stride
    assert values is not None
    return values


def _refine(
    values: npt.NDArray[np.float32], shape: tuple[int, ...], factor: int
) -> npt.NDArray[np.float32]:
    for axis in range(3):
        position = np.arange(shape[axis]) / factor
        low = np.minimum(np.floor(position).astype(np.int64), values.shape[axis] - 1)
        high = np.minimum(low + 1, values.shape[axis] - 1)
        part = (position - low).astype(np.float32)
        part = part.reshape([-1 if a == axis else 1 for a in range(3)])
        values = (
            np.take(values, low, axis=axis) * (1 - part) + np.take(values, high, axis=axis) * part
        )
    return values


@numba.njit(nogil=True, cache=True)
def _relax(values, fixed, sweeps, omega):  # type: ignore[no-untyped-def]
    """Red-black over-relaxation, mirrored at the border, in place; the last relative change."""
    nz, ny, nx = values.shape
    largest = np.float32(0.0)
    for _ in range(sweeps):
        largest = np.float32(0.0)
        for colour in range(2):
            for i in range(nz):
                a, b = max(i - 1, 0), min(i + 1, nz - 1)
                for j in range(ny):
                    c, d = max(j - 1, 0), min(j + 1, ny - 1)
                    for k in range((i + j + colour) % 2, nx, 2):
                        if fixed[i, j, k]:
                            continue
                        e, f = max(k - 1, 0), min(k + 1, nx - 1)
                        mean = (
                            values[a, j, k]
                            + values[b, j, k]
                            + values[i, c, k]
                            + values[i, d, k]
                            + values[i, j, e]
                            + values[i, j, f]
                        ) * np.float32(1.0 / 6.0)
                        change = mean - values[i, j, k]
                        values[i, j, k] += omega * change
                        largest = max(largest, abs(change) / (abs(mean) + np.float32(1e-30)))
    return largest
