"""The table of protrusions: what each of them measures, with units."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from ..charts import MOTIFS, Floats, Ints, Mask, Surface
from ..geometry.laplacian import vertex_mass
from ..unwrapping.uv import direction_to_uv, uv_to_direction
from .columns import COLUMNS
from .segment import Segmentation
from .solid_measures import measure_solids

Columns = dict[str, npt.NDArray[Any]]

CURVATURE = "mean_curvature_per_um"
# The guess of the motif; see the column's meaning.
LONG = 2.0
TINY = np.finfo(np.float64).tiny


def measure_protrusions(
    found: Segmentation,
    mask: Mask,
    surface: Surface,
    image: Floats,
    *,
    rows: int | None = None,
    only: npt.ArrayLike | None = None,
) -> Columns:
    """The table of protrusions by its columns, a row per label.

    Parameters
    ----------
    found : Segmentation
    mask : Mask
        The cell on the working grid.
    surface : Surface
        With the field ``mean_curvature_per_um``; without it, curvatures are NaN.
    image : ndarray, (n, 3)
        The surface's vertices in (d µm, v, u), NaN where they have no image.
    rows : int, optional
        Of the uv image; without them, v and u are NaN.
    only : array-like of int, optional
        Labels to measure; every one there is otherwise. What is measured of a label does not
        depend on which others are.

    Returns
    -------
    dict of str to ndarray, (k,)
        In the order of :data:`.columns.COLUMNS`, which define them; rows in the order of the
        labels. Labels without a vertex or a voxel have zeros and NaN where these are needed.
    """
    labels = present(found) if only is None else np.unique(np.asarray(only, np.int64))
    weights = vertex_mass(surface.vertices, surface.faces)
    columns = _of_surface(found, surface, weights, labels)
    columns |= _in_uv(found.labels, weights, image, rows, labels)
    solid = measure_solids(found.volume, found.cortex, mask.voxel_size[0], labels)
    columns |= solid
    columns["aspect"] = _ratio(columns["height_max_um"], columns["width_um"])
    ball = np.cbrt(np.pi) * np.cbrt(6 * columns["volume_um3"]) ** 2
    columns["sphericity"] = _ratio(ball, columns["area_um2"] + columns["base_area_um2"])
    columns["motif"] = _motifs(columns)
    return {name: columns[name] for name in COLUMNS}


def parts_against_whole(found: Segmentation, mask: Mask) -> dict[str, Any]:
    """Whether cortex and protrusions add up to the cell.

    Returns
    -------
    dict
        ``cell_um3``, ``cortex_um3``, ``protrusions_um3`` by the voxels;
        ``parts_difference``, cortex and protrusions together against the cell, relative.
    """
    voxel = float(np.prod(mask.voxel_size))
    cell, cortex = int(mask.data.sum()), int(found.cortex.sum())
    protrusions = int(np.count_nonzero(found.volume))
    return {
        "cell_um3": cell * voxel,
        "cortex_um3": cortex * voxel,
        "protrusions_um3": protrusions * voxel,
        "parts_difference": (cortex + protrusions) / max(cell, 1) - 1.0,
    }


def _ratio(above: Floats, below: Floats) -> Floats:
    """NaN where it is not defined."""
    ratio = np.full(len(above), np.nan)
    np.divide(above, below, out=ratio, where=below > 0)
    return ratio


def present(found: Segmentation) -> Ints:
    """The labels that there are, on the surface or in the volume, (k,) int64, sorted."""
    there = np.zeros(1 + max(found.labels.max(initial=0), found.volume.max(initial=0)), bool)
    there[found.labels] = True
    there |= np.bincount(found.volume.ravel(), minlength=len(there)) > 0
    there[0] = False
    return np.flatnonzero(there)


def replaced_rows(columns: Mapping[str, npt.NDArray[Any]], fresh: Columns, gone: Ints) -> Columns:
    """The table without the rows of labels that are gone, and with others measured anew."""
    stay = ~np.isin(columns["label"], [*gone, *fresh["label"]])
    order = np.argsort(np.concatenate([columns["label"][stay], fresh["label"]]), kind="stable")
    return {name: np.concatenate([columns[name][stay], fresh[name]])[order] for name in COLUMNS}


# On the surface ------------------------------------------------------------------------


def _of_surface(found: Segmentation, surface: Surface, weights: Floats, labels: Ints) -> Columns:
    """Measures of the surface; `weights` is a third of the area of the faces at each vertex."""
    # Sums run in the order of the vertices: the same, whichever labels are chosen.
    inside, row = _rows(found.labels, labels)
    area = np.bincount(row, weights[inside], len(labels))
    curvature = surface.fields.get(CURVATURE, np.full(len(weights), np.nan))

    def mean(values: Floats) -> Floats:
        total = np.bincount(row, (weights * values)[inside], len(labels))
        mean = np.full(len(labels), np.nan)
        np.divide(total, area, out=mean, where=area > 0)
        return mean

    def largest(values: Floats) -> Floats:
        top = np.full(len(labels), np.nan)
        np.fmax.at(top, row, values[inside])
        return top

    z, y, x = (mean(part) for part in surface.vertices.T)
    return {
        "label": labels,
        "vertices": np.bincount(row, minlength=len(labels)),
        "area_um2": area,
        "height_max_um": largest(found.height_um),
        "height_mean_um": mean(found.height_um),
        "mean_curvature_per_um": mean(curvature),
        "mean_curvature_max_per_um": largest(curvature),
        "touching": _touching(found.labels, surface.faces, labels),
        "z_um": z,
        "y_um": y,
        "x_um": x,
    }


def _rows(of_vertex: npt.NDArray[np.int32], labels: Ints) -> tuple[Ints, Ints]:
    """The vertices with one of these labels, in their order, and the row of each."""
    size = 1 + max(int(labels.max(initial=0)), int(of_vertex.max(initial=0)))
    table = np.full(size, -1, np.int64)
    table[labels] = np.arange(len(labels))
    row = table[of_vertex]
    inside = np.flatnonzero(row >= 0)
    return inside, row[inside]


def _touching(of_vertex: npt.NDArray[np.int32], faces: Ints, labels: Ints) -> Ints:
    """How many other labels each of these has as a neighbour along an edge."""
    corners = of_vertex[faces].astype(np.int64)
    ends = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2)
    ends = ends[(ends[:, 0] != ends[:, 1]) & (ends > 0).all(axis=1)]
    pairs = np.unique(np.sort(ends, axis=1), axis=0)
    size = 1 + max(int(labels.max(initial=0)), int(of_vertex.max(initial=0)))
    count: Ints = np.bincount(pairs.ravel(), minlength=size)[labels]
    return count


# In (u, v) -----------------------------------------------------------------------------


def _in_uv(
    of_vertex: npt.NDArray[np.int32],
    weights: Floats,
    image: Floats,
    rows: int | None,
    labels: Ints,
) -> Columns:
    """Row and column of the mean direction, where there is one."""
    vu = np.full((len(labels), 2), np.nan)
    if rows is not None and len(labels):
        mapped = np.isfinite(image).all(axis=1)
        inside, row = _rows(np.where(mapped, of_vertex, 0), labels)
        directions = uv_to_direction(image[inside, 1:], rows) * weights[inside, None]
        total = np.stack([np.bincount(row, part, len(labels)) for part in directions.T], axis=1)
        length = np.linalg.norm(total, axis=1)
        there = length > 0
        vu[there] = direction_to_uv(total[there] / length[there, None], rows)
    return {"v_px": vu[:, 0], "u_px": vu[:, 1]}


# Motifs --------------------------------------------------------------------------------


def _motifs(columns: Columns) -> npt.NDArray[np.int8]:
    """A guess by the shape, as an index into MOTIFS; the rule is the column's meaning."""
    sheet = columns["base_elongation"] >= LONG
    tube = columns["length_um"] >= LONG * np.maximum(columns["breadth_um"], TINY)
    number = {motif: np.int8(i) for i, motif in enumerate(MOTIFS)}
    other = np.where(tube, number["filopodium"], number["bleb"])
    return np.where(sheet, number["lamellipodium"], other)
