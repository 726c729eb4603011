"""A volume on cubic voxels, as sharp along one axis as along the others.

A microscope resolves less along its axis than across it, and this stays with the microscope
when the cell turns: it would pull a registration back. So the sharper axes are blurred more.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import ndimage, sparse
from scipy.interpolate import make_interp_spline

from ..charts import Floats, Size3, Volume

# A stack is taken to be blurred by about a voxel (σ) along every axis, as it is when it was
# sampled just finely enough; the common blur is a little more than the coarsest of them.
COARSEST = 1.1
FINEST = 2.0
# Cubic voxels per σ of the blur, so that linear interpolation between them adds next to none.
PER_BLUR = 3.0
SMALLEST_SIGMA = 0.1
NEGLIGIBLE = 1e-7


def common_blur_um(*voxel_sizes: Size3) -> float:
    """σ in µm of the blur that volumes of these voxel sizes (z, y, x) can all be brought to."""
    return max(max(COARSEST * max(size), FINEST * min(size)) for size in voxel_sizes)


def blur_of(volume_size: Size3, blur_um: float) -> Floats:
    """σ in µm along z, y and x after :func:`isotropic`: not less than that of the voxels."""
    blur: Floats = np.maximum(np.asarray(volume_size), blur_um)
    return blur


def isotropic(volume: Volume, blur_um: float, edge: float) -> Volume:
    """Blurred alike along all axes, on cubic voxels.

    Parameters
    ----------
    volume : Volume
    blur_um : float
        σ of the blur along every axis, with that of the voxels, which is taken to be one voxel.
    edge : float
        Of the cubic voxels, in µm.

    Returns
    -------
    Volume
        float32, from the centre of the first voxel to at most that of the last. Between the
        voxels of the volume cubic splines are used: next to none of the blur depends on where a
        new voxel lies between the old ones.
    """
    data = np.asarray(volume.data)
    for axis in (2, 1, 0):  # the longest rows first: what follows is smaller
        size = volume.voxel_size[axis]
        sigma = float(np.sqrt(max(blur_um**2 - size**2, 0.0))) / size
        data = _along(data, axis, sigma, edge / size)
    return Volume(data, (edge, edge, edge), volume.origin)


def _along(
    data: npt.NDArray[np.generic], axis: int, sigma: float, step: float
) -> npt.NDArray[np.float32]:
    """Blur and resample one axis; σ and step in voxels."""
    count = data.shape[axis]
    steps = int(np.floor((count - 1) / step + 1e-9))
    places = np.linspace(0.0, steps * step, steps + 1)
    weights = _weights(count, sigma, places)
    rest = np.moveaxis(data, axis, 0)
    shape = rest.shape[1:]
    rows = rest.reshape(count, -1).astype(np.float32)
    found = (weights @ rows).reshape(-1, *shape)
    return np.ascontiguousarray(np.moveaxis(found, 0, axis))


def _weights(count: int, sigma: float, places: Floats) -> sparse.csr_array:
    """Weights (places, count) of a row's voxels; beyond its ends it goes on as it ends."""
    blur = np.eye(count)
    if sigma > SMALLEST_SIGMA:
        blur = ndimage.gaussian_filter1d(blur, sigma, axis=0, mode="nearest")
    degree = min(3, count - 1)
    spline = make_interp_spline(np.arange(count), blur, k=degree) if degree else None
    weights = blur[:1] if spline is None else spline(places)
    return sparse.csr_array(np.where(np.abs(weights) > NEGLIGIBLE, weights, 0).astype(np.float32))
