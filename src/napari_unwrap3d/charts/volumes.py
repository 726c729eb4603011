"""Stacks of images, volumes and masks, with their voxel size."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ..errors import AxesError, InputError, NotFiniteError, VoxelSizeMissingError

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Size3 = tuple[float, float, float]

AXES = "tczyx"

# A picometre and a metre: beyond, the unit was mistaken.
SMALLEST_VOXEL_UM, LARGEST_VOXEL_UM = 1e-6, 1e6
LARGEST_ANISOTROPY = 100.0
LARGEST_REACH_SAMPLE = 20_000


def check_voxel_size(voxel_size: Any) -> Size3:
    """Three positive finite numbers (z, y, x) in µm, or a clear error."""
    hint = "Give it as voxel_size=(z, y, x) in µm, e.g. (0.3, 0.104, 0.104)."
    if voxel_size is None:
        raise VoxelSizeMissingError("The voxel size is not known.", hint=hint)
    try:
        sizes = tuple(float(s) for s in np.atleast_1d(np.asarray(voxel_size, dtype=float)))
    except (TypeError, ValueError):
        raise InputError(
            "A voxel size has numbers only.", got=repr(voxel_size), hint=hint
        ) from None
    if len(sizes) != 3:
        raise AxesError("A voxel size has three numbers.", numbers=len(sizes), hint=hint)
    if not all(np.isfinite(s) and s > 0 for s in sizes):
        raise InputError("Voxel sizes must be positive.", voxel_size=sizes, hint=hint)
    if min(sizes) < SMALLEST_VOXEL_UM or max(sizes) > LARGEST_VOXEL_UM:
        raise InputError(
            "No microscope has such voxels; are the lengths in µm?",
            voxel_size=sizes,
            hint=f"{hint} Of a mesh in another unit, read_mesh(path, scale=...) takes the µm.",
        )
    if max(sizes) > LARGEST_ANISOTROPY * min(sizes):
        raise InputError(
            "The voxel is too long for its width: nothing is known between such slices.",
            voxel_size=sizes,
            ratio=max(sizes) / min(sizes),
            hint=f"{hint} Are all three in µm, and in the order z, y, x?",
        )
    return sizes


@dataclass(frozen=True, eq=False)
class Stack:
    """Image data as it was read: lazily, with axes, voxel size and channels.

    Attributes
    ----------
    data : array-like
        numpy or dask array, one axis per letter of `axes`. Never loaded as a whole.
    axes : str
        Letters out of ``tczyx`` in this order; ``zyx`` are always there.
    voxel_size : (float, float, float)
        (z, y, x) in µm.
    time_step : float or None
        Seconds between two timepoints; None when unknown or without a t axis.
    channels : tuple of str
        Names of the channels; empty without a c axis.
    name : str
        What the user calls it, e.g. the file's name.
    """

    data: Any
    axes: str
    voxel_size: Size3
    time_step: float | None = None
    channels: tuple[str, ...] = ()
    name: str = "stack"

    def __post_init__(self) -> None:
        object.__setattr__(self, "voxel_size", check_voxel_size(self.voxel_size))
        expected = "".join(a for a in AXES if a in self.axes)
        if self.axes != expected or not self.axes.endswith("zyx"):
            raise AxesError(
                f"The axes must be 'zyx', 'tzyx', 'czyx' or 'tczyx', not {self.axes!r}.",
                hint="Name the axes when reading, e.g. read_stack(path, axes='tzyx').",
            )
        if self.data.ndim != len(self.axes):
            raise AxesError(
                "The number of axes does not fit the data.",
                dimensions=self.data.ndim,
                axes=self.axes,
                hint="A stack is (z, y, x) with t and c in front where they exist.",
            )
        if np.dtype(self.data.dtype).kind not in "biuf":
            raise InputError(
                "The intensities of a stack are real numbers.",
                dtype=str(self.data.dtype),
                hint="Convert them first, e.g. numpy.abs(data) of complex numbers.",
            )

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(int(n) for n in self.data.shape)

    @property
    def timepoints(self) -> int:
        return self.shape[0] if "t" in self.axes else 1

    def volume(self, t: int = 0, c: int = 0) -> Any:
        """One (z, y, x) volume, still lazy."""
        data = self.data
        if "t" in self.axes:
            data = data[t]
        if "c" in self.axes:
            data = data[c]
        return data


@dataclass(frozen=True, eq=False)
class Volume:
    """Values on a regular grid in space.

    Attributes
    ----------
    data : ndarray, (z, y, x)
    voxel_size : (float, float, float)
        (z, y, x) in µm.
    origin : (float, float, float)
        Position (z, y, x) in µm of the centre of voxel (0, 0, 0).
    """

    data: Any
    voxel_size: Size3
    origin: Size3 = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "voxel_size", check_voxel_size(self.voxel_size))
        object.__setattr__(self, "origin", tuple(float(o) for o in self.origin))
        if self.data.ndim != 3:
            raise AxesError(
                "A volume has three axes (z, y, x).",
                dimensions=int(self.data.ndim),
                hint="Choose one timepoint and one channel.",
            )

    @property
    def shape(self) -> tuple[int, int, int]:
        z, y, x = self.data.shape
        return int(z), int(y), int(x)

    def to_index(self, points: npt.ArrayLike) -> Floats:
        """Points (n, 3) in µm as fractional indices (n, 3)."""
        return (np.asarray(points, dtype=float) - self.origin) / self.voxel_size

    def to_world(self, index: npt.ArrayLike) -> Floats:
        """Fractional indices (n, 3) as points (n, 3) in µm."""
        world: Floats = np.asarray(index, dtype=float) * self.voxel_size + np.asarray(self.origin)
        return world


@dataclass(frozen=True, eq=False)
class Mask(Volume):
    """Binary volume of one cell; see :class:`Volume`. `data` is bool."""

    def __post_init__(self) -> None:
        super().__post_init__()
        data = np.asarray(self.data)
        if data.dtype != np.bool_:
            if data.dtype.kind == "f" and not np.isfinite(data).all():
                raise NotFiniteError(
                    "The mask contains NaN or infinite values.",
                    voxels=int((~np.isfinite(data)).sum()),
                    hint="A mask is True inside the cell and False outside.",
                )
            values = np.unique(data)
            if len(values) > 2:
                raise InputError(
                    "A mask has two values; this looks like a label image or an intensity.",
                    values=len(values),
                    hint="Pick one label (labels == 3), or pass a Stack to have it segmented.",
                )
            data = data != 0
        object.__setattr__(self, "data", data)


@dataclass(frozen=True, eq=False)
class TemporalMask(Mask):
    """One mask for all timepoints of a movie, around which their common space is built.

    Attributes
    ----------
    ever, always : ndarray, (z, y, x) bool
        The voxels that are inside at one timepoint at least, and at all of them, on the same
        grid: the common space has to hold what lies between.
    """

    ever: Any = None
    always: Any = None

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("ever", "always"):
            if np.shape(getattr(self, name)) != self.shape:
                raise AxesError(
                    f"The voxels that are {name} inside are on the mask's grid.",
                    mask=self.shape,
                    found=np.shape(getattr(self, name)),
                )

    def reach(self, count: int = LARGEST_REACH_SAMPLE) -> Floats:
        """Points (n, 3) in µm, at most about `count`, on the borders of `ever` and `always`."""
        borders = [
            solid & ~ndimage.binary_erosion(solid, border_value=1)
            for solid in (self.ever, self.always)
        ]
        points = np.concatenate([np.argwhere(border) for border in borders])
        return self.to_world(points[:: max(len(points) // count, 1)])
