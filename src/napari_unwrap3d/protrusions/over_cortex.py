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

from ..charts import Floats, Ints, Mask, Surface
from ..geometry.interpolate import sample_linear
from ..geometry.laplacian import vertex_mass
from ..geometry.opening import (
    Field,
    Solid,
    automatic_threshold,
    continued,
    open_by_part,
    roughness,
)
from ..geometry.topology import box_around
from ..geometry.voxel_graph import voxel_graph
from ..parameters import ProtrusionParameters
from ..progress import Progress
from .instances import find_instances
from .kinds import FOOT, KINDS, LEAST_FOOT, chosen_kind, rules_of
from .segment import Segmentation
from .volumes import down_to_cortex

Labels = npt.NDArray[np.int32]

MARGIN = 3
# Around a footprint the cell is no cortex yet: its foot widens. A part of the ball's radius.
REACH = 0.25
LEAST_REACH = 4.0  # voxels
# In voxels; one less wide or high cannot be told from the roughness of the mask.
LEAST_AREA = 60.0
LEAST_HEIGHT = 2.5
STANDS_OUT = 4.0  # deviations of the cortex over the threshold


def over_cortex(
    mask: Mask,
    surface: Surface,
    parameters: ProtrusionParameters,
    progress: Progress,
    part: float = 1.0,
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
    part : float
        Protrusions are found down to this part of the least height and width; but none that
        cannot be told from the roughness of the cortex.

    Returns
    -------
    Segmentation
        Labels in the order of decreasing volume.
    """
    cell = _Cell.of(mask, surface)
    progress(0.0, "opening the cell by a ball")
    opened, largest = open_by_part(cell.mask, parameters.radius, progress)
    radius = opened.radius
    at_vertices = sample_linear(opened.height, cell.points)

    progress(0.4, "telling protrusions apart")
    median, deviation = roughness(at_vertices)
    threshold = automatic_threshold(at_vertices)
    if parameters.threshold_um is not None:
        threshold = parameters.threshold_um / cell.voxel_um
    over = progress.run(voxel_graph, cell.mask & (opened.height > threshold))
    of_voxel = opened.height.ravel()[over.flat].astype(float)
    noticeable = median + STANDS_OUT * deviation
    least = _least(parameters, cell.voxel_um, noticeable)
    lowest = least[0] * part**2, max(least[1] * part, min(noticeable, least[1]))
    tried = {}
    for kind in KINDS if parameters.kind == "automatic" else (parameters.kind,):
        rules = rules_of(kind, threshold, parameters.join, parameters.split)
        labels = over.on_grid(progress.run(find_instances, over, of_voxel, rules))
        tried[kind] = _renumbered(labels, _large_enough(cell, labels, at_vertices, lowest))
    kind, reason = chosen_kind(tried)
    labels = tried[kind]

    progress(0.7, "carrying them down to the cortex")
    reach = max(REACH * radius, LEAST_REACH)
    height = progress.run(continued, cell.mask, opened, labels > 0, threshold, reach)
    foot = max(FOOT[kind] * radius, LEAST_FOOT)
    labels = progress.run(down_to_cortex, cell.mask, labels, height, threshold, foot)
    labels = _renumbered(labels, _by_volume(labels))
    progress(0.9, "carrying them to the surface")
    volume = np.zeros(mask.shape, np.int32)
    volume[cell.box] = labels
    numbers = {
        "largest_radius_um": largest * cell.voxel_um,
        "radius_um": radius * cell.voxel_um,
        "threshold_um": threshold * cell.voxel_um,
        "cortex_median_um": median * cell.voxel_um,
        "cortex_deviation_um": deviation * cell.voxel_um,
        "least_area_um2": least[0] * cell.voxel_um**2,
        "least_height_um": least[1] * cell.voxel_um,
        "kind": kind,
        "kind_reason": reason,
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
    """The box around the cell, the surface in its voxels, and the outermost of these."""

    mask: Solid
    box: tuple[slice, ...]
    points: Floats
    area: Floats
    voxel_um: float
    shell: Ints
    nearest: Ints

    @classmethod
    def of(cls, mask: Mask, surface: Surface) -> _Cell:
        solid = np.asarray(mask.data)
        box = box_around(solid, MARGIN)
        corner = np.array([side.start for side in box])
        # Rounded, so that of two voxels as near it is always the same one.
        points = np.round(mask.to_index(surface.vertices) - corner, 6)
        voxel_um = float(np.mean(mask.voxel_size))
        area = vertex_mass(surface.vertices, surface.faces)
        inside = np.ascontiguousarray(solid[box])
        shell = np.argwhere(inside & ~ndimage.binary_erosion(inside))
        _, nearest = KDTree(shell).query(points)
        return cls(inside, box, points, area, voxel_um, shell, nearest)

    def at_vertices(self, values: Labels) -> Labels:
        """Of the mask's outermost voxel nearest to each vertex."""
        found: Labels = values[tuple(self.shell[self.nearest].T)]
        return found


def _least(
    parameters: ProtrusionParameters, voxel_um: float, noticeable: float
) -> tuple[float, float]:
    """The least area in voxel² and the least height in voxels of a protrusion."""
    area, height = LEAST_AREA, max(LEAST_HEIGHT, noticeable)
    if parameters.least_area_um2 is not None:
        area = parameters.least_area_um2 / voxel_um**2
    if parameters.least_height_um is not None:
        height = parameters.least_height_um / voxel_um
    return area, height


def _large_enough(
    cell: _Cell, labels: Labels, height: Field, least: tuple[float, float]
) -> list[int]:
    """The labels that cover enough of the surface and are high enough."""
    of_vertex = cell.at_vertices(labels)
    count = int(labels.max(initial=0)) + 1
    area = np.bincount(of_vertex, cell.area, count) / cell.voxel_um**2
    top = np.zeros(count)
    np.maximum.at(top, of_vertex, height)
    kept = (area >= least[0]) & (top >= least[1])
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
