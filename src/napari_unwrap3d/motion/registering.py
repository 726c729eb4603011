"""What of a timepoint is registered: its image, its mask, or the voxels within its mesh."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ..charts import Mask, Stack, Volume
from ..geometry.rigid import Rigid
from ..imaging.register import Registered, register, register_channel
from ..imaging.roi import channel_index, chosen_volume, crop_box, cropped_mask
from ..imaging.scan import slabs
from ..parameters import Parameters, RegistrationParameters, StackParameters
from ..progress import Progress
from .outlines import outline
from .timelapse import Source, at_timepoint

# Of the parameters of the stack, those that say what is looked at.
SEEN_BY_REGISTRATION = {"channel", "label", "crop_voxels", "crop_um", "working_voxel_um"}
STILL = {
    "shift_um": [0.0, 0.0, 0.0],
    "angle_deg": 0.0,
    "residual_before": 0.0,
    "residual": 0.0,
    "corresponding": 1.0,
}


def unmoved(parameters: RegistrationParameters) -> Registered:
    """The timepoint onto which all others are moved; and all of them without registration."""
    return Registered(numbers={} if parameters.method == "none" else STILL)


def register_timepoint(
    first: Source, this: Source, parameters: Parameters, progress: Progress
) -> Registered:
    """Where a timepoint lies in the world of the first one.

    Stacks are registered by the intensities of the channel that shows the outline, or by the
    label that is taken; masks as they are; meshes through the voxels that they enclose.

    Raises
    ------
    Unwrap3DError
        As :func:`~napari_unwrap3d.imaging.register.register` and, of a mesh, :func:`outline`.
    """
    fixed, moving = (_seen(source, parameters, progress.part(0.0, 0.1)) for source in (first, this))
    chosen = parameters.registration
    pose, numbers = register(fixed, moving, chosen, progress.part(0.1, 1.0))
    return Registered(pose, {}, numbers)


def register_channels(
    stack: Stack, registered: Registered, parameters: Parameters, progress: Progress
) -> Registered:
    """The same timepoint, with every other channel moved onto the one that shows the outline.

    Raises
    ------
    Unwrap3DError
        As :func:`~napari_unwrap3d.imaging.register.register_channel`.
    """
    chosen = parameters.stack
    count = stack.shape[0] if "c" in stack.axes else 1
    shown = channel_index(stack, chosen.channel)
    others = [c for c in range(count) if c != shown]
    poses: dict[int, Rigid] = {}
    found: dict[str, Any] = {}
    outlines = _channel(stack, shown, chosen)
    for i, channel in enumerate(others):
        part = progress.part(i / len(others), (i + 1) / len(others))
        other = _channel(stack, channel, chosen)
        pose, numbers = register_channel(outlines, other, parameters.registration, part)
        poses[channel], found[str(channel)] = pose, numbers
    return replace(registered, channels=poses, numbers={**registered.numbers, "channels": found})


def _seen(source: Source, parameters: Parameters, progress: Progress) -> Volume:
    """The part of a timepoint's source by which it is registered; a stack stays lazy."""
    chosen = parameters.stack
    if isinstance(source, Mask):
        crop = crop_box(source.shape, source.voxel_size, chosen, source.origin)
        return _floating(source if crop is None else cropped_mask(source, crop))
    if not isinstance(source, Stack):
        return _floating(outline(source, Rigid(), parameters, progress)[0])
    volume = _channel(source, chosen.channel, chosen)
    if chosen.label is None:
        return volume
    found = np.concatenate([slab == chosen.label for _, slab in slabs(volume.data)])
    return _floating(Volume(found, volume.voxel_size, volume.origin))


def _channel(stack: Stack, channel: int | str, chosen: StackParameters) -> Volume:
    """A channel of one timepoint within the crop, lazy."""
    chosen = at_timepoint(chosen)
    data = chosen_volume(stack, chosen.timepoint, channel)
    crop = crop_box(data.shape, stack.voxel_size, chosen)
    if crop is None:
        return Volume(data, stack.voxel_size)
    z, y, x = (side.start * size for side, size in zip(crop, stack.voxel_size, strict=True))
    return Volume(data[crop], stack.voxel_size, (z, y, x))


def _floating(volume: Volume) -> Volume:
    return Volume(volume.data.astype(np.float32), volume.voxel_size, volume.origin)
