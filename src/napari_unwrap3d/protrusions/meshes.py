"""Closed meshes of the parts of a cell: one per protrusion, and one of the cortex."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ..charts import Floats, Ints, Mask, Protrusions, Surface, Volume
from ..geometry.marching import clamped_marching_cubes
from ..geometry.mesh import (
    euler_characteristic,
    face_areas,
    is_watertight,
    nonmanifold_vertices,
    signed_volume,
)
from ..geometry.remesh import simplify
from ..progress import Progress, silent

Solid = npt.NDArray[np.bool_]

CORTEX = 0
SMOOTHING_VOXELS = 1.0
# Room for the smoothing around a solid, in voxels.
MARGIN = 5
# Meshes with more vertices are simplified to a part of them.
MANY_VERTICES, KEPT_PART = 1000, 0.25


def part_meshes(
    found: Protrusions,
    *,
    only: npt.ArrayLike | None = None,
    simplified: bool = True,
    progress: Progress | None = None,
) -> dict[int, Surface]:
    """A closed mesh of every protrusion, and of the cortex.

    Marching cubes of the smoothed voxels of each part, at the level that encloses as many
    voxels as it has: smoothing alone takes a sixth of the volume of a thin filopodium. As
    in the paper (Methods, Topography guided decomposition of cell surface), a mesh with more
    than 1000 vertices is simplified to a quarter of them.

    Parameters
    ----------
    found : Protrusions
    only : array-like of int, optional
        Labels; 0 is the cortex. All, unless given.
    simplified : bool
        False keeps every vertex.
    progress : Progress, optional

    Returns
    -------
    dict of int to Surface
        Label to a closed mesh in µm with positive volume, 0 the cortex. Its report has
        ``area_um2``, ``volume_um3`` and ``voxels_um3``, the volume by the voxels. Labels
        without a voxel have no mesh.
    """
    report = progress if progress is not None else silent()
    wanted = [CORTEX, *found.columns["label"].tolist()] if only is None else [*np.unique(only)]
    boxes = ndimage.find_objects(found.volume.data, max_label=max([1, *wanted]))
    meshes = {}
    for i, label in enumerate(wanted):
        report(i / len(wanted), "meshing the parts")
        if label == CORTEX:
            solid, low = found.cortex.data, np.zeros(3)
        elif boxes[label - 1] is not None:
            solid = found.volume.data[boxes[label - 1]] == label
            low = np.array([part.start for part in boxes[label - 1]], dtype=np.float64)
        else:
            continue
        if solid.any():
            meshes[int(label)] = _mesh(solid, low, found.volume, simplified)
    report(1.0, "meshing the parts")
    return meshes


def _mesh(solid: Solid, low: Floats, grid: Volume, simplified: bool) -> Surface:
    vertices, faces = _closed(np.pad(solid, MARGIN))
    if simplified and len(vertices) > MANY_VERTICES:
        fewer = simplify(vertices, faces, int(KEPT_PART * len(vertices)))
        if is_watertight(fewer[1]) and signed_volume(*fewer) > 0:
            vertices, faces = fewer
    vertices = grid.to_world(vertices - MARGIN + low)
    report = {
        "area_um2": float(face_areas(vertices, faces).sum()),
        "volume_um3": signed_volume(vertices, faces),
        "voxels_um3": int(solid.sum()) * float(np.prod(grid.voxel_size)),
        "euler_characteristic": euler_characteristic(faces),
    }
    return Surface(vertices, faces, report=report)


def _closed(solid: Solid) -> tuple[Floats, Ints]:
    """A closed mesh of a solid, smooth unless that would pinch it or leave nothing of it."""
    for smoothing in (SMOOTHING_VOXELS, 0.5 * SMOOTHING_VOXELS):
        field = ndimage.gaussian_filter(solid.astype(np.float32), smoothing)
        # As many voxels are above the level as the solid has.
        inside = int(solid.sum())
        ordered = np.partition(field.ravel(), [-inside - 1, -inside])
        level = 0.5 * (ordered[-inside - 1] + ordered[-inside])
        vertices, faces = clamped_marching_cubes((field - level) / max(level, 1e-6))
        if is_watertight(faces) and not len(nonmanifold_vertices(faces)):
            return vertices, faces
    return clamped_marching_cubes(np.where(solid, np.float32(1), np.float32(-1)))


def meshes_against_whole(meshes: Mapping[int, Surface], mask: Mask) -> float:
    """Volume of all closed meshes against that of the cell's voxels, relative."""
    cell = int(mask.data.sum()) * float(np.prod(mask.voxel_size))
    total = sum(float(mesh.report["volume_um3"]) for mesh in meshes.values())
    return total / cell - 1.0
