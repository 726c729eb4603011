"""The one resampling of a stack: from its own voxels to the isotropic working grid.

The working grid's voxel centres lie at whole multiples of the working voxel in world
coordinates, so that they do not depend on which box of the image was read.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ..charts import Floats, Mask, Size3, Volume
from ..errors import ParameterError
from ..geometry.rigid import Rigid

# Positions and sizes that agree to this fraction of a voxel are the same.
SAME = 1e-6
# Half-way between two slices the distance is often 0, up to this part of a voxel.
TIE = 1e-4
LARGEST_GRID = 1 << 30

AnyVolume = TypeVar("AnyVolume", bound=Volume)


def is_isotropic(voxel_size: Size3, edge: float) -> bool:
    """True when the voxel is a cube of this edge."""
    return bool(np.allclose(voxel_size, edge, rtol=SAME, atol=0.0))


def to_working_grid(volume: Volume, working_voxel_um: float, pose: Rigid | None = None) -> Volume:
    """Resample intensities linearly to isotropic voxels.

    Where the working voxel is larger than the volume's, the volume is smoothed first so
    that the coarser grid does not alias.

    Parameters
    ----------
    volume : Volume
        Any voxel size. Nothing is computed along axes that fit already.
    working_voxel_um : float
        Edge of the isotropic voxel in µm.
    pose : Rigid, optional
        Where the volume's world lies in that of the working grid. Where it rotates, a trilinear
        interpolation takes every new voxel straight from the volume's own.

    Returns
    -------
    Volume
        float32, within the volume's outermost voxel centres. Where the volume was rotated, the
        box around it; voxels that :func:`covered` does not have repeat the nearest ones.

    Raises
    ------
    ParameterError
        The working grid would have more than 2³⁰ voxels.
    """
    data = np.asarray(volume.data, dtype=np.float32)
    ratio = working_voxel_um / np.asarray(volume.voxel_size)
    # A box of `ratio` voxels has the variance (ratio² − 1) / 12 in excess of a voxel's own.
    sigma = np.sqrt(np.maximum(ratio**2 - 1, 0) / 12)
    if (sigma > 0.1).any():
        data = ndimage.gaussian_filter(data, sigma, mode="nearest")
    return _interpolated(replace(volume, data=data), working_voxel_um, pose)


def covered(working: Volume, volume: Volume, pose: Rigid) -> npt.NDArray[np.bool_]:
    """Which voxels of a working grid lie among the centres of a volume that was moved there."""
    inside = np.ones(working.shape, bool)
    for axis, length in enumerate(volume.shape):
        place = own_index(working, volume, pose, axis)
        inside &= (place > -SAME) & (place < length - 1 + SAME)
    return inside


def own_index(working: Volume, volume: Volume, pose: Rigid, axis: int) -> npt.NDArray[np.float64]:
    """Where the voxels (z, y, x) of a working grid come from: indices of a volume, on one axis."""
    matrix, offset = _to_index(volume, working.origin, working.voxel_size[0], pose)
    z, y, x = (np.arange(n) * matrix[axis, i] for i, n in enumerate(working.shape))
    place: npt.NDArray[np.float64] = z[:, None, None] + y[:, None] + (x + offset[axis])
    return place


def mask_to_working_grid(mask: Mask, working_voxel_um: float, pose: Rigid | None = None) -> Mask:
    """Resample a mask to isotropic voxels through its signed distance in µm.

    Interpolating zeros and ones linearly would put every boundary half-way between two
    slices, so that anisotropic stacks come out as terraces. The signed distance varies
    smoothly between the slices, and so does its zero (shape-based interpolation, Raya
    and Udupa 1990, doi:10.1109/42.52980).

    Parameters
    ----------
    mask : Mask
        Returned as it is where its voxels fit already.
    working_voxel_um : float
        Edge of the isotropic voxel in µm.
    pose : Rigid, optional
        Where the mask's world lies in that of the working grid.

    Returns
    -------
    Mask
        With one empty voxel of the given mask around it, so that it closes at the border.

    Raises
    ------
    ParameterError
        The working grid would have more than 2³⁰ voxels.
    """
    unmoved = pose is None or pose.is_identity
    if is_isotropic(mask.voxel_size, working_voxel_um) and unmoved:
        return mask
    size = np.asarray(mask.voxel_size)
    padded = np.pad(mask.data, 1)
    first = tuple(float(o) for o in np.asarray(mask.origin) - size)
    inwards = ndimage.distance_transform_edt(padded, sampling=mask.voxel_size)
    inwards -= ndimage.distance_transform_edt(~padded, sampling=mask.voxel_size)
    distance = Volume(inwards.astype(np.float32), mask.voxel_size, (first[0], first[1], first[2]))
    found = _interpolated(distance, working_voxel_um, pose)
    near = TIE * working_voxel_um
    inside = found.data > near
    # Every other tie belongs to the cell, so that neither its volume nor its place changes.
    undecided = np.flatnonzero(np.abs(found.data) <= near)
    odd = np.sum(np.unravel_index(undecided, found.shape), axis=0) % 2 == 1
    inside.ravel()[undecided[odd]] = True
    return Mask(inside, found.voxel_size, found.origin)


def shifted(volume: AnyVolume, pose: Rigid | None) -> AnyVolume:
    """The volume at the place where a motion takes it; nothing is interpolated."""
    if pose is None or pose.is_identity:
        return volume
    z, y, x = pose.apply(volume.origin)
    return replace(volume, origin=(float(z), float(y), float(x)))


def _interpolated(volume: Volume, edge: float, pose: Rigid | None) -> Volume:
    """Linear interpolation, once, from a volume's voxels to the grid where a pose puts it."""
    if pose is not None and pose.turns:
        return _turned(volume, edge, pose)
    volume = shifted(volume, pose)
    size, origin = np.asarray(volume.voxel_size), np.asarray(volume.origin)
    begin, count = _nodes(origin, origin + (np.asarray(volume.shape) - 1) * size, edge)
    data = volume.data
    for axis in range(3):
        places = ((begin[axis] + np.arange(count[axis])) * edge - origin[axis]) / size[axis]
        data = interpolate_axis(data, places, axis)
    return _placed(data, begin * edge, edge)


