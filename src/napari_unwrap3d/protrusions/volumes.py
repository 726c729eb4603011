"""Which voxels of the cell are whose protrusion, down to a cortex under its footprint.

All lengths here are voxels of the mask's grid.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ..geometry.interpolate import sample_nearest

Field = npt.NDArray[np.float32]
Labels = npt.NDArray[np.int32]
Solid = npt.NDArray[np.bool_]

BEYOND = (0.0, 0.7, 1.4)  # how far above the threshold a label is looked for
EVERY_NEIGHBOUR = np.ones((3, 3, 3))


def down_to_cortex(
    mask: Solid, labels: Labels, height: Field, under: Field, threshold: float
) -> Labels:
    """Labels of the voxels over the threshold carried down to the cortex under them.

    Parameters
    ----------
    mask : ndarray, (z, y, x) bool
    labels : ndarray, (z, y, x) int32
        Of voxels whose `height` is over `threshold`.
    height, under : ndarray, (z, y, x) float32
        Over the cell opened by the ball, and by a larger one that does not rise into wide
        footprints.
    threshold : float

    Returns
    -------
    ndarray, (z, y, x) int32
        A voxel between both takes the label that is met going outward, if any. Every label is
        one connected piece.
    """
    below = mask & (labels == 0) & (np.maximum(height, under) > 0) & (height <= threshold)
    index = np.argwhere(below)
    outward = _gradient(under, index)
    rise = (threshold - height[below])[:, None]
    found = np.zeros(len(index), np.int32)
    for more in BEYOND:
        met = sample_nearest(labels, index + outward * (rise + more))
        found = np.where(found > 0, found, met).astype(np.int32)
    whole = labels.copy()
    whole[below] = found
    return one_piece_each(whole)


def _gradient(field: Field, index: npt.NDArray[np.int64]) -> npt.NDArray[np.float64]:
    """Unit vectors (n, 3) along the slope of a field at voxels (n, 3)."""
    slope = np.empty(index.shape)
    last = np.array(field.shape) - 1
    for axis in range(3):
        step = np.eye(3, dtype=np.int64)[axis]
        after, before = np.minimum(index + step, last), np.maximum(index - step, 0)
        slope[:, axis] = field[tuple(after.T)] - field[tuple(before.T)]
    length = np.linalg.norm(slope, axis=1, keepdims=True)
    unit: npt.NDArray[np.float64] = slope / np.maximum(length, 1e-6)
    return unit


def one_piece_each(labels: Labels) -> Labels:
    """Only the largest 26-connected piece of every label."""
    out = labels.copy()
    for label, box in enumerate(ndimage.find_objects(labels), start=1):
        if box is None:
            continue
        mine = labels[box] == label
        pieces, count = ndimage.label(mine, EVERY_NEIGHBOUR)
        if count > 1:
            largest = 1 + int(np.argmax(np.bincount(pieces.ravel())[1:]))
            out[box][mine & (pieces != largest)] = 0
    return out
