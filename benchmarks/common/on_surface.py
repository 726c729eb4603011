"""Labels of voxels carried to the vertices of a surface."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage

import napari_unwrap3d as unwrap3d


def labels_at_vertices(
    mask: unwrap3d.Mask, labels: npt.NDArray[Any], surface: unwrap3d.Surface
) -> npt.NDArray[np.int32]:
    """The label (n,) of the voxel of the cell that is nearest to each vertex."""
    nearest = ndimage.distance_transform_edt(
        ~mask.data, return_distances=False, return_indices=True
    )
    place = np.rint(mask.to_index(surface.vertices)).astype(np.int64)
    place = np.clip(place, 0, np.array(mask.data.shape) - 1)
    voxel = nearest[:, place[:, 0], place[:, 1], place[:, 2]]
    return np.asarray(labels[tuple(voxel)], np.int32)
