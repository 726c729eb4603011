"""Tables from pixels to vertices and back, read for a brush's worth of them at a time."""

from __future__ import annotations

import math

import numba
import numpy as np
import numpy.typing as npt

from ..charts import Ints
from ..errors import AxesError

Index = npt.NDArray[np.int32]
Labels = npt.NDArray[np.uint16]


class Rows:
    """A few numbers for every row.

    Parameters
    ----------
    rows : ndarray, (k,)
        The row of each number; those of −1 are left out.
    items : ndarray, (k,)
        The numbers.
    count : int
        How many rows there are.
    """

    def __init__(self, rows: npt.NDArray[np.integer], items: npt.NDArray[np.integer], count: int):
        known = rows >= 0
        if not known.all():
            rows, items = rows[known], items[known]
        self._start = np.concatenate([[0], np.cumsum(np.bincount(rows, minlength=count))])
        self._items = _counted(rows, np.asarray(items, np.int64), self._start)

    def of(self, rows: npt.NDArray[np.integer]) -> Ints:
        """The numbers of some rows, one row's after the other's."""
        first = self._start[rows]
        count = self._start[np.asarray(rows) + 1] - first
        end = np.cumsum(count)
        total = int(end[-1]) if len(end) else 0
        found: Ints = self._items[np.repeat(first - end + count, count) + np.arange(total)]
        return found


@numba.njit(nogil=True, cache=True)
def _counted(rows, items, start):  # type: ignore[no-untyped-def]
    """The items in the order of their rows."""
    place = start[:-1].copy()
    result = np.empty_like(items)
    for i in range(len(rows)):
        result[place[rows[i]]] = items[i]
        place[rows[i]] += 1
    return result


class Places:
    """The few places of a large grid that matter, numbered in order.

    Parameters
    ----------
    chosen : ndarray of bool
        Of the grid's shape.
    """

    def __init__(self, chosen: npt.NDArray[np.bool_]) -> None:
        flat = chosen.ravel()
        self.flat: Ints = np.flatnonzero(flat)
        bits = np.packbits(np.pad(flat, (0, -len(flat) % 64)), bitorder="little")
        self._words = bits.view("<u8")
        counts = np.bitwise_count(self._words).astype(np.int64)
        self._before = np.cumsum(counts) - counts

    def rank(self, flat: npt.NDArray[np.integer]) -> Ints:
        """The numbers of flat indices (k,), −1 for those that do not matter."""
        index = np.asarray(flat, np.int64)
        word, bit = self._words[index >> 6], (index & 63).astype(np.uint64)
        one = np.uint64(1)
        below = np.bitwise_count(word & ((one << bit) - one)).astype(np.int64)
        present = ((word >> bit) & one).astype(bool)
        return np.where(present, self._before[index >> 6] + below, -1)


class Owners:
    """Which vertices of the surface the pixels of a chart show, and which they mark.

    Parameters
    ----------
    shape : tuple of int
        Of the chart's image.
    size : int
        Number of vertices of the surface.
    shown : ndarray, (k,)
        The vertex whose label each pixel shows, −1 for none.
    marked : Rows
        The vertices that drawing in each pixel (or group of pixels) marks.
    group : ndarray, (k,), optional
        The row of `marked` for every pixel, −1 for none; unless given its own number.
    places : Places, optional
        Which pixels of the image the k are; all unless given.
    """

    def __init__(
        self,
        shape: tuple[int, ...],
        size: int,
        shown: npt.NDArray[np.integer],
        marked: Rows,
        group: npt.NDArray[np.integer] | None = None,
        places: Places | None = None,
    ) -> None:
        self.shape = shape
        self._shown: Index = np.asarray(shown, np.int32)
        self._marked, self._group, self._places = marked, group, places
        flat = np.arange(len(shown)) if places is None else places.flat
        self._pixels = Rows(self._shown, flat, size)

    def touched(self, pixels: npt.NDArray[np.integer]) -> Ints:
        """The vertices, sorted, that drawing in pixels (flat indices) marks."""
        rows = self._known(pixels)
        if self._group is not None:
            group = np.unique(self._group[rows])
            rows = np.asarray(group[group >= 0], np.int64)
        return np.unique(self._marked.of(rows))

    def owned(self, vertices: npt.NDArray[np.integer]) -> Ints:
        """The pixels (flat indices) that show any of the vertices (each at most once)."""
        return self._pixels.of(vertices)

    def values(self, pixels: npt.NDArray[np.integer], labels: Labels) -> Labels:
        """What pixels (flat indices) show of labels (n,); 0 where they show no vertex."""
        place = pixels if self._places is None else self._places.rank(pixels)
        vertex = np.where(place >= 0, self._shown[place], -1)
        return np.where(vertex >= 0, labels[vertex], 0).astype(labels.dtype)

    def display(self, labels: Labels) -> Labels:
        """The whole image of labels (n,)."""
        shown = np.where(self._shown >= 0, labels[self._shown], 0).astype(labels.dtype)
        if self._places is None:
            return shown.reshape(self.shape)
        image = np.zeros(math.prod(self.shape), labels.dtype)
        image[self._places.flat] = shown
        return image.reshape(self.shape)

    def _known(self, pixels: npt.NDArray[np.integer]) -> Ints:
        """The numbers among the k of those pixels that are."""
        if self._places is None:
            return np.asarray(pixels, np.int64)
        rank = self._places.rank(pixels)
        return rank[rank >= 0]


def flat_indices(indices: tuple[npt.ArrayLike, ...], shape: tuple[int, ...]) -> Ints:
    """Flat indices of pixels.

    Raises
    ------
    AxesError
        They are of another number of axes, or lie outside of the image.
    """
    arrays = tuple(np.atleast_1d(np.asarray(axis)) for axis in indices)
    if len(arrays) != len(shape) or any(axis.dtype.kind not in "iu" for axis in arrays):
        raise AxesError(
            "Pixels are given by one array of whole numbers per axis.",
            axes=len(arrays),
            expected=len(shape),
        )
    try:
        return np.asarray(np.ravel_multi_index(arrays, shape), np.int64).ravel()
    except ValueError as error:
        raise AxesError(f"Pixels lie outside of the image: {error}.", shape=shape) from error
