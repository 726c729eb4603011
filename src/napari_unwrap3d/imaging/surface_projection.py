"""Surface-limited projections: the brightest of what lies near the surface along every ray.

Paper, Fig. 4c and Methods, "Visualization": rays along the depth at every pixel, and the maximum
intensity of the voxels within ± 1 µm of the cell's surface.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Mask
from ..errors import ParameterError
from ..geometry.distance import signed_distance
from ..geometry.interpolate import sample_linear
from ..geometry.rigid import Rigid
from ..progress import Progress, silent
from .signal import around_cell, intensities, own

Axis = Literal["z", "y", "x"]
Statistic = Literal["max", "mean"]
STATISTICS: tuple[Statistic, ...] = ("max", "mean")
# The paper's ± 1 µm.
REACH_UM = 1.0
LARGEST_IMAGE = 1 << 26
EDGE = 1e-6

# Of each view: the axes (z, y, x) along the rays, down and to the right, and their signs; the
# pictures of meshes look the same ways, and nothing is mirrored.
VIEWS: dict[str, tuple[tuple[int, int, int], tuple[int, int, int]]] = {
    "z": ((0, 1, 2), (1, 1, 1)),
    "y": ((1, 0, 2), (1, -1, 1)),
    "x": ((2, 0, 1), (-1, -1, 1)),
}


@dataclass(frozen=True, eq=False)
class SurfaceProjection:
    """What lies near the surface, seen along an axis.

    Attributes
    ----------
    image : ndarray, (rows, columns) float32
        Rows go along +y seen along z, along −z seen along y and x (upwards is up); columns along
        +x, and +y seen along x. NaN where no ray comes near the surface.
    pixel_um : float
    extent : (left, right, bottom, top)
        Of the image's edges in µm, along the view's right and down, as imshow takes it.
    axis : str
    """

    image: npt.NDArray[np.float32]
    pixel_um: float
    extent: tuple[float, float, float, float]
    axis: Axis


def surface_projection(
    volume: Any,
    voxel_size: tuple[float, float, float],
    mask: Mask,
    reach_um: float = REACH_UM,
    axis: Axis = "z",
    *,
    statistic: Statistic = "max",
    pixel_um: float | None = None,
    pose: Rigid | None = None,
    box: Floats | None = None,
    progress: Progress | None = None,
) -> SurfaceProjection:
    """Project the intensities near a cell's surface along an axis.

    Intensities are read once, by trilinear interpolation where the rays come from in the
    image's own world.

    Parameters
    ----------
    volume : array-like, (z, y, x)
        Lazy or not; only what is around the cell is read.
    voxel_size : (float, float, float)
        Of it, in µm.
    mask : Mask
        The cell, cubic voxels.
    reach_um : float
        On both sides of the surface.
    axis : "z", "y" or "x"
    statistic : "max" or "mean"
    pixel_um : float, optional
        Edge of a pixel, and the step along the rays; the mask's voxel by default.
    pose : Rigid, optional
        Where the volume's world lies in the mask's.
    box : ndarray, (2, 3), optional
        The corners in µm of what is shown; the mask's own box, and the reach around it, by
        default.
    progress : Progress, optional

    Raises
    ------
    ParameterError
        The reach or the pixel is no length, or the image would be too large; there is no such
        axis or statistic.
    InputError
        The cell lies outside of the volume.
    """
    edge = mask.voxel_size[0]
    pixel = edge if pixel_um is None else float(pixel_um)
    _check(reach_um, pixel, axis, statistic)
    report = progress or silent()
    near = _padded(mask, reach_um)
    distance = signed_distance(near.data) * np.float32(edge)
    corners = box_around(mask, reach_um) if box is None else np.asarray(box, np.float64)
    first, count = _grid(corners, pixel)
    (along, down, right), signs = VIEWS[axis]
    if count[down] * count[right] > LARGEST_IMAGE:
        raise ParameterError(
            "The projection would be too large.",
            pixels=int(count[down] * count[right]),
            hint="Choose larger pixels.",
        )
    lines = [first[i] + np.arange(count[i]) * pixel for i in range(3)]
    shell = np.argwhere(np.abs(distance) <= reach_um + edge)
    image = around_cell(volume, voxel_size, mask, near.to_world(shell), pose)
    total = np.full((count[down], count[right]), -np.inf if statistic == "max" else 0.0)
    hits = np.zeros(total.shape, np.int64)
    for step, depth in enumerate(lines[along]):
        report(step / count[along], "projecting")
        plane = np.empty((*total.shape, 3))
        plane[..., along] = depth
        plane[..., down] = lines[down][:, None]
        plane[..., right] = lines[right]
        points = plane.reshape(-1, 3)
        close = np.flatnonzero(_within(near, distance, points, reach_um))
        if not len(close):
            continue
        values = intensities(image, own(points[close], pose))
        there = np.isfinite(values)
        close, values = close[there], values[there]
        hits.ravel()[close] += 1
        if statistic == "max":
            total.ravel()[close] = np.maximum(total.ravel()[close], values)
        else:
            total.ravel()[close] += values
    if statistic == "mean":
        total /= np.maximum(hits, 1)
    found = np.where(hits > 0, total, np.nan).astype(np.float32)[:: signs[1], :: signs[2]]
    return SurfaceProjection(
        np.ascontiguousarray(found), pixel, _extent(lines, down, right, signs, pixel), axis
    )


def box_around(mask: Mask, reach_um: float) -> Floats:
    """The corners (2, 3) in µm of a box around a mask's voxels and the reach beyond."""
    where = [np.flatnonzero(mask.data.any(axis=others)) for others in ((1, 2), (0, 2), (0, 1))]
    low, high = (mask.to_world([[w[end] for w in where]])[0] for end in (0, -1))
    room = reach_um + 0.5 * mask.voxel_size[0]
    return np.stack([low - room, high + room])


