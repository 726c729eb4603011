"""The nodes of the topography next to the surface, and values of the surface at them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from .atlas import Atlas
from .charts import Floats, Ints
from .geometry.near import nearest_vertices

# How far from the surface a node may lie, so that the shell is wide enough to be drawn on.
NEAR_VOXELS = 2.0

Values = npt.NDArray[np.float32]


def surface_index(atlas: Atlas) -> Floats:
    """Where the surface's vertices lie in the topography, in nodes (d layer, v, u) (n, 3)."""
    chart = atlas.topography
    index = chart.surface.copy()
    index[:, 0] = (index[:, 0] - chart.d_um[0]) / (chart.d_um[1] - chart.d_um[0])
    return index


def nearest_at_nodes(atlas: Atlas) -> npt.NDArray[np.int32]:
    """The vertex of the surface nearest to each node (D, N, 2N) next to it, −1 elsewhere."""
    chart = atlas.topography
    reach = NEAR_VOXELS * atlas.voxel_um
    step = float(chart.d_um[1] - chart.d_um[0])
    return nearest_vertices(
        surface_index(atlas),
        atlas.surface.vertices,
        atlas.surface.faces,
        chart.shape,
        reach,
        (math.ceil(reach / step), 1, 1),
        chart.positions,
        (chart.first_layer[1:-1], chart.last_layer[1:-1]),
        periodic=True,
    )


@dataclass(frozen=True)
class Shell:
    """The nodes next to the surface.

    Attributes
    ----------
    shape : (D, N, 2N)
        Of the topography.
    flat : ndarray, (k,) int64
        Flat indices of the nodes, in order.
    vertex : ndarray, (k,) int32
        The vertex of the surface nearest to each.
    """

    shape: tuple[int, int, int]
    flat: Ints
    vertex: npt.NDArray[np.int32]

    @classmethod
    def of(cls, atlas: Atlas) -> Shell:
        """That of an atlas with its topography; takes about a second for 300 000 faces."""
        nearest = nearest_at_nodes(atlas)
        flat = np.flatnonzero(nearest.ravel() >= 0)
        return cls(atlas.topography.shape, flat, nearest.ravel()[flat])

    def within(self, mask: npt.NDArray[np.bool_]) -> Shell:
        """The nodes of the shell that lie in a mask (D, N, 2N)."""
        inside = mask.ravel()[self.flat]
        return Shell(self.shape, self.flat[inside], self.vertex[inside])

    @cached_property
    def starts(self) -> Ints:
        """Where each layer begins among the nodes, and the end (D + 1,)."""
        layers, rows, columns = self.shape
        return np.searchsorted(self.flat, np.arange(layers + 1) * rows * columns)

    @property
    def layer(self) -> Ints:
        """The layer of each node (k,)."""
        return np.repeat(np.arange(self.shape[0]), np.diff(self.starts))


class ShellVolume:
    """Values at the nodes of a shell, NaN elsewhere, read like an array (D, N, 2N).

    One layer is (N, 2N); several layers together are read as their projection (1, N, 2N), in
    which nodes without a value do not count. So a slice costs as much as it has nodes, and a
    whole topography, of hundreds of megabytes, is never filled.

    Parameters
    ----------
    shell : Shell
    values : ndarray, (k,)
        One per node of the shell.

    Attributes
    ----------
    projection : "max" or "mean"
        What several layers are read as.
    """

    ndim = 3
    dtype = np.dtype(np.float32)

    def __init__(self, shell: Shell, values: npt.ArrayLike) -> None:
        self.shell, self.values = shell, np.asarray(values, np.float32)
        self.projection = "max"

    @property
    def shape(self) -> tuple[int, int, int]:
        return self.shell.shape

    @property
    def size(self) -> int:
        return math.prod(self.shape)

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, index: Any) -> Values:
        first, *others = index if isinstance(index, tuple) else (index,)
        if isinstance(first, slice):
            low, high, step = first.indices(len(self))
            if step != 1:
                raise IndexError("Layers are read one by one, or all between two.")
            several: Values = self._between(low, high)[(slice(None), *others)]
            return several
        layer = range(len(self))[first]
        found: Values = self._between(layer, layer + 1)[(0, *others)]
        return found

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> npt.NDArray[Any]:
        """The whole volume, filled."""
        found = np.full(self.size, np.nan, self.dtype)
        found[self.shell.flat] = self.values
        return found.reshape(self.shape).astype(dtype or self.dtype, copy=False)

    def _between(self, low: int, high: int) -> Values:
        """Layers from `low` to before `high`, as one (1, N, 2N)."""
        _, rows, columns = self.shape
        part = slice(*self.shell.starts[[low, max(low, high)]])
        pixel, values = self.shell.flat[part] % (rows * columns), self.values[part]
        found = np.full(rows * columns, np.nan, self.dtype)
        if high - low == 1:
            found[pixel] = values
        elif self.projection == "max":
            np.fmax.at(found, pixel, values)
        else:
            known = np.isfinite(values)
            pixel, values = pixel[known], values[known]
            count = np.bincount(pixel, minlength=rows * columns)
            total = np.bincount(pixel, weights=values, minlength=rows * columns)
            np.divide(total, count, out=found, where=count > 0, casting="same_kind")
        return found.reshape(1, rows, columns)