def _turned(volume: Volume, edge: float, pose: Rigid) -> Volume:
    """Trilinear interpolation to the box around the rotated volume."""
    last = np.asarray(volume.shape) - 1
    corners = pose.apply(volume.to_world([*product(*((0, n) for n in last))]))
    begin, count = _nodes(corners.min(axis=0), corners.max(axis=0), edge)
    matrix, offset = _to_index(volume, begin * edge, edge, pose)
    data = ndimage.affine_transform(
        volume.data, matrix, offset, tuple(count.tolist()), order=1, mode="nearest"
    )
    return _placed(data, begin * edge, edge)


def _to_index(
    volume: Volume, origin: npt.ArrayLike, edge: float, pose: Rigid
) -> tuple[Floats, Floats]:
    """The affine map from a grid's indices to those of a volume that a pose moves there."""
    back, size = pose.inverse(), np.asarray(volume.voxel_size)
    offset = (back.apply(origin) - np.asarray(volume.origin)) / size
    return back.rotation * edge / size[:, None], offset


def _nodes(low: Floats, high: Floats, edge: float) -> tuple[Floats, npt.NDArray[np.int64]]:
    """First multiple of the edge between two corners in µm, and the number of them, per axis."""
    begin = np.ceil(low / edge - SAME)
    end = np.maximum(np.floor(high / edge + SAME), begin)
    count = end - begin + 1
    if np.prod(count) > LARGEST_GRID:
        raise ParameterError(
            "The working grid would be too large.",
            voxels=int(np.prod(count)),
            working_voxel_um=float(edge),
            hint="Choose a larger working voxel, or crop the stack around the cell.",
        )
    return begin, count.astype(np.int64)


def _placed(data: npt.NDArray[np.float32], first: Floats, edge: float) -> Volume:
    z, y, x = (float(f) for f in first)
    return Volume(data, (float(edge),) * 3, (z, y, x))


def interpolate_axis(
    data: npt.NDArray[np.float32], positions: Floats, axis: int
) -> npt.NDArray[np.float32]:
    """Linear interpolation along one axis at fractional indices, which are clamped."""
    n = data.shape[axis]
    places = np.clip(positions, 0, n - 1)
    nearest = np.rint(places)
    if np.abs(places - nearest).max() < SAME:
        index = nearest.astype(np.int64)
        return data if np.array_equal(index, np.arange(n)) else np.take(data, index, axis)
    low = np.minimum(np.floor(places).astype(np.int64), max(n - 2, 0))
    shape = [1, 1, 1]
    shape[axis] = len(places)
    weight = (places - low).astype(np.float32).reshape(shape)
    result = np.take(data, low, axis)
    result += weight * (np.take(data, np.minimum(low + 1, n - 1), axis) - result)
    return result
