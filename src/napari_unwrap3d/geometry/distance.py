"""Exact Euclidean distance transforms on isotropic grids.

The separable lower-envelope algorithm of Felzenszwalb and Huttenlocher (2012,
doi:10.4086/toc.2012.v008a019), compiled; scipy's is an order of magnitude slower and
its result is the reference in the tests.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
import numpy as np
import numpy.typing as npt

from .parallel import ranges, run_blocks

PLANES_PER_BLOCK = 16
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
    squared = np.empty(mask.shape, np.float32)
    _in_blocks(lambda part: _along_last_axis(mask[part], squared[part]), len(mask))
    for lines in (squared.transpose(0, 2, 1), squared.transpose(1, 2, 0)):
        _transform(lines)
    _in_blocks(lambda part: np.sqrt(squared[part], out=squared[part]), len(squared))
    return squared


def power_distance(weight: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """Smallest ``|p − q|² + weight(q)`` over all voxels q, for every voxel p.

    With ``weight = −radius²`` it is zero on the surface of a union of balls, negative within
    and positive outside of it.

    Parameters
    ----------
    weight : ndarray, (z, y, x) float32
        In voxels²; `FAR` or more where there is no q.

    Returns
    -------
    ndarray, (z, y, x) float32
        In voxels²; `FAR` everywhere where there is no q at all.
    """
    power = np.array(weight, np.float32, order="C")
    for lines in (power, power.transpose(0, 2, 1), power.transpose(1, 2, 0)):
        _transform(lines)
    return power


def _transform(lines: npt.NDArray[np.float32]) -> None:
    """Lower envelopes along the last axis of a view, in place."""
    length = lines.shape[2]

    def transform(part: slice) -> None:
        line, apex = np.empty(length, np.float32), np.empty(length, np.int64)
        _transform_lines(lines[part], line, apex, np.empty(length + 1))

    _in_blocks(transform, len(lines))


def _in_blocks(function: Callable[[slice], Any], size: int) -> None:
    run_blocks(function, ranges(size, PLANES_PER_BLOCK))


def signed_distance(mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.float32]:
    """Signed distance in voxels to the boundary of a mask, negative inside.

    The boundary lies half-way between the centres of neighbouring voxels of different
    value, so the nearest centres on both sides have ±½.
    """
    half = np.float32(0.5)
    outside = distance_to(mask)
    inside = distance_to(~mask)
    # One of the two is 0 at every voxel.
    outside -= inside
    outside += np.where(mask, half, -half)
    return outside


@numba.njit(nogil=True, cache=True)
def _along_last_axis(mask, squared):  # type: ignore[no-untyped-def]
    """Squared distance along the last axis alone, `FAR` in lines without a True voxel."""
    rows, columns, n = mask.shape
    for row in range(rows):
        for column in range(columns):
            steps = np.float32(1e6)
            for q in range(n):
                steps = np.float32(0) if mask[row, column, q] else steps + np.float32(1)
                squared[row, column, q] = steps
            for q in range(n - 2, -1, -1):
                after = squared[row, column, q + 1] + np.float32(1)
                squared[row, column, q] = min(squared[row, column, q], after)
            for q in range(n):
                steps = squared[row, column, q]
                squared[row, column, q] = FAR if steps >= np.float32(1e6) else steps * steps


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
