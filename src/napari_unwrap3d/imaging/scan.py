"""One pass through a lazy volume, slab by slab: what is in it, and where the cell lies.

Never more than a slab and a coarse copy is in memory; the cell's box is read afterwards.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Size3, Volume
from ..errors import InputError, NotFiniteError
from ..progress import Progress

SLAB_BYTES = 32 * 2**20
COARSE_VOXELS = 1 << 21
LISTED = 30

Box = tuple[slice, slice, slice]


@dataclass(frozen=True)
class Scan:
    """What one pass found.

    Attributes
    ----------
    coarse : ndarray, float32
        Means over blocks of voxels.
    factors : (int, int, int)
        Voxels per block along z, y, x.
    two_values : bool
        Nothing but a smaller and a larger value occurs.
    lowest, highest : float
    """

    coarse: npt.NDArray[np.float32]
    factors: tuple[int, int, int]
    two_values: bool
    lowest: float
    highest: float


def slabs(volume: Any) -> Iterator[tuple[int, npt.NDArray[Any]]]:
    """First index and values of slabs of whole planes, in the pieces the volume is stored in."""
    depth = int(volume.shape[0])
    chunks = getattr(volume, "chunks", None)
    if chunks and isinstance(chunks[0], tuple):
        edges = np.concatenate([[0], np.cumsum(chunks[0])])
    else:
        plane = int(np.prod(volume.shape[1:])) * volume.dtype.itemsize
        edges = np.append(np.arange(0, depth, max(1, SLAB_BYTES // max(plane, 1))), depth)
    for start, stop in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        yield start, np.asarray(volume[start:stop])


def scan(volume: Any, voxel_size: Size3, progress: Progress) -> Scan:
    """Read a volume once and keep its block means.

    Raises
    ------
    NotFiniteError
        There are NaN or infinite values; with their number.
    """
    factors = coarse_factors(volume.shape, voxel_size)
    shape = tuple(-(-int(n) // f) for n, f in zip(volume.shape, factors, strict=True))
    total = np.zeros(shape)
    rows, columns = (np.arange(0, n, f) for n, f in zip(volume.shape[1:], factors[1:], strict=True))
    extremes = _Extremes()
    not_finite = 0
    for start, slab in slabs(volume):
        progress(start / volume.shape[0], "reading")
        with np.errstate(over="ignore"):
            values = slab.astype(np.float32)
        if slab.dtype.kind == "f":
            not_finite += int((~np.isfinite(values)).sum())
        extremes.add(slab)
        blocks = np.add.reduceat(np.add.reduceat(values, rows, axis=1), columns, axis=2)
        np.add.at(total, (start + np.arange(len(slab))) // factors[0], blocks)
    if not_finite:
        raise NotFiniteError(
            "The stack contains NaN or infinite values.",
            voxels=not_finite,
            of=int(np.prod(volume.shape)),
            hint="Replace them (e.g. by the background) before unwrapping; numbers beyond "
            "±3e38 count as infinite.",
        )
    counts = [
        np.minimum(f, n - f * np.arange(m))
        for n, f, m in zip(volume.shape, factors, shape, strict=True)
    ]
    total /= counts[0][:, None, None] * counts[1][:, None] * counts[2]
    lowest, highest = extremes.lowest, extremes.highest
    return Scan(total.astype(np.float32), factors, extremes.only_two, lowest, highest)


class _Extremes:
    """The smallest and largest value so far, and whether there was any other."""

    def __init__(self) -> None:
        self.lowest, self.highest = np.inf, -np.inf
        self.only_two = True

    def add(self, values: npt.NDArray[Any]) -> None:
        low, high = float(values.min()), float(values.max())
        if self.only_two:
            met = {self.lowest, self.highest, low, high} - {np.inf, -np.inf}
            self.only_two = len(met) <= 2 and bool(((values == low) | (values == high)).all())
        self.lowest, self.highest = min(self.lowest, low), max(self.highest, high)


def coarse_factors(shape: tuple[int, ...], voxel_size: Size3) -> tuple[int, int, int]:
    """Voxels per block so that blocks are about cubes and at most 2²¹ of them are kept."""
    extent = float(np.prod(np.asarray(shape) * np.asarray(voxel_size)))
    edge = (extent / COARSE_VOXELS) ** (1 / 3)
    z, y, x = (max(1, int(np.ceil(edge / size - 0.5))) for size in voxel_size)
    return z, y, x


def box_of(found: npt.NDArray[np.bool_]) -> Box:
    """The smallest box that holds every True voxel (there must be one)."""
    sides = []
    for axis in range(3):
        others = tuple(a for a in range(3) if a != axis)
        index = np.flatnonzero(found.any(axis=others))
        sides.append(slice(int(index[0]), int(index[-1]) + 1))
    return sides[0], sides[1], sides[2]


def grown(box: Box, by: Floats | npt.NDArray[np.int64], shape: tuple[int, ...]) -> Box:
    """A box grown by `by` (3, 2) voxels before and after each axis, within the image."""
    sides = [
        slice(max(0, side.start - int(before)), min(int(n), side.stop + int(after)))
        for side, (before, after), n in zip(box, by, shape, strict=True)
    ]
    return sides[0], sides[1], sides[2]


def box_of_value(volume: Any, value: float, progress: Progress) -> Box | None:
    """The smallest box that holds every voxel of this value, or None without one."""
    along = [np.zeros(int(n), dtype=bool) for n in volume.shape]
    for start, slab in slabs(volume):
        progress(start / volume.shape[0], "looking for the cell")
        found = slab == value
        along[0][start : start + len(slab)] = found.any(axis=(1, 2))
        along[1] |= found.any(axis=(0, 2))
        along[2] |= found.any(axis=(0, 1))
    if not along[0].any():
        return None
    index = [np.flatnonzero(a) for a in along]
    sides = [slice(int(i[0]), int(i[-1]) + 1) for i in index]
    return sides[0], sides[1], sides[2]


def labels_in(volume: Any) -> npt.NDArray[Any]:
    """Every value but 0 that occurs in a label image."""
    found = np.unique(np.concatenate([np.unique(slab) for _, slab in slabs(volume)]))
    labels: npt.NDArray[Any] = found[found != 0]
    return labels


def missing_label(volume: Any, label: int) -> InputError:
    """The error for a label that does not occur, listing those that do."""
    present = labels_in(volume)
    listed = ", ".join(str(value) for value in present[:LISTED])
    more = f" and {len(present) - LISTED} more" if len(present) > LISTED else ""
    return InputError(
        f"There is no label {label} in this label image.",
        labels=len(present),
        hint=f"Labels: {listed or 'none'}{more}.",
    )


def read_box(volume: Any, voxel_size: Size3, box: Box) -> Volume:
    """Bring one box of a lazy volume into memory, at its place in the world."""
    data = np.asarray(volume[box])
    origin = tuple(side.start * size for side, size in zip(box, voxel_size, strict=True))
    return Volume(data, voxel_size, (origin[0], origin[1], origin[2]))
