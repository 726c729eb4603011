"""Exact Euclidean distance transforms on isotropic grids.

The separable lower-envelope algorithm of Felzenszwalb and Huttenlocher (2012,
doi:10.4086/toc.2012.v008a019), compiled; scipy's is an order of magnitude slower and
its result is the reference in the tests.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

FAR = np.float32(1e12)


def distance_to(mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.float32]:
    """Distance in voxels from every voxel's centre to the nearest True voxel's centre.

    Parameters
    ----------
    mask : ndarray, (z, y, x) bool

    Returns
    -------
    ndarray, (z, y, x) float32
        0 where `mask` is True; 1e6 everywhere if no voxel is True.
    """
    squared = np.where(mask, np.float32(0), FAR)
    longest = max(squared.shape)
    buffers = np.empty(longest, np.float32), np.empty(longest, np.int64), np.empty(longest + 1)
    for axis in range(3):
        _transform_lines(np.moveaxis(squared, axis, 2), *buffers)
    result: npt.NDArray[np.float32] = np.sqrt(squared)
    return result


def signed_distance(mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.float32]:
    """Signed distance in voxels to the boundary of a mask, negative inside.

    The boundary lies half-way between the centres of neighbouring voxels of different
    value, so the nearest centres on both sides have ±½.
    """
    half = np.float32(0.5)
    outside = distance_to(mask)
    inside = distance_to(~mask)
    result: npt.NDArray[np.float32] = np.where(mask, half - inside, outside - half)
    return result


@numba.njit(nogil=True, cache=True)
def _transform_lines(values, line, apex, breaks):  # type: ignore[no-untyped-def]
    """Lower envelope of parabolas along the last axis, in place."""
    rows, columns, n = values.shape
    for row in range(rows):
        for column in range(columns):
            last = -1
            for q in range(n):
                height = values[row, column, q]
                line[q] = height
                if height >= FAR:
                    continue
                while last >= 0:
                    p = apex[last]
                    crossing = ((height + q * q) - (line[p] + p * p)) / (2.0 * (q - p))
                    if crossing > breaks[last]:
                        break
                    last -= 1
                last += 1
                apex[last] = q
                breaks[last] = -1e30 if last == 0 else crossing
            if last < 0:
                continue
            k = 0
            for q in range(n):
                while k < last and breaks[k + 1] < q:
                    k += 1
                p = apex[k]
                values[row, column, q] = line[p] + (q - p) * (q - p)
