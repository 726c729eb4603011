"""What a user can set, one model per step, with units, ranges and sources.

The forms of the interface, the options of the command line, the TOML file and the
documentation all come from these models. An unknown key is an error.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from .errors import ParameterError

PAPER = "10.1101/2023.04.12.536640"


def setting(
    default: Any, title: str, description: str, *, unit: str = "", source: str = "", **limits: Any
) -> Any:
    """A field with its title, unit and source; `limits` are pydantic's ge, le, gt, lt."""
    extra: dict[str, Any] = {"unit": unit, "source": source}
    return Field(default, title=title, description=description, json_schema_extra=extra, **limits)


class StepParameters(BaseModel):
    """Base of the parameters of a step: frozen, and unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True)


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
    threshold: Literal["otsu", "multi-otsu", "value"] = setting(
        "otsu", "Threshold", "How the cell is told from the background."
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

    iterations: int = setting(
        50,
        "Maximum iterations",
        "Upper limit of cMCF iterations.",
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
        "the threshold; change_point: the first elbow of the curve; fixed: the given iteration.",
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


class SphereParameters(StepParameters):
    """Sphere (Steps 2, 3): from angle-preserving to area-preserving."""

    blend: float = setting(
        1.0, "Conformal – equiareal", "0 preserves angles, 1 preserves areas.", ge=0, le=1
    )
    iterations: int = setting(100, "Iterations", "Upper limit of the equiareal flow.", ge=0, le=200)
    tolerance: float = setting(
        0.003, "Tolerance", "Stop when mean |log λ| is below.", ge=1e-5, le=1
    )


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
    axis_weight: Literal["mean_curvature", "absolute_curvature", "positive_curvature", "none"] = (
        setting(
            "mean_curvature",
            "Axis weight",
            "What should be mapped with little distortion, i.e. away from the poles.",
            source="Step 4, weighted PCA",
        )
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
    if isinstance(value, bool):
        return [comment, f"{name} = {str(value).lower()}"]
    if isinstance(value, str):
        return [comment, f'{name} = "{value}"']
    return [comment, f"{name} = {value!r}"]


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
