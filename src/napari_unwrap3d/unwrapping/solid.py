"""The solid of a mesh: its voxels on an isotropic working grid."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..charts import Mask, Surface
from ..errors import NotWatertightError
from ..geometry.mesh import (
    connected_components,
    is_consistently_wound,
    is_watertight,
    signed_volume,
)
from ..geometry.repair import repair_mesh
from ..geometry.voxelize import voxelize

# Without a given working voxel, the longest edge of the bounding box has this many.
AUTOMATIC_VOXELS = 200
MARGIN_VOXELS = 8


def closed_mesh(mesh: Surface) -> Surface:
    """The mesh itself if it is one closed piece wound outwards, else repaired, with a report.

    Fields are kept; a vertex that was added has the value of the one it stands for.

    Raises
    ------
    SeveralCellsError, NotWatertightError, NotManifoldError, MeshError
        It cannot be repaired; see :func:`~napari_unwrap3d.geometry.repair.repair_mesh`.
    """
    sound = is_watertight(mesh.faces) and is_consistently_wound(mesh.faces)
    one_piece = connected_components(mesh.faces, len(mesh.vertices))[0].max() == 0
    if sound and one_piece and signed_volume(mesh.vertices, mesh.faces) > 0:
        return mesh
    mended = repair_mesh(mesh.vertices, mesh.faces)
    fields = {name: np.asarray(values)[mended.origin] for name, values in mesh.fields.items()}
    report = {**mesh.report, **mended.report}
    return Surface(mended.vertices, mended.faces, fields, report=report)


def mask_of_mesh(mesh: Surface, working_voxel_um: float | None) -> tuple[Mask, dict[str, Any]]:
    """Voxels whose centre is inside a closed mesh.

    Parameters
    ----------
    mesh : Surface
        Watertight, positive signed volume.
    working_voxel_um : float or None
        None: 200 voxels along the longest edge of the bounding box.

    Returns
    -------
    mask : Mask
    report : dict
        ``working_voxel_um``, ``voxels`` and whether the voxel was chosen automatically.

    Raises
    ------
    NotWatertightError
        The mesh encloses no voxel.
    """
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    edge = working_voxel_um or float((high - low).max()) / AUTOMATIC_VOXELS
    origin = low - MARGIN_VOXELS * edge
    shape = np.ceil((high - low) / edge).astype(int) + 2 * MARGIN_VOXELS + 1
    depth, height, width = (int(n) for n in shape)
    solid = voxelize((mesh.vertices - origin) / edge, mesh.faces, (depth, height, width))
    if not solid.any():
        raise NotWatertightError(
            "The mesh encloses no voxel.",
            working_voxel_um=edge,
            hint="Check that the mesh is closed, or choose a smaller working voxel.",
        )
    z, y, x = (float(o) for o in origin)
    report = {
        "working_voxel_um": edge,
        "working_voxel_automatic": working_voxel_um is None,
        "voxels": int(solid.sum()),
    }
    return Mask(solid, (edge, edge, edge), (z, y, x)), report
