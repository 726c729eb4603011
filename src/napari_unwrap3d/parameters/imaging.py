"""Parameters from the stack to the surface."""

from __future__ import annotations

from typing import Literal

from .base import SixIndices, SixLengths, StepParameters, ThreeSizes, setting

SEGMENTATION = "Methods, Cell segmentation and surface meshing"


class StackParameters(StepParameters):
    """Stack: which volume, and how the cell is segmented in it."""

    timepoint: int = setting(0, "Timepoint", "Which timepoint of the stack to unwrap.", ge=0)
    channel: int = setting(0, "Channel", "Which channel shows the cell's outline.", ge=0)
    label: int | None = setting(
        None,
        "Label",
        "In a label image, the label of the cell; empty: the stack is an image.",
        ge=1,
    )
    working_voxel_um: float | None = setting(
        None,
        "Working voxel",
        "Edge of the isotropic voxel everything is computed in; empty: the smallest edge of "
        "the stack's voxel.",
        unit="µm",
        gt=0,
    )
    crop_voxels: SixIndices | None = setting(
        None,
        "Crop",
        "The part of the volume to use, as z start, z stop, y start, y stop, x start, x stop; a "
        "stop is the first voxel left out; empty: all of it.",
        unit="voxels",
    )
    crop_um: SixLengths | None = setting(
        None,
        "Crop",
        "The same in world coordinates: voxels whose centre lies between start and stop are used.",
        unit="µm",
    )
    deconvolution: Literal["none", "wiener", "richardson-lucy"] = setting(
        "none",
        "Deconvolution",
        "Sharpen the image with a measured point-spread function (PSF): wiener is linear; "
        "richardson-lucy keeps intensities positive.",
        source=f"{SEGMENTATION}, Wiener-Hunt",
    )
    psf: str | None = setting(
        None, "PSF", "TIFF file of the point-spread function, without background."
    )
    psf_voxel_um: ThreeSizes | None = setting(
        None,
        "Voxel of the PSF",
        "Its voxel size (z, y, x), instead of what its file says.",
        unit="µm",
    )
    wiener_balance: float = setting(
        0.01,
        "Wiener balance",
        "Weight of the smoothness of the image; larger for more noise.",
        gt=0,
        le=1000,
    )
    richardson_lucy_iterations: int = setting(
        10, "Richardson–Lucy iterations", "More are sharper and noisier.", ge=1, le=500
    )
    local_contrast_um: float = setting(
        0.0,
        "Local contrast size",
        "Enhance the contrast locally, in blocks of this size (contrast-limited adaptive "
        "histogram equalisation); 0: off.",
        unit="µm",
        source=SEGMENTATION,
        ge=0,
    )
    local_contrast_limit: float = setting(
        0.01,
        "Contrast limit",
        "Larger enhances faint parts more, and noise with them.",
        gt=0,
        le=1,
    )
    edge_enhancement: float = setting(
        0.0,
        "Edge enhancement",
        "Add this much of the difference to the smoothed image (unsharp masking); 0: off.",
        source=SEGMENTATION,
        ge=0,
        le=20,
    )
    edge_voxels: float = setting(
        2.0,
        "Edge size",
        "Gaussian σ of the smoothing in the edge enhancement.",
        unit="voxels",
        gt=0,
        le=20,
    )
    smoothing_voxels: float = setting(
        1.0, "Smoothing", "Gaussian σ before thresholding.", unit="voxels", ge=0, le=10
    )
    background_um: float = setting(
        0.0,
        "Background size",
        "Subtract what is smoother than this (Gaussian σ); 0: no background correction.",
        unit="µm",
        ge=0,
    )
    threshold: Literal["otsu", "edge", "multi-otsu", "multi-level", "value"] = setting(
        "otsu",
        "Threshold",
        "How the cell is told from the background. edge: the intensity at which the image rises "
        "most steeply at the outline that Otsu's threshold gives, the truest size of a blurred "
        "cell; Otsu's where that would change its volume by more than a fifth. multi-level: what "
        "is above Otsu's threshold in the enhanced image, or in the image smoothed over the "
        "interior's size.",
        source=SEGMENTATION,
    )
    threshold_value: float = setting(
        0.0, "Threshold value", "The intensity above which a voxel is cell (threshold = value)."
    )
    threshold_classes: int = setting(
        3, "Classes", "Number of classes of the multi-level Otsu threshold.", ge=3, le=5
    )
    threshold_class: int = setting(
        1,
        "Lowest class kept",
        "Classes from this one upwards are cell (0 is the darkest).",
        ge=1,
        le=4,
    )
    interior_um: float = setting(
        1.0,
        "Interior size",
        "Gaussian σ that evens out the interior (threshold = multi-level).",
        unit="µm",
        gt=0,
    )
    fill: bool = setting(True, "Fill cavities", "Fill what is enclosed by the cell.")
    second_cell_fraction: float = setting(
        0.5,
        "Second cell",
        "Refuse when a second component has at least this fraction of the largest one's volume.",
        gt=0,
        le=1,
    )


class SurfaceParameters(StepParameters):
    """Surface: from the mask to the mesh."""

    smoothing_voxels: float = setting(
        1.0,
        "Smoothing",
        "Gaussian σ of the binary volume before marching cubes.",
        unit="voxels",
        source="Datasets, σ = 1",
        ge=0,
        le=5,
    )
    curvature_smoothing_voxels: float = setting(
        2.0,
        "Curvature smoothing",
        "Gaussian σ of the signed distance from which mean curvature is computed.",
        unit="voxels",
        ge=0.5,
        le=10,
    )


class SealedParameters(StepParameters):
    """Sealed surface: genus 0 for every cell."""

    handles: Literal["smaller", "seal", "cut"] = setting(
        "smaller",
        "Handles",
        "seal: close the hole of every handle by a membrane; cut: cut every handle where it is "
        "thinnest; smaller: for each handle what changes less volume.",
        source="Step 1, genus-0 reference",
    )
