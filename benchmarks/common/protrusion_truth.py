"""Segmented protrusions against those of a simulated cell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from scipy.optimize import linear_sum_assignment
from scipy.spatial import KDTree

import napari_unwrap3d as unwrap3d
from napari_unwrap3d.geometry.distance import signed_distance
from napari_unwrap3d.geometry.interpolate import sample_linear
from napari_unwrap3d.geometry.laplacian import vertex_mass

Floats = npt.NDArray[np.float64]
Labels = npt.NDArray[np.integer]
Solid = npt.NDArray[np.bool_]

MATCH = 0.5


@dataclass(frozen=True, eq=False)
class Comparison:
    """What was found, against the truth.

    Attributes
    ----------
    iou : float
        Of all protrusions together, by the area of the surface.
    f1 : float
        One-to-one matches of an IoU of at least ½.
    found, true : int
        Number of protrusions.
    volume, area, height : ndarray, (matches,)
        Relative errors of the matched ones.
    imaging : ndarray, (matches,)
        Relative error of the volume of those voxels of the mask that are nearest to each true
        protrusion: what is lost, or won, before anything is segmented.
    cortex, under : float
        Mean distance in voxels of the cortex from the true body, and from the cortex to the
        body's surface under the true protrusions.
    """

    iou: float
    f1: float
    found: int
    true: int
    volume: Floats
    area: Floats
    height: Floats
    imaging: Floats
    cortex: float
    under: float


def shell(solid: Solid) -> npt.NDArray[np.int64]:
    """Voxels (n, 3) of a solid with a face on its outside."""
    outermost: npt.NDArray[np.int64] = np.argwhere(solid & ~ndimage.binary_erosion(solid))
    return outermost


def on_vertices(truth: Any, vertices: Floats) -> Labels:
    """The true label of the outermost voxel nearest to each vertex."""
    outermost = shell(truth.mask.data)
    _, nearest = KDTree(outermost).query(truth.mask.to_index(vertices))
    labels: Labels = truth.labels.data[tuple(outermost[nearest].T)]
    return labels


def compare(
    found: unwrap3d.Protrusions | Any, mask: unwrap3d.Mask, surface: Any, truth: Any
) -> Comparison:
    """A segmentation of `mask` and `surface` against the truth of the cell.

    `found` has ``labels``, ``height_um``, ``volume`` and ``cortex`` (arrays).
    """
    weight = vertex_mass(surface.vertices, surface.faces)
    true = on_vertices(truth, surface.vertices)
    labels = np.asarray(found.labels)
    both = weight[(labels > 0) & (true > 0)].sum()
    either = weight[(labels > 0) | (true > 0)].sum()
    count, true_count = int(labels.max(initial=0)), len(truth.kinds)
    pairs = matches(labels, true, weight, count, true_count)
    f1 = 2 * len(pairs) / (count + true_count) if count + true_count else 1.0
    errors = _errors(found, mask, truth, true, weight, pairs)
    cortex, under = _cortex_distances(found.cortex, mask, truth)
    iou = float(both / either) if either else 1.0
    return Comparison(iou, f1, count, true_count, *errors, cortex, under)


def matches(
    labels: Labels, true: Labels, weight: Floats, count: int, true_count: int
) -> list[tuple[int, int]]:
    """Pairs of a found and a true label, one to one, with an IoU of at least ½."""
    key = labels.astype(np.int64) * (true_count + 1) + true
    size = (count + 1) * (true_count + 1)
    shared = np.bincount(key, weight, size).reshape(count + 1, true_count + 1)
    union = shared.sum(axis=1)[:, None] + shared.sum(axis=0) - shared
    overlap = (shared / np.maximum(union, 1e-12))[1:, 1:]
    rows, columns = linear_sum_assignment(-overlap)
    kept = overlap[rows, columns] >= MATCH
    return [(int(a) + 1, int(b) + 1) for a, b in zip(rows[kept], columns[kept], strict=True)]


def _errors(
    found: Any,
    mask: unwrap3d.Mask,
    truth: Any,
    true: Labels,
    weight: Floats,
    pairs: list[tuple[int, int]],
) -> tuple[Floats, Floats, Floats, Floats]:
    """Relative errors of volume, area and height, and of the volume that the mask has."""
    voxel = float(np.prod(mask.voxel_size) / np.prod(truth.mask.voxel_size))
    volumes = np.bincount(np.asarray(found.volume).ravel()) * voxel
    true_volumes = np.bincount(truth.labels.data.ravel(), minlength=len(truth.kinds) + 1)
    carried = np.bincount(_carried(mask, truth), minlength=len(true_volumes)) * voxel
    volume, area, height, imaging = [], [], [], []
    for one, other in pairs:
        mine = found.labels == one
        volume.append(volumes[one] / true_volumes[other] - 1)
        imaging.append(carried[other] / true_volumes[other] - 1)
        area.append(weight[mine].sum() / weight[true == other].sum() - 1)
        height.append(found.height_um[mine].max() / truth.heights_um[other - 1] - 1)
    return np.array(volume), np.array(area), np.array(height), np.array(imaging)


def _carried(mask: unwrap3d.Mask, truth: Any) -> Labels:
    """For every voxel of the mask the true label of the nearest voxel of the true cell."""
    inside = np.argwhere(mask.data)
    index = np.rint(truth.mask.to_index(mask.to_world(inside))).astype(np.int64)
    index = np.clip(index, 0, np.array(truth.mask.shape) - 1)
    nearest = ndimage.distance_transform_edt(
        ~truth.mask.data, return_distances=False, return_indices=True
    )
    place = tuple(axis[tuple(index.T)] for axis in nearest)
    labels: Labels = truth.labels.data[place]
    return labels


def _cortex_distances(cortex: Solid, mask: unwrap3d.Mask, truth: Any) -> tuple[float, float]:
    """Mean distances in voxels between the surfaces of the cortex and of the true body."""
    body = np.asarray(truth.body.data)
    outermost = mask.to_world(shell(np.asarray(cortex)))
    # An outermost voxel's centre is half a voxel within.
    away = sample_linear(signed_distance(body), truth.body.to_index(outermost)) + 0.5
    protruding = ndimage.binary_dilation(truth.labels.data > 0, np.ones((3, 3, 3)))
    footing = body & ~ndimage.binary_erosion(body) & protruding
    if not footing.any():
        return float(np.abs(away).mean()), 0.0
    places = mask.to_index(truth.body.to_world(np.argwhere(footing)))
    below = sample_linear(signed_distance(np.asarray(cortex)), places) + 0.5
    return float(np.abs(away).mean()), float(np.abs(below).mean())
