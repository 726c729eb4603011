"""Which vertex of the surface speaks for which voxel, when a person edits protrusions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree

from ..charts import Floats, Ints, Protrusions, Surface
from ..geometry.distance import distance_to

Labels = npt.NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Ownership:
    """Voxels whose label is that of a vertex.

    A voxel of a protrusion belongs to the nearest vertex of this protrusion. A voxel of the
    cortex belongs to the nearest vertex without a protrusion if that is as high over the
    cortex, at least, as it is far away. So what is painted around a foot takes what is over
    the cortex there, and the labels that were found give the volume that was found.

    Attributes
    ----------
    voxel : ndarray, (n,) int64
        Flat indices on the mask's grid.
    vertex : ndarray, (n,) int64
    """

    voxel: Ints
    vertex: Ints

    @classmethod
    def of(cls, base: Protrusions, surface: Surface) -> Ownership:
        """Who owns what, given what was found."""
        parts = [*_of_protrusions(base, surface.vertices), _of_cortex(base, surface.vertices)]
        voxel, vertex = (np.concatenate(part) for part in zip(*parts, strict=True))
        return cls(voxel, vertex)

    def relabelled(self, volume: Labels, labels: Labels) -> tuple[Labels, Ints]:
        """The volume by labels of vertices, and the voxels (flat) that differ from `volume`."""
        now = labels[self.vertex]
        differs = np.flatnonzero(volume.ravel()[self.voxel] != now)
        changed = self.voxel[differs]
        fresh = volume.copy()
        fresh.ravel()[changed] = now[differs]
        return fresh, changed


def _of_protrusions(base: Protrusions, vertices: Floats) -> list[tuple[Ints, Ints]]:
    volume = base.volume.data.ravel()
    voxels = np.flatnonzero(volume)
    voxels = voxels[np.argsort(volume[voxels], kind="stable")]
    speakers = np.flatnonzero(base.labels)
    speakers = speakers[np.argsort(base.labels[speakers], kind="stable")]
    parts = []
    for label in np.unique(base.labels[speakers]):
        own, mine = _with(label, volume, voxels), _with(label, base.labels, speakers)
        _, nearest = KDTree(vertices[mine]).query(_places(base, own))
        parts.append((own, mine[nearest]))
    return parts


def _with(label: int, labels: Labels, ordered: Ints) -> Ints:
    """Those of the places, which are ordered by label, that have this one."""
    of_place = labels[ordered]
    return ordered[slice(*np.searchsorted(of_place, [label, label + 1]))]


def _of_cortex(base: Protrusions, vertices: Floats) -> tuple[Ints, Ints]:
    speakers = np.flatnonzero((base.labels == 0) & (base.height_um > 0))
    nothing = np.zeros(0, np.int64)
    if len(speakers) == 0:
        return nothing, nothing
    reach = float(base.height_um[speakers].max())
    cell = base.cortex.data | (base.volume.data > 0)
    # From the surface a voxel's centre is at least about half a voxel less far than this.
    depth = distance_to(~cell)
    near = base.cortex.data & (depth <= reach / min(base.volume.voxel_size) + 1.0)
    voxels = np.flatnonzero(near)
    apart, nearest = KDTree(vertices[speakers]).query(_places(base, voxels))
    owned = apart <= base.height_um[speakers[nearest]]
    return voxels[owned], speakers[nearest[owned]]


def _places(base: Protrusions, voxels: Ints) -> Floats:
    index = np.stack(np.unravel_index(voxels, base.volume.shape), axis=1)
    return base.volume.to_world(index)
