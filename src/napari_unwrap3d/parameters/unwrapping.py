"""Parameters of the paper's steps, from the reference to the plane."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import model_validator

from .base import Direction, StepParameters, setting


class ReferenceParameters(StepParameters):
    """Reference (Step 1): smooth the surface to the cortex without protrusions."""

    skip: bool = setting(
        False,
        "Skip",
        "No smoothing, for cells without protrusions: the reference is the sealed surface itself, "
        "remeshed.",
        source="Step 4, direct unwrapping",
    )
    keep_mesh: bool = setting(
        False,
        "Keep the mesh",
        "With skip: the reference is the sealed surface vertex for vertex, so that its own mesh "
        "goes to the sphere.",
        source="Extended Data Fig. 1h, input surface to sphere",
    )
    method: Literal["flow", "cortex", "second_cortex"] = setting(
        "flow",
        "Method",
        "flow: smoothed by mean curvature flow (the paper's); cortex: the cell opened by a ball, "
        "so that d = 0 is the cell's body and d the height of protrusions; second_cortex: the "
        "same, going on smoothly under the footprints of protrusions, into which the ball rises.",
        source="Step 1, flow",
    )
    cortex_radius: float = setting(
        0.45,
        "Cortex radius",
        "With cortex: radius of the ball, as a part of the largest ball that fits into the cell.",
        gt=0,
        lt=1,
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
        "Continue this many iterations after the stop, unless that is fixed: the feet of "
        "protrusions smooth away last.",
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
        110.0,
        "Registration",
        "How strongly the cortex is tied to its place in the reference's (u, v); 0.1 gives way to "
        "equal areas.",
        ge=0,
        le=1000,
    )
    slack_rad: float = setting(
        0.1,
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
