"""The signal under a surface: intensities along paths that go straight inwards.

Paper, Methods, "Cell segmentation and surface meshing" (blebs and ruffles): from every
vertex a trajectory follows the steepest gradient of the distance transform to an absolute
depth of 1 µm; the vertex gets the 95th percentile, or the mean, of the intensity along it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ..charts import Floats, Mask, Size3, Volume
from ..errors import InputError, NotFiniteError, ParameterError
from ..geometry.distance import signed_distance
from ..geometry.interpolate import sample_linear
from ..geometry.rigid import Rigid
from ..progress import Progress
from .scan import read_box

# Gaussian σ of the signed distance that is descended, in voxels of the mask.
DISTANCE_SMOOTHING = 1.5
# A path ends where the depth grows by less than this per length: it has reached the middle.
LEAST_SLOPE = 0.25
FEWEST_STEPS = 10
STEPS_PER_VOXEL = 2
CHUNK = 20_000


@dataclass(frozen=True)
class InwardField:
    """The smoothed depth below the surface of a mask, and its gradient.

    Attributes
    ----------
    mask : Mask
        Cubic voxels.
    depth : ndarray, (z, y, x) float32
        In voxels, positive inside.
    gradient : tuple of ndarray, (z, y, x) float32
        Of `depth`, along z, y and x.
    """

    mask: Mask
    depth: npt.NDArray[np.float32]
    gradient: tuple[npt.NDArray[np.float32], ...]

    @classmethod
    def of(cls, mask: Mask) -> InwardField:
        """From the signed distance of a mask."""
        depth = -ndimage.gaussian_filter(signed_distance(mask.data), DISTANCE_SMOOTHING)
        return cls(mask, depth, tuple(np.gradient(depth)))

    def depth_at(self, points: Floats) -> Floats:
        """Depth in µm at points (n, 3) in µm."""
        found = sample_linear(self.depth, self.mask.to_index(points)).astype(np.float64)
        return found * self.mask.voxel_size[0]

    def inwards(self, points: Floats) -> Floats:
        """Unit vectors (n, 3) that point inwards; 0 where there is no direction."""
        index = self.mask.to_index(points)
        found = np.stack([sample_linear(g, index) for g in self.gradient], axis=1)
        length = np.linalg.norm(found, axis=1, keepdims=True)
        unit: Floats = (found / np.maximum(length, 1e-6)).astype(np.float64)
        return unit


def steps_to(depth_um: float, finest_um: float) -> int:
    """Into how many steps a path is cut, two or more in every voxel of this edge."""
    if depth_um == 0:
        return 0
    return max(FEWEST_STEPS, int(np.ceil(STEPS_PER_VOXEL * depth_um / finest_um)))


def path_points(
    field: InwardField, points: Floats, depth_um: float, steps: int
) -> Iterator[tuple[Floats, npt.NDArray[np.bool_]]]:
    """The points (n, 3) in µm after every step inwards, and which paths have come that far.

    The first are the given points. A path ends where going on leads no deeper, so that one
    in a thin protrusion does not come out on its other side.
    """
    length = depth_um / max(steps, 1)
    place = points
    deep = field.depth_at(place)
    going = np.ones(len(points), dtype=bool)
    yield place, going
    for _ in range(steps):
        middle = place + 0.5 * length * field.inwards(place)
        onward = place + length * field.inwards(middle)
        deeper = field.depth_at(onward)
        going = going & (deeper - deep >= LEAST_SLOPE * length)
        place = np.where(going[:, None], onward, place)
        deep = np.where(going, deeper, deep)
        yield place, going


def surface_signal(
    image: Volume,
    points: Floats,
    field: InwardField,
    depth_um: float,
    percentile: float | None,
    progress: Progress,
    pose: Rigid | None = None,
) -> Floats:
    """The percentile, or the mean, of an image along the path inwards from every point.

    Parameters
    ----------
    image : Volume
        Any voxel size.
    points : ndarray, (n, 3)
        (z, y, x) in µm, on the surface of the field's mask.
    field : InwardField
    depth_um : float
        Length of the paths.
    percentile : float or None
        0 to 100; None: the mean.
    progress : Progress
    pose : Rigid, optional
        Where the image's world lies in that of the points.

    Returns
    -------
    ndarray, (n,)
        NaN where a path leaves the image.
    """
    steps = steps_to(depth_um, min(*image.voxel_size, *field.mask.voxel_size))
    result = np.full(len(points), np.nan)
    for begin in range(0, len(points), CHUNK):
        progress(begin / len(points), "sampling the signal")
        part = slice(begin, begin + CHUNK)
        values, left = [], np.zeros(len(points[part]), dtype=bool)
        for place, going in path_points(field, points[part], depth_um, steps):
            found = intensities(image, own(place, pose))
            left |= np.isnan(found) & going
            values.append(np.where(going, found, np.nan))
        samples = np.stack(values)
        along = mean_along(samples) if percentile is None else percentile_along(samples, percentile)
        result[part] = np.where(left, np.nan, along)
    return result


def own(points: Floats, pose: Rigid | None) -> Floats:
    """Points (n, 3) in µm in the world of an image that a motion brought to its place."""
    return points if pose is None or pose.is_identity else pose.inverse().apply(points)


def intensities(image: Volume, points: Floats) -> Floats:
    """Trilinear intensities at points (n, 3) in µm; NaN outside of the image's voxels."""
    index = image.to_index(points)
    found = sample_linear(image.data, index).astype(np.float64)
    inside = (index >= -0.5) & (index <= np.array(image.shape) - 0.5)
    found[~inside.all(axis=1)] = np.nan
    return found


