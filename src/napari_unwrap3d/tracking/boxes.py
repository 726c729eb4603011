"""Boxes on the uv image, which may reach over the seam and over the poles.

Paper, Methods, "Bleb segmentation and tracking": the bounding box of every bleb on the image,
which is padded as the sphere continues. Here a box has coordinates that go on without end, and
its pixels are looked up on the sphere, so that no box ends at a border.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Ints
from ..errors import ParameterError
from ..geometry.padding import wrap_uv


@dataclass(frozen=True)
class Box:
    """Rows `top` … `bottom` − 1 and columns `left` … `right` − 1 of an endless uv image.

    Rows below 0 and from N on continue half a turn away, columns are periodic in 2N.
    """

    top: float
    left: float
    bottom: float
    right: float

    def __post_init__(self) -> None:
        if not (self.bottom > self.top and self.right > self.left):
            raise ParameterError(
                "A box has at least one row and one column.",
                rows=self.bottom - self.top,
                columns=self.right - self.left,
            )

    @property
    def area(self) -> float:
        """In pixels."""
        return (self.bottom - self.top) * (self.right - self.left)

    @property
    def centre(self) -> tuple[float, float]:
        """(v, u) of the middle, pixel centres at whole numbers."""
        return (self.top + self.bottom - 1) / 2, (self.left + self.right - 1) / 2

    def moved(self, v: float, u: float) -> Box:
        """The same box so many pixels farther."""
        return Box(self.top + v, self.left + u, self.bottom + v, self.right + u)

    def near(self, other: Box, rows: int) -> Box:
        """The same place on the sphere, in the coordinates that lie nearest to another box's."""
        v, u = other.centre
        candidates = _images(self, rows)
        # Whole turns are added to come as near as can be.
        turns = [round((u - image.centre[1]) / (2 * rows)) * 2 * rows for image in candidates]
        shifted = [image.moved(0, turn) for image, turn in zip(candidates, turns, strict=True)]
        return min(shifted, key=lambda box: np.hypot(box.centre[0] - v, box.centre[1] - u))

    def iou(self, other: Box, rows: int) -> float:
        """Intersection over union with another box, wherever the two are written."""
        here = self.near(other, rows)
        height = min(here.bottom, other.bottom) - max(here.top, other.top)
        width = min(here.right, other.right) - max(here.left, other.left)
        shared = max(height, 0.0) * max(width, 0.0)
        return shared / (here.area + other.area - shared)

    def pixels(self, rows: int) -> tuple[Ints, Ints]:
        """Rows and columns (h, w) of the image under the box's pixels.

        A box that is higher than the image, or wider than once around, has pixels twice.
        """
        v = np.arange(np.rint(self.top), np.rint(self.bottom), dtype=np.float64)
        u = np.arange(np.rint(self.left), np.rint(self.right), dtype=np.float64)
        grid = np.stack(np.meshgrid(v, u, indexing="ij"), axis=-1)
        wrapped = wrap_uv(grid.reshape(-1, 2), rows).reshape(grid.shape)
        index = np.rint(wrapped).astype(np.int64)
        return np.clip(index[..., 0], 0, rows - 1), index[..., 1] % (2 * rows)

    def cut(self, image: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """The part (h, w) of an image (N, 2N) under the box."""
        v, u = self.pixels(image.shape[0])
        part: npt.NDArray[Any] = image[v, u]
        return part

    def inside(self, rows: int) -> npt.NDArray[np.bool_]:
        """Which pixels (N, 2N) lie under the box."""
        found = np.zeros((rows, 2 * rows), bool)
        found[self.pixels(rows)] = True
        return found


def _images(box: Box, rows: int) -> list[Box]:
    """A box, and the same place seen over the north and over the south pole."""
    height = box.bottom - box.top
    over = [
        Box(-box.bottom, box.left + rows, -box.top, box.right + rows),
        Box(2 * rows - box.bottom, box.left + rows, 2 * rows - box.top, box.right + rows),
    ]
    assert all(np.isclose(each.bottom - each.top, height) for each in over)
    return [box, *over]


def overlaps(boxes: Sequence[Box], others: Sequence[Box], rows: int) -> Floats:
    """Intersection over union (n, m) of every box with every other, wherever they are written."""
    here = _corners([image for box in boxes for image in _images(box, rows)])
    there = _corners(others)
    here = here.reshape(len(boxes), 1, 3, 4)
    there = there.reshape(1, len(others), 1, 4)
    # Of the images of a box, and whole turns of them, the one that shares most counts.
    turns = np.rint((_middle(there) - _middle(here)) / (2 * rows)) * 2 * rows
    height = _shared(here[..., 0], here[..., 2], there[..., 0], there[..., 2])
    width = _shared(here[..., 1] + turns, here[..., 3] + turns, there[..., 1], there[..., 3])
    shared = (height * width).max(axis=2)
    found: Floats = shared / (_areas(here)[..., 0] + _areas(there)[..., 0] - shared)
    return found


def _corners(boxes: Sequence[Box]) -> Floats:
    corners = [(box.top, box.left, box.bottom, box.right) for box in boxes]
    return np.array(corners, np.float64).reshape(-1, 4)


def _middle(corners: Floats) -> Floats:
    middle: Floats = (corners[..., 1] + corners[..., 3]) / 2
    return middle


def _areas(corners: Floats) -> Floats:
    area: Floats = (corners[..., 2] - corners[..., 0]) * (corners[..., 3] - corners[..., 1])
    return area


def _shared(low: Floats, high: Floats, other_low: Floats, other_high: Floats) -> Floats:
    """How long two intervals lie over each other."""
    shared: Floats = np.maximum(np.minimum(high, other_high) - np.maximum(low, other_low), 0.0)
    return shared


def bounding_box(region: npt.NDArray[np.bool_]) -> Box:
    """The smallest box around a region (N, 2N), over the seam or over a pole where that is smaller.

    Raises
    ------
    ParameterError
        The region is empty.
    """
    v, u = np.nonzero(region)
    return box_of_pixels(v, u, region.shape[0])


def bounding_boxes(labels: npt.NDArray[np.integer[Any]]) -> dict[int, Box]:
    """The box of every label of an image (N, 2N), by label; 0 is no label."""
    v, u = np.nonzero(labels)
    present, first = np.unique(labels[v, u], return_inverse=True)
    order = np.argsort(first, kind="stable")
    parts = np.split(order, np.searchsorted(first[order], np.arange(1, len(present))))
    rows = labels.shape[0]
    named = zip(present.tolist(), parts, strict=False)
    return {label: box_of_pixels(v[part], u[part], rows) for label, part in named}


def box_of_pixels(v: Ints, u: Ints, rows: int) -> Box:
    """The smallest box around pixels (n,) of an image with N rows; see :func:`bounding_box`."""
    if len(v) == 0:
        raise ParameterError("An empty region has no box.")
    candidates = [_around_seam(v, u, rows)]
    # Over a pole: what lies on the far side of it is written beyond the first, or last, row.
    middle = _azimuth_of_axis(u, rows)
    far = np.abs((u - middle + rows) % (2 * rows) - rows) > rows / 2
    if far.any() and not far.all():
        turned = np.where(far, u + rows, u)
        candidates.append(_around_seam(np.where(far, -1 - v, v), turned, rows))
        candidates.append(_around_seam(np.where(far, 2 * rows - 1 - v, v), turned, rows))
    return min(candidates, key=lambda box: box.area)


def _azimuth_of_axis(u: Ints, rows: int) -> float:
    """The column of a plane through the poles that pixels lie along, on either side of them.

    Angles are doubled, so that half a turn apart is the same.
    """
    angle = 2 * (u + 0.5) * np.pi / rows
    mean = np.arctan2(np.sin(angle).mean(), np.cos(angle).mean()) / 2
    return float(mean * rows / np.pi - 0.5)


def _around_seam(v: Ints, u: Ints, rows: int) -> Box:
    """The box of pixels whose columns are periodic: the widest gap is left out."""
    columns: Floats = np.unique(u % (2 * rows)).astype(np.float64)
    after = np.append(columns[1:], columns[0] + 2 * rows)
    widest = int(np.argmax(after - columns))
    left = float(after[widest] % (2 * rows))
    width = 2 * rows - float(after[widest] - columns[widest]) + 1
    return Box(float(v.min()), left, float(v.max()) + 1, left + width)
