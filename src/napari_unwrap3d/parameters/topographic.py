"""Parameters of the paper's protrusions: by height and curvature in (d, u, v)."""

from __future__ import annotations

from typing import Literal

from .base import StepParameters, setting

REFERENCE = "Methods, Reference surface inference"
# The areas are those of so many voxels of the paper's, with edges of 0.104 µm.
BINARY = "Methods, Topography guided binary segmentation"
INSTANCES = "Methods, Topography guided instance segmentation"


class TopographicParameters(StepParameters):
    """Protrusions by topography (the paper's method): height, binary, instances, volumes."""

    zero: Literal["baseline", "plane"] = setting(
        "baseline",
        "Height over",
        "baseline: a smooth surface by asymmetric least squares; plane: the reference, d = 0.",
        source=f"{BINARY}, both",
    )
    asymmetry: float = setting(
        0.25,
        "Asymmetry p",
        "Weight of what lies above the baseline; 1 − p of what lies below.",
        source=f"{REFERENCE}, p = 0.25",
        gt=0,
        lt=1,
    )
    smoothness: float = setting(
        1.0,
        "Smoothness λ",
        "Of the baseline, in pixels at the equator of its grid to the fourth power: ripples "
        "shorter than 2π λ^¼ pixels are smoothed away.",
        source=f"{REFERENCE}, λ = 1",
        gt=0,
    )
    iterations: int = setting(
        10, "Iterations", "Of the baseline's weights.", source=f"{REFERENCE}, 10", ge=1, le=100
    )
    baseline_rows: int = setting(
        64,
        "Baseline rows",
        "The baseline is found on an image of so many rows and smoothly enlarged.",
        unit="pixels",
        source=f"{REFERENCE}, 512 rows downsampled 8 times",
        ge=8,
        le=256,
    )
    threshold: Literal["mean", "otsu", "value"] = setting(
        "mean",
        "Threshold",
        "Height from which on the surface belongs to protrusions: its mean over the area, Otsu's, "
        "or the given value.",
        source=f"{BINARY}, mean",
    )
    threshold_um: float = setting(0.5, "Height", "For threshold = value.", unit="µm")
    smallest_start_um2: float = setting(
        2.2,
        "Smallest region, first",
        "Regions above the threshold with less area are left out.",
        unit="µm²",
        source=f"{BINARY}, 200 voxels²",
        ge=0,
    )
    smallest_region_um2: float = setting(
        5.4,
        "Smallest region, last",
        "The same after the spreading.",
        unit="µm²",
        source=f"{BINARY}, 500 voxels²",
        ge=0,
    )
    affinity: float = setting(
        0.9,
        "Affinity γ",
        "Weight of the distance between neighbouring vertices, against the bend between them.",
        source=f"{BINARY}, γ = 0.9",
        ge=0,
        le=1,
    )
    clamping: float = setting(
        0.99,
        "Clamping α",
        "How much comes from the neighbours when labels spread.",
        source=f"{BINARY}, 0.99",
        gt=0,
        lt=1,
    )
    binary_iterations: int = setting(
        20, "Binary spreading", "Iterations.", source=f"{BINARY}, 20", ge=0, le=500
    )
    binary_chance: float = setting(
        0.25,
        "Binary chance",
        "Least chance that makes a vertex one of a protrusion in each iteration.",
        source=f"{BINARY}, 0.25",
        gt=0,
        lt=1,
    )
    background_um: float = setting(
        0.8,
        "Background from",
        "What is farther than this, along the surface, from what is above the threshold is "
        "background and stays so: the spreading, which the chance alone does not end, ends there.",
        unit="µm",
        gt=0,
    )
    grid_voxels: float = setting(
        0.5,
        "Curvature grid",
        "Edge of the topographic voxels in which curvature and instances are found.",
        unit="voxels",
        source="Datasets, α = 0.5",
        ge=0.2,
        le=2,
    )
    shell: float = setting(
        2.0,
        "Shell",
        "Radius of the ball that dilates and erodes the cell to the shell around its surface.",
        unit="topographic voxels",
        source=f"{INSTANCES}, 2",
        ge=1,
        le=10,
    )
    classes: int = setting(
        3,
        "Classes",
        "Of curvature; the one with the highest is the tops of protrusions.",
        source=f"{INSTANCES}, 3",
        ge=2,
        le=10,
    )
    samples: int = setting(
        10_000,
        "Samples",
        "Voxels that the classes are fitted on.",
        source=f"{INSTANCES}, 10,000",
        ge=100,
    )
    smallest_top: int = setting(
        500,
        "Smallest top",
        "Connected parts of the highest class with fewer voxels are left out.",
        unit="topographic voxels",
        source=f"{INSTANCES}, 500",
        ge=1,
    )
    expansion: float = setting(
        3.0,
        "Expansion",
        "How far tops reach when they are carried to the mesh, and labels of the mesh into the "
        "cell.",
        unit="topographic voxels",
        source=f"{INSTANCES}, 3",
        ge=0,
        le=20,
    )
    smallest_instance_um2: float = setting(
        1.1,
        "Smallest instance",
        "Instances that have less area before the spreading are left out.",
        unit="µm²",
        source=f"{INSTANCES}, 100 voxels²",
        ge=0,
    )
    spreading: int = setting(
        10, "Instance spreading", "Iterations.", source=f"{INSTANCES}, 10", ge=0, le=500
    )
    seed: int = setting(0, "Seed", "Of the random samples and the classes.", ge=0)
