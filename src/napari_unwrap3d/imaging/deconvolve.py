"""Deconvolution of an image with a measured point-spread function (PSF)."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import fft, ndimage

from ..charts import Size3, Volume
from ..errors import AxesError, InputError, NotFiniteError, ParameterError, VoxelSizeMissingError
from ..files.stacks import read_stack
from ..parameters import StackParameters
from ..progress import Progress
from .scan import Box, grown, read_box

logger = logging.getLogger(__name__)

Image = npt.NDArray[np.float32]

# Fewest voxels over which an image fades into its continuation.
SHORTEST_TAPER = 8
# A PSF that is not below this part of its maximum at its border has background or is cut.
FAINT = 0.05
# Intensities below this part of the largest one count as this in the Richardson–Lucy ratio.
SMALLEST_RATIO = 1e-6


# The point-spread function -------------------------------------------------------


def chosen_psf(
    parameters: StackParameters, voxel_size: Size3, shape: tuple[int, ...]
) -> Image | None:
    """The PSF of the parameters on the voxels of a stack, or None without deconvolution.

    Raises
    ------
    ParameterError
        No file was given.
    InputError
        See :func:`read_psf` and :func:`prepared_psf`.
    """
    if parameters.deconvolution == "none":
        return None
    if not parameters.psf:
        raise ParameterError(
            "A deconvolution needs a point-spread function.",
            deconvolution=parameters.deconvolution,
            hint="Give its TIFF file as stack.psf, or set stack.deconvolution to none.",
        )
    return prepared_psf(read_psf(parameters.psf, parameters.psf_voxel_um), voxel_size, shape)


def read_psf(path: str | Path, voxel_size: Size3 | None = None) -> Volume:
    """Read a PSF.

    Parameters
    ----------
    path : path
        A stack of one volume, e.g. a TIFF file.
    voxel_size : (float, float, float), optional
        (z, y, x) in µm; instead of what the file says.

    Raises
    ------
    VoxelSizeMissingError
        The file does not give it.
    AxesError
        There are several channels or timepoints.
    FileFormatError
        The file cannot be read.
    """
    try:
        stack = read_stack(path, voxel_size)
    except VoxelSizeMissingError as error:
        raise VoxelSizeMissingError(
            f"The voxel size of the point-spread function {Path(path).name} is not known.",
            **error.measured,
            hint="Give it in µm as stack.psf_voxel_um = [z, y, x].",
        ) from error
    if stack.axes != "zyx":
        raise AxesError(
            "A point-spread function is one volume.",
            axes=stack.axes,
            shape=stack.shape,
            hint="Save one channel and one timepoint of it.",
        )
    return Volume(np.asarray(stack.data), stack.voxel_size)


def prepared_psf(psf: Volume, voxel_size: Size3, shape: tuple[int, ...]) -> Image:
    """A PSF on the voxels of an image, centred, with the sum 1.

    Its centre is the centroid of what has at least half of its maximum.

    Parameters
    ----------
    psf : Volume
    voxel_size : (float, float, float)
        Of the image, (z, y, x) in µm.
    shape : (int, int, int)
        Of the image.

    Returns
    -------
    ndarray, (z, y, x) float32
        An odd number of voxels along every axis.

    Raises
    ------
    NotFiniteError
        There are NaN or infinite values.
    InputError
        Its sum is not positive, or it is larger than the image.
    """
    data = np.asarray(psf.data, dtype=np.float64)
    not_finite = int((~np.isfinite(data)).sum())
    if not_finite:
        raise NotFiniteError(
            "The point-spread function contains NaN or infinite values.",
            voxels=not_finite,
            of=data.size,
            hint="Replace them by 0.",
        )
    _check_size(psf, voxel_size, shape)
    _check_sum(data)
    _warn_of_background(data)
    resampled = _resampled(data, np.asarray(voxel_size) / np.asarray(psf.voxel_size))
    _check_sum(resampled)
    result: Image = (resampled / resampled.sum()).astype(np.float32)
    return result


def _check_size(psf: Volume, voxel_size: Size3, shape: tuple[int, ...]) -> None:
    extent = np.asarray(psf.shape) * np.asarray(psf.voxel_size)
    room = np.asarray(shape) * np.asarray(voxel_size)
    if (extent > room * (1 + 1e-6)).any():
        raise InputError(
            "The point-spread function is larger than the image.",
            psf_um=tuple(round(float(e), 4) for e in extent),
            image_um=tuple(round(float(r), 4) for r in room),
            hint="Crop it around its maximum, or check the voxel sizes.",
        )


def _check_sum(data: npt.NDArray[np.float64]) -> None:
    total = float(data.sum())
    if not total > 0:
        raise InputError(
            "The point-spread function does not have a positive sum.",
            sum=total,
            hint="Subtract less background from it, or crop it around its maximum.",
        )


def _warn_of_background(data: npt.NDArray[np.float64]) -> None:
    inner = tuple(slice(1, -1) if n > 2 else slice(None) for n in data.shape)
    border = np.ones(data.shape, dtype=bool)
    border[inner] = False
    level = float(np.median(data[border]) / data.max()) if border.any() else 0.0
    if level > FAINT:
        logger.warning(
            "the point-spread function has %.0f %% of its maximum at its border; subtract its "
            "background, or take a larger part of it",
            100 * level,
        )


def _resampled(
    data: npt.NDArray[np.float64], ratio: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """The PSF on voxels `ratio` times as large, with its centre on the middle one."""
    # As for the stack: what coarser voxels cannot show is smoothed away first.
    sigma = np.sqrt(np.maximum(ratio**2 - 1, 0) / 12)
    if (sigma > 0.1).any():
        data = ndimage.gaussian_filter(data, sigma, mode="constant")
    bright = np.where(data >= data.max() / 2, data, 0)
    centre = np.asarray(ndimage.center_of_mass(bright))
    longer = np.maximum(centre, np.asarray(data.shape) - 1 - centre)
    reach = np.ceil(longer / ratio - 1e-6).astype(int)
    depth, height, width = (int(n) for n in 2 * reach + 1)
    result: npt.NDArray[np.float64] = ndimage.affine_transform(
        data,
        ratio,
        centre - reach * ratio,
        (depth, height, width),
        order=3,
        mode="grid-constant",
    )
    return result


# Images --------------------------------------------------------------------------


def read_deconvolved(
    volume: Any,
    voxel_size: Size3,
    box: Box,
    psf: Image,
    parameters: StackParameters,
    progress: Progress,
) -> Volume:
    """One box of a lazy volume, deconvolved together with what the PSF reaches around it."""
    reach = (np.asarray(psf.shape) // 2)[:, None].repeat(2, axis=1)
    around = grown(box, reach, volume.shape)
    wide = read_box(volume, voxel_size, around)
    data = deconvolved(np.asarray(wide.data, dtype=np.float32), psf, parameters, progress)
    z, y, x = (
        slice(side.start - outer.start, side.stop - outer.start)
        for side, outer in zip(box, around, strict=True)
    )
    origin = wide.to_world([[z.start, y.start, x.start]])[0]
    return Volume(data[z, y, x], voxel_size, (float(origin[0]), float(origin[1]), float(origin[2])))


def deconvolved(image: Image, psf: Image, parameters: StackParameters, progress: Progress) -> Image:
    """The image without the blur of the microscope, by the chosen method.

    Parameters
    ----------
    image : ndarray, (z, y, x) float32
        Finite.
    psf : ndarray, (z, y, x) float32
        On the same voxels, with the sum 1; see :func:`prepared_psf`.
    parameters : StackParameters
    progress : Progress

    Returns
    -------
    ndarray, (z, y, x) float32
        In the unit of `image`.
    """
    from skimage.restoration import wiener

    progress(0.0, "deconvolution")
    # Both need no more than that, but the ratio of Richardson and Lucy has to be positive.
    lowest = np.float32(min(float(image.min()), 0.0))
    continued, inner = tapered(image - lowest, psf.shape)
    if parameters.deconvolution == "wiener":
        result = progress.run(wiener, continued, psf, parameters.wiener_balance, clip=False)
    else:
        result = richardson_lucy(continued, psf, parameters.richardson_lucy_iterations, progress)
    restored: Image = (result[inner] + lowest).astype(np.float32)
    return restored


def tapered(image: Image, psf_shape: tuple[int, ...]) -> tuple[Image, Box]:
    """The image continued beyond its border so that it is periodic without a step.

    It is mirrored as far as the PSF reaches, and then fades to the mean of its border: the
    Fourier transform joins opposite sides, and a step between them would ring.

    Parameters
    ----------
    image : ndarray, (z, y, x) float32
    psf_shape : (int, int, int)

    Returns
    -------
    continued : ndarray float32
        Of sizes for which the Fourier transform is fast.
    inner : tuple of slice
        Where the image is in it.
    """
    reach = np.asarray(psf_shape) // 2
    fade = np.maximum(reach, SHORTEST_TAPER)
    before = reach + fade
    total = [
        int(fft.next_fast_len(int(n + 2 * pad), real=True))
        for n, pad in zip(image.shape, before, strict=True)
    ]
    after = np.asarray(total) - np.asarray(image.shape) - before
    level = np.float32(np.mean([image.take(i, axis).mean() for axis in range(3) for i in (0, -1)]))
    widths = [(int(a), int(b)) for a, b in zip(before, after, strict=True)]
    continued = np.pad(image, widths, mode="symmetric") - level
    for axis, n in enumerate(image.shape):
        place = np.arange(total[axis]) - before[axis]
        away = np.maximum(np.maximum(-place, place - (n - 1)), 0)
        part = np.clip((away - reach[axis]) / fade[axis], 0, 1)
        shape = [1, 1, 1]
        shape[axis] = -1
        continued *= (0.5 + 0.5 * np.cos(np.pi * part)).astype(np.float32).reshape(shape)
    continued += level
    z, y, x = (slice(int(a), int(a) + n) for a, n in zip(before, image.shape, strict=True))
    return continued, (z, y, x)


def richardson_lucy(image: Image, psf: Image, iterations: int, progress: Progress) -> Image:
    """Richardson–Lucy deconvolution of a periodic image, which keeps its sum.

    scikit-image's takes the outside of the image for black, transforms the PSF anew in every
    iteration, and cannot report.

    Parameters
    ----------
    image : ndarray, (z, y, x) float32
        Not negative.
    psf : ndarray, (z, y, x) float32
        Sum 1, an odd number of voxels along every axis.
    iterations : int
    progress : Progress

    Returns
    -------
    ndarray, (z, y, x) float32
        Not negative.
    """
    highest = float(image.max())
    if not highest > 0:
        return image
    kernel = np.zeros(image.shape, dtype=np.float32)
    kernel[tuple(slice(n) for n in psf.shape)] = psf
    kernel = np.roll(kernel, [-(n // 2) for n in psf.shape], axis=(0, 1, 2))
    transfer = fft.rfftn(kernel)

    def blurred(values: Image, by: Any) -> Image:
        result: Image = fft.irfftn(fft.rfftn(values) * by, image.shape)
        return result

    smallest = np.float32(SMALLEST_RATIO * highest)
    estimate = np.full_like(image, image.mean())
    for i in range(iterations):
        progress(i / iterations, f"deconvolution, iteration {i + 1}")
        ratio = (image / np.maximum(blurred(estimate, transfer), smallest)).astype(np.float32)
        estimate *= np.maximum(blurred(ratio, transfer.conj()), 0)
    return estimate
