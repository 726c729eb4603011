"""The direction field normal to the reference, along which Step 5 propagates.

Near the reference it is the gradient of the smoothed signed distance; away from it the
gradient of a harmonic function, whose streamlines cannot cross: outside between the
reference and the box around the cell, inside between the reference and a ball at its
deepest point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ..charts import Floats, Mask, Volume
from ..errors import TooSmallError
from ..geometry.distance import signed_distance
from ..geometry.harmonic import harmonic_between
from ..geometry.parallel import run_blocks
from ..geometry.streamlines import blend_directions, trace_to_surface
from ..progress import Progress

SMOOTHING_VOXELS = 1.5
NEAR_VOXELS = 3.0
MARGIN_FRACTION = 0.12
SMALLEST_MARGIN_VOXELS = 10
CORE_FRACTION = 0.15
SMALLEST_DEPTH_VOXELS = 3.0
SEARCH_STEP_VOXELS = 0.5


@dataclass(frozen=True, eq=False)
class NormalField:
    """Unit outward directions around and inside a solid, on a grid with room around it.

    Attributes
    ----------
    directions : ndarray, (z, y, x, 3) float32
    distance : Volume
        Smoothed signed distance in voxels, negative inside the solid.
    core : ndarray, (3,)
        Index coordinates of the solid's deepest point.
    core_radius : float
        Radius in voxels of the ball where inward streamlines end.
    """

    directions: npt.NDArray[np.float32]
    distance: Volume
    core: Floats
    core_radius: float

    def arc_length(self, points: Floats) -> Floats:
        """Signed arc length (n,) in voxels from the solid's surface to points (n, 3) in µm."""
        index = np.ascontiguousarray(self.distance.to_index(points))
        limit = 2.0 * sum(self.distance.shape)
        length, _ = trace_to_surface(
            self.directions, self.distance.data, index, SEARCH_STEP_VOXELS, limit
        )
        return np.asarray(length)


def normal_field(solid: Mask, points: Floats, progress: Progress) -> NormalField:
    """Build the field around a solid so that the box holds all `points` with a margin.

    Parameters
    ----------
    solid : Mask
        A topological ball on an isotropic grid.
    points : ndarray, (n, 3)
        In µm: the vertices of the surface.

    Raises
    ------
    TooSmallError
        The solid is less than three voxels deep everywhere.
    """
    grid = _with_room(solid, points)
    distance = progress.run(signed_distance, grid.data)
    progress(0.2, "distance to the reference")
    smooth = ndimage.gaussian_filter(distance, SMOOTHING_VOXELS)
    depth = -float(distance.min())
    if depth < SMALLEST_DEPTH_VOXELS:
        raise TooSmallError(
            "The reference is too thin to be unwrapped at this voxel size.",
            depth_voxels=depth,
            needed=SMALLEST_DEPTH_VOXELS,
            hint="Choose a smaller working voxel.",
        )
    core = np.array(np.unravel_index(int(distance.argmin()), distance.shape), dtype=np.float64)
    radius = max(CORE_FRACTION * depth, 2.5)
    box = np.ones(grid.shape, bool)
    box[2:-2, 2:-2, 2:-2] = False
    core_ball = _ball(grid.shape, core, radius)
    # At the same time, where there are two cores; only one of them may tell how far it is.
    outer, inner = run_blocks(
        lambda shell: harmonic_between(*shell),
        [
            (grid.data, box, progress.part(0.25, 0.8)),
            (~grid.data, core_ball, Progress(cancelled=progress.cancelled)),
        ],
    )
    directions = progress.run(blend_directions, distance, smooth, outer, inner, NEAR_VOXELS)
    return NormalField(
        directions=directions,
        distance=Volume(smooth, grid.voxel_size, grid.origin),
        core=core,
        core_radius=radius,
    )


def _with_room(solid: Mask, points: Floats) -> Mask:
    """The solid on a grid that holds it and the points with a margin all around."""
    index = solid.to_index(points)
    inside = np.argwhere(solid.data)
    low = np.minimum(index.min(axis=0), inside.min(axis=0))
    high = np.maximum(index.max(axis=0), inside.max(axis=0))
    margin = max(SMALLEST_MARGIN_VOXELS, MARGIN_FRACTION * float((high - low).max()))
    first = np.floor(low - margin).astype(np.int64)
    last = np.ceil(high + margin).astype(np.int64)
    data = np.zeros(tuple(last - first + 1), bool)
    start, stop = np.maximum(first, 0), np.minimum(last + 1, solid.shape)
    source = tuple(slice(a, b) for a, b in zip(start, stop, strict=True))
    target = tuple(slice(a, b) for a, b in zip(start - first, stop - first, strict=True))
    data[target] = solid.data[source]
    z, y, x = solid.to_world(first.astype(np.float64))
    return Mask(data, solid.voxel_size, (float(z), float(y), float(x)))


def _ball(shape: tuple[int, int, int], centre: Floats, radius: float) -> npt.NDArray[np.bool_]:
    axes = np.ogrid[tuple(slice(n) for n in shape)]
    squared = sum((axis - c) ** 2 for axis, c in zip(axes, centre, strict=True))
    ball: npt.NDArray[np.bool_] = squared <= radius**2
    return ball
