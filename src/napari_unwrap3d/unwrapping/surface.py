"""From the mask to the surface as it is, and to the sealed surface of genus 0."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ..charts import Ints, Mask, SealedSurface, Surface
from ..errors import EmptyMaskError, TooSmallError
from ..geometry.curvature import angle_deficit, mean_curvature
from ..geometry.distance import signed_distance
from ..geometry.handles import ball_without_handles
from ..geometry.marching import clamped_marching_cubes, field_with_sign
from ..geometry.mesh import (
    connected_components,
    euler_characteristic,
    is_watertight,
    mesh_report,
)
from ..geometry.repair import repair
from ..geometry.topology import fill_cavities, sealed_parts
from ..geometry.voxelize import winding_number
from ..parameters import SealedParameters, SurfaceParameters
from ..progress import Progress

SMALLEST_VOXELS = 500


def smooth_solid(
    mask: npt.NDArray[np.bool_], smoothing: float
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.bool_]]:
    """The smoothed mask minus ½, and the largest component of where it is positive.

    The sign of the field is made to agree with that component, so that what falls off
    when smoothing does not come back as an island.

    Raises
    ------
    EmptyMaskError, TooSmallError
        Nothing, or next to nothing, is left.
    """
    values = mask.astype(np.float32)
    smooth = ndimage.gaussian_filter(values, smoothing) if smoothing else values
    solid = smooth > 0.5
    labels, count = ndimage.label(solid, structure=np.ones((3, 3, 3)))
    if count == 0:
        raise EmptyMaskError(
            "Nothing of the mask is left after smoothing.",
            voxels=int(mask.sum()),
            smoothing_voxels=smoothing,
            hint="Smooth less, or choose a smaller working voxel.",
        )
    sizes = np.bincount(labels.ravel())[1:]
    solid = labels == np.argmax(sizes) + 1
    if sizes.max() < SMALLEST_VOXELS:
        raise TooSmallError(
            "The object is too small to be unwrapped.",
            voxels=int(sizes.max()),
            needed=SMALLEST_VOXELS,
            hint="Choose a smaller working voxel.",
        )
    return field_with_sign(smooth - np.float32(0.5), solid), solid


def surface(
    mask: Mask, parameters: SurfaceParameters, given: Surface | None, progress: Progress
) -> Surface:
    """The surface of a mask, or a given mesh, with its curvatures.

    Parameters
    ----------
    mask : Mask
        The cell on the isotropic working grid.
    parameters : SurfaceParameters
    given : Surface or None
        A mesh that was read; its vertices and faces are kept.
    progress : Progress

    Returns
    -------
    Surface
        With the fields ``mean_curvature_per_um`` and ``gaussian_curvature`` (angle
        deficit in radians), and the report of its topology and quality. Of a mesh that
        was read, ``self_intersecting_voxels`` are those it encloses twice or inside out.
    """
    report: dict[str, Any] = {}
    if given is None:
        progress(0.1, "marching cubes")
        field, solid = smooth_solid(mask.data, parameters.smoothing_voxels)
        vertices, faces = clamped_marching_cubes(field)
        report["voxels_lost_by_smoothing"] = int((mask.data & ~solid).sum())
        if not is_watertight(faces):
            vertices, faces, repaired = repair(vertices, faces)
            report["repaired"] = repaired
        vertices = mask.to_world(vertices)
    else:
        vertices, faces = given.vertices, given.faces
        report.update(given.report)
        winding = winding_number(mask.to_index(vertices), faces, mask.shape)
        report["self_intersecting_voxels"] = int(((winding < 0) | (winding > 1)).sum())
    progress(0.4, "curvature")
    distance = signed_distance(mask.data)
    progress(0.6, "curvature")
    curvature = mean_curvature(
        distance, mask.to_index(vertices), smoothing=parameters.curvature_smoothing_voxels
    )
    progress(0.9, "measuring the mesh")
    report.update(mesh_report(vertices, faces))
    return Surface(
        vertices=vertices,
        faces=faces,
        fields={
            **(given.fields if given is not None else {}),
            "mean_curvature_per_um": curvature / mask.voxel_size[0],
            "gaussian_curvature": angle_deficit(vertices, faces),
        },
        report=report,
    )


def sealed_surface(
    mask: Mask,
    surface: Surface,
    parameters: SurfaceParameters,
    closing: SealedParameters,
    progress: Progress,
) -> SealedSurface:
    """The same cell with its handles, holes and cavities closed: genus 0, watertight.

    A handle's hole is closed by a membrane, or the handle is cut. Where nothing was
    changed its mesh is the surface's own, unless that intersects itself.
    """
    progress(0.1, "closing handles and holes")
    field, solid = smooth_solid(mask.data, parameters.smoothing_voxels)
    ball = ball_without_handles(solid, closing.handles, progress.check)
    progress(0.8, "meshing the sealed surface")
    parts = tuple(
        {
            "kind": part["kind"],
            "position_um": tuple(float(c) for c in mask.to_world(part["position"])),
            "volume_um3": part["voxels"] * float(np.prod(mask.voxel_size)),
        }
        for part in sealed_parts(solid, ball)
    )
    if is_sphere(surface.faces) and not surface.report.get("self_intersecting_voxels"):
        vertices, faces = surface.vertices, surface.faces
    else:
        index, faces = clamped_marching_cubes(field_with_sign(field, ball))
        vertices = mask.to_world(index)
    filled = fill_cavities(solid)
    return SealedSurface(
        vertices=vertices,
        faces=faces,
        mask=Mask(ball, mask.voxel_size, mask.origin),
        membranes=_mask_or_none(ball & ~filled, mask),
        cuts=_mask_or_none(filled & ~ball, mask),
        sealed=parts,
    )


def _mask_or_none(voxels: npt.NDArray[np.bool_], like: Mask) -> Mask | None:
    return Mask(voxels, like.voxel_size, like.origin) if voxels.any() else None


def is_sphere(faces: Ints) -> bool:
    """Whether a mesh is one closed piece without handles.

    The wall of a cavity is a piece of its own, so the genus alone does not tell.
    """
    closed = is_watertight(faces) and euler_characteristic(faces) == 2
    return closed and int(connected_components(faces)[0].max()) == 0


def same_mesh(sealed: SealedSurface, surface: Surface) -> bool:
    """Whether nothing had to be closed, so that the sealed surface is the surface."""
    return sealed.vertices is surface.vertices or (
        sealed.vertices.shape == surface.vertices.shape
        and sealed.faces.shape == surface.faces.shape
        and np.array_equal(sealed.vertices, surface.vertices)
        and np.array_equal(sealed.faces, surface.faces)
    )
