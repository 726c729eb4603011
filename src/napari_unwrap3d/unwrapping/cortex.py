"""The body of a cell as a solid: what a ball reaches from within."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ..geometry.distance import distance_to
from ..geometry.topology import box_around
from ..progress import Progress
from ..protrusions.cortex import depth, opening
from ..protrusions.instances import automatic_threshold

Solid = npt.NDArray[np.bool_]
Field = npt.NDArray[np.float32]

MARGIN = 3
# So far around what stands out, as a part of the largest inscribed radius, the second ball
# takes the place of the first.
FOOTPRINT = 0.15
FAR_OUTSIDE = np.float32(10.0)


def cortex_depth(
    solid: Solid, radius: float, second_radius: float | None, progress: Progress
) -> Field:
    """Depth below the surface of a solid's body, which is the solid opened by a ball.

    Parameters
    ----------
    solid : ndarray, (z, y, x) bool
    radius : float
        Of the ball, as a part of the largest ball that fits in.
    second_radius : float or None
        Of the ball around what stands out of the first one's cortex; None for one pass.
    progress : Progress

    Returns
    -------
    ndarray, (z, y, x) float32
        In voxels, positive in the body, at least −`FAR_OUTSIDE`.
    """
    box = box_around(solid, MARGIN)
    inner = np.ascontiguousarray(solid[box])
    progress(0.0, "opening the cell by a ball")
    depths = progress.run(depth, inner)
    largest = float(depths.max())
    level = progress.run(opening, depths, radius * largest).height
    if second_radius is not None:
        shell = inner & ~ndimage.binary_erosion(inner)
        above = inner & (level > automatic_threshold(level[shell]))
        second = progress.run(opening, depths, second_radius * largest).height
        near = distance_to(above) <= FOOTPRINT * largest
        level = np.where(near, np.maximum(level, second), level)
    depth_below = np.full(solid.shape, -FAR_OUTSIDE, np.float32)
    depth_below[box] = np.maximum(-level, -FAR_OUTSIDE)
    return depth_below
