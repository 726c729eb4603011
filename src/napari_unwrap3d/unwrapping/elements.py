"""What a vertex, a pixel or a node stands for, and means of a field that allow for it.

The mean of a field over a piece of the surface is its mean over the same piece of the uv
image with each pixel weighed by its area dA, and of a volume, over the topography, with
each node weighed by its volume dV (paper, "Bleb timeseries extraction").
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ..charts import UV, Floats, Topography, TriangleMesh
from ..errors import AxesError
from ..geometry.curvilinear import node_volumes
from ..geometry.laplacian import vertex_mass
from ..progress import Progress, silent


def elements(
    chart: TriangleMesh | UV | Topography, progress: Progress | None = None
) -> npt.NDArray[Any]:
    """Area in µm² of every vertex (n,) or pixel (N, 2N), volume in µm³ of every node (D, N, 2N).

    The volume is 0 where a column does not reach; the nodes inside the mapped mask have the
    volume of the part of the cell that the topography covers.
    """
    if isinstance(chart, UV):
        return np.asarray(chart.fields["area_um2"])
    if isinstance(chart, Topography):
        return node_volumes(chart.nodes, chart.first_layer, chart.last_layer, progress or silent())
    return vertex_mass(chart.vertices, chart.faces)


def region_mean(
    values: npt.ArrayLike, region: npt.ArrayLike | None, weights: npt.ArrayLike
) -> float:
    """Mean of a field over a region, allowing for the chart's distortion.

    Parameters
    ----------
    values : array-like
        One number per vertex, pixel or node; those that are NaN do not count.
    region : array-like of bool, or None
        Where to take the mean; None: everywhere.
    weights : array-like
        What each stands for; see :func:`elements`.

    Returns
    -------
    float
        NaN where nothing of the region has a value or a weight.

    Raises
    ------
    AxesError
        The three are not of one shape.
    """
    within = None if region is None else np.asarray(region)
    if within is not None and within.dtype != np.bool_:
        raise AxesError(
            "A region is an array of bool.",
            dtype=str(within.dtype),
            hint="Pick one label (labels == 3), or use region_means for all of them.",
        )
    labels = np.ones(np.shape(values), np.int64) if within is None else within.astype(np.int64)
    means = region_means(values, labels, weights)
    return float(means[1]) if len(means) > 1 else float("nan")


def region_means(values: npt.ArrayLike, labels: npt.ArrayLike, weights: npt.ArrayLike) -> Floats:
    """:func:`region_mean` of every label, (largest label + 1,); that of 0 is the background's."""
    field, areas = np.asarray(values, dtype=np.float64), np.asarray(weights, dtype=np.float64)
    parts = np.asarray(labels)
    if not field.shape == areas.shape == parts.shape:
        raise AxesError(
            "Values, region and weights are of one shape.",
            values=field.shape,
            region=parts.shape,
            weights=areas.shape,
        )
    if parts.dtype.kind not in "iub" or parts.min(initial=0) < 0:
        raise AxesError("Labels are integers from 0.", dtype=str(parts.dtype))
    known = np.isfinite(field)
    place, size = parts[known].astype(np.int64), int(parts.max(initial=0)) + 1
    total = np.bincount(place, areas[known], minlength=size)
    summed = np.bincount(place, areas[known] * field[known], minlength=size)
    means = np.full(size, np.nan)
    np.divide(summed, total, out=means, where=total > 0)
    return means
