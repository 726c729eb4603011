"""A light-sheet microscope: blur, sampling on the camera and by the stage, noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr

from ..charts import Floats, Size3
from .solids import Field, weighted

CORTEX_DEPTH_UM = 0.15
CORTEX_BRIGHTNESS = 1.2
TEXTURE = 0.12
NUCLEUS_DIMMING = 0.3


@dataclass(frozen=True)
class Microscope:
    """How the cell is imaged.

    Attributes
    ----------
    psf_um : (float, float, float)
        Standard deviations (z, y, x) of the Gaussian point-spread function in µm.
    photons : float
        Expected photons per voxel in the middle of the cytosol.
    background_photons : float
        Expected photons per voxel far from the cell, on average over the field of view.
    background_slope : float
        Relative change of the background across the field of view.
    offset, counts_per_photon, read_noise : float
        Of the camera: counts = offset + counts_per_photon × photons + N(0, read_noise).
    """

    psf_um: Size3 = (0.35, 0.12, 0.12)
    photons: float = 100.0
    background_photons: float = 12.0
    background_slope: float = 0.3
    offset: float = 100.0
    counts_per_photon: float = 2.2
    read_noise: float = 3.5


def filled(field: Field, voxel_um: float) -> Field:
    """Which part of every voxel is inside, from signed distances in µm."""
    part: Field = np.clip(np.float32(0.5) - field / np.float32(voxel_um), 0, 1)
    return part


def fluorescence(
    field: Field, texture: Field, voxel_um: float, nucleus: tuple[Floats, float]
) -> Field:
    """Concentration of the dye: cytosol 1, brighter under the membrane, dimmer in the nucleus.

    Parameters
    ----------
    field : ndarray, (z, y, x) float32
        Signed distance in µm, negative inside.
    texture : ndarray, (z, y, x) float32
        Of unit variance: how the dye is unevenly spread.
    nucleus : (ndarray (3,), float)
        Centre (z, y, x) and radius in µm.
    """
    size = field.shape[0]
    depth = (field + np.float32(CORTEX_DEPTH_UM)) / np.float32(CORTEX_DEPTH_UM)
    dye = np.float32(1) + np.float32(CORTEX_BRIGHTNESS) * np.exp(np.float32(-0.5) * depth * depth)
    dye += np.float32(TEXTURE) * texture
    axes = [((np.arange(size) * voxel_um - c) ** 2).astype(np.float32) for c in nucleus[0]]
    distance = np.sqrt(axes[0][:, None, None] + axes[1][:, None] + axes[2])
    distance -= np.float32(nucleus[1])
    dye -= np.float32(NUCLEUS_DIMMING) * np.clip(0.5 - distance / np.float32(0.4), 0, 1)
    visible: Field = np.maximum(dye, np.float32(0)) * filled(field, voxel_um)
    return visible


def image(
    dye: Field,
    voxel_um: float,
    voxel_size: Size3,
    microscope: Microscope,
    rng: np.random.Generator,
) -> npt.NDArray[np.uint16]:
    """The stack (z, y, x) that the microscope records of a dye on a cubic grid.

    Voxel (0, 0, 0) of the stack is centred on voxel (0, 0, 0) of the dye. A pixel of the
    camera averages over its area; a plane is recorded at one position of the stage.
    """
    light = blurred(dye, voxel_um, voxel_size, microscope)
    return camera(light, background(rng, light.shape, microscope), microscope, rng)


def blurred(
    dye: Field, voxel_um: float, voxel_size: Size3, microscope: Microscope, widening: float = 1.0
) -> Field:
    """What the optics make of a dye, sampled; the point-spread is `widening` times as wide."""
    pixel = (0.0, voxel_size[1], voxel_size[2])
    weights = [
        sampling(dye.shape[a], voxel_um, voxel_size[a], widening * microscope.psf_um[a], pixel[a])
        for a in range(3)
    ]
    return weighted(dye, weights)


def camera(
    light: Field, beside: Floats, microscope: Microscope, rng: np.random.Generator
) -> npt.NDArray[np.uint16]:
    """Counts of a light (z, y, x) and of the background photons beside it."""
    expected = microscope.photons * light.astype(np.float64)
    expected += beside
    electrons = rng.poisson(expected)
    counts = microscope.offset + microscope.counts_per_photon * electrons
    counts += rng.normal(0.0, microscope.read_noise, counts.shape)
    recorded: npt.NDArray[np.uint16] = np.clip(np.rint(counts), 0, 65535).astype(np.uint16)
    return recorded


def sampling(
    count: int, voxel_um: float, step_um: float, sigma_um: float, pixel_um: float
) -> Floats:
    """Weights (samples, count) of source voxels in samples that are `step_um` apart.

    The exact integral of a Gaussian over each source voxel, averaged over a pixel of
    width `pixel_um` (0: a point). Sample 0 is centred on voxel 0; light from outside of
    the grid is missing.
    """
    samples = int(np.floor((count - 1) * voxel_um / step_um + 1e-9)) + 1
    edges = (np.arange(count + 1) - 0.5) * voxel_um
    reach = (edges - np.arange(samples)[:, None] * step_um) / sigma_um
    half = pixel_um / 2 / sigma_um
    if half == 0:
        reached = ndtr(reach)
    else:
        reached = (_integral(reach + half) - _integral(reach - half)) / (2 * half)
    weights: Floats = np.diff(reached, axis=1)
    return weights


def _integral(t: Floats) -> Floats:
    """Antiderivative of the standard normal's distribution function."""
    integral: Floats = t * ndtr(t) + np.exp(-0.5 * t * t) / np.sqrt(2 * np.pi)
    return integral


def background(rng: np.random.Generator, shape: tuple[int, ...], microscope: Microscope) -> Floats:
    """Expected photons (z, y, x) without a cell: they slope in a random direction."""
    direction = rng.normal(size=3)
    direction /= np.abs(direction).sum()
    planes = [d * np.linspace(-0.5, 0.5, n) for d, n in zip(direction, shape, strict=True)]
    slope = planes[0][:, None, None] + planes[1][:, None] + planes[2]
    photons: Floats = microscope.background_photons * (1.0 + microscope.background_slope * slope)
    return photons
