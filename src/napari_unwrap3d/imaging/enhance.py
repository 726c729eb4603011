"""Local contrast and edges of an image, enhanced before it is smoothed and thresholded."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ..charts import Floats, Size3
from ..parameters import StackParameters
from ..progress import Progress

Image = npt.NDArray[np.float32]

# A block of the local contrast has at least this many voxels along every axis.
SMALLEST_BLOCK = 4


def enhanced(
    image: Image,
    voxel_size: Size3,
    working_voxel_um: float,
    parameters: StackParameters,
    progress: Progress,
) -> Image:
    """The image with its local contrast, then its edges enhanced, as far as they are wanted.

    Parameters
    ----------
    image : ndarray, (z, y, x) float32
    voxel_size : (float, float, float)
        Of `image`, in µm; may be coarser than the working grid.
    working_voxel_um : float
        The voxel that `edge_voxels` refers to.
    parameters : StackParameters
        Both are off by default; then the image itself is returned.
    progress : Progress

    Returns
    -------
    ndarray, (z, y, x) float32
    """
    values = image
    if parameters.local_contrast_um:
        progress(0.0, "local contrast")
        block = parameters.local_contrast_um / np.asarray(voxel_size)
        values = progress.run(local_contrast, values, block, parameters.local_contrast_limit)
    if parameters.edge_enhancement:
        progress(0.7, "edges")
        sigma = parameters.edge_voxels * working_voxel_um / np.asarray(voxel_size)
        values = progress.run(sharpened, values, sigma, parameters.edge_enhancement)
    return values


def local_contrast(image: Image, block: Floats, limit: float) -> Image:
    """Contrast-limited adaptive histogram equalisation, within the image's own range.

    Parameters
    ----------
    image : ndarray, (z, y, x) float32
    block : ndarray, (3,)
        Size in voxels of the blocks whose histograms are equalised.
    limit : float
        Largest part of a block's voxels in one bin of 256, from nearly 0 (nothing changes)
        to 1 (no limit).

    Returns
    -------
    ndarray, (z, y, x) float32
        From the smallest to the largest intensity of `image`. Another gain or offset of the
        image gives the same with that gain and offset.
    """
    from skimage.exposure import equalize_adapthist

    low, high = float(image.min()), float(image.max())
    if not high > low:
        return image
    sizes = np.clip(np.rint(block), SMALLEST_BLOCK, np.maximum(image.shape, SMALLEST_BLOCK))
    unit = (image - np.float32(low)) / np.float32(high - low)
    equalised = equalize_adapthist(unit, sizes.astype(int).tolist(), clip_limit=limit)
    result: Image = (low + (high - low) * equalised).astype(np.float32)
    return result


def sharpened(image: Image, sigma: Floats, amount: float) -> Image:
    """Unsharp masking: ``image + amount · (image − smoothed image)``.

    Parameters
    ----------
    image : ndarray, (z, y, x) float32
    sigma : ndarray, (3,)
        Gaussian σ in voxels along every axis.
    amount : float

    Returns
    -------
    ndarray, (z, y, x) float32
    """
    smooth: Image = ndimage.gaussian_filter(image, sigma, mode="nearest")
    result: Image = image + np.float32(amount) * (image - smooth)
    return result
