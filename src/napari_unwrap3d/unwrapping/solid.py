"""The solid of a mesh: its voxels on an isotropic working grid."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..charts import Mask, Surface
from ..errors import NotWatertightError
from ..geometry.mesh import (
    connected_components,
    degenerate_faces,
    is_consistently_wound,
    is_watertight,
    nonmanifold_vertices,
    signed_volume,
)
from ..geometry.repair import repair_mesh
from ..geometry.voxelize import winding_number

# Without a given working voxel, the longest edge of the bounding box has this many.
AUTOMATIC_VOXELS = 200
MARGIN_VOXELS = 8


def closed_mesh(mesh: Surface) -> Surface:
    """The mesh itself if it is one closed manifold wound outwards, else repaired, with a report.

    Neither has a vertex without a face. Fields are kept; a vertex that was added has the
    value of the one it stands for.

    Raises
    ------
    SeveralCellsError, NotWatertightError, NotManifoldError, MeshError
        It cannot be repaired; see :func:`~napari_unwrap3d.geometry.repair.repair_mesh`.
    """
    if _is_sound(mesh):
        return mesh
    mended = repair_mesh(mesh.vertices, mesh.faces)
    repairs = mended.report["repairs"]
    if not repairs:
        return mesh
    fields = {name: np.asarray(values)[mended.origin] for name, values in mesh.fields.items()}
    earlier = list(mesh.report.get("repairs", ()))
    report = {**mesh.report, **mended.report, "repairs": earlier + repairs}
    return Surface(mended.vertices, mended.faces, fields, report=report)


def _is_sound(mesh: Surface) -> bool:
    vertices, faces = mesh.vertices, mesh.faces
    return (
        is_watertight(faces)
        and is_consistently_wound(faces)
        and int(connected_components(faces, len(vertices))[0].max()) == 0
        and bool((np.bincount(faces.ravel(), minlength=len(vertices)) > 0).all())
        and len(nonmanifold_vertices(faces)) == 0
        and not degenerate_faces(vertices, faces).any()
        and signed_volume(vertices, faces) > 0
    )


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
        ``working_voxel_um``, ``voxels`` and whether the voxel was chosen automatically;
        ``repairs`` where the mesh intersects itself.

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
    winding = winding_number((mesh.vertices - origin) / edge, mesh.faces, (depth, height, width))
    solid = winding > 0
    if not solid.any():
        raise NotWatertightError(
            "The mesh encloses no voxel.",
            working_voxel_um=edge,
            longest_edge_um=float((high - low).max()),
            hint="Choose a smaller working voxel, or check that the mesh is in µm "
            "(read_mesh(path, scale=...)) and closed.",
        )
    z, y, x = (float(o) for o in origin)
    report: dict[str, Any] = {
        "working_voxel_um": edge,
        "working_voxel_automatic": working_voxel_um is None,
        "voxels": int(solid.sum()),
    }
    overlaps = (
        ("taken once where the mesh encloses them twice, as it intersects itself", winding > 1),
        ("left out where the mesh encloses them inside out, as it intersects itself", winding < 0),
    )
    repairs = [
        {"what": f"voxels were {what}", "count": int(voxels.sum())}
        for what, voxels in overlaps
        if voxels.any()
    ]
    if repairs:
        report["repairs"] = repairs
    return Mask(solid, (edge, edge, edge), (z, y, x)), report
