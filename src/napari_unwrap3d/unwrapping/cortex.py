"""The body of a cell: what a ball reaches from within."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ..geometry.opening import (
    automatic_threshold,
    continued,
    open_by_part,
)
from ..geometry.topology import box_around
from ..progress import Progress

Solid = npt.NDArray[np.bool_]
Field = npt.NDArray[np.float32]

MARGIN = 3
# Around a footprint the cell is no cortex yet: its foot widens. A part of the ball's radius.
REACH = 0.25
FAR_OUTSIDE = np.float32(10.0)


def cortex_depth(solid: Solid, radius: float, twice: bool, progress: Progress) -> Field:
    """Depth below the surface of a solid's body, which is the solid opened by a ball.

    Parameters
    ----------
    solid : ndarray, (z, y, x) bool
    radius : float
        Of the ball, as a part of the largest ball that fits in.
    twice : bool
        Whether the body goes on smoothly under what stands out of it, into which a ball
        rises; see :func:`.continued`.
    progress : Progress

    Returns
    -------
    ndarray, (z, y, x) float32
        In voxels, positive in the body, at least −`FAR_OUTSIDE`.
    """
    box = box_around(solid, MARGIN)
    inner = np.ascontiguousarray(solid[box])
    progress(0.0, "opening the cell by a ball")
    opened, _ = open_by_part(inner, radius, progress)
    height = opened.height
    if twice:
        shell = inner & ~ndimage.binary_erosion(inner)
        threshold = automatic_threshold(height[shell])
        above = inner & (height > threshold)
        height = progress.run(continued, inner, opened, above, threshold, REACH * opened.radius)
    below = np.full(solid.shape, -FAR_OUTSIDE, np.float32)
    below[box] = np.maximum(-height, -FAR_OUTSIDE)
    return below
