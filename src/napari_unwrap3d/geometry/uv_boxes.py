"""Sums over many boxes of uv images at once, over the seam and over the poles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class BoxSums:
    """What is summed over the two parts of every box: [:, 0] on what is marked, [:, 1] off it.

    Attributes
    ----------
    pixels : ndarray, (k, 2)
        How many pixels there are; those that a box holds twice count once.
    area : ndarray, (k, 2)
        Of those whose area is known.
    weight : ndarray, (k, 2, F)
        The area over which each image is known.
    total : ndarray, (k, 2, F)
        The images times the area.
    """

    pixels: Floats
    area: Floats
    weight: Floats
    total: Floats

    def means(self, part: int | None = None) -> Floats:
        """Mean of every image (k, F) on (0) or off (1), or over the whole box; NaN of nothing."""
        weight = self.weight.sum(axis=1) if part is None else self.weight[:, part]
        total = self.total.sum(axis=1) if part is None else self.total[:, part]
        means: Floats = np.divide(total, weight, out=np.full(total.shape, np.nan), where=weight > 0)
        return means


def label_sums(
    images: npt.NDArray[Any],
    areas: npt.NDArray[Any],
    corners: npt.ArrayLike,
    labels: npt.NDArray[Any],
    wanted: npt.ArrayLike,
) -> BoxSums:
    """Sums over boxes, on and off a label of each.

    Parameters
    ----------
    images : ndarray, (F, N, 2N)
        NaN where a value is not known.
    areas : ndarray, (N, 2N)
        Of the pixels.
    corners : array-like, (k, 4)
        Rows `top` … `bottom` − 1 and columns `left` … `right` − 1 of an endless image, in the
        order (top, left, bottom, right); they are rounded.
    labels : ndarray, (N, 2N) int
    wanted : array-like, (k,) int
        The label that is marked in each box; negative: none.
    """
    given = (np.asarray(wanted, np.int64), np.asarray(labels, np.int64))
    return _sums(images, areas, corners, *given, np.zeros((1, 1), np.bool_))


def largest_part_sums(
    images: npt.NDArray[Any],
    areas: npt.NDArray[Any],
    corners: npt.ArrayLike,
    marked: npt.NDArray[np.bool_],
) -> BoxSums:
    """Sums over boxes, on and off the largest connected part (of pixels) of what is marked.

    Parameters
    ----------
    images, areas, corners
        As for :func:`label_sums`.
    marked : ndarray, (N, 2N) bool
        Parts are connected within a box, also by corners.
    """
    none = np.zeros(len(np.asarray(corners)), np.int64)
    return _sums(images, areas, corners, none, np.zeros((1, 1), np.int64), marked)


def _sums(
    images: npt.NDArray[Any],
    areas: npt.NDArray[Any],
    corners: npt.ArrayLike,
    wanted: Ints,
    labels: Ints,
    marked: npt.NDArray[np.bool_],
) -> BoxSums:
    boxes = np.rint(np.asarray(corners, np.float64)).astype(np.int64).reshape(-1, 4)
    stacked = np.ascontiguousarray(images, np.float64)
    count, fields = len(boxes), len(stacked)
    pixels, area = np.zeros((count, 2)), np.zeros((count, 2))
    weight, total = np.zeros((count, 2, fields)), np.zeros((count, 2, fields))
    _add_boxes(
        stacked,
        np.ascontiguousarray(areas, np.float64),
        boxes,
        np.ascontiguousarray(wanted),
        np.ascontiguousarray(labels),
        np.ascontiguousarray(marked),
        (pixels, area, weight, total),
    )
    return BoxSums(pixels, area, weight, total)


@numba.njit(nogil=True, cache=True)
def _place(row, column, rows):  # type: ignore[no-untyped-def]
    """The pixel of the image that lies under one of the endless image."""
    if row < 0:
        row, column = -1 - row, column + rows
    elif row >= rows:
        row, column = 2 * rows - 1 - row, column + rows
    return min(max(row, 0), rows - 1), column % (2 * rows)


@numba.njit(nogil=True, cache=True)
def _add_boxes(images, areas, boxes, wanted, labels, marked, sums):  # type: ignore[no-untyped-def]
    rows, columns = areas.shape
    pixels, area, weight, total = sums
    by_label = labels.shape[0] > 1
    seen = np.full((rows, columns), -1, np.int64)
    for k in range(len(boxes)):
        top, left, bottom, right = boxes[k]
        if by_label:
            on = np.zeros((1, 1), np.bool_)
        else:
            on = _largest_part(marked, top, left, bottom, right)
        for i in range(bottom - top):
            for j in range(right - left):
                row, column = _place(top + i, left + j, rows)
                if seen[row, column] == k:
                    continue
                seen[row, column] = k
                here = labels[row, column] == wanted[k] if by_label else on[i, j]
                part = 0 if here else 1
                pixels[k, part] += 1.0
                size = areas[row, column]
                if not size > 0:
                    continue
                area[k, part] += size
                for f in range(len(images)):
                    value = images[f, row, column]
                    if np.isfinite(value):
                        weight[k, part, f] += size
                        total[k, part, f] += size * value


@numba.njit(nogil=True, cache=True)
def _largest_part(marked, top, left, bottom, right):  # type: ignore[no-untyped-def]
    """Which pixels (h, w) of a box belong to the largest part of what is marked."""
    rows = marked.shape[0]
    height, width = bottom - top, right - left
    part = np.zeros((height, width), np.int64)
    stack = np.empty((height * width, 2), np.int64)
    best, largest, count = 0, 0, 0
    for i in range(height):
        for j in range(width):
            row, column = _place(top + i, left + j, rows)
            if part[i, j] != 0 or not marked[row, column]:
                continue
            count += 1
            part[i, j] = count
            stack[0, 0], stack[0, 1] = i, j
            depth, size = 1, 0
            while depth > 0:
                depth -= 1
                y, x = stack[depth, 0], stack[depth, 1]
                size += 1
                for a in range(max(y - 1, 0), min(y + 2, height)):
                    for b in range(max(x - 1, 0), min(x + 2, width)):
                        row, column = _place(top + a, left + b, rows)
                        if part[a, b] == 0 and marked[row, column]:
                            part[a, b] = count
                            stack[depth, 0], stack[depth, 1] = a, b
                            depth += 1
            if size > largest:
                best, largest = count, size
    return (part == best) & (part > 0)
