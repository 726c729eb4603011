"""Which part of a stack is looked at: the timepoint, the channel, and a crop."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..charts import Mask, Size3, Stack
from ..errors import ParameterError
from ..parameters import StackParameters
from .scan import Box

# The fewest voxels along an axis that are still a volume.
THINNEST = 2


def channel_index(stack: Stack, channel: int | str) -> int:
    """The number of a channel given by its number or its name.

    Raises
    ------
    ParameterError
        There is no such channel.
    """
    count = stack.shape[stack.axes.index("c")] if "c" in stack.axes else 1
    if channel in stack.channels:
        return stack.channels.index(str(channel))
    text = str(channel)
    if not text.isdecimal() or int(text) >= count:
        named = f" or by name: {', '.join(stack.channels)}" if stack.channels else ""
        raise ParameterError(
            f"There is no channel {channel}.",
            channels=count,
            hint=f"Channels are counted from 0 to {count - 1}{named}.",
        )
    return int(text)


def chosen_volume(stack: Stack, timepoint: int, channel: int | str) -> Any:
    """The volume of a timepoint and a channel, still lazy.

    Raises
    ------
    ParameterError
        There is no such timepoint or channel.
    """
    if timepoint >= stack.timepoints:
        raise ParameterError(
            f"There is no timepoint {timepoint}.",
            timepoints=stack.timepoints,
            hint=f"Timepoints are counted from 0 to {stack.timepoints - 1}.",
        )
    return stack.volume(timepoint, channel_index(stack, channel))


def crop_box(
    shape: tuple[int, ...],
    voxel_size: Size3,
    parameters: StackParameters,
    origin: Size3 = (0.0, 0.0, 0.0),
) -> Box | None:
    """The voxels of a volume that are used, or None for all of them.

    Parameters
    ----------
    shape : (int, int, int)
    voxel_size : (float, float, float)
        (z, y, x) in µm.
    parameters : StackParameters
        `crop_voxels`, which must lie inside the volume, or `crop_um`, which may reach beyond.
    origin : (float, float, float)
        Centre (z, y, x) in µm of voxel (0, 0, 0).

    Raises
    ------
    ParameterError
        Both are given, or one does not hold two voxels of the volume along every axis.
    """
    voxels, lengths = parameters.crop_voxels, parameters.crop_um
    if voxels is None and lengths is None:
        return None
    if voxels is not None and lengths is not None:
        raise ParameterError(
            "The crop is given twice.",
            crop_voxels=voxels,
            crop_um=lengths,
            hint="Give crop_voxels or crop_um.",
        )
    if voxels is not None:
        ends = np.reshape(voxels, (3, 2))
        outside = bool((ends < 0).any() or (ends[:, 1] > np.asarray(shape)).any())
    else:
        world = np.reshape(np.asarray(lengths, dtype=float), (3, 2))
        index = (world - np.reshape(origin, (3, 1))) / np.reshape(voxel_size, (3, 1))
        # A crop that ends on a voxel's centre takes that voxel, whatever the rounding.
        near = np.rint(index)
        index = np.where(np.abs(index - near) < 1e-6, near, index)
        ends = np.stack([np.ceil(index[:, 0]), np.floor(index[:, 1]) + 1], axis=1)
        ends = np.clip(ends, 0, np.reshape(shape, (3, 1))).astype(np.int64)
        outside = False
    if outside or (ends[:, 1] - ends[:, 0] < THINNEST).any():
        raise ParameterError(
            "The crop does not hold a part of the volume.",
            crop=str(voxels if voxels is not None else lengths),
            shape=tuple(int(n) for n in shape),
            voxel_size_um=voxel_size,
            hint="Give z start, z stop, y start, y stop, x start, x stop, each stop beyond its "
            "start and inside the volume.",
        )
    z, y, x = (slice(int(start), int(stop)) for start, stop in ends)
    return z, y, x


def cropped_mask(mask: Mask, box: Box) -> Mask:
    """A part of a mask, at its place in the world."""
    return moved(Mask(mask.data[box], mask.voxel_size, mask.origin), box, mask.voxel_size)


def moved(mask: Mask, box: Box, voxel_size: Size3) -> Mask:
    """A mask that was found in a crop, at its place in the world.

    Parameters
    ----------
    mask : Mask
    box : tuple of slice
        The crop, in voxels of this size.
    voxel_size : (float, float, float)
        In µm.
    """
    z, y, x = (
        origin + side.start * size
        for origin, side, size in zip(mask.origin, box, voxel_size, strict=True)
    )
    return Mask(mask.data, mask.voxel_size, (z, y, x))
