"""Parameters of movies: registration, the common space, and what is stored of each frame."""

from __future__ import annotations

from typing import Literal

from .base import Positive, StepParameters, setting

BLEBS = "Methods, 3D timelapse lightsheet imaging and analysis of blebs"
RUFFLES = "Methods, 3D timelapse lightsheet imaging and analysis of ruffles"


class RegistrationParameters(StepParameters):
    """Registration: every timepoint is moved rigidly onto the first, the channels onto one."""

    method: Literal["none", "translation", "rigid"] = setting(
        "translation",
        "Registration",
        "none: the cell does not drift; translation: shift every timepoint onto the first; rigid: "
        "shift and rotate it.",
        source=RUFFLES,
    )
    channels: bool = setting(
        False,
        "Register channels",
        "Also move every other channel onto the one that shows the outline (shift it, and rotate "
        "it where the method is rigid).",
        source=RUFFLES,
    )
    channel_timepoints: Literal["first", "each"] = setting(
        "first",
        "Channels registered at",
        "first: the channels lie to each other as at the first timepoint, as they do where optics "
        "and cameras shift them; each: they are registered at every timepoint.",
        source=RUFFLES,
    )
    blur_um: Positive | None = setting(
        None,
        "Blur",
        "Standard deviation of the blur at which two images are compared, the same along all "
        "axes. Empty: a little more than the longest edge of a voxel, and none between channels. "
        "Give more where the images are noisy.",
        unit="µm",
    )


class MovieParameters(StepParameters):
    """Movie: the common space of all timepoints, and what is kept of each."""

    common: Literal["recommended", "mean", "timepoint", "each"] = setting(
        "recommended",
        "Common space",
        "mean: the space around the temporal mean surface; timepoint: around the surface of one "
        "timepoint; each: every timepoint has its own atlas, and their spheres are aligned; "
        "recommended: what the masks of all timepoints speak for.",
        source=f"{BLEBS}; {RUFFLES}",
    )
    timepoint: int = setting(
        0, "Timepoint", "Whose surface makes the common space (common = timepoint).", ge=0
    )
    largest_outside: float = setting(
        0.02,
        "Largest part outside",
        "Where more of a timepoint's surface area leaves the mapped shell than this, an atlas of "
        "its own for each timepoint is proposed.",
        gt=0,
        le=1,
    )
    projection: Literal["outermost", "plane"] = setting(
        "outermost",
        "Projection",
        "outermost: S(u, v) is the outermost surface over every pixel, set to d = 0; plane: the "
        "surface flattened by topographic cMCF, which takes some ten seconds per timepoint.",
        source=f"{BLEBS}; {RUFFLES}",
    )
    signals: str = setting(
        "all",
        "Signals",
        "Channels sampled below the surface, by number or name and separated by commas; a ratio is "
        "written as 0/1; all: every channel; empty: none.",
    )
    depth_um: float = setting(
        1.0,
        "Depth",
        "How far below the surface signals are sampled.",
        unit="µm",
        source=BLEBS,
        ge=0,
    )
    statistic: Literal["percentile", "mean"] = setting(
        "percentile",
        "Statistic",
        "What is taken of the intensities along the path inwards.",
        source=f"{BLEBS}; {RUFFLES}",
    )
    percentile: float = setting(
        95.0,
        "Percentile",
        "Of the intensities (statistic = percentile).",
        source=BLEBS,
        ge=0,
        le=100,
    )
    normalize: bool = setting(
        True,
        "Normalise",
        "Divide every signal by its mean in the whole cell at that timepoint, which corrects "
        "bleaching.",
        source=BLEBS,
    )
