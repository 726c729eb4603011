"""Tell the cell from the background: enhance, smooth, correct the background, threshold."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ..charts import Size3
from ..errors import EmptyMaskError, ParameterError
from ..geometry.distance import distance_to, signed_distance
from ..geometry.topology import fill_cavities, largest_part
from ..parameters import StackParameters
from ..progress import Progress
from .enhance import Image, enhanced
from .resample import interpolate_axis

# Smoothing by less than this does nothing.
SMALLEST_SIGMA = 0.3
# Where the steepest level is looked for: in voxels around the outline, and in intensities there.
EDGE_VOXELS = 4.0
EDGE_LEVELS = (0.02, 0.98)
EDGE_BINS = 40
# A level that would change the cell's volume by more is another thing's than its outline's.
LARGEST_CHANGE = 0.2
EDGE_DEPTH = 8.0  # voxels, that a part of the cell is thick on either side of its middle
EDGE_PEAK = 0.9


def foreground(
    image: Image,
    voxel_size: Size3,
    working_voxel_um: float,
    parameters: StackParameters,
    progress: Progress,
) -> tuple[npt.NDArray[np.bool_], float]:
    """Enhance, smooth, correct the background, and threshold.

    Parameters
    ----------
    image : ndarray, (z, y, x) float32
    voxel_size : (float, float, float)
        Of `image`, in µm; may be coarser than the working grid.
    working_voxel_um : float
        The voxel that `smoothing_voxels` refers to.

    Returns
    -------
    mask : ndarray, (z, y, x) bool
    threshold : float
        Intensity (after the correction) above which a voxel is cell.

    Raises
    ------
    EmptyMaskError
        The image is constant.
    ParameterError
        The class to keep does not exist, or there are too few intensities for it.
    """
    fine = enhanced(image, voxel_size, working_voxel_um, parameters, progress.part(0.0, 0.3))
    values = corrected(fine, voxel_size, working_voxel_um, parameters, progress.part(0.3, 0.7))
    progress(0.7, "threshold")
    threshold = threshold_of(values, parameters)
    mask = values > threshold
    if parameters.threshold == "multi-level":
        if fine is not image:
            part = progress.part(0.7, 0.9)
            values = corrected(image, voxel_size, working_voxel_um, parameters, part)
        progress(0.9, "interior")
        mask |= progress.run(interior, values, voxel_size, parameters.interior_um)
    return mask, threshold


def interior(values: Image, voxel_size: Size3, interior_um: float) -> npt.NDArray[np.bool_]:
    """The inside of the cell, also where it is unevenly stained.

    Otsu's threshold of the image smoothed with this σ, drawn in by as much so that it stays
    behind the surface.
    """
    from skimage.filters import threshold_otsu

    smooth = ndimage.gaussian_filter(values, interior_um / np.asarray(voxel_size), mode="nearest")
    if not smooth.max() > smooth.min():
        return np.zeros(values.shape, dtype=bool)
    inside = smooth > threshold_otsu(smooth.ravel())
    deep: npt.NDArray[np.bool_] = (
        ndimage.distance_transform_edt(inside, sampling=voxel_size) > interior_um
    )
    return deep


def corrected(
    image: Image,
    voxel_size: Size3,
    working_voxel_um: float,
    parameters: StackParameters,
    progress: Progress,
) -> Image:
    """The image smoothed, and without what is smoother than the background's size."""
    progress(0.0, "smoothing")
    values = image
    sigma = parameters.smoothing_voxels * working_voxel_um / np.asarray(voxel_size)
    if (sigma >= SMALLEST_SIGMA).any():
        values = progress.run(ndimage.gaussian_filter, values, sigma, mode="nearest")
    if parameters.background_um:
        progress(0.5, "background")
        size = parameters.background_um / np.asarray(voxel_size)
        values = values - progress.run(background, image, size)
    return values


