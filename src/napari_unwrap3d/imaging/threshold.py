"""Tell the cell from the background: smoothing, background correction, threshold."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ..charts import Size3
from ..errors import EmptyMaskError, ParameterError
from ..parameters import StackParameters
from ..progress import Progress
from .resample import interpolate_axis

Image = npt.NDArray[np.float32]

# Smoothing by less than this does nothing.
SMALLEST_SIGMA = 0.3


def foreground(
    image: Image,
    voxel_size: Size3,
    working_voxel_um: float,
    parameters: StackParameters,
    progress: Progress,
) -> tuple[npt.NDArray[np.bool_], float]:
    """Smooth, correct the background, and threshold.

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
    values = corrected(image, voxel_size, working_voxel_um, parameters, progress.part(0.0, 0.8))
    progress(0.8, "threshold")
    threshold = threshold_of(values, parameters)
    return values > threshold, threshold


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
    if parameters.threshold == "otsu":
        return float(threshold_otsu(values.ravel()))
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
