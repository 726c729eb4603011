"""Parameters of tracking: protrusions that are linked, and regions that are carried by a flow."""

from __future__ import annotations

from typing import Literal

from .base import Positive, StepParameters, setting
from .movie import BLEBS, RUFFLES

BOXES = f"{BLEBS}, Bleb segmentation and tracking"
ROIS = f"{RUFFLES}, Optical flow ROI tracking"


class TrackingParameters(StepParameters):
    """Tracking: which protrusions at different timepoints are one."""

    method: Literal["surface", "boxes"] = setting(
        "surface",
        "Method",
        "surface: feet on the common surface are linked by distance, area and height; boxes: "
        "boxes on the uv image, predicted by optical flow, are linked by their overlap (the "
        "paper's way).",
        source=BOXES,
    )
    followed_part: float = setting(
        0.4,
        "Followed from",
        "A protrusion is followed while it is at least by this part as high and as wide as the "
        "smallest height and area of protrusions ask for (protrusions.method = cortex); a track "
        "that is never as high and as wide as these is left out. 1: only what is.",
        gt=0,
        le=1,
    )
    longest_step_um: Positive = setting(
        1.5,
        "Longest step",
        "How far a protrusion may move along the surface from one timepoint to the next.",
        unit="µm",
    )
    area_weight: float = setting(
        0.5,
        "Weight of area",
        "How much of a step it counts where the area changes: the difference of the square roots "
        "of two areas, times this (method = surface).",
        ge=0,
    )
    height_weight: float = setting(
        0.5,
        "Weight of height",
        "How much of a step it counts where the height changes: the difference, times this "
        "(method = surface).",
        ge=0,
    )
    gap_s: float = setting(
        6.0,
        "Longest gap",
        "For how long a protrusion may be lost and found again.",
        unit="s",
        source=BOXES,
        ge=0,
    )
    split_um: float = setting(
        0.0,
        "Splits",
        "How far a protrusion may be from the one that it comes out of; 0: none comes out of "
        "another (method = surface).",
        unit="µm",
        ge=0,
    )
    merge_um: float = setting(
        0.0,
        "Merges",
        "How far a protrusion may be from the one that it goes into; 0: none goes into another "
        "(method = surface).",
        unit="µm",
        ge=0,
    )
    least_lifetime_s: float = setting(
        0.0,
        "Shortest lifetime",
        "Tracks that last less long are left out. The paper keeps those of more than 6 s.",
        unit="s",
        source=BOXES,
        ge=0,
    )
    least_curvature_per_um: float | None = setting(
        None,
        "Least mean curvature",
        "Tracks whose mean curvature over their life is less are left out; empty: none. The paper "
        "asks for more than 0.1 (method = boxes).",
        unit="1/µm",
        source=BOXES,
    )


class BoxParameters(StepParameters):
    """Tracking of boxes: the paper's tracker on the uv image."""

    flow: Literal["farneback", "dis"] = setting(
        "farneback", "Optical flow", "What predicts the next box.", source=BOXES
    )
    field: str = setting(
        "mean_curvature_per_um", "Field", "What the flow is computed from.", source=BOXES
    )
    window_um: Positive | None = setting(
        None,
        "Window",
        "Over what length motion is taken to be the same (flow = farneback); empty: a sixteenth "
        "of the image's height.",
        unit="µm",
    )
    clipped_percent: float = setting(
        0.5,
        "Clipped values",
        "How many percent of the values are shown as black, and as many as white, in the 8-bit "
        "images that the flow is computed from. The paper takes the extremes: 0.",
        unit="%",
        source=BOXES,
        ge=0,
        lt=50,
    )
    least_iou: float = setting(
        0.25,
        "Least overlap",
        "Two boxes are linked if their intersection over union is larger.",
        source=BOXES,
        ge=0,
        le=1,
    )
    least_matched: float = setting(
        0.5,
        "Least matched part",
        "Tracks that have a protrusion of their own for a smaller part of their life are left out.",
        source=BOXES,
        ge=0,
        le=1,
    )
    largest_jump_um2: Positive = setting(
        2.0,
        "Largest jump of area",
        "A box whose area differs by more from the moving average of its track is replaced by "
        "one interpolated from the others.",
        unit="µm²",
        source=BOXES,
    )
    smoothing: int = setting(
        3, "Smoothing", "Timepoints of the moving average (odd).", source=BOXES, ge=1
    )


class FlowParameters(StepParameters):
    """Flow: regions of the surface that are carried by the optical flow of a field."""

    field: str = setting(
        "mean_curvature_per_um",
        "Field",
        "What is followed on the uv images; a ratio is written as two names with a slash, such "
        "as signal_actin/signal_CyOFP1.",
        source=ROIS,
    )
    smoothing_s: float = setting(
        0.0,
        "Average over time",
        "Full width at half maximum of a moving average of the images over time, before the flow "
        "is computed: patterns that travel farther than their own size in it vanish, and what is "
        "left is the flow of slower ones. 0: none.",
        unit="s",
        ge=0,
    )
    method: Literal["farneback", "dis"] = setting(
        "dis",
        "Optical flow",
        "How motion between two images is found: dense inverse search, which is smooth along "
        "ridges, where nothing tells how far they move; or as the paper does it, by polynomial "
        "expansion (Farnebäck).",
        source=ROIS,
    )
    window_um: Positive | None = setting(
        None,
        "Window",
        "Over what length motion is taken to be the same (method = farneback); empty: a "
        "sixteenth of the image's height.",
        unit="µm",
    )
    clipped_percent: float = setting(
        0.5,
        "Clipped values",
        "How many percent of the values are shown as black, and as many as white, in the 8-bit "
        "images that the flow is computed from. The paper takes the extremes: 0.",
        unit="%",
        source=ROIS,
        ge=0,
        lt=50,
    )
    regions: int = setting(
        1000, "Regions", "How many regions the image begins with.", source=ROIS, ge=4, le=20000
    )
    coverage: float = setting(
        0.5,
        "Least coverage",
        "A new region begins at a place of the first regions where less than this part of it is "
        "covered.",
        source=ROIS,
        gt=0,
        le=1,
    )
    least_distance: float = setting(
        0.25,
        "Least distance",
        "A region ends where it comes nearer to an older one than this many times its own width; "
        "0: never.",
        ge=0,
        le=1,
    )
    least_lifetime_s: float = setting(
        0.0, "Shortest lifetime", "Regions that last less long are left out.", unit="s", ge=0
    )
    plane: str = setting(
        "",
        "Plane",
        "Annotation of a flat part of the cell, such as its bottom: speeds are projected on the "
        "plane that is fitted to it, too. Empty: they are not.",
        source=RUFFLES,
    )
