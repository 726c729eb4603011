"""A uv image of positions as a closed mesh: what can be rebuilt from S(u, v)."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt


def mesh_of_image(positions: npt.NDArray[Any]) -> tuple[npt.NDArray[Any], npt.NDArray[np.int64]]:
    """Two triangles per pixel, closed over the seam, and with a vertex on each pole.

    Parameters
    ----------
    positions : ndarray, (N, 2N, 3)
        (z, y, x) of the pixels' centres; NaN where a pixel has none.

    Returns
    -------
    vertices : ndarray, (n, 3)
    faces : ndarray, (m, 3)
        Outward for an outward image; without those that have a corner without a place.
    """
    rows, columns, _ = positions.shape
    with np.errstate(invalid="ignore"):
        poles = np.nanmean(positions[[0, -1]], axis=1)
    vertices = np.concatenate([positions.reshape(-1, 3), poles])
    number = np.arange(rows * columns).reshape(rows, columns)
    right = np.roll(number, -1, axis=1)
    a, b, c, d = number[:-1], right[:-1], number[1:], right[1:]
    north, south = (np.full(columns, rows * columns + k) for k in (0, 1))
    faces = [
        np.stack([a, b, c], axis=-1).reshape(-1, 3),
        np.stack([b, d, c], axis=-1).reshape(-1, 3),
        np.stack([north, right[0], number[0]], axis=-1),
        np.stack([number[-1], right[-1], south], axis=-1),
    ]
    joined = np.concatenate(faces)
    placed = np.isfinite(vertices).all(axis=1)[joined].all(axis=1)
    used, renumbered = np.unique(joined[placed], return_inverse=True)
    return vertices[used], renumbered.reshape(-1, 3)
