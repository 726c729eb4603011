"""A solid opened by a ball, as a smooth height over the surface of what the ball reaches.

What a ball of some part of the largest inscribed radius can reach from within is the cell's
body; everything else stands out of it. All lengths here are voxels of the mask's grid.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage, sparse
from scipy.spatial import KDTree
from scipy.special import ndtri

from ..progress import Progress
from .distance import FAR, distance_to, power_distance
from .laplacian import Factor, cotangent_laplacian, mass_matrix
from .marching import clamped_marching_cubes
from .mesh import vertex_normals
from .topology import euler_characteristic, largest_part

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Field = npt.NDArray[np.float32]
Heights = npt.NDArray[np.floating]
Solid = npt.NDArray[np.bool_]

# The mask is smoothed by so much to tell where its surface passes between voxels.
SMOOTHING = 1.0
LEAST_SHARE = 0.05  # of the smoothed mask, beyond which a voxel is as far as one can tell
LEAST_MASS = 1e-3  # voxel² around a vertex, as slivers of marching cubes have next to none
TUNNEL = 0.3  # how wide a hole is filled, as a part of the ball's radius
STAY = 1e-9  # voxel⁻⁴: felt over some 180 voxels
# Of heights over the opened solid, from below, this part tells how rough its surface is.
LOW = 0.6
ROUGHNESS = 3.0  # median absolute deviations
DEVIATION = 1.4826  # of a normal distribution, in median absolute deviations
LEAST_THRESHOLD = 0.5  # voxels
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


def largest_radius(mask: Solid) -> float:
    """Radius in voxels of the largest ball within a solid."""
    return float(distance_to(~mask).max()) - 0.5


def without_tunnels(mask: Solid, radius: float) -> Solid:
    """The solid with narrow holes through its body filled, as a ball cannot pass beside them.

    A hole is filled where it is closed by a ball of three tenths of `radius` and lies within the
    cortex of what results; gaps between protrusions stay open. A solid without handles is
    returned as it is.
    """
    if euler_characteristic(mask) == 1:
        return mask
    reach = TUNNEL * radius
    room = int(np.ceil(reach)) + 1
    padded = np.pad(mask, room)
    closed = distance_to(distance_to(padded) > reach) > reach
    inner = tuple(slice(room, -room) for _ in range(3))
    closed = np.ascontiguousarray(closed[inner]) | mask
    deep = opening(depth(closed, radius), radius).height < -1.0
    filled: Solid = mask | (closed & deep)
    return filled


def depth(mask: Solid, at: float) -> Field:
    """Distance (z, y, x) from the surface of a solid in voxels, 0 outside of it.

    The surface is where the smoothed mask is ½, so that it is not off by the half voxel that
    depends on how the surface lies on the grid; this is exact at the depth `at`, to a fifth of a
    voxel below, and coarser above.
    """
    outside = ndimage.binary_dilation(mask) & ~mask
    smooth = ndimage.gaussian_filter(mask.astype(np.float32), SMOOTHING)[outside]
    beyond = -SMOOTHING * ndtri(np.clip(smooth.astype(float), LEAST_SHARE, 0.5))
    # |p − q| is the depth plus how far q is beyond the surface; in squares, that is a weight
    # which depends on the depth.
    weight = np.full(mask.shape, FAR, np.float32)
    weight[outside] = -beyond * (2 * at + beyond)
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


def open_by_part(solid: Solid, part: float, progress: Progress) -> tuple[Opening, float]:
    """A solid opened by a ball of a part of the largest radius in it, and that radius in voxels."""
    largest = progress.run(largest_radius, solid)
    radius = part * largest
    whole = progress.run(without_tunnels, solid, radius)
    return progress.run(opening, progress.run(depth, whole, radius), radius), largest


def continued(
    mask: Solid, opened: Opening, protrusions: Solid, above: float, reach: float
) -> Field:
    """The height over the cortex, which goes on smoothly under the footprints of protrusions.

    A ball that opens the cell rises into wide footprints. Within `reach` voxels of them the
    opened cell's surface is therefore drawn anew, as the surface of least bending (the squared
    Laplacian of its points vanishes) that goes on from around them.

    Parameters
    ----------
    mask : ndarray, (z, y, x) bool
    opened : Opening
        Of this mask.
    protrusions : ndarray, (z, y, x) bool
        The voxels that are over the cortex.
    above : float
        Their least height.
    reach : float

    Returns
    -------
    ndarray, (z, y, x) float32
        In voxels.
    """
    low = np.argwhere(protrusions & (opened.height < above + reach))
    if not len(low):
        return opened.height
    vertices, faces = clamped_marching_cubes(-opened.height)
    apart, _ = KDTree(low).query(vertices, distance_upper_bound=reach)
    free = apart <= reach
    if free.all():
        return opened.height
    moved = _least_bending(vertices, faces, free)
    rise = np.einsum("ij,ij->i", moved - vertices, vertex_normals(vertices, faces))
    height = opened.height.copy()
    # With the two layers around it, between which the surface is sampled.
    near = distance_to(protrusions) <= 2 * reach
    near &= ndimage.binary_dilation(mask, iterations=2) & (opened.height > -reach)
    _, nearest = KDTree(vertices).query(np.argwhere(near))
    height[near] -= rise[nearest].astype(np.float32)
    return height


def _least_bending(vertices: Floats, faces: Ints, free: npt.NDArray[np.bool_]) -> Floats:
    """The vertices with the free ones where the squared Laplacian of their places vanishes."""
    laplacian = cotangent_laplacian(vertices, faces)
    mass = mass_matrix(vertices, faces, "barycentric", LEAST_MASS).diagonal()
    bending = (laplacian @ sparse.diags_array(1.0 / mass) @ laplacian).tocsr()
    inner, outer = np.flatnonzero(free), np.flatnonzero(~free)
    rows = bending[inner]
    # A faint pull to where they are keeps what is free on all sides in its place.
    pull = STAY * mass[inner]
    right = pull[:, None] * vertices[inner] - rows[:, outer] @ vertices[outer]
    moved = vertices.copy()
    moved[inner] = Factor(rows[:, inner] + sparse.diags_array(pull)).solve(right)
    return moved


def roughness(height: Heights) -> tuple[float, float]:
    """Median and standard deviation of the heights of the cortex itself.

    The lower 60 % of all heights are taken for the cortex.
    """
    low = height[height <= np.quantile(height, LOW)]
    median = float(np.median(low))
    return median, DEVIATION * float(np.median(np.abs(low - median)))


def automatic_threshold(height: Heights) -> float:
    """Median + 3 MAD of the lower 60 % of the heights, but at least half a voxel."""
    median, deviation = roughness(height)
    return max(LEAST_THRESHOLD, median + ROUGHNESS * deviation)
