"""Sampling the channels of a stack at the surface of an atlas."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Literal

import numpy as np

from .atlas import Atlas
from .charts import Floats, Stack
from .errors import InputError
from .imaging.roi import channel_index, chosen_volume
from .imaging.signal import (
    InwardField,
    around_cell,
    check_sampling,
    surface_signal,
    whole_cell_mean,
)
from .progress import Progress, silent


def sample_signal(
    stack: Stack,
    atlas: Atlas,
    channel: int | str = 0,
    *,
    depth_um: float = 1.0,
    statistic: Literal["percentile", "mean"] = "percentile",
    percentile: float = 95.0,
    divide_by: int | str | None = None,
    normalize: bool = False,
    progress: Progress | None = None,
) -> Floats:
    """The intensity of a channel just below the surface, for every vertex of it.

    From every vertex a path goes inwards along the gradient of the smoothed distance
    transform of the cell, in µm, and the channel is read along it from its own voxels. A path
    is `depth_um` long; where the cell is thinner than twice that it ends in the middle.
    Paper, Methods, "Cell segmentation and surface meshing": to 1 µm, the 95th percentile for
    Septin, the mean for Tractin and CyOFP1 and then their ratio; normalised by the mean of
    the whole cell, which also corrects bleaching.

    Parameters
    ----------
    stack : Stack
        Axes out of ``tczyx``; any voxel size. Its world is the atlas', i.e. the stack that the
        atlas was made from, or one registered to it. The timepoint is the atlas'
        (``atlas.parameters.stack.timepoint``) where the stack has several. Only the part around
        the cell is read.
    atlas : Atlas
        With its surface and its mask.
    channel : int or str
        Number (from 0) or name.
    depth_um : float
        Length of the paths in µm; 0 reads at the surface itself.
    statistic : "percentile" or "mean"
        What is taken of the intensities along a path.
    percentile : float
        0 to 100, for the statistic "percentile".
    divide_by : int or str, optional
        Another channel: its signal, found in the same way, divides the channel's.
    normalize : bool
        Divide each channel by its mean intensity in the whole cell first.
    progress : Progress, optional

    Returns
    -------
    ndarray, (n,) float64
        One value per vertex of ``atlas.surface``, in the stack's intensities, or as a ratio
        without a unit. NaN where a path leaves the stack, or where the divisor is 0.

    Raises
    ------
    ParameterError
        There is no such channel, timepoint or statistic, or the depth is negative.
    InputError
        The surface lies outside of the stack, or the mean to normalise by is not positive.
    NotFiniteError
        There are NaN or infinite intensities around the cell.
    ChartMissingError
        The atlas has no surface.
    Cancelled
        The user asked to stop.
    """
    report = progress or silent()
    check_sampling(depth_um, statistic, percentile)
    points, mask = atlas.surface.vertices, atlas.mask
    timepoint = atlas.parameters.stack.timepoint if "t" in stack.axes else 0
    wanted = [channel] if divide_by is None else [channel, divide_by]
    volumes = [chosen_volume(stack, timepoint, name) for name in wanted]
    report(0.0, "distance transform")
    field = report.run(InwardField.of, mask)
    signals = []
    for i, volume in enumerate(volumes):
        part = report.part(0.2 + 0.8 * i / len(volumes), 0.2 + 0.8 * (i + 1) / len(volumes))
        image = around_cell(volume, stack.voxel_size, mask, points)
        level = percentile if statistic == "percentile" else None
        signal = surface_signal(image, points, field, depth_um, level, part.part(0.0, 0.8))
        if normalize:
            signal = signal / whole_cell_mean(image, mask, part.part(0.8, 1.0))
        signals.append(signal)
    report(1.0, "signal")
    if divide_by is None:
        return signals[0]
    divisor = np.where(signals[1] == 0, np.nan, signals[1])
    ratio: Floats = signals[0] / divisor
    return ratio


def check_signals(stack: Stack | None, channels: Sequence[str]) -> None:
    """Raise before anything is computed when a channel to sample does not exist.

    Raises
    ------
    InputError
        There is no stack.
    ParameterError
        There is no such channel.
    """
    if stack is None and channels:
        raise InputError(
            "--signal is for stacks, and a mesh has no channels.",
            hint="Leave it out, or sample a stack with sample_signal.",
        )
    for channel in channels:
        assert stack is not None
        channel_index(stack, channel)


def with_signals(atlas: Atlas, stack: Stack, channels: Sequence[str], progress: Progress) -> Atlas:
    """The atlas with the signal of these channels as fields of its surface."""
    fields = {}
    for i, channel in enumerate(channels):
        part = progress.part(i / len(channels), (i + 1) / len(channels))
        # Names of fields in PLY files are words.
        name = re.sub(r"\W+", "_", channel)
        fields[f"signal_{name}"] = sample_signal(stack, atlas, channel, progress=part)
    return atlas.replaced(surface=atlas.surface.with_fields(**fields))
