"""What a user can set, one model per step, with units, ranges and sources.

The forms of the interface, the options of the command line, the TOML file and the
documentation all come from these models. An unknown key is an error.
"""

from __future__ import annotations

import json
import math
import re
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    model_validator,
)

from .errors import ParameterError

PAPER = "10.1101/2023.04.12.536640"
SEGMENTATION = "Methods, Cell segmentation and surface meshing"


def setting(
    default: Any, title: str, description: str, *, unit: str = "", source: str = "", **limits: Any
) -> Any:
    """A field with its title, unit and source; `limits` are pydantic's ge, le, gt, lt."""
    extra: dict[str, Any] = {"unit": unit, "source": source}
    return Field(default, title=title, description=description, json_schema_extra=extra, **limits)


def _numbers(value: Any) -> Any:
    """The numbers of a text such as ``"0.3, 0.1, 0.1"``, as a form gives it."""
    return re.split(r"[\s,;×]+", value.strip(" []()")) if isinstance(value, str) else value


Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
ThreeSizes = Annotated[tuple[Positive, Positive, Positive], BeforeValidator(_numbers)]
SixIndices = Annotated[tuple[int, int, int, int, int, int], BeforeValidator(_numbers)]
SixLengths = Annotated[
    tuple[Finite, Finite, Finite, Finite, Finite, Finite], BeforeValidator(_numbers)
]


