"""The paper's way from a cell's charts to its protrusions, all steps in order."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...charts import UV, Mask, Surface, Topography
from ...geometry.affinity import edge_affinity
from ...geometry.laplacian import vertex_mass
from ...parameters import Parameters
from ...progress import Progress
from ..segment import Labels, Segmentation
from .binary import binary_protrusions
from .height import heights
from .instances import find_instances, shell_places, topographic_curvatures
from .kinds import instances_of_kind
from .volumes import protrusion_volumes

NOTHING = {"kind": "none", "kind_reason": "nothing stands out", "instances": 0}


def by_topography(
    mask: Mask,
    surface: Surface,
    uv: UV,
    topography: Topography,
    parameters: Parameters,
    progress: Progress,
) -> Segmentation:
    """Protrusions by their height and curvature in (d, u, v); doi:10.1101/2023.04.12.536640.

    Parameters
    ----------
    mask : Mask
        The cell on the isotropic working grid.
    surface : Surface
        Its mesh; a label per vertex comes out.
    uv, topography
        The charts of Steps 4–6.
    parameters : Parameters
        ``topographic``, and of ``protrusions`` the kind.
    progress : Progress

    Returns
    -------
    Segmentation
        ``numbers`` has the threshold, the shares of the area and ``kind`` with ``kind_reason``.
    """
    chosen, voxel_um = parameters.topographic, mask.voxel_size[0]
    height = heights(surface, topography, chosen, progress.part(0.0, 0.1))
    areas = vertex_mass(surface.vertices, surface.faces)
    affinity = edge_affinity(surface.vertices, surface.faces, chosen.affinity)
    progress(0.1, "finding what stands out")
    binary, numbers = progress.run(
        binary_protrusions, height.vertex_um, surface, areas, affinity, voxel_um, chosen
    )
    numbers["without_image"] = height.without_image
    labels = np.zeros(len(binary), np.int32)
    numbers |= NOTHING
    if binary.any():
        curvatures = topographic_curvatures(
            uv, topography, voxel_um, chosen, progress.part(0.15, 0.3)
        )
        places = shell_places(topography, curvatures)

        def attempt(method: str, part: Progress) -> tuple[Labels, dict[str, Any]]:
            return find_instances(curvatures, method, places, binary, areas, affinity, chosen, part)

        best = instances_of_kind(
            parameters.protrusions.kind, attempt, surface, areas, progress.part(0.3, 0.5)
        )
        labels = best.labels
        numbers |= best.numbers
        del curvatures, places
    volume = protrusion_volumes(
        mask,
        surface,
        uv,
        topography,
        labels,
        height.image,
        round(chosen.expansion),
        progress.part(0.5, 1.0),
    )
    return Segmentation(
        labels=labels,
        height_um=height.vertex_um,
        volume=volume,
        cortex=mask.data & (volume == 0),
        numbers=numbers,
    )
