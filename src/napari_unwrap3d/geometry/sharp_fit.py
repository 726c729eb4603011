"""The last part of a rigid motion, from all that noisy volumes show.

Blurring both volumes until they fit well throws most of what they say about the motion away: it
is in edges and fine structure. Here the volumes stay sharp, and their noise is averaged by what
the residual is projected on: the derivatives of a smooth copy of the fixed volume (instrumental
variables). With white noise and a copy that is like the volume itself this is the best there is.

A microscope's blur does not turn with the cell. To first order the difference is ½ (Σ − R Σ Rᵀ)
: ∇∇f, with the covariance Σ of the blur and the rotation R, which is taken off the residual.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt

from .interpolate import value_at
from .rigid import Rigid
from .rigid_fit import moved_back, solved

Floats = npt.NDArray[np.float64]
Image = npt.NDArray[np.float32]

ITERATIONS = 6
CONVERGED = 1e-3  # voxels


@dataclass(frozen=True, eq=False)
class SharpPair:
    """Two volumes on cubic voxels of one size, and what they are compared by.

    Attributes
    ----------
    fixed, moving : ndarray, (z, y, x) float32
    smooth : ndarray, (z, y, x) float32
        The fixed volume with less noise.
    fixed_origin, moving_origin : ndarray, (3,)
        Centres of the first voxels in µm.
    edge : float
        In µm.
    blur : ndarray, (3,)
        σ of the blur of both volumes along z, y and x in µm.
    """

    fixed: Image
    moving: Image
    smooth: Image
    fixed_origin: Floats
    moving_origin: Floats
    edge: float
    blur: Floats


def refined_motion(pair: SharpPair, weights: Image, start: Rigid, *, rotate: bool) -> Rigid:
    """Refine a motion that is right to a fraction of a voxel; `start` where nothing is to go by.

    Parameters
    ----------
    pair : SharpPair
    weights : ndarray, (z, y, x) float32
        Of the fixed volume's voxels; 0 where the volumes do not correspond.
    start : Rigid
        From the moving volume's world to the fixed one's.
    rotate : bool
        Whether the rotation is refined, too.

    Returns
    -------
    Rigid
        The same on any number of threads.
    """
    index = np.argwhere(weights > 0)
    if not len(index):
        return start
    middle = index.mean(axis=0)
    radius = float(np.sqrt(((index - middle) ** 2).sum(axis=1).mean())) * pair.edge
    centre = pair.fixed_origin + middle * pair.edge
    covariance = np.diag(pair.blur**2)
    motions = 6 if rotate else 3
    pose = start
    for _ in range(ITERATIONS):
        back = pose.inverse()
        turned = pose.rotation @ covariance @ pose.rotation.T
        # From the indices of the fixed volume to those of the moving one.
        offset = (back.apply(pair.fixed_origin) - pair.moving_origin) / pair.edge
        normal, right = _equations(
            pair.smooth,
            pair.fixed,
            pair.moving,
            weights,
            back.rotation,
            offset,
            middle,
            pair.edge / radius,
            (covariance - turned) / pair.edge**2,
            motions,
        )
        unknowns = solved(normal, right)
        if unknowns is None:
            return start
        step = unknowns[:motions] * pair.edge
        pose = moved_back(step, centre, radius) @ pose
        if np.linalg.norm(step) < CONVERGED * pair.edge:
            break
    return pose


@numba.njit(nogil=True, cache=True)
def _equations(  # type: ignore[no-untyped-def]
    smooth, fixed, moving, weights, matrix, offset, middle, scale, blur, motions
):
    """Projected equations for the motion in voxels, gain, offset and slope."""
    nz, ny, nx = fixed.shape
    mz, my, mx = moving.shape
    columns = motions + 5
    normal, right = np.zeros((columns, columns)), np.zeros(columns)
    on, row = np.empty(columns), np.empty(columns)
    for i in range(1, nz - 1):
        for j in range(1, ny - 1):
            for k in range(1, nx - 1):
                weight = weights[i, j, k]
                if weight == 0:
                    continue
                z = matrix[0, 0] * i + matrix[0, 1] * j + matrix[0, 2] * k + offset[0]
                y = matrix[1, 0] * i + matrix[1, 1] * j + matrix[1, 2] * k + offset[1]
                x = matrix[2, 0] * i + matrix[2, 1] * j + matrix[2, 2] * k + offset[2]
                if not (0 <= z <= mz - 1 and 0 <= y <= my - 1 and 0 <= x <= mx - 1):
                    continue
                found = value_at(moving, z, y, x)
                p, q, r = (i - middle[0]) * scale, (j - middle[1]) * scale, (k - middle[2]) * scale
                value = smooth[i, j, k]
                target = fixed[i, j, k]
                gz = 0.5 * (smooth[i + 1, j, k] - smooth[i - 1, j, k])
                gy = 0.5 * (smooth[i, j + 1, k] - smooth[i, j - 1, k])
                gx = 0.5 * (smooth[i, j, k + 1] - smooth[i, j, k - 1])
                on[0], on[1], on[2] = gz, gy, gx
                if motions == 6:
                    on[3], on[4], on[5] = q * gx - r * gy, r * gz - p * gx, p * gy - q * gz
                    target -= _turned_blur(smooth, i, j, k, blur)
                on[motions], on[motions + 1] = value, 1.0
                on[motions + 2], on[motions + 3], on[motions + 4] = p, q, r
                row[:] = on
                row[motions] = found
                for m in range(columns):
                    projected = weight * on[m]
                    right[m] += projected * target
                    for n in range(columns):
                        normal[m, n] += projected * row[n]
    return normal, right


@numba.njit(nogil=True, cache=True)
def _turned_blur(image, i, j, k, blur):  # type: ignore[no-untyped-def]
    """½ of a difference of covariances (3, 3) in voxels² : ∇∇ of an image at a voxel."""
    twice = 2 * image[i, j, k]
    zz = image[i + 1, j, k] - twice + image[i - 1, j, k]
    yy = image[i, j + 1, k] - twice + image[i, j - 1, k]
    xx = image[i, j, k + 1] - twice + image[i, j, k - 1]
    zy = image[i + 1, j + 1, k] - image[i + 1, j - 1, k]
    zy -= image[i - 1, j + 1, k] - image[i - 1, j - 1, k]
    zx = image[i + 1, j, k + 1] - image[i + 1, j, k - 1]
    zx -= image[i - 1, j, k + 1] - image[i - 1, j, k - 1]
    yx = image[i, j + 1, k + 1] - image[i, j + 1, k - 1]
    yx -= image[i, j - 1, k + 1] - image[i, j - 1, k - 1]
    straight = blur[0, 0] * zz + blur[1, 1] * yy + blur[2, 2] * xx
    return 0.5 * straight + 0.25 * (blur[0, 1] * zy + blur[0, 2] * zx + blur[1, 2] * yx)
