"""Parameters of the refinement of protrusions that are several blebs."""

from __future__ import annotations

from typing import Literal

from .base import StepParameters, setting

SOURCE = "Methods, Refinement of undersegmented blebs"


class RefinementParameters(StepParameters):
    """Refinement: several blebs under one label are told apart by their round caps."""

    apply: Literal["never", "blebs", "always"] = setting(
        "blebs",
        "Split touching blebs",
        "Take protrusions apart that are several round blebs: never, where the protrusions of "
        "the cell are blebs, or always; it may cut wavy sheets.",
        source=SOURCE,
    )
    smoothing_voxels: float = setting(
        4.0,
        "Smoothing",
        "The mean curvature is diffused over the surface by this length first.",
        unit="voxels",
        ge=0,
        le=20,
    )
    depth: float = setting(
        0.3,
        "Depth of a waist",
        "Two caps are two where the way between them narrows by more than this part of the "
        "smaller one's radius.",
        gt=0,
        lt=1,
    )
    pixels: int = setting(
        128,
        "Pixels",
        "Along an edge of the square image that each protrusion is laid on.",
        unit="pixels",
        source=SOURCE + ", 128 × 128",
        ge=16,
        le=1024,
    )
    minimum_area: float = setting(
        10.0,
        "Smallest part",
        "Parts with less area of the surface are given to their neighbours.",
        unit="voxels²",
        source=SOURCE,
        ge=0,
    )