def mean_along(samples: Floats) -> Floats:
    """Mean (n,) of the samples (k, n) that are not NaN; NaN without any."""
    known = ~np.isnan(samples)
    count = known.sum(axis=0)
    total = np.where(known, samples, 0).sum(axis=0)
    result: Floats = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return result


def percentile_along(samples: Floats, percentile: float) -> Floats:
    """Percentile (n,) of the samples (k, n) that are not NaN; NaN without any.

    As numpy's nanpercentile, which goes through the columns one by one.
    """
    ordered = np.sort(samples, axis=0)
    last = np.maximum((~np.isnan(samples)).sum(axis=0) - 1, 0)
    place = percentile / 100 * last
    low = np.floor(place).astype(np.int64)
    high = np.minimum(low + 1, last)
    column = np.arange(samples.shape[1])
    first, second = ordered[low, column], ordered[high, column]
    result: Floats = first + (place - low) * (second - first)
    return result


def whole_cell_mean(
    image: Volume, mask: Mask, progress: Progress, pose: Rigid | None = None
) -> float:
    """Mean intensity in the mask, as far as the image reaches.

    `pose` is where the image's world lies in the mask's.

    Raises
    ------
    InputError
        It is not positive, or the cell lies outside of the image.
    """
    total, count = 0.0, 0
    for plane in range(mask.shape[0]):
        progress(plane / mask.shape[0], "mean of the cell")
        row, column = np.nonzero(mask.data[plane])
        index = np.column_stack([np.full(len(row), plane), row, column])
        found = intensities(image, own(mask.to_world(index), pose))
        total += float(np.nansum(found))
        count += int((~np.isnan(found)).sum())
    mean = total / count if count else 0.0
    if not mean > 0:
        raise InputError(
            "The mean intensity in the cell is not positive, so nothing can be normalised by it.",
            mean=mean,
            voxels=count,
            hint="Choose another channel, or sample it with normalize=False.",
        )
    return mean


def around_cell(
    volume: Any, voxel_size: Size3, mask: Mask, points: Floats, pose: Rigid | None = None
) -> Volume:
    """The part of a lazy volume around a mask and points, in memory.

    `pose` is where the volume's world lies in theirs.

    Raises
    ------
    InputError
        No point lies in the volume.
    NotFiniteError
        There are NaN or infinite intensities.
    """
    shape = np.asarray(volume.shape)
    ends = np.array([*product(*zip((0, 0, 0), mask.shape, strict=True))])
    corners, points = own(mask.to_world(ends), pose), own(points, pose)
    low = np.minimum(corners.min(axis=0), points.min(axis=0)) / voxel_size
    high = np.maximum(corners.max(axis=0), points.max(axis=0)) / voxel_size
    first = np.clip(np.floor(low).astype(np.int64), 0, shape - 2)
    last = np.clip(np.ceil(high).astype(np.int64) + 1, first + 2, shape)
    z, y, x = (slice(int(a), int(b)) for a, b in zip(first, last, strict=True))
    image = read_box(volume, voxel_size, (z, y, x))
    index = points / np.asarray(voxel_size)
    inside = ((index >= -0.5) & (index <= shape - 0.5)).all(axis=1)
    if not inside.any():
        raise InputError(
            "The surface lies outside of the stack.",
            surface_um=tuple(round(float(c), 3) for c in points.mean(axis=0)),
            stack_um=tuple(round(float(c), 3) for c in shape * np.asarray(voxel_size)),
            hint="Give the stack that the atlas was made from, with the same voxel size.",
        )
    if np.asarray(image.data).dtype.kind == "f":
        not_finite = int((~np.isfinite(image.data)).sum())
        if not_finite:
            raise NotFiniteError(
                "The channel contains NaN or infinite values around the cell.",
                voxels=not_finite,
                hint="Replace them (e.g. by the background) before sampling.",
            )
    return image


def check_sampling(depth_um: float, statistic: str, percentile: float) -> None:
    """Raise unless the depth is a length and the statistic is known."""
    if not (np.isfinite(depth_um) and depth_um >= 0):
        raise ParameterError(
            "The depth is a length in µm.", depth_um=float(depth_um), hint="Give e.g. 1.0."
        )
    if statistic not in ("mean", "percentile"):
        raise ParameterError(
            f"There is no statistic {statistic!r}.", hint="Choose 'mean' or 'percentile'."
        )
    if not 0 <= percentile <= 100:
        raise ParameterError(
            "A percentile lies between 0 and 100.",
            percentile=float(percentile),
            hint="Give e.g. 95.",
        )
