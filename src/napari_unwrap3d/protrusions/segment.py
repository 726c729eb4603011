"""From the charts of a cell to its protrusions, by either method."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Mask, Protrusions, Surface, Volume
from ..parameters import Parameters, ProtrusionParameters
from ..progress import Progress, silent

if TYPE_CHECKING:
    from ..atlas import Atlas

Labels = npt.NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Segmentation:
    """What a method finds, before it is measured.

    Attributes
    ----------
    labels : ndarray, (n,) int32
        One per vertex of the surface, 1…k, 0 = none.
    height_um : ndarray, (n,)
        Over the cortex, negative below.
    volume : ndarray, (z, y, x) int32
        On the mask's grid, 0 in the cortex and outside of the cell.
    cortex : ndarray, (z, y, x) bool
        The mask's voxels without a label in `volume`.
    numbers : mapping
        JSON-able.
    """

    labels: Labels
    height_um: Floats
    volume: Labels
    cortex: npt.NDArray[np.bool_]
    numbers: Mapping[str, Any] = field(default_factory=dict)


def segment_protrusions(
    atlas: Atlas,
    parameters: ProtrusionParameters | None = None,
    progress: Progress | None = None,
) -> Protrusions:
    """Every bleb, lamellipodium and filopodium of a cell, with its volume and measures.

    Parameters
    ----------
    atlas : Atlas
    parameters : ProtrusionParameters, optional
        Those of the atlas unless given.
    progress : Progress, optional

    Returns
    -------
    Protrusions
        ``labels`` one per vertex of ``atlas.surface``, ``volume``, and ``table``, a pandas
        DataFrame with a row per protrusion. A cell without any gives an empty table.
    """
    chosen = atlas.parameters
    if parameters is not None:
        chosen = chosen.model_copy(update={"protrusions": parameters})
    return segment_cell(partial(getattr, atlas), chosen, progress or silent())


def segment_cell(
    charts: Callable[[str], Any], parameters: Parameters, progress: Progress
) -> Protrusions:
    """The protrusions of the cell with these charts; see :func:`segment_protrusions`."""
    found = find_protrusions(charts, parameters, progress.part(0.0, 0.9))
    progress(0.9, "measuring the protrusions")
    topography, rows = charts("topography").surface, charts("topography").shape[1]
    method = parameters.protrusions.method
    return measured(found, charts("mask"), charts("surface"), topography, method, rows=rows)


def find_protrusions(
    charts: Callable[[str], Any], parameters: Parameters, progress: Progress, part: float = 1.0
) -> Segmentation:
    """What the chosen method finds, refined where that was chosen.

    Parameters
    ----------
    charts : callable
        Gives a chart by its name. Over the cortex only mask and surface are needed; the
        method "topography" needs uv and topography, too.
    parameters : Parameters
    progress : Progress
    part : float
        Over the cortex, down to which part of the least height and width; see
        :func:`.over_cortex.over_cortex`.
    """
    mask, surface = charts("mask"), charts("surface")
    finding = progress.part(0.0, 0.9)
    if parameters.protrusions.method == "cortex":
        from .over_cortex import over_cortex

        found = over_cortex(mask, surface, parameters.protrusions, finding, part)
    else:
        from .topographic.method import by_topography

        uv, topography = charts("uv"), charts("topography")
        found = by_topography(mask, surface, uv, topography, parameters, finding)
    kind = found.numbers.get("kind", parameters.protrusions.kind)
    apply = parameters.refinement.apply
    if apply == "always" or (apply == "blebs" and kind == "blebs"):
        from .refine import refine_segmentation

        finding = progress.part(0.9, 1.0)
        found = refine_segmentation(found, mask, surface, parameters.refinement, finding)
    return found


def measured(
    found: Segmentation,
    mask: Mask,
    surface: Surface,
    image: Floats,
    method: str,
    *,
    rows: int | None = None,
) -> Protrusions:
    """The table of what was found; `image` (n, 3) is the surface in (d µm, v, u).

    Without the `rows` of the uv image the table has no v and no u.
    """
    from .table import measure_protrusions, parts_against_whole

    columns = measure_protrusions(found, mask, surface, image, rows=rows)
    volume = Volume(found.volume, mask.voxel_size, mask.origin)
    cortex = replace(mask, data=found.cortex)
    return Protrusions(
        labels=found.labels,
        height_um=found.height_um,
        volume=volume,
        cortex=cortex,
        columns=columns,
        method=method,
        numbers={
            **found.numbers,
            "method": method,
            "protrusions": len(columns["label"]),
            **parts_against_whole(found, mask),
        },
    )
