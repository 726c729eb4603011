"""``S^t(u, v)`` of one timepoint by topographic cMCF (paper, Step 7), where it is one to one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from ..charts import UV, Floats, Mask, Plane, SealedSurface, Surface, Topography
from ..errors import NotCertifiedError
from ..geometry.locate import SurfaceLocator, interpolate
from ..parameters import Parameters
from ..progress import Progress
from ..unwrapping.plane import plane
from ..unwrapping.surface import same_mesh, sealed_surface

OUTERMOST, PLANE = "outermost", "plane"
AREA = "area_um2"

Images = dict[str, npt.NDArray[np.float32]]


def plane_images(
    cell: Surface,
    chart: Topography,
    uv: UV,
    mask: Mask,
    parameters: Parameters,
    progress: Progress,
) -> tuple[Images | None, Mapping[str, Any]]:
    """The fields of a surface over the pixels of its own plane, and what came of it.

    Parameters
    ----------
    cell : Surface
        With the fields that are to be shown.
    chart : Topography
        With that surface in it.
    uv : UV
        Of the common space.
    mask : Mask
    parameters : Parameters
    progress : Progress

    Returns
    -------
    images : dict of str to ndarray, (N, 2N) float32, or None
        ``area_um2`` is dA of the pixel. None where the plane cannot be certified.
    numbers : dict
        ``projection``, and ``projection_reason`` where it is not "plane".
    """
    voxel = mask.voxel_size[0]
    part = progress.part(0.0, 0.2)
    sealed = sealed_surface(mask, cell, parameters.surface, parameters.sealed, part)
    try:
        flat = plane(cell, sealed, uv, chart, voxel, parameters.plane, progress.part(0.2, 1.0))
    except NotCertifiedError as error:
        reason = str(error).removesuffix(error.hint).strip()
        return None, {"projection": OUTERMOST, "projection_reason": reason}
    return _images(cell, sealed, flat), {"projection": PLANE}


def _images(cell: Surface, sealed: SealedSurface, flat: Plane) -> Images:
    found = {
        name: _over_pixels(values, sealed, flat).astype(np.float32)
        for name, values in _on_sealed(cell, sealed).items()
    }
    return found | {AREA: flat.fields[AREA].astype(np.float32)}


def _on_sealed(cell: Surface, sealed: SealedSurface) -> Mapping[str, npt.NDArray[Any]]:
    """The fields at the vertices that were flattened, from the nearest place of the surface."""
    if same_mesh(sealed, cell):
        return cell.fields
    face, weights, _ = SurfaceLocator(cell.vertices, cell.faces).closest(sealed.vertices)
    return {
        name: interpolate(values, cell.faces, face, weights) for name, values in cell.fields.items()
    }


def _over_pixels(values: npt.NDArray[Any], sealed: SealedSurface, flat: Plane) -> Floats:
    face, weights = flat.face.ravel(), flat.weights.reshape(-1, 3)
    return interpolate(values, sealed.faces, face, weights).reshape(flat.face.shape)
