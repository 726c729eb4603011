"""The default method: what stands out of the cell opened by a ball.

It looks at the mask and the surface only, so that the result does not depend on the axis, nor
on anything else of the unwrapping.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from scipy.spatial import KDTree

from ..charts import Floats, Mask, Surface
from ..geometry.interpolate import sample_linear
from ..geometry.laplacian import vertex_mass
from ..geometry.topology import box_around
from ..geometry.voxel_graph import voxel_graph
from ..parameters import ProtrusionParameters
from ..progress import Progress
from .cortex import Field, Solid, continued, depth, largest_radius, opening
from .instances import Rules, automatic_threshold, find_instances, roughness
from .segment import Segmentation
from .volumes import down_to_cortex

Labels = npt.NDArray[np.int32]

MARGIN = 3
# Around a footprint the cell is no cortex yet: its foot widens. A part of the ball's radius.
REACH = 0.25
# And how far around what stands over the threshold that foot is a part of the protrusion.
FOOT = 0.11
# In voxels; one less wide or high cannot be told from the roughness of the mask.
LEAST_AREA = 60.0
LEAST_HEIGHT = 2.5
STANDS_OUT = 4.0  # deviations of the cortex over the threshold


def over_cortex(
    mask: Mask, surface: Surface, parameters: ProtrusionParameters, progress: Progress
) -> Segmentation:
    """Protrusions as what stands out of the cell opened by a ball.

    Parameters
    ----------
    mask : Mask
        Isotropic.
    surface : Surface
        Of this mask.
    parameters : ProtrusionParameters
    progress : Progress

    Returns
    -------
    Segmentation
        Labels in the order of decreasing volume.
    """
    cell = _Cell.of(mask, surface)
    progress(0.0, "opening the cell by a ball")
    largest = progress.run(largest_radius, cell.mask)
    radius = parameters.radius * largest
    opened = progress.run(opening, progress.run(depth, cell.mask, radius), radius)
    at_vertices = sample_linear(opened.height, cell.points)

    progress(0.4, "telling protrusions apart")
    rules = _rules(at_vertices, parameters, cell.voxel_um)
    labels = progress.run(_instances, cell.mask, opened.height, rules)
    labels = _renumbered(labels, _large_enough(cell, labels, at_vertices, parameters))

    progress(0.7, "carrying them down to the cortex")
    reach = REACH * radius
    height = progress.run(continued, cell.mask, opened, labels > 0, rules.threshold, reach)
    foot = FOOT * radius
    labels = progress.run(down_to_cortex, cell.mask, labels, height, rules.threshold, foot)
    labels = _renumbered(labels, _by_volume(labels))
    progress(0.9, "carrying them to the surface")
    volume = np.zeros(mask.shape, np.int32)
    volume[cell.box] = labels
    numbers = {
        "largest_radius_um": largest * cell.voxel_um,
        "radius_um": radius * cell.voxel_um,
        "threshold_um": rules.threshold * cell.voxel_um,
        "kind": parameters.kind,
        "kind_reason": "chosen" if parameters.kind != "automatic" else "all kinds alike",
    }
    return Segmentation(
        labels=cell.at_vertices(labels),
        height_um=sample_linear(height, cell.points).astype(float) * cell.voxel_um,
        volume=volume,
        cortex=np.asarray(mask.data) & (volume == 0),
        numbers=numbers,
    )


@dataclass(frozen=True, eq=False)
class _Cell:
    """The box around the cell, and the surface in its voxels."""

    mask: Solid
    box: tuple[slice, ...]
    points: Floats
    area: Floats
    voxel_um: float

    @classmethod
    def of(cls, mask: Mask, surface: Surface) -> _Cell:
        solid = np.asarray(mask.data)
        box = box_around(solid, MARGIN)
        corner = np.array([side.start for side in box])
        points = mask.to_index(surface.vertices) - corner
        voxel_um = float(np.mean(mask.voxel_size))
        area = vertex_mass(surface.vertices, surface.faces)
        return cls(np.ascontiguousarray(solid[box]), box, points, area, voxel_um)

    def at_vertices(self, values: Labels) -> Labels:
        """Of the mask's outermost voxel nearest to each vertex."""
        inner = ndimage.binary_erosion(self.mask, border_value=0)
        shell = np.argwhere(self.mask & ~inner)
        _, nearest = KDTree(shell).query(self.points)
        found: Labels = values[tuple(shell[nearest].T)]
        return found


def _rules(height: Field, parameters: ProtrusionParameters, voxel_um: float) -> Rules:
    given = parameters.threshold_um
    threshold = automatic_threshold(height) if given is None else given / voxel_um
    return Rules(threshold, own=parameters.join, split=parameters.split, least=2.0)


def _instances(mask: Solid, height: Field, rules: Rules) -> Labels:
    graph = voxel_graph(mask & (height > rules.threshold))
    of_node = height.ravel()[graph.flat].astype(float)
    return graph.on_grid(find_instances(graph, of_node, rules))


def _large_enough(
    cell: _Cell, labels: Labels, height: Field, parameters: ProtrusionParameters
) -> list[int]:
    """The labels that cover enough of the surface and are high enough."""
    of_vertex = cell.at_vertices(labels)
    count = int(labels.max(initial=0)) + 1
    area = np.bincount(of_vertex, cell.area, count)
    top = np.zeros(count)
    np.maximum.at(top, of_vertex, height)
    least_area, least_height = parameters.least_area_um2, parameters.least_height_um
    if least_area is None:
        least_area = LEAST_AREA * cell.voxel_um**2
    if least_height is None:
        median, deviation = roughness(height)
        least_height = max(LEAST_HEIGHT, median + STANDS_OUT * deviation) * cell.voxel_um
    kept = (area >= least_area) & (top * cell.voxel_um >= least_height)
    return [int(label) for label in np.flatnonzero(kept) if label > 0]


def _by_volume(labels: Labels) -> list[int]:
    voxels = np.bincount(labels.ravel())
    order = np.argsort(-voxels, kind="stable")
    return [int(label) for label in order if label > 0 and voxels[label] > 0]


def _renumbered(labels: Labels, kept: list[int]) -> Labels:
    """1, 2, … for the labels that are kept, in this order, and 0 for the others."""
    new = np.zeros(int(labels.max(initial=0)) + 1, np.int32)
    new[kept] = np.arange(1, len(kept) + 1)
    return new[labels]