class StepParameters(BaseModel):
    """Base of the parameters of a step: frozen, and unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True)


def _split_text(value: Any) -> Any:
    """Numbers that were typed, "0, 0, 1", as a list of them."""
    return value.replace(",", " ").split() if isinstance(value, str) else value


def _has_length(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    length = math.hypot(*vector)
    if not 0.0 < length < math.inf:
        raise ValueError(f"a direction has a positive, finite length; this one's is {length:g}")
    return vector


Direction = Annotated[
    tuple[float, float, float], BeforeValidator(_split_text), AfterValidator(_has_length)
]


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
        "Crop in µm",
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
    threshold: Literal["otsu", "multi-otsu", "multi-level", "value"] = setting(
        "otsu",
        "Threshold",
        "How the cell is told from the background. multi-level: what is above Otsu's threshold in "
        "the enhanced image, or in the image smoothed over the interior's size.",
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


class ReferenceParameters(StepParameters):
    """Reference (Step 1): smooth the surface to the cortex without protrusions."""

    skip: bool = setting(
        False,
        "Skip",
        "No smoothing, for cells without protrusions: the reference is the sealed surface itself, "
        "remeshed.",
        source="Step 4, direct unwrapping",
    )
    flow: Literal["cMCF", "MCF"] = setting(
        "cMCF",
        "Flow",
        "cMCF keeps the Laplacian of the start, and with it the shape of the triangles; MCF is "
        "plain mean curvature flow, which may pinch off thin parts.",
        source="Step 1",
    )
    laplacian: Literal["cotangent", "intrinsic-delaunay", "robust"] = setting(
        "cotangent",
        "Laplacian",
        "cotangent: of the mesh as it is; intrinsic-delaunay: without negative weights; robust: "
        "the same where triangles are thin or collapsed.",
        source="Step 1, robust Laplacian optional, mollify factor 1e-5",
    )
    mass: Literal["barycentric", "voronoi", "full"] = setting(
        "barycentric",
        "Mass",
        "How area belongs to vertices: a third of the faces around, the part that is nearest, "
        "or the integrals of products of hat functions.",
        source="Step 1, barycentric",
    )
    keep_volume: bool = setting(
        False,
        "Keep volume",
        "Scale to the starting volume after every iteration, not to the starting area: the "
        "reference has the volume of the sealed surface, protrusions included.",
    )
    iterations: int = setting(
        50,
        "Maximum iterations",
        "Upper limit of the flow's iterations.",
        source="Datasets, 50",
        ge=1,
        le=200,
    )
    delta: float = setting(
        5e-4,
        "Time step δ",
        "Stiffness of the flow; larger smooths more per iteration (unit-area surface).",
        source="Datasets, 5e-4",
        gt=0,
        le=1,
    )
    stop: Literal["total_curvature", "paper", "change_point", "fixed"] = setting(
        "total_curvature",
        "Stop at",
        "total_curvature: total |K| / 4π below the limit; paper: the change of mean |K| exceeds "
        "the threshold; change_point: an elbow of the curve; fixed: the given iteration.",
        source="Methods, Automatic stopping criterion for cMCF",
    )
    curvature_limit: float = setting(
        1.6,
        "Total |K| limit",
        "Total absolute Gaussian curvature over 4π (1 = convex).",
        gt=1,
        le=20,
    )
    threshold: float = setting(
        1e-5,
        "Δ threshold",
        "The paper's rule stops when mean |K| changes by more than −threshold.",
        source="Datasets, 1e-5 (blebs, lamellipodia), 1e-4 (filopodia)",
        gt=0,
    )
    change_point: int = setting(
        1,
        "Change point",
        "Which elbow of the curve, for stop = change_point: at each one a step falls to a tenth of "
        "the steepest since the last.",
        ge=1,
        le=10,
    )
    minimum_iterations: int = setting(
        1, "Minimum iterations", "Never stop earlier.", source="Methods, t_min", ge=0, le=200
    )
    extra_iterations: int = setting(
        0,
        "Extra iterations",
        "Continue this many iterations after the stop.",
        source="Datasets, +5",
        ge=0,
        le=50,
    )
    fixed_iteration: int = setting(10, "Iteration", "The iteration for stop = fixed.", ge=1, le=200)
    smoothing_voxels: float = setting(
        1.0,
        "Smoothing",
        "Gaussian σ of the voxelised reference before marching cubes.",
        unit="voxels",
        source="Datasets, σ = 1",
        ge=0,
        le=5,
    )
    vertices: int = setting(
        120_000,
        "Vertices",
        "Vertices of the reference's mesh, from which every map is made: labels carried through "
        "it are as fine as they are.",
        source="Datasets, ACVD 90 % of marching cubes' own",
        ge=1_000,
        le=400_000,
    )
    mesh_smoothing: int = setting(
        0,
        "Mesh smoothing",
        "Iterations of volume-constrained Laplacian smoothing of the reference's mesh.",
        source="Datasets, 15 (ruffles)",
        ge=0,
        le=100,
    )


class SphereParameters(StepParameters):
    """Sphere (Steps 2, 3): from angle-preserving to area-preserving."""

    blend: float = setting(
        1.0,
        "Conformal – equiareal",
        "0 preserves angles, 1 preserves areas. A criterion looks for the best place up to here.",
        ge=0,
        le=1,
    )
    method: Literal["poisson", "advection"] = setting(
        "poisson",
        "Method",
        "poisson: a Poisson flow that never flips a face; advection: the paper's, along the "
        "gradient of the area distortion, the best iteration without flips.",
        source="Step 3, mesh relaxation",
    )
    criterion: Literal["equiareal", "mips", "q_log_lambda", "area_mips"] = setting(
        "equiareal",
        "Criterion",
        "What the blend (poisson) or the iteration (advection) is chosen for. equiareal: areas; "
        "mips: angles; q_log_lambda: (1 − θ) Q + θ |log λ|; area_mips: area-preserving MIPS.",
        source="Methods, Stopping criteria",
    )
    theta: float | None = setting(
        None,
        "Weight θ",
        "Weight of the areas in q_log_lambda (0 to 1) and area_mips; empty: the paper's 0.5 and 1.",
        source="Methods, Stopping criteria",
        ge=0,
        le=10,
    )
    target: Literal["reference", "uniform"] = setting(
        "reference",
        "Areas",
        "reference: every face keeps its share of the reference's area; uniform: all faces get "
        "the same area.",
    )
    step: float = setting(
        1.0,
        "Step ε",
        "Advection: how far the vertices move in an iteration, in mean lengths of an edge.",
        source="Datasets, ε = 1",
        gt=0,
        le=10,
    )
    delta: float = setting(
        0.1,
        "Stiffness δ",
        "Advection: larger moves the vertices more evenly.",
        source="Datasets, 0.1, and 5e-3 where that was not equiareal",
        ge=0,
        le=10,
    )
    iterations: int = setting(100, "Iterations", "Upper limit of the equiareal flow.", ge=0, le=200)
    tolerance: float = setting(
        0.003, "Tolerance", "Stop when mean |log λ| is below.", ge=1e-5, le=1
    )

    @model_validator(mode="after")
    def _check_theta(self) -> Self:
        if self.criterion == "q_log_lambda" and self.theta is not None and self.theta > 1:
            raise ValueError(f"theta of q_log_lambda is at most 1, not {self.theta:g}")
        return self


class UVParameters(StepParameters):
    """uv (Step 4): the unwrapping axis and the image grid."""

    rows: int = setting(
        512,
        "Rows N",
        "The uv image has N rows and 2N columns.",
        unit="pixels",
        source="Datasets, 1024 × 512",
        ge=32,
        le=2048,
        multiple_of=8,
    )
    axis_weight: Literal[
        "mean_curvature", "absolute_curvature", "positive_curvature", "field", "none"
    ] = setting(
        "mean_curvature",
        "Axis weight",
        "What should be mapped with little distortion, i.e. away from the poles.",
        source="Step 4, weighted PCA",
    )
    axis_field: str = setting(
        "mean_curvature_per_um",
        "Axis field",
        "The field of the reference, or of the surface next to it, that weighs the axis "
        "(axis weight = field).",
    )
    axis_zyx: Direction | None = setting(
        None,
        "Axis by hand",
        "Direction (z, y, x) in which the north pole lies, seen from the reference's centroid; "
        "empty: found by the axis weight.",
        source="Datasets, blebs: not the inferred axis",
    )
    axis_roll_degrees: float = setting(
        0.0,
        "Roll",
        "Turn the image around its axis: what lay at this azimuth comes to the middle column.",
        unit="°",
        ge=-180,
        le=180,
    )


class TopographyParameters(StepParameters):
    """Topography (Steps 5, 6): the (d, u, v) space normal to the reference."""

    step_voxels: float = setting(
        0.5,
        "Step α",
        "Arc length between two layers.",
        unit="voxels",
        source="Datasets, α = 0.5",
        ge=0.1,
        le=2,
    )
    automatic_step: bool = setting(
        False,
        "Automatic α",
        "α is half the mean sum of a pixel's steps in u and v on the reference, at most ½ voxel.",
        source="Datasets, min(0.5, ½ (Δu + Δv))",
    )
    propagation: Literal["streamlines", "active_contour"] = setting(
        "streamlines",
        "Propagation",
        "streamlines: each pixel's normal is followed on its own, and normals cannot cross; "
        "active_contour: the whole layer moves as an elastic sheet, which is slower.",
        source="Methods, Step 5 and Mesh displacement by active contour cMCF",
    )
    contour_delta: float = setting(
        5e-4,
        "Contour δ",
        "Stiffness of the active contour (unit-area surface).",
        source="Datasets, 5e-4",
        gt=0,
        le=1,
    )
    contour_smoothing: Literal["none", "robust", "box"] = setting(
        "robust",
        "Contour smoothing",
        "How the active contour's displacements are smoothed over (u, v): robust: splines that "
        "outliers do not pull (doi:10.1016/j.csda.2009.09.020); box: mean of 5 × 5 pixels.",
        source="Datasets, uniform box filter of 5 pixels",
    )
    depth_um: float | None = setting(
        None,
        "Depth D_in",
        "How far to go inwards from the reference; empty: the paper's 20 voxels, or deeper where "
        "the surface needs it.",
        unit="µm",
        source="Datasets, D_in = 40 steps",
        ge=0,
    )
    margin_voxels: float = setting(
        2.0, "Outer margin", "How far D_out goes beyond the surface.", unit="voxels", ge=1, le=20
    )
    smoothing_voxels: float = setting(
        1.0,
        "Smoothing",
        "Gaussian σ of the mapped binary before marching cubes, in layers.",
        unit="voxels",
        source="Datasets, σ = 1",
        ge=0,
        le=5,
    )


class DirectParameters(StepParameters):
    """Direct: the sealed surface on the sphere, one to one even under overhangs, on request."""

    compute: bool = setting(
        False,
        "Compute the direct chart",
        "Put the sealed surface itself on the sphere, too.",
    )
    rows: int = setting(
        512,
        "Rows N",
        "The direct image has N rows and 2N columns.",
        unit="pixels",
        ge=32,
        le=4096,
        multiple_of=8,
    )
    registration: float = setting(
        40.0,
        "Registration",
        "How strongly the cortex is tied to its place in the reference's (u, v); 0.1 gives way to "
        "equal areas.",
        ge=0,
        le=1000,
    )
    slack_rad: float = setting(
        0.05,
        "Slack",
        "How far the cortex may lie from its place in the reference's (u, v) at no cost.",
        unit="rad",
        ge=0,
        le=1,
    )
    shape: float = setting(
        0.05,
        "Angles against areas",
        "Weight of the faces' angles against their areas; smaller for long, thin protrusions.",
        gt=0,
        le=10,
    )
    sweeps: int = setting(20, "Sweeps", "Rounds at every size of the mesh.", ge=1, le=500)
    final_sweeps: int = setting(40, "Final sweeps", "Rounds at the end.", ge=1, le=1000)


class PlaneParameters(StepParameters):
    """Plane (Step 7): the topographic surface flattened, on request."""

    compute: bool = setting(
        False, "Compute the plane", "Flatten the topographic surface to the (u, v) plane, too."
    )
    laplacian: Literal["automatic", "robust", "cotangent", "positive"] = setting(
        "automatic",
        "Laplacian",
        "robust: of the intrinsic Delaunay triangulation, keeps angles best; cotangent: of the "
        "triangles as they are; positive: cotangents raised above zero, so that no face flips "
        "in the limit; automatic: robust, and positive where that flips faces.",
        source="Datasets, robust mesh Laplacian",
    )
    delta: float = setting(
        5e4,
        "Time step δ",
        "Stiffness of the flow; a smaller one flattens more slowly.",
        unit="pixels²",
        source="Datasets, 5e4",
        gt=0,
        le=1e8,
    )
    iterations: int = setting(
        10,
        "Iterations",
        "Upper limit of topographic cMCF iterations; fewer when nothing moves any more.",
        source="Datasets, 10",
        ge=1,
        le=200,
    )


class Parameters(StepParameters):
    """All parameters of the pipeline, one group per step."""

    stack: StackParameters = Field(default_factory=StackParameters, title="Stack")
    surface: SurfaceParameters = Field(default_factory=SurfaceParameters, title="Surface")
    sealed: SealedParameters = Field(default_factory=SealedParameters, title="Sealed surface")
    reference: ReferenceParameters = Field(default_factory=ReferenceParameters, title="Reference")
    sphere: SphereParameters = Field(default_factory=SphereParameters, title="Sphere")
    uv: UVParameters = Field(default_factory=UVParameters, title="uv")
    topography: TopographyParameters = Field(
        default_factory=TopographyParameters, title="Topography"
    )
    direct: DirectParameters = Field(default_factory=DirectParameters, title="Direct")
    plane: PlaneParameters = Field(default_factory=PlaneParameters, title="Plane")

    @classmethod
    def preset(cls, name: str) -> Parameters:
        """The paper's values for one kind of protrusion ("Datasets").

        Raises
        ------
        ParameterError
            The name is not one of :data:`PRESETS`.
        """
        if name not in PRESETS:
            raise ParameterError(
                f"There is no preset {name!r}.", hint=f"Presets: {', '.join(PRESETS)}."
            )
        return cls.from_dict(PRESETS[name])

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Parameters:
        """Check and build; a :class:`ParameterError` names every key that is wrong."""
        try:
            return cls.model_validate(values)
        except ValidationError as error:
            problems = "; ".join(
                f"{'.'.join(map(str, item['loc']))}: {item['msg']} (got {item['input']!r})"
                for item in error.errors()
            )
            raise ParameterError(
                f"Parameters are not valid: {problems}.",
                hint="`napari-unwrap3d info --parameters` lists every parameter with its range.",
            ) from None

    @classmethod
    def from_toml(cls, source: str | Path) -> Parameters:
        """Read a TOML file (a Path) or TOML text (a str)."""
        text = source.read_text(encoding="utf-8") if isinstance(source, Path) else source
        try:
            values = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise ParameterError(f"The parameters are not valid TOML: {error}.") from None
        return cls.from_dict(values)

    def to_toml(self) -> str:
        """TOML text with a comment (title, unit, source) above every parameter."""
        lines = [f"# Parameters of napari-unwrap3d; the method: doi:{PAPER}"]
        for step in type(self).model_fields:
            group: StepParameters = getattr(self, step)
            lines += ["", f"[{step}]"]
            for name, info in type(group).model_fields.items():
                lines += _toml_lines(name, getattr(group, name), info)
        return "\n".join(lines) + "\n"


def _toml_lines(name: str, value: Any, info: Any) -> list[str]:
    extra = info.json_schema_extra or {}
    unit = f" [{extra['unit']}]" if extra.get("unit") else ""
    source = f" Paper: {extra['source']}." if extra.get("source") else ""
    comment = f"# {info.title}{unit}: {info.description}{source}"
    if value is None:
        return [comment, f"# {name} ="]
    return [comment, f"{name} = {toml_value(value)}"]


def toml_value(value: Any) -> str:
    """A value as it is written in TOML and after ``--set``."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    return repr(list(value) if isinstance(value, tuple) else value)


PRESETS: dict[str, dict[str, Any]] = {
    "blebs": {
        "reference": {"iterations": 50, "delta": 5e-4, "threshold": 1e-5},
        "uv": {"rows": 512, "axis_weight": "mean_curvature"},
        "topography": {"step_voxels": 0.5},
    },
    "lamellipodia": {
        "reference": {"iterations": 50, "delta": 5e-4, "threshold": 1e-5},
        "uv": {"rows": 512, "axis_weight": "mean_curvature"},
        "topography": {"step_voxels": 0.5},
    },
    "filopodia": {
        "reference": {"iterations": 50, "delta": 5e-4, "threshold": 1e-4},
        "uv": {"rows": 512, "axis_weight": "mean_curvature"},
        "topography": {"step_voxels": 0.5},
    },
    "ruffles": {
        "reference": {"iterations": 50, "delta": 1e-5, "threshold": 5e-5},
        "uv": {"rows": 512, "axis_weight": "positive_curvature"},
        "topography": {"step_voxels": 0.5},
    },
}