def _check(reach_um: float, pixel: float, axis: str, statistic: str) -> None:
    for name, value in (("reach", reach_um), ("pixel", pixel)):
        if not (np.isfinite(value) and value > 0):
            raise ParameterError(f"The {name} is a length in µm.", length_um=float(value))
    if axis not in VIEWS:
        raise ParameterError(f"There is no axis {axis!r}.", hint="Axes: z, y, x.")
    if statistic not in STATISTICS:
        raise ParameterError(
            f"There is no statistic {statistic!r}.", hint=f"Known: {', '.join(STATISTICS)}."
        )


def _padded(mask: Mask, reach_um: float) -> Mask:
    """With room for the reach, and a voxel, around it."""
    edge = mask.voxel_size[0]
    width = int(np.ceil(reach_um / edge)) + 1
    z, y, x = (float(o) - width * edge for o in mask.origin)
    return Mask(np.pad(mask.data, width), mask.voxel_size, (z, y, x))


def _grid(box: Floats, pixel: float) -> tuple[Floats, npt.NDArray[np.int64]]:
    """Whole multiples of the pixel, so that the same place is the same pixel at any time."""
    begin = np.ceil(box[0] / pixel - EDGE)
    end = np.maximum(np.floor(box[1] / pixel + EDGE), begin)
    return begin * pixel, (end - begin + 1).astype(np.int64)


def _within(
    near: Mask, distance: npt.NDArray[np.float32], points: Floats, reach_um: float
) -> npt.NDArray[np.bool_]:
    index = near.to_index(points)
    limit = np.array(near.shape) - 1
    inside = ((index >= -EDGE) & (index <= limit + EDGE)).all(axis=1)
    close = np.zeros(len(points), bool)
    found = sample_linear(distance, index[inside])
    close[inside] = np.abs(found) <= reach_um
    return close


def _extent(
    lines: list[Floats], down: int, right: int, signs: tuple[int, int, int], pixel: float
) -> tuple[float, float, float, float]:
    vertical, horizontal = (
        np.sort(sign * lines[axis])[[0, -1]] for axis, sign in ((down, signs[1]), (right, signs[2]))
    )
    half = pixel / 2
    return (
        float(horizontal[0] - half),
        float(horizontal[1] + half),
        float(vertical[1] + half),
        float(vertical[0] - half),
    )
