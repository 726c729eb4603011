"""Registration: the rigid motion of every timepoint onto the first, and between channels."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Volume
from ..errors import EmptyMaskError
from ..geometry.distance import signed_distance
from ..geometry.rigid import Rigid
from ..geometry.rigid_fit import Fit, Samples, fit_motion, sampled
from ..geometry.sharp_fit import SharpPair, refined_motion
from ..geometry.topology import fill_cavities, largest_part
from ..parameters import RegistrationParameters
from ..progress import Progress
from .isotropic import PER_BLUR, blur_of, common_blur_um, isotropic
from .itk import best_motion
from .scan import box_of, scan

logger = logging.getLogger(__name__)

Bools = npt.NDArray[np.bool_]

# The coarse copies, on which the cell is looked for, have at most this many voxels.
COARSE_VOXELS = 48**3
# The volumes that are compared have at most this many.
FINE_VOXELS = 1 << 23
POINTS = 60_000
# Around the cell's outline so far outwards and inwards, in σ of the blur.
OUTWARDS, INWARDS = 2.5, 8.0
# The moving cell is looked for in a box larger by this part of the fixed cell's, which has
# turned or changed.
ROOM = 0.15
# σ of the blur of the sharp volumes, and of their smooth copy, in their finest voxels.
SHARP, SMOOTH = 1.4, 3.1
# Whether places correspond is decided anew so often, with the motion found before.
PASSES = 2
# Above, it is doubtful that the two show the same cell.
DOUBTFUL = 0.5


@dataclass(frozen=True, eq=False)
class Registered:
    """Where one timepoint lies in the common world.

    Attributes
    ----------
    pose : Rigid
        From the world of the channel that shows the outline to the common one.
    channels : mapping of int to Rigid
        From the world of another channel to that channel's; absent: the same world.
    numbers : mapping
        See :func:`register`; ``channels`` holds the same of every other channel, by its number.
        JSON-able.
    """

    pose: Rigid = field(default_factory=Rigid)
    channels: Mapping[int, Rigid] = field(default_factory=dict)
    numbers: Mapping[str, Any] = field(default_factory=dict)

    def of_channel(self, channel: int) -> Rigid:
        """From the world of a channel to the common one; the intensities move once."""
        other = self.channels.get(channel)
        return self.pose if other is None else self.pose @ other

    def with_channels_of(self, other: Registered) -> Registered:
        """The same, with the channels where they lie at another timepoint."""
        found = other.numbers.get("channels", {})
        return Registered(self.pose, other.channels, {**self.numbers, "channels": found})

    def to_plain(self) -> dict[str, Any]:
        """As JSON holds it."""
        return {
            "pose": self.pose.to_list(),
            "channels": {str(c): pose.to_list() for c, pose in self.channels.items()},
            "numbers": dict(self.numbers),
        }

    @classmethod
    def from_plain(cls, values: Mapping[str, Any]) -> Registered:
        """Undo :meth:`to_plain`."""
        return cls(
            Rigid.from_list(values["pose"]),
            {int(c): Rigid.from_list(pose) for c, pose in values["channels"].items()},
            dict(values["numbers"]),
        )


def register(
    fixed: Volume, moving: Volume, parameters: RegistrationParameters, progress: Progress
) -> tuple[Rigid, dict[str, Any]]:
    """The motion that brings one timepoint of a cell onto another, and what was measured.

    In passes, each of which starts from the one before: the shift between coarse copies
    (cross-correlation by FFT, scikit-image); the whole cell by the correlation of intensities
    (SimpleITK, two levels); a robust fit of equally blurred volumes, from which places that do
    not correspond drop out (:mod:`~napari_unwrap3d.geometry.rigid_fit`); and, of images, a fit of
    the sharp ones where they correspond (:mod:`~napari_unwrap3d.geometry.sharp_fit`). What comes
    and goes on a cell, as blebs do, pulls the second pass off by a voxel and a degree; the third
    finds the body, and the last averages the noise.

    Parameters
    ----------
    fixed, moving : Volume
        Intensities, or a mask, of any voxel size, each in its own world; may be lazy.
    parameters : RegistrationParameters
    progress : Progress

    Returns
    -------
    Rigid
        From the world of `moving` to that of `fixed`.
    dict
        ``shift_um``: from where the cell's middle is in `fixed` to where it is in `moving`,
        (z, y, x); ``angle_deg``: by how much the cell has turned; ``residual_before`` and
        ``residual``: 1 − correlation of the intensities, at the points of and around the cell
        that correspond, before and after; ``corresponding``: the part of all points that do;
        ``blur_um``: σ at which they were compared.

    Raises
    ------
    EmptyMaskError
        There is nothing but background in one of them.
    NotFiniteError
        There are NaN or infinite intensities.
    """
    rotate = parameters.method == "rigid"
    pair = _Pair.of(fixed, moving, parameters, progress.part(0.0, 0.4))
    around = pair.start
    progress(0.4, "the whole cell")
    part = progress.part(0.4, 0.6)
    found = best_motion(
        pair.fixed, pair.moving, pair.region, around, "correlation", part, rotate=rotate
    )
    progress(0.6, "the parts that do not change")
    samples = pair.samples()
    edge, origin = pair.moving.voxel_size[0], pair.moving.origin
    fit = progress.run(fit_motion, samples, pair.moving.data, origin, edge, found, rotate=rotate)
    progress(0.8, "fine structure")
    # Between the steps of a mask there is no fine structure.
    pose = fit.pose if pair.masks else progress.run(pair.refined, fit, rotate=rotate)
    found_there, inside = sampled(pair.moving.data, origin, edge, samples.points, fit.pose)
    kept = (fit.weights(samples.values, found_there, samples.points) > 0) & inside
    points, values = samples.points[kept], samples.values[kept]
    before, after = (
        _residual(values, *sampled(pair.moving.data, origin, edge, points, each))
        for each in (Rigid(), pose)
    )
    if after > DOUBTFUL:
        logger.warning("the cell of two timepoints correlates by %.2f only", 1 - after)
    numbers = {
        **_motion_numbers(pose, pair.centre),
        "residual_before": before,
        "residual": after,
        "corresponding": float(kept.mean()),
        "blur_um": pair.blur_um,
    }
    return pose, numbers


def register_channel(
    outline: Volume, other: Volume, parameters: RegistrationParameters, progress: Progress
) -> tuple[Rigid, dict[str, Any]]:
    """The motion that brings another channel onto the one that shows the outline.

    By mutual information, as what is bright in one may be dark in the other (SimpleITK).

    Parameters
    ----------
    outline, other : Volume
        Of one timepoint, in one world.
    parameters : RegistrationParameters
        The channel is rotated, too, where `method` is "rigid".
    progress : Progress

    Returns
    -------
    Rigid
        From where the other channel is to where it belongs.
    dict
        ``shift_um`` and ``angle_deg``, as of :func:`register`.

    Raises
    ------
    EmptyMaskError, NotFiniteError
        As :func:`register`.
    """
    rotate = parameters.method == "rigid"
    pair = _Pair.of(outline, other, parameters, progress.part(0.0, 0.4), apart=False)
    progress(0.4, "channels")
    part = progress.part(0.4, 1.0)
    pose = best_motion(
        pair.fixed, pair.moving, pair.region, Rigid(), "mutual information", part, rotate=rotate
    )
    return pose, _motion_numbers(pose, pair.centre)


def _motion_numbers(pose: Rigid, centre: Floats) -> dict[str, Any]:
    """Where the cell has gone; the pose brings it back."""
    shift = pose.inverse().apply(centre) - centre
    return {"shift_um": [float(s) for s in shift], "angle_deg": pose.angle_deg}


def _residual(values: Floats, found: Floats, inside: Bools) -> float:
    """1 − correlation at the points that are inside."""
    if inside.sum() < 2:
        return 1.0
    one, other = (part[inside] - part[inside].mean() for part in (values, found))
    size = float(np.sqrt((one @ one) * (other @ other)))
    return 1.0 - float(one @ other) / size if size > 0 else 1.0


# The two volumes made alike ------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Pair:
    """Two volumes around a cell on cubic voxels, equally blurred along all axes.

    `recorded` are both as they were, `region` are the voxels of `fixed` in and around the cell,
    `centre` is its middle, and `start` a shift from the moving volume to the fixed one that is
    right within a few voxels.
    """

    fixed: Volume
    moving: Volume
    recorded: tuple[Volume, Volume]
    region: Bools
    centre: Floats
    start: Rigid
    blur_um: float
    masks: bool

    @classmethod
    def of(
        cls,
        fixed: Volume,
        moving: Volume,
        parameters: RegistrationParameters,
        progress: Progress,
        *,
        apart: bool = True,
    ) -> _Pair:
        """Find the cell, and read and resample what is around it.

        What is `apart` may have drifted and turned. Else it is two channels at one place, which
        the microscope blurs alike: they stay as sharp as they are, as blur shifts the outline of
        what is unevenly bright.
        """
        finest = min(*fixed.voxel_size, *moving.voxel_size)
        common = common_blur_um(fixed.voxel_size, moving.voxel_size) if apart else finest
        blur = parameters.blur_um or common
        halves = progress.part(0.0, 0.3), progress.part(0.3, 0.6)
        found = [_coarse(each, half) for each, half in zip((fixed, moving), halves, strict=True)]
        coarse = [volume for volume, _ in found]
        low, high = _cell_bounds(coarse[0])
        shift = np.zeros(3)
        if apart:
            progress(0.6, "the shift at large")
            shift = progress.run(_shift_at_large, *coarse)
        margin = (OUTWARDS + 1) * blur
        edge = max(
            blur / PER_BLUR,
            finest,
            float((np.prod(high - low + 2 * margin) / FINE_VOXELS) ** (1 / 3)),
        )
        room = margin + ROOM * float((high - low).max())
        progress(0.7, "reading the cell")
        fixed_part = _part(fixed, low - margin, high + margin)
        moving_part = _part(moving, low + shift - room, high + shift + room)
        progress(0.8, "equal resolution")
        blur = max(blur, edge)
        fine = progress.run(isotropic, fixed_part, blur, edge)
        other = progress.run(isotropic, moving_part, blur, edge)
        region, centre = progress.run(_region, fine, blur)
        parts = fixed_part, moving_part
        masks = any(two_values for _, two_values in found)
        start = Rigid(np.eye(3), -shift)
        return cls(fine, other, parts, region, centre, start, blur, masks)

    def refined(self, fit: Fit, *, rotate: bool) -> Rigid:
        """The motion from what both volumes show where they correspond, at their full sharpness."""
        edge = self.fixed.voxel_size[0]
        finest = min(min(volume.voxel_size) for volume in self.recorded)
        sharp, smooth = (max(edge, factor * finest) for factor in (SHARP, SMOOTH))
        fixed, moving = (isotropic(volume, sharp, edge) for volume in self.recorded)
        pair = SharpPair(
            fixed.data,
            moving.data,
            isotropic(self.recorded[0], smooth, edge).data,
            np.asarray(fixed.origin),
            np.asarray(moving.origin),
            edge,
            blur_of(self.recorded[0].voxel_size, sharp),
        )
        points = self.fixed.to_world(np.argwhere(self.region))
        values = self.fixed.data[self.region].astype(np.float64)
        weights = np.zeros(self.fixed.shape, np.float32)
        pose = fit.pose
        for _ in range(PASSES):
            found, inside = sampled(self.moving.data, self.moving.origin, edge, points, pose)
            weights[self.region] = np.where(inside, fit.weights(values, found, points), 0.0)
            pose = refined_motion(pair, weights, pose, rotate=rotate)
        return pose

    def samples(self) -> Samples:
        """The fixed volume and its gradient at points of the region, evenly spread."""
        index = np.argwhere(self.region)
        index = index[:: max(len(index) // POINTS, 1)]
        z, y, x = index.T
        edge = self.fixed.voxel_size[0]
        slopes = [slope[z, y, x] / edge for slope in np.gradient(self.fixed.data)]
        return Samples(
            self.fixed.to_world(index),
            self.fixed.data[z, y, x].astype(np.float64),
            np.stack(slopes, axis=1).astype(np.float64),
        )


def _coarse(volume: Volume, progress: Progress) -> tuple[Volume, bool]:
    """Means over blocks, on cubic voxels; and whether the volume is a mask."""
    found = scan(volume.data, volume.voxel_size, progress)
    if not found.highest > found.lowest:
        raise EmptyMaskError(
            "The image has one intensity everywhere, so there is no cell to register.",
            intensity=found.lowest,
            hint="Choose another channel (stack.channel), or registration.method = none.",
        )
    factors = np.asarray(found.factors)
    z, y, x = (float(s) for s in factors * np.asarray(volume.voxel_size))
    first = volume.to_world((factors - 1)[None] / 2)[0]
    blocks = Volume(found.coarse, (z, y, x), (first[0], first[1], first[2]))
    edge = float((np.prod(np.asarray(blocks.shape) * (z, y, x)) / COARSE_VOXELS) ** (1 / 3))
    edge = max(edge, z, y, x)
    coarse = isotropic(blocks, max(edge, common_blur_um(blocks.voxel_size)), edge)
    return coarse, found.two_values


def _cell_bounds(coarse: Volume) -> tuple[Floats, Floats]:
    """Lowest and highest (z, y, x) in µm of the largest bright thing."""
    box = box_of(_cell(coarse.data))
    ends = np.array([[side.start - 1, side.stop] for side in box], float)
    low, high = coarse.to_world(ends.T)
    return low, high


def _cell(data: npt.NDArray[np.float32]) -> Bools:
    """The largest bright thing, without its cavities."""
    from skimage.filters import threshold_otsu

    return fill_cavities(largest_part(data > threshold_otsu(data)))


def _shift_at_large(fixed: Volume, moving: Volume) -> Floats:
    """How far (z, y, x) in µm the cell has gone from one coarse copy to another."""
    from skimage.registration import phase_cross_correlation

    edge = max(fixed.voxel_size[0], moving.voxel_size[0])
    images = []
    for volume in (fixed, moving):
        if volume.voxel_size[0] < edge:
            volume = isotropic(volume, volume.voxel_size[0], edge)
        data = volume.data - np.median(volume.data)
        images.append(np.maximum(data, 0))
    # Empty all around, so that what leaves on one side does not come in on the other.
    shape = np.array([image.shape for image in images]).sum(axis=0)
    padded = [
        np.pad(image, [(0, int(n) - m) for n, m in zip(shape, image.shape, strict=True)])
        for image in images
    ]
    back, _, _ = phase_cross_correlation(padded[0], padded[1], normalization=None)
    gone: Floats = np.asarray(moving.origin) - np.asarray(fixed.origin) - back * edge
    return gone


def _part(volume: Volume, low: Floats, high: Floats) -> Volume:
    """The voxels between two corners in µm, in memory, at their place in the world."""
    first, last = volume.to_index(np.stack([low, high]))
    shape = np.asarray(volume.shape)
    start = np.clip(np.floor(first).astype(int), 0, np.maximum(shape - 2, 0))
    stop = np.clip(np.ceil(last).astype(int) + 1, start + 2, shape)
    z, y, x = (slice(int(a), int(b)) for a, b in zip(start, stop, strict=True))
    data = np.asarray(volume.data[z, y, x])
    origin = volume.to_world(start[None])[0]
    return Volume(data, volume.voxel_size, (origin[0], origin[1], origin[2]))


def _region(volume: Volume, blur_um: float) -> tuple[Bools, Floats]:
    """The voxels in and around the cell's outline, and the middle of the cell in µm."""
    cell = _cell(volume.data)
    distance = signed_distance(cell) * volume.voxel_size[0]
    region: Bools = (distance < OUTWARDS * blur_um) & (distance > -INWARDS * blur_um)
    return region, volume.to_world(np.argwhere(cell).mean(axis=0)[None])[0]
