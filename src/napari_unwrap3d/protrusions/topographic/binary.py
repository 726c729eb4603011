"""Which vertices are on protrusions at all (paper, "Topography guided binary segmentation")."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import sparse
from scipy.sparse import csgraph
from skimage.filters import threshold_otsu

from ...charts import Floats, Surface
from ...geometry.affinity import spread_binary
from ...geometry.mesh import edges_with_faces
from ...parameters import TopographicParameters

Bools = npt.NDArray[np.bool_]

# Of the working grid: a mask does not tell less from nothing. The mean height of a cell
# without protrusions is the noise of its voxels.
LEAST_HEIGHT_VOXELS = 0.5


def binary_protrusions(
    height_um: Floats,
    surface: Surface,
    areas: Floats,
    affinity: sparse.csr_array,
    voxel_um: float,
    parameters: TopographicParameters,
) -> tuple[Bools, dict[str, Any]]:
    """The vertices (n,) that stand out, and the numbers on the way.

    Two classes spread over each other, protrusions and background. With the paper's chance of
    ¼ a straight front of protrusions moves on for ever, slowly; what is far from all that
    is above the threshold is therefore held to be background.

    Parameters
    ----------
    height_um : ndarray, (n,)
        Over the baseline.
    surface : Surface
    areas : ndarray, (n,)
        Of every vertex in µm².
    affinity : sparse array, (n, n)
        Between neighbours.
    voxel_um : float
        Edge of a voxel of the working grid.
    """
    threshold = height_threshold(height_um, areas, parameters)
    if parameters.threshold != "value":
        threshold = max(threshold, LEAST_HEIGHT_VOXELS * voxel_um)
    marked = height_um >= threshold
    marked = without_small(marked, affinity, areas, parameters.smallest_start_um2)
    first = float(areas[marked].sum())
    if marked.any():
        marked = spread_binary(
            affinity,
            marked,
            ~_near(marked, surface, parameters.background_um),
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


def _near(marked: Bools, surface: Surface, reach_um: float) -> Bools:
    """The vertices at most so far, along edges, from marked ones."""
    first, second = edges_with_faces(surface.faces).vertices.T
    length = np.linalg.norm(surface.vertices[first] - surface.vertices[second], axis=1)
    edges = sparse.csr_array((length, (first, second)), shape=(len(marked),) * 2)
    distance = csgraph.dijkstra(
        edges, directed=False, indices=np.flatnonzero(marked), min_only=True, limit=reach_um
    )
    return np.asarray(distance <= reach_um)


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
