"""A spread cell: a flat bottom, a thin lamella all around, a dome in the middle."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numba
import numpy as np
import numpy.typing as npt

from ..charts import Floats
from ..geometry.rigid import Rigid
from .moments import Moment

SPACING_UM = 0.08
BEYOND = 1.12  # how far the maps reach, in parts of the mean radius
EDGE_UM = 0.7
MODES = np.arange(2, 7)
INNER, OUTER = 0.45, 0.88  # of the lamella, in parts of the outline's radius

Map = npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Lamella:
    """The body of a spread cell, as maps over its bottom.

    Positions over the bottom are (a, b) in µm from its middle; maps are (a, b) arrays.

    Attributes
    ----------
    origin : ndarray, (3,)
        Middle (z, y, x) of the bottom in µm, in the cell's own world.
    frame : ndarray, (3, 3)
        Rows are the unit vectors up, along a and along b.
    radius_um : float
        Mean radius of the outline.
    amplitudes, phases : ndarray, (5,)
        Relative waves of the outline's radius, two to six around the cell.
    thickness_um, dome_um, dome_width_um : float
        Of the lamella; what the dome adds in the middle; its standard deviation.
    """

    origin: Floats
    frame: Floats
    radius_um: float
    amplitudes: Floats
    phases: Floats
    thickness_um: float
    dome_um: float
    dome_width_um: float

    def __reduce__(self) -> Any:
        # Without the maps, which are made again in no time.
        return type(self), tuple(getattr(self, one.name) for one in fields(self))

    @property
    def up(self) -> Floats:
        return np.asarray(self.frame[0])

    def outline(self, azimuth: npt.ArrayLike) -> Floats:
        """Radius in µm of the outline at angles from a towards b."""
        waves = np.cos(np.asarray(azimuth)[..., None] * MODES + self.phases)
        radius: Floats = self.radius_um * (1.0 + waves @ self.amplitudes)
        return radius

    def top(self, radius: npt.ArrayLike) -> Floats:
        """Height in µm of the upper side, that far from the middle."""
        fall = np.exp(-0.5 * (np.asarray(radius) / self.dome_width_um) ** 4)
        height: Floats = self.thickness_um + self.dome_um * fall
        return height

    def point(self, height: npt.ArrayLike, radius: npt.ArrayLike, azimuth: npt.ArrayLike) -> Floats:
        """Points (..., 3) in µm in the cell's own world."""
        radii, angle = np.asarray(radius), np.asarray(azimuth)
        local = np.stack(
            np.broadcast_arrays(height, radii * np.cos(angle), radii * np.sin(angle)), axis=-1
        )
        points: Floats = self.origin + local @ self.frame
        return points

    def samples(self, count: int) -> Floats:
        """Points (count, 3) in µm on the upper side and on the bottom, away from the edge."""
        per_side = np.array([(count + 1) // 2, count // 2])
        found = []
        for number, side in zip(per_side, (1.0, 0.0), strict=True):
            index = np.arange(number) + 0.5
            azimuth = np.pi * (1.0 + np.sqrt(5.0)) * index
            radius = OUTER * np.sqrt(index / max(number, 1)) * self.outline(azimuth)
            found.append(self.point(side * self.top(radius), radius, azimuth))
        return np.concatenate(found)

    # Maps ---------------------------------------------------------------------------

    @cached_property
    def polar(self) -> tuple[Floats, Floats]:
        """Radius in µm and azimuth of every pixel of the maps."""
        half = int(np.ceil(BEYOND * self.radius_um / SPACING_UM))
        axis = np.arange(-half, half + 1) * SPACING_UM
        a, b = np.meshgrid(axis, axis, indexing="ij")
        return np.hypot(a, b), np.arctan2(b, a)

    @cached_property
    def side(self) -> Map:
        """Distance in µm beyond the outline, to first order."""
        radius, azimuth = self.polar
        outline = self.outline(azimuth)
        slope = np.gradient(outline - radius, SPACING_UM)
        distance = (radius - outline) / np.sqrt(slope[0] ** 2 + slope[1] ** 2 + 1e-6)
        return np.asarray(distance, np.float32)

    @cached_property
    def bare(self) -> Floats:
        """Height in µm of the upper side without anything on it."""
        return self.top(self.polar[0])

    @cached_property
    def zone(self) -> npt.NDArray[np.bool_]:
        """Which pixels are lamella: outside of the dome, inside of the edge."""
        radius, azimuth = self.polar
        part = radius / self.outline(azimuth)
        return np.asarray((part > INNER) & (part < OUTER))

    def moment(
        self,
        height: Floats,
        owner: npt.NDArray[np.int32],
        signal: Floats,
        curvature: Floats,
        pose: Rigid,
        size: int,
        voxel_um: float,
    ) -> Moment:
        """The cell whose upper side has a height (a, b) in µm, on the working grid.

        Parameters
        ----------
        height, signal, curvature : ndarray, (a, b)
        owner : ndarray, (a, b) int32
            The label of what stands there.
        pose : Rigid
            From the cell's own world to that of the grid.
        size, voxel_um
            Of the grid.
        """
        shape = (size,) * 3
        field, bare = np.empty(shape, np.float32), np.empty(shape, np.float32)
        labels = np.zeros(shape, np.int32)
        signals, curvatures = np.empty(shape, np.float32), np.empty(shape, np.float32)
        maps = np.stack(
            [height, upright(height), self.bare, upright(self.bare), self.side, signal, curvature],
            axis=-1,
        ).astype(np.float32)
        back = pose.inverse()
        turn = self.frame @ back.rotation * voxel_um
        shift = self.frame @ (back.translation - self.origin)
        _raise(
            maps, owner, turn, shift, SPACING_UM, EDGE_UM, field, bare, labels, signals, curvatures
        )
        mask, body = field < 0, bare < 0
        labels[~mask | body] = 0
        return Moment(field, mask, body, labels, signals, curvatures)


def draw_lamella(
    rng: np.random.Generator, middle: Floats, up: Floats, half_extent_um: float
) -> Lamella:
    """A random spread cell that fits into a cube.

    Parameters
    ----------
    rng : numpy.random.Generator
    middle : ndarray, (3,)
        Of the cube.
    up : ndarray, (3,)
        Unit vector.
    half_extent_um : float
        Half the edge of the cube.
    """
    along = np.cross(up, [0.0, 0.0, 1.0])
    along /= np.linalg.norm(along)
    frame = np.stack([up, along, np.cross(up, along)])
    amplitudes = rng.uniform(0.3, 1.0, len(MODES)) / MODES
    amplitudes *= rng.uniform(0.03, 0.05) / np.sqrt(0.5 * (amplitudes**2).sum())
    phases = rng.uniform(0, 2 * np.pi, len(MODES))
    thickness = 0.18 * half_extent_um
    shape = Lamella(
        np.zeros(3), frame, 1.0, amplitudes, phases, 0.18, rng.uniform(0.32, 0.42), 0.33
    )
    azimuth = np.linspace(0, 2 * np.pi, 400)
    rim = shape.outline(azimuth)
    # The lamella carries ruffles, which are as high as it is.
    hull = np.concatenate(
        [
            shape.point(0.0, rim, azimuth),
            shape.point(2 * shape.thickness_um, rim, azimuth),
            shape.point(shape.top(0.0), 0.25, azimuth),
        ]
    )
    low, high = hull.min(axis=0), hull.max(axis=0)
    scale = 2 * half_extent_um / float((high - low).max())
    return Lamella(
        middle - scale * (low + high) / 2,
        frame,
        scale,
        amplitudes,
        phases,
        max(thickness, shape.thickness_um * scale),
        shape.dome_um * scale,
        shape.dome_width_um * scale,
    )


def upright(height: Floats) -> Floats:
    """Cosine (a, b) of the slope of a height in µm."""
    slope = np.gradient(height, SPACING_UM)
    cosine: Floats = 1.0 / np.sqrt(1.0 + slope[0] ** 2 + slope[1] ** 2)
    return cosine


def mean_curvature(height: Floats) -> Floats:
    """Of the upper side, in 1/µm; positive on crests."""
    slope = np.gradient(height, SPACING_UM)
    cosine = 1.0 / np.sqrt(1.0 + slope[0] ** 2 + slope[1] ** 2)
    bent = [np.gradient(s * cosine, SPACING_UM, axis=i) for i, s in enumerate(slope)]
    curvature: Floats = -0.5 * (bent[0] + bent[1])
    return curvature


@numba.njit(nogil=True, cache=True)
def _rounded(a, b, width):  # type: ignore[no-untyped-def]
    """The maximum, rounded off where both are alike."""
    overlap = max(width - abs(a - b), 0.0)
    return max(a, b) + overlap * overlap / (4.0 * width)


@numba.njit(nogil=True, cache=True)
def _raise(maps, owner, turn, shift, spacing, edge, field, bare, labels, signals, curvatures):  # type: ignore[no-untyped-def]
    """Signed distances and labels of voxels from maps over the bottom."""
    rows, columns = owner.shape
    values = np.empty(maps.shape[2], np.float64)
    for i in range(field.shape[0]):
        for j in range(field.shape[1]):
            for k in range(field.shape[2]):
                up = turn[0, 0] * i + turn[0, 1] * j + turn[0, 2] * k + shift[0]
                a = turn[1, 0] * i + turn[1, 1] * j + turn[1, 2] * k + shift[1]
                b = turn[2, 0] * i + turn[2, 1] * j + turn[2, 2] * k + shift[2]
                x = min(max(a / spacing + rows // 2, 0.0), rows - 1.001)
                y = min(max(b / spacing + columns // 2, 0.0), columns - 1.001)
                m, n = int(x), int(y)
                fx, fy = x - m, y - n
                for c in range(values.size):
                    values[c] = (
                        maps[m, n, c] * (1 - fx) * (1 - fy)
                        + maps[m + 1, n, c] * fx * (1 - fy)
                        + maps[m, n + 1, c] * (1 - fx) * fy
                        + maps[m + 1, n + 1, c] * fx * fy
                    )
                walls = _rounded(-up, values[4], edge)
                field[i, j, k] = _rounded((up - values[0]) * values[1], walls, edge)
                bare[i, j, k] = _rounded((up - values[2]) * values[3], walls, edge)
                labels[i, j, k] = owner[int(x + 0.5), int(y + 0.5)]
                signals[i, j, k] = values[5]
                curvatures[i, j, k] = values[6]