def background(image: Image, sigma: npt.NDArray[np.float64]) -> Image:
    """The image smoothed with a large σ (in voxels per axis), on a coarser grid.

    Blocks of a quarter of σ lose nothing that survives the smoothing.
    """
    steps = [max(1, int(s / 4)) for s in sigma]
    coarse: npt.NDArray[np.floating] = image
    for axis, step in enumerate(steps):
        first = np.arange(0, image.shape[axis], step)
        shape = [1, 1, 1]
        shape[axis] = -1
        count = np.diff(first, append=image.shape[axis]).astype(np.float32)
        coarse = np.add.reduceat(coarse, first, axis=axis) / count.reshape(shape)
    smooth: Image = ndimage.gaussian_filter(
        coarse.astype(np.float32), sigma / np.asarray(steps), mode="nearest", truncate=3
    )
    for axis, step in enumerate(steps):
        centre = (np.arange(image.shape[axis]) - (step - 1) / 2) / step
        smooth = interpolate_axis(smooth, centre, axis)
    return smooth


def threshold_of(values: Image, parameters: StackParameters) -> float:
    """The intensity that separates the cell from the background."""
    from skimage.filters import threshold_multiotsu, threshold_otsu

    if parameters.threshold == "value":
        return float(parameters.threshold_value)
    low, high = float(values.min()), float(values.max())
    if not high > low:
        raise EmptyMaskError(
            "The image has one intensity everywhere, so there is no cell in it.",
            intensity=low,
            hint="Choose another channel or timepoint.",
        )
    if parameters.threshold in ("otsu", "multi-level"):
        return float(threshold_otsu(values.ravel()))
    if parameters.threshold == "edge":
        return steepest_level(values, float(threshold_otsu(values.ravel())))
    if parameters.threshold_class >= parameters.threshold_classes:
        raise ParameterError(
            "The lowest class kept does not exist.",
            threshold_class=parameters.threshold_class,
            threshold_classes=parameters.threshold_classes,
            hint="Classes are counted from 0; the brightest is threshold_classes − 1.",
        )
    try:
        levels = threshold_multiotsu(values.ravel(), parameters.threshold_classes)
    except ValueError:
        raise ParameterError(
            "The image has too few intensities for so many classes.",
            threshold_classes=parameters.threshold_classes,
            hint="Use threshold = otsu.",
        ) from None
    return float(levels[parameters.threshold_class - 1])


def steepest_level(values: Image, threshold: float) -> float:
    """The intensity at which the image rises most steeply into the cell.

    Blur moves a bright membrane's outline at any fixed part of the contrast outwards; the
    steepest place stays where the edge is, to first order. Measured along the normals of the
    outline at `threshold`, next to it, on average over all places of the same intensity. Where
    that would change the cell's volume by more than a fifth, as with parts of different
    brightness or next to coarse voxels, `threshold` itself is returned.
    """
    cell = fill_cavities(largest_part(values > threshold))
    if cell.all() or not cell.any():
        return threshold
    distance = signed_distance(cell)
    near = np.abs(distance) < EDGE_VOXELS
    # What is thin is dimmed by the blur, and rises to less.
    core = distance < -EDGE_DEPTH
    if core.any():
        near &= distance_to(core) < EDGE_DEPTH + EDGE_VOXELS + 1.0
    smooth = ndimage.gaussian_filter(np.clip(distance, -2 * EDGE_VOXELS, 2 * EDGE_VOXELS), 1.0)
    inward = [-slope[near] for slope in np.gradient(smooth)]
    rise = sum(a[near] * b for a, b in zip(np.gradient(values), inward, strict=True))
    level = values[near]
    lowest, highest = np.quantile(level, EDGE_LEVELS)
    edges = np.linspace(float(lowest), float(highest), EDGE_BINS + 1)
    which = np.digitize(level, edges)
    # The first and the last bin are what lies beyond the levels.
    count = np.bincount(which, minlength=EDGE_BINS + 2)[1:-1]
    mean = np.bincount(which, rise, EDGE_BINS + 2)[1:-1] / np.maximum(count, 1)
    # The peak is broad: its middle is steadier than its highest bin.
    steep = np.flatnonzero(mean >= EDGE_PEAK * mean.max())
    return float(0.5 * (edges[steep] + edges[steep + 1]).mean())
