"""Step 6: the surface in (d, u, v): its own mesh cut for drawing, and the mapped mask's."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ..charts import Floats, Ints
from ..errors import EmptyMaskError
from ..geometry.curvilinear import in_columns
from ..geometry.marching import clamped_marching_cubes
from ..geometry.parallel import ranges, run_blocks
from ..progress import Progress, silent

QUANTUM = 1e-4
ROWS_PER_BLOCK = 64


def cut_at_seam(image: Floats, faces: Ints, rows: int) -> tuple[Floats, Ints, Ints]:
    """Cut a mesh in (d, v, u) along the seam so that no face spans the image.

    Parameters
    ----------
    image : ndarray, (n, 3)
        (d µm, v, u) per vertex, NaN where a vertex has no image.
    faces : ndarray, (m, 3)
    rows : int
        N; the image is 2N wide.

    Returns
    -------
    vertices : ndarray, (p, 3)
        Vertices doubled at the seam, the copies at u + 2N.
    faces : ndarray, (k, 3)
        Without faces that have a corner without image.
    origin : ndarray, (p,)
        The vertex each one is a copy of.
    """
    mapped = np.asarray(np.isfinite(image).all(axis=1))
    kept = faces[mapped[faces].all(axis=1)]
    u = image[:, 2][kept]
    shift = (np.ptp(u, axis=1) > rows)[:, None] & (u < rows)
    origin, place = np.unique(kept + shift * len(image), return_inverse=True)
    copied = origin >= len(image)
    origin = np.where(copied, origin - len(image), origin)
    vertices = image[origin].copy()
    vertices[copied, 2] += 2.0 * rows
    return vertices, place.reshape(kept.shape), origin


def mesh_mapped_mask(
    level: npt.NDArray[Any], smoothing: float, progress: Progress | None = None
) -> tuple[Floats, Ints]:
    """Marching cubes of the mapped mask, closed over the seam and the poles.

    Parameters
    ----------
    level : ndarray, (D, N + 2, 2N) float32 or bool
        Positive inside the cell, at the nodes of a topography.
    smoothing : float
        Gaussian σ, in layers, of the binarised level (the paper's way); 0 meshes the level
        itself.
    progress : Progress, optional

    Returns
    -------
    vertices : ndarray, (p, 3)
        Grid coordinates (layer, row, column).
    faces : ndarray, (q, 3)
        Outward in space.
    """
    report = progress if progress is not None else silent()
    field = _SmoothedLevel(level, smoothing)
    vertices, faces = _march_in_blocks(field, report)
    # (d, v, u) is a left-handed frame of (z, y, x): turn the faces over.
    return _weld(vertices, faces[:, ::-1], level.shape[1], level.shape[2])


class _SmoothedLevel:
    """The level, smoothed, a block of rows at a time: all of it would be the largest array.

    Layers below and above all changes of sign are left out.
    """

    def __init__(self, level: npt.NDArray[Any], smoothing: float) -> None:
        self._level, self._smoothing = level, smoothing
        # How far ndimage's Gaussian reaches.
        self._reach = int(4.0 * smoothing + 0.5)
        self.rows = level.shape[1]
        self.inside = float(np.mean([(layer > 0).mean() for layer in level]))
        full = [bool((layer > 0).all()) for layer in level]
        some = [bool((layer > 0).any()) for layer in level]
        lowest = full.index(False) if False in full else len(full)
        highest = len(some) - some[::-1].index(True) if True in some else 0
        self.first = max(min(lowest - self._reach - 1, len(level) - 2), 0)
        self._stop = min(max(highest, lowest) + self._reach + 1, len(level))

    def block(self, first: int, stop: int) -> npt.NDArray[np.float32]:
        """Rows first … stop − 1 from layer `first` on, the first column again at the end."""
        begin, end = max(first - self._reach, 0), min(stop + self._reach, self.rows)
        values = self._level[self.first : self._stop, begin:end]
        if self._smoothing:
            values = ndimage.gaussian_filter(
                (values > 0).astype(np.float32),
                self._smoothing,
                mode=("nearest", "nearest", "wrap"),
            )
            values -= np.float32(0.5)
        values = values[:, first - begin : stop - begin]
        values = np.concatenate([values, values[:, :, :1]], axis=2, dtype=np.float32)
        if self._smoothing:
            # Smoothing must not open the pole rows, whose columns are one and the same point.
            for pole in {0, self.rows - 1} & set(range(first, stop)):
                row = values[:, pole - first]
                row[:] = row[:, :-1].mean(axis=1, keepdims=True)
        if self._stop == len(self._level):
            values[-1] = np.minimum(values[-1], -np.float32(0.5))
        return values


def faces_in_columns(
    vertices: Floats, faces: Ints, first_layer: Ints, last_layer: Ints
) -> tuple[Floats, Ints]:
    """Without the faces that lie where a column has ended.

    Beyond its end a column stays where it is, so that the mapped mask changes between
    columns that end at different places: a wall that the cell does not have.

    Parameters
    ----------
    vertices : ndarray, (p, 3)
        Grid coordinates (layer, row, column).
    faces : ndarray, (q, 3)
    first_layer, last_layer : ndarray, (rows, columns) int64
        The layers that each column reaches.
    """
    corners = vertices[faces]
    # A face over the seam has corners at both ends of the row.
    over_seam = np.ptp(corners[:, :, 2], axis=1) > first_layer.shape[1] / 2
    column = corners[:, :, 2] + over_seam[:, None] * (
        (corners[:, :, 2] < first_layer.shape[1] / 2) * first_layer.shape[1]
    )
    centre = np.column_stack([corners[:, :, :2].mean(axis=1), column.mean(axis=1)])
    inside = in_columns(centre, first_layer, last_layer)
    if inside.all():
        return vertices, faces
    used, renumbered = np.unique(faces[inside], return_inverse=True)
    return vertices[used], renumbered.reshape(-1, 3)


def _march_in_blocks(field: _SmoothedLevel, progress: Progress) -> tuple[Floats, Ints]:
    """Marching cubes of blocks of rows that share their first and last row.

    One call for the whole would keep every other thread, and so a cancellation, waiting
    for seconds.
    """

    def march(rows: slice) -> tuple[Floats, Ints] | None:
        block = field.block(rows.start, min(rows.stop + 1, field.rows))
        if not block.max() > 0 > block.min():
            return None
        vertices, faces = clamped_marching_cubes(block)
        vertices[:, :2] += (field.first, rows.start)
        return vertices, faces

    blocks = ranges(field.rows - 1, ROWS_PER_BLOCK)
    parts = run_blocks(march, blocks, progress, "meshing the topographic surface")
    pieces = [part for part in parts if part is not None]
    if not pieces:
        raise EmptyMaskError(
            "There is no surface in the topography: the mapped mask is empty or full.",
            fraction_inside=field.inside,
            hint="Check the mask, or give the topography a greater depth.",
        )
    start = np.cumsum([0, *(len(vertices) for vertices, _ in pieces)])
    faces = [part + begin for (_, part), begin in zip(pieces, start, strict=False)]
    return np.concatenate([vertices for vertices, _ in pieces]), np.concatenate(faces)


def _weld(vertices: Floats, faces: Ints, rows: int, columns: int) -> tuple[Floats, Ints]:
    """Join the vertices that meet at the seam, at the poles and between blocks of rows.

    Faces that collapse are dropped.
    """
    layer, row, column = vertices.T
    at_pole = (row <= 0.0) | (row >= rows - 1.0)
    between = np.mod(row, ROWS_PER_BLOCK) == 0.0
    special = np.flatnonzero(at_pole | between | (column <= 0.0) | (column >= columns))
    around = np.where(at_pole, 0.0, np.mod(column, columns))[special]
    places = (layer[special], row[special], around)
    key = np.stack([np.rint(place / QUANTUM).astype(np.int64) for place in places])
    # Sorted by column, row and layer; equal ones stay in their order.
    order = np.lexsort(key)
    new = np.append(True, (np.diff(key[:, order], axis=1) != 0).any(axis=0))[: len(order)]
    target = np.arange(len(vertices))
    target[special[order]] = special[order[np.flatnonzero(new)]][np.cumsum(new) - 1]
    welded = target[faces]
    keep = (
        (welded[:, 0] != welded[:, 1])
        & (welded[:, 1] != welded[:, 2])
        & (welded[:, 2] != welded[:, 0])
    )
    used, renumbered = np.unique(welded[keep], return_inverse=True)
    return vertices[used], renumbered.reshape(-1, 3)
