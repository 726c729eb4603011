"""Which vertices are on protrusions at all (paper, "Topography guided binary segmentation")."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse import csgraph
from skimage.filters import threshold_otsu

from ...charts import Floats
from ...geometry.affinity import spread_binary
from ...parameters import TopographicParameters

Bools = npt.NDArray[np.bool_]


def binary_protrusions(
    height_um: Floats,
    areas: Floats,
    affinity: sparse.csr_array,
    parameters: TopographicParameters,
) -> tuple[Bools, dict[str, Any]]:
    """The vertices (n,) that stand out, and the numbers on the way.

    Parameters
    ----------
    height_um : ndarray, (n,)
        Over the baseline.
    areas : ndarray, (n,)
        Of every vertex in µm².
    affinity : sparse array, (n, n)
        Between neighbours.
    """
    threshold = height_threshold(height_um, areas, parameters)
    # On a sphere all heights are equal but for rounding, and nothing stands out.
    marked = (height_um >= threshold) & (height_um.max() > threshold)
    marked = without_small(marked, affinity, areas, parameters.smallest_start_um2)
    first = float(areas[marked].sum())
    never = height_um < parameters.background * threshold
    if marked.any():
        marked = spread_binary(
            affinity,
            marked,
            never,
            parameters.binary_iterations,
            parameters.clamping,
            parameters.binary_chance,
        )
    marked = without_small(marked, affinity, areas, parameters.smallest_region_um2)
    total = float(areas.sum())
    return marked, {
        "threshold_um": threshold,
        "share_above_threshold": first / total,
        "share_of_area": float(areas[marked].sum()) / total,
    }


def height_threshold(height_um: Floats, areas: Floats, parameters: TopographicParameters) -> float:
    """The height in µm from which on a vertex is on a protrusion."""
    if parameters.threshold == "value":
        return parameters.threshold_um
    if parameters.threshold == "otsu" and np.ptp(height_um) > 0:
        return float(threshold_otsu(height_um))
    return float(np.average(height_um, weights=areas))


def without_small(marked: Bools, graph: sparse.csr_array, areas: Floats, smallest: float) -> Bools:
    """Only those of the connected regions of marked vertices that have at least so much area."""
    inside = np.flatnonzero(marked)
    _, part = csgraph.connected_components(graph[inside][:, inside], directed=False)
    area = np.bincount(part, areas[inside])
    kept = np.zeros_like(marked)
    kept[inside[area[part] >= smallest]] = True
    return kept
