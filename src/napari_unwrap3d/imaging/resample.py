"""The one resampling of a stack: from its own voxels to the isotropic working grid.

The working grid's voxel centres lie at whole multiples of the working voxel in world
coordinates, so that they do not depend on which box of the image was read.
"""

from __future__ import annotations

from dataclasses import replace
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
        Where the volume's world lies in that of the working grid.

    Returns
    -------
    Volume
        float32, within the volume's outermost voxel centres.

    Raises
    ------
    ParameterError
        The working grid would have more than 2³⁰ voxels.
    """
    volume = shifted(volume, pose)
    data = np.asarray(volume.data, dtype=np.float32)
    ratio = working_voxel_um / np.asarray(volume.voxel_size)
    # A box of `ratio` voxels has the variance (ratio² − 1) / 12 in excess of a voxel's own.
    sigma = np.sqrt(np.maximum(ratio**2 - 1, 0) / 12)
    if (sigma > 0.1).any():
        data = ndimage.gaussian_filter(data, sigma, mode="nearest")
    starts, positions = _grid(volume, working_voxel_um)
    for axis, where in enumerate(positions):
        data = interpolate_axis(data, where, axis)
    origin = tuple(float(s) for s in starts)
    edge = float(working_voxel_um)
    return Volume(data, (edge, edge, edge), (origin[0], origin[1], origin[2]))


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
    mask = shifted(mask, pose)
    size = np.asarray(mask.voxel_size)
    padded = np.pad(mask.data, 1)
    origin = np.asarray(mask.origin) - size
    around = Volume(padded, mask.voxel_size, (origin[0], origin[1], origin[2]))
    starts, positions = _grid(around, working_voxel_um)
    distance = ndimage.distance_transform_edt(padded, sampling=mask.voxel_size)
    distance -= ndimage.distance_transform_edt(~padded, sampling=mask.voxel_size)
    distance = distance.astype(np.float32)
    for axis, where in enumerate(positions):
        distance = interpolate_axis(distance, where, axis)
    edge = float(working_voxel_um)
    first = tuple(float(s) for s in starts)
    inside = distance > TIE * edge
    # Every other tie belongs to the cell, so that neither its volume nor its place changes.
    undecided = np.flatnonzero(np.abs(distance) <= TIE * edge)
    odd = np.sum(np.unravel_index(undecided, distance.shape), axis=0) % 2 == 1
    inside.ravel()[undecided[odd]] = True
    return Mask(inside, (edge, edge, edge), (first[0], first[1], first[2]))


def shifted(volume: AnyVolume, pose: Rigid | None) -> AnyVolume:
    """The volume at the place where a motion takes it; nothing is interpolated."""
    if pose is None or pose.is_identity:
        return volume
    z, y, x = pose.apply(volume.origin)
    return replace(volume, origin=(float(z), float(y), float(x)))


def _grid(volume: Volume, edge: float) -> tuple[Floats, list[Floats]]:
    """World position of the first voxel, and every voxel's place as indices of `volume`."""
    size, origin = np.asarray(volume.voxel_size), np.asarray(volume.origin)
    last = origin + (np.asarray(volume.shape) - 1) * size
    begin = np.ceil(origin / edge - SAME)
    end = np.maximum(np.floor(last / edge + SAME), begin)
    count = end - begin + 1
    if np.prod(count) > LARGEST_GRID:
        raise ParameterError(
            "The working grid would be too large.",
            voxels=int(np.prod(count)),
            working_voxel_um=float(edge),
            hint="Choose a larger working voxel, or crop the stack around the cell.",
        )
    positions = [
        ((begin[i] + np.arange(int(count[i]))) * edge - origin[i]) / size[i] for i in range(3)
    ]
    return begin * edge, positions


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
