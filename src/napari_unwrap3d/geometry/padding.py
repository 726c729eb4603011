"""Continuing a uv image over its borders as the sphere continues.

Rows are half a pixel away from the poles, so beyond the first row comes the first row
again, half a turn away. The one padding of the package: filters, gradients, flow and
tracking use it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt


def pad_sphere(image: npt.NDArray[Any], width: int, *, axis: int = 0) -> npt.NDArray[Any]:
    """Pad the rows `axis` (v) and columns `axis` + 1 (u) of a uv image by `width` pixels.

    Parameters
    ----------
    image : ndarray
        (..., N, 2N, ...) with the rows at `axis`.
    width : int
        At most N.

    Returns
    -------
    ndarray
        (..., N + 2 width, 2N + 2 width, ...); columns continue periodically, rows continue
        half a turn away (2N must be even, which it is).
    """
    if width == 0:
        return image
    half = image.shape[axis + 1] // 2
    over = np.roll(image, half, axis=axis + 1)
    top = np.flip(_take(over, axis, slice(None, width)), axis=axis)
    bottom = np.flip(_take(over, axis, slice(-width, None)), axis=axis)
    tall = np.concatenate([top, image, bottom], axis=axis)
    left = _take(tall, axis + 1, slice(-width, None))
    right = _take(tall, axis + 1, slice(None, width))
    return np.concatenate([left, tall, right], axis=axis + 1)


def wrap_uv(points: npt.NDArray[np.float64], rows: int) -> npt.NDArray[np.float64]:
    """Bring points (n, 2) (v, u) into −½ ≤ v ≤ N − ½ and −½ ≤ u < 2N − ½ over poles and seam."""
    v, u = points[:, 0] + 0.5, points[:, 1] + 0.5
    v = np.mod(v, 2.0 * rows)
    beyond = v > rows
    v = np.where(beyond, 2.0 * rows - v, v)
    u = np.mod(np.where(beyond, u + rows, u), 2.0 * rows)
    return np.stack([v - 0.5, u - 0.5], axis=1)


def sample_uv_linear(
    image: npt.NDArray[Any], points: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Bilinear values of a uv image (N, 2N, ...) at points (n, 2) (v, u), over poles and seam."""
    rows = image.shape[0]
    padded = pad_sphere(image, 1).astype(np.float64)
    v, u = (wrap_uv(points, rows) + 1.0).T
    i, j = np.floor(v).astype(np.int64), np.floor(u).astype(np.int64)
    shape = (-1,) + (1,) * (image.ndim - 2)
    fv, fu = (v - i).reshape(shape), (u - j).reshape(shape)
    top = padded[i, j] * (1 - fu) + padded[i, j + 1] * fu
    bottom = padded[i + 1, j] * (1 - fu) + padded[i + 1, j + 1] * fu
    return np.asarray(top * (1 - fv) + bottom * fv)


def sample_uv_nearest(image: npt.NDArray[Any], points: npt.NDArray[np.float64]) -> npt.NDArray[Any]:
    """Values of the pixels that hold the points (n, 2) (v, u)."""
    rows, columns = image.shape[:2]
    v, u = wrap_uv(points, rows).T
    i = np.clip(np.floor(v + 0.5).astype(np.int64), 0, rows - 1)
    j = np.floor(u + 0.5).astype(np.int64) % columns
    values: npt.NDArray[Any] = image[i, j]
    return values


def sample_uv_label(image: npt.NDArray[Any], points: npt.NDArray[np.float64]) -> npt.NDArray[Any]:
    """Labels of a uv image (N, 2N) at points (n, 2) (v, u): the largest bilinear vote wins.

    Of equal votes the nearer pixel's wins, so that a pixel's own centre has its own label.
    """
    rows = image.shape[0]
    padded = pad_sphere(image, 1)
    v, u = (wrap_uv(points, rows) + 1.0).T
    i, j = np.floor(v).astype(np.int64), np.floor(u).astype(np.int64)
    fv, fu = v - i, u - j
    labels = np.stack([padded[i + p, j + q] for p in (0, 1) for q in (0, 1)])
    shares = np.stack([a * b for a in (1 - fv, fv) for b in (1 - fu, fu)])
    votes = [((labels == label) * shares).sum(axis=0) for label in labels]
    winner = np.argmax(np.round(votes, 12) + 1e-13 * shares, axis=0)
    values: npt.NDArray[Any] = labels[winner, np.arange(len(points))]
    return values


def _take(image: npt.NDArray[Any], axis: int, part: slice) -> npt.NDArray[Any]:
    index = [slice(None)] * image.ndim
    index[axis] = part
    return image[tuple(index)]
