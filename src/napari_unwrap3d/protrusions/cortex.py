"""The cortex: the cell opened by a ball, as a smooth height over its surface.

What a ball of some part of the largest inscribed radius can reach from within is the cell's
body; everything else stands out of it. All lengths here are voxels of the mask's grid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from scipy.special import ndtri

from ..geometry.distance import FAR, power_distance
from ..geometry.topology import largest_part

Field = npt.NDArray[np.float32]
Solid = npt.NDArray[np.bool_]

# The mask is smoothed by so much to tell where its surface passes between voxels.
SMOOTHING = 1.0
SHELL = 2.0  # thickness of the layer of centres that is enough to draw the opened cell


@dataclass(frozen=True, eq=False)
class Opening:
    """A cell opened by a ball.

    Attributes
    ----------
    height : ndarray, (z, y, x) float32
        Over the opened cell's surface in voxels, negative below it; smooth but for creases
        where a voxel is as far from two places.
    radius : float
        Of the ball, in voxels.
    """

    height: Field
    radius: float


def depth(mask: Solid) -> Field:
    """Distance (z, y, x) from the surface of a solid in voxels, 0 outside of it.

    The surface is where the smoothed mask is ½, so that it is not off by the half voxel that
    depends on how the surface lies on the grid.
    """
    outside = ndimage.binary_dilation(mask, np.ones((3, 3, 3))) & ~mask
    smooth = ndimage.gaussian_filter(mask.astype(np.float32), SMOOTHING)[outside]
    beyond = -SMOOTHING * ndtri(np.clip(smooth.astype(float), 0.02, 0.5))
    # |p − q| is the depth plus how far q is beyond the surface; in squares, that is a weight
    # which depends on the depth, and is exact at this one.
    usual = 0.5 * np.cbrt(mask.sum() * 3 / (4 * np.pi))
    weight = np.full(mask.shape, FAR, np.float32)
    weight[outside] = -beyond * (2 * usual + beyond)
    squared = power_distance(weight)
    inner: Field = np.sqrt(np.maximum(squared, 0, out=squared), out=squared)
    inner[~mask] = 0
    return inner


def opening(depths: Field, radius: float) -> Opening:
    """A solid, given by the depths in it, opened by a ball of `radius` voxels.

    It is the union of the balls that touch the surface from within and whose centres are
    deeper than `radius`; of several parts, the one with the largest core is kept.
    """
    core = largest_part(depths >= radius)
    weight = np.full(depths.shape, FAR, np.float32)
    shell = core & (depths < radius + SHELL)
    weight[shell] = -(depths[shell] ** 2)
    height = power_distance(weight)
    height += np.float32(radius**2)
    np.sqrt(np.maximum(height, 0, out=height), out=height)
    height -= np.float32(radius)
    height[core] = -depths[core]
    return Opening(height, radius)
