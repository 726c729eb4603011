"""Which voxels of the cell are whose protrusion, down to a cortex under its footprint.

All lengths here are voxels of the mask's grid.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..geometry.interpolate import sample_nearest
from ..geometry.topology import largest_parts
from ..geometry.voxel_graph import spread, voxel_graph

Field = npt.NDArray[np.float32]
Labels = npt.NDArray[np.int32]
Solid = npt.NDArray[np.bool_]

BEYOND = (0.0, 0.7, 1.4)  # how far above a level a label is looked for


def down_to_cortex(
    mask: Solid, labels: Labels, height: Field, threshold: float, reach: float
) -> Labels:
    """Labels carried to the foot of the protrusions, and down to the cortex under them.

    Parameters
    ----------
    mask : ndarray, (z, y, x) bool
    labels : ndarray, (z, y, x) int32
    height : ndarray, (z, y, x) float32
        Over the cortex that goes on under the footprints.
    threshold : float
        Where protrusions begin, of the height at the surface.
    reach : float
        How far around what is labelled the foot of a protrusion is looked for.

    Returns
    -------
    ndarray, (z, y, x) int32
        No label is below the cortex, and every one is a single 26-connected piece.
    """
    # The surface passes half a voxel beyond the centres of the outermost voxels.
    over = max(threshold - 0.5, 0.0)
    labels = np.where(height > 0, labels, 0)
    graph = voxel_graph(mask & ((height > over) | (labels > 0)))
    whole = graph.on_grid(spread(graph, labels.ravel()[graph.flat], reach))
    if over > 0:
        between = mask & (whole == 0) & (height > 0) & (height <= over)
        whole[between] = _outward(whole, height, between, over)
    return largest_parts(whole)


def _outward(labels: Labels, height: Field, chosen: Solid, level: float) -> Labels:
    """The labels met from the chosen voxels (n) going along the slope up to a level."""
    index = np.argwhere(chosen)
    outward = _slope(height, index)
    rise = (level - height[chosen])[:, None]
    found = np.zeros(len(index), np.int32)
    for more in BEYOND:
        met = sample_nearest(labels, np.asarray(index + outward * (rise + more)))
        found = np.where(found > 0, found, met).astype(np.int32)
    return found


def _slope(field: Field, index: npt.NDArray[np.int64]) -> npt.NDArray[np.float64]:
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
