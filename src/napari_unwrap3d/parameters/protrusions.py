"""Parameters of the protrusions: over the cortex, the default."""

from __future__ import annotations

from typing import Literal

from .base import StepParameters, setting


class ProtrusionParameters(StepParameters):
    """Protrusions: every bleb, lamellipodium and filopodium, with its volume, on request."""

    compute: bool = setting(False, "Find protrusions", "Segment and measure protrusions, too.")
    method: Literal["cortex", "topography"] = setting(
        "cortex",
        "Method",
        "cortex: what stands out of the cell opened by a ball; topography: the paper's way, by "
        "the height and the curvature in (d, u, v).",
    )
    kind: Literal["automatic", "blebs", "lamellipodia", "filopodia"] = setting(
        "automatic",
        "Kind",
        "What to look for; automatic tries all and says which it took and why.",
        source="Methods, Topography guided instance segmentation of protrusions",
    )
    radius: float = setting(
        0.45,
        "Cortex radius",
        "Radius of the ball that opens the cell, as a part of the largest ball that fits in; "
        "larger where protrusions are nearly as thick as the body, smaller where it is lumpy.",
        gt=0,
        lt=1,
    )
    threshold_um: float | None = setting(
        None,
        "Threshold",
        "Height over the cortex where protrusions begin; automatic unless given: the median and "
        "three deviations of the cortex's own heights, and at least half a voxel.",
        unit="µm",
        ge=0,
    )
    least_area_um2: float | None = setting(
        None,
        "Smallest area",
        "Protrusions that cover less of the surface are left out; 60 voxel faces unless given.",
        unit="µm²",
        ge=0,
    )
    least_height_um: float | None = setting(
        None,
        "Smallest height",
        "Protrusions whose top is lower are left out; 2.5 voxels unless given, and more on a "
        "rough cell.",
        unit="µm",
        ge=0,
    )
    join: float | None = setting(
        None,
        "Join",
        "Two footprints are one protrusion where the lower peak rises over the saddle between "
        "them by less than this part of its height; by the kind unless given (0.12 blebs, 0.25 "
        "lamellipodia). 0: filopodia that touch with their tips stay apart.",
        ge=0,
        le=1,
    )
    split: float | None = setting(
        None,
        "Split",
        "Two peaks over one footprint are two protrusions where the saddle between them is lower "
        "than this part of the lower peak; by the kind unless given (0.6 blebs, 0.4 "
        "lamellipodia, 0.5 filopodia).",
        ge=0,
        le=1,
    )
