"""A picture of every chart of an atlas, as PNG, to see at a glance what came out."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Sphere
from ..geometry.distortion import area_distortion, conformal_error
from ..geometry.mesh import face_areas, vertex_normals
from ..progress import Progress, silent
from ..unwrapping.axis import frame
from ..unwrapping.uv_views import chessboard
from .drawing import (
    ACCENT,
    INK,
    Colours,
    colour_bar,
    common_extents,
    curvature_colours,
    histogram_panel,
    mesh_panel,
    new_figure,
    save_figure,
    sequential,
    symmetric,
    uv_panel,
)
from .panels import (
    CURVATURE,
    curvature_field,
    flat_surface,
    front_and_back,
    grid_lengths,
    highest_pixel,
    section,
    shown_heights,
)
from .protrusion_pictures import draw_protrusions

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..atlas import Atlas

SIDES = ("z", "y", "x")
CHESS_TILES = 8


def write_pictures(
    atlas: Atlas, folder: str | Path, progress: Progress | None = None
) -> list[Path]:
    """Draw every chart that the atlas has.

    Parameters
    ----------
    atlas : Atlas
    folder : path
        Made when it does not exist.
    progress : Progress, optional

    Returns
    -------
    list of Path
        One PNG per picture, named after :data:`PICTURES`.
    """
    report = progress if progress is not None else silent()
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for index, (name, (draw, charts)) in enumerate(PICTURES.items()):
        report(index / len(PICTURES), f"drawing {name}")
        if all(atlas.has(chart) for chart in charts):
            written.append(save_figure(draw(atlas), folder / f"{name}.png"))
    report(1.0, "pictures")
    return written


# Meshes ----------------------------------------------------------------------


def draw_surface(atlas: Atlas) -> Figure:
    """The surface from three sides, coloured by mean curvature."""
    chart = atlas.surface
    area = face_areas(chart.vertices, chart.faces).sum()
    return _three_sides(
        chart, "Surface S(x, y, z)", f"{len(chart.vertices):,} vertices, area {area:.4g} µm²"
    )


def draw_reference(atlas: Atlas) -> Figure:
    """The reference from three sides, coloured by mean curvature, at the surface's scale."""
    chart = atlas.reference
    area = face_areas(chart.vertices, chart.faces).sum()
    return _three_sides(
        chart,
        "Reference S_ref(x, y, z): the cortex without protrusions",
        f"{len(chart.vertices):,} vertices, area {area:.4g} µm², stopped at iteration "
        f"{chart.iteration}; same scale as the surface",
        [atlas.surface.vertices] if atlas.has("surface") else [],
    )


def _three_sides(chart: Any, title: str, subtitle: str, beside: Sequence[Floats] = ()) -> Figure:
    figure = new_figure(13.0, 5.3, title, subtitle)
    panels = figure.subplots(1, 3)
    values = curvature_field(chart)
    colours = curvature_colours(values) if values is not None else None
    extents = common_extents(np.concatenate([chart.vertices, *beside]), list(SIDES))
    mesh = chart.vertices, chart.faces, values, colours
    normals = vertex_normals(chart.vertices, chart.faces)
    for axes, side, extent in zip(panels, SIDES, extents, strict=True):
        mesh_panel(axes, *mesh, side, extent, normals=normals)
        axes.set_title(f"seen along {side}", fontsize=12, color=INK)
    if colours is not None:
        colour_bar(figure, colours, list(panels))
    return figure


def _relaxed_state(sphere: Sphere) -> str:
    if sphere.method == "advection" and sphere.criterion != "equiareal":
        return f"iteration {sphere.iteration} of the advection ({sphere.criterion})"
    if sphere.blend < 1:
        return f"blend {sphere.blend:g}"
    if sphere.target == "uniform":
        return "equiareal (all faces alike)"
    return "equiareal (areas kept)"


def draw_sphere(atlas: Atlas) -> Figure:
    """Conformal and equiareal state side by side: mean curvature above, area change below."""
    sphere, reference = atlas.sphere, atlas.reference
    states = {
        "conformal (angles kept)": sphere.conformal,
        _relaxed_state(sphere): sphere.vertices,
    }
    figure = new_figure(
        13.0,
        7.2,
        "Sphere S²",
        "the reference's mesh on the unit sphere, from both sides of the axis",
    )
    panels = figure.subplots(2, 4)
    curvature = curvature_field(reference)
    bent = curvature_colours(curvature) if curvature is not None else None
    distortion = {
        name: -np.log(np.maximum(area_distortion(reference.vertices, v, sphere.faces), 1e-12))
        for name, v in states.items()
    }
    spread = symmetric(
        np.concatenate(list(distortion.values())),
        "log (area here / area on the reference)",
        name="PuOr_r",
        ends=("shrunk", "enlarged"),
        least=0.02,
    )
    axis = atlas.uv.rotation if atlas.has("uv") else np.eye(3)
    front, back = front_and_back(axis)
    for column, (name, vertices) in enumerate(states.items()):
        rows = ((panels[0], curvature, bent), (panels[1], distortion[name], spread))
        for offset, (view, side) in enumerate(((front, "front"), (back, "back"))):
            for row, values, colours in rows:
                mesh = vertices, sphere.faces, values, colours
                axes = row[2 * column + offset]
                # On the unit sphere the normals are the vertices.
                mesh_panel(axes, *mesh, view, pixels=340, scale_bar_unit="", normals=vertices)
            panels[0, 2 * column + offset].set_title(f"{name}\n{side}", fontsize=12, color=INK)
    if bent is not None:
        colour_bar(figure, bent, list(panels[0]))
    colour_bar(figure, spread, list(panels[1]))
    return figure


# uv --------------------------------------------------------------------------


def draw_uv(atlas: Atlas) -> Figure:
    """What lies outermost over each pixel: its mean curvature and its height."""
    fields = atlas.uv.fields
    rows, columns = atlas.uv.shape
    wanted = [
        ("surface_mean_curvature_per_um", "mean curvature of the surface", curvature_colours),
        ("surface_height_um", "height of the surface over the reference", _height_colours),
    ]
    if not all(name in fields for name, _, _ in wanted):
        wanted = [(CURVATURE, "mean curvature of the reference", curvature_colours)]
    wanted = [item for item in wanted if item[0] in fields]
    size = f"{columns} × {rows} pixels; light grey: no value"
    figure = new_figure(
        11.0, 0.9 + 5.2 * len(wanted), "uv image S(u, v): the unwrapped surface", size
    )
    panels = figure.subplots(max(len(wanted), 1), 1, squeeze=False)[:, 0]
    for axes, (name, title, colours_of) in zip(panels, wanted, strict=False):
        colours = colours_of(fields[name])
        uv_panel(axes, fields[name], colours, title)
        colour_bar(figure, colours, axes)
    return figure


def draw_direct(atlas: Atlas) -> Figure:
    """The direct image: every sheet of the surface, where the uv image shows the outermost."""
    chart = atlas.direct
    rows, columns = chart.shape
    numbers = atlas.quality.get("direct", {})
    figure = new_figure(
        11.0,
        11.3,
        "Direct image: the whole surface, one to one",
        f"{columns} × {rows} pixels; {chart.cortex.mean():.0%} of the vertices are tied to their "
        f"place in the uv image; mean |log λ| = {numbers.get('mean_abs_log_lambda', math.nan):.3f}",
    )
    wanted = [
        (CURVATURE, "mean curvature of the surface", curvature_colours),
        ("height_um", "height over the reference", _height_colours),
    ]
    wanted = [item for item in wanted if item[0] in atlas.surface.fields]
    panels = figure.subplots(max(len(wanted), 1), 1, squeeze=False)[:, 0]
    for axes, (name, title, colours_of) in zip(panels, wanted, strict=False):
        values = np.nan_to_num(atlas.surface.fields[name])
        image = atlas.carry(values, "surface", "direct")
        colours = colours_of(image)
        uv_panel(axes, image, colours, title)
        colour_bar(figure, colours, axes)
    return figure


def _height_colours(values: npt.NDArray[Any]) -> Colours:
    return sequential(values, "height d (µm)", "cividis")


def draw_sphere_distortion(atlas: Atlas) -> Figure:
    """How much the sphere stretches angles and areas of the reference, on the uv grid."""
    reference, sphere, face = atlas.reference, atlas.sphere, atlas.uv.face
    q = conformal_error(reference.vertices, sphere.vertices, sphere.faces)
    change = area_distortion(reference.vertices, sphere.vertices, sphere.faces)
    return _distortion(
        "Distortion of the sphere: the reference → the sphere",
        q[face],
        # As for the uv image: positive where things are shown larger than they are.
        -np.log(np.maximum(change, 1e-12))[face],
        atlas.uv.fields["area_um2"],
    )


def draw_uv_distortion(atlas: Atlas) -> Figure:
    """How much the uv image stretches angles and areas: it cannot but do so at the poles."""
    fields = atlas.uv.fields
    return _distortion(
        "Distortion of the uv image: the reference → (u, v)",
        fields["conformal_error"],
        np.log(np.maximum(fields["area_distortion"], 1e-12)),
        fields["area_um2"],
    )


def _distortion(
    title: str,
    q: npt.NDArray[Any],
    log_area: npt.NDArray[Any],
    area_um2: npt.NDArray[Any],
) -> Figure:
    figure = new_figure(
        13.0, 7.6, title, "histograms and means: each pixel weighs as the area it stands for"
    )
    panels = figure.subplots(2, 2, height_ratios=(3, 2))
    stretch = sequential(q, "Q", low=1.0, weights=area_um2)
    change = symmetric(
        log_area,
        "log λ",
        name="PuOr_r",
        ends=("shrunk", "enlarged"),
        least=0.02,
        weights=area_um2,
    )
    area = np.asarray(area_um2, dtype=float).ravel()
    mean_q = float(np.average(q.ravel(), weights=area))
    mean_change = float(np.average(np.abs(log_area).ravel(), weights=area))
    uv_panel(panels[0, 0], q, stretch, "angles: conformal error Q (1 = kept)")
    uv_panel(panels[0, 1], log_area, change, "areas: log λ (0 = kept)")
    colour_bar(figure, stretch, panels[0, 0])
    colour_bar(figure, change, panels[0, 1])
    text = f"mean Q = {mean_q:.4f}"
    histogram_panel(panels[1, 0], q.ravel(), area, stretch, "conformal error Q", (mean_q, text))
    text = f"mean |log λ| = {mean_change:.4f}"
    histogram_panel(panels[1, 1], log_area.ravel(), area, change, "log λ", (0.0, text))
    return figure


def draw_chessboard(atlas: Atlas) -> Figure:
    """Squares of the uv image, carried back to the reference: what they look like on the cell."""
    reference = atlas.reference
    board = chessboard(atlas.uv.shape[0], CHESS_TILES)
    carried = atlas.carry(board, "uv", "reference", kind="label")
    colours = Colours("cividis", 0.6, 2.4, "")
    figure = new_figure(
        13.0,
        9.6,
        "Chessboard: squares of the uv image on the reference",
        "their shape shows how angles change, their size how areas do; left: the middle of the "
        "image, right: from behind",
    )
    grid = figure.add_gridspec(2, 2, height_ratios=(1, 1))
    title = f"{2 * CHESS_TILES} × {CHESS_TILES} squares on (u, v)"
    uv_panel(figure.add_subplot(grid[0, :]), board.astype(float), colours, title)
    mesh = reference.vertices, reference.faces, carried.astype(float), colours
    # Where the image's poles and its middle lie on the cell: the sphere is turned against it.
    places = atlas.uv.positions
    rows = len(places)
    centre = places.mean(axis=(0, 1))
    middle = places[rows // 2, rows - 1 : rows + 1].mean(axis=0)
    axis = frame((places[0] - places[-1]).mean(axis=0), middle - centre)
    for column, (view, side) in enumerate(
        zip(front_and_back(axis), ("front", "back"), strict=True)
    ):
        axes = figure.add_subplot(grid[1, column])
        mesh_panel(axes, *mesh, view)
        axes.set_title(side, fontsize=12, color=INK)
    return figure


# Topography ------------------------------------------------------------------


def draw_topography(atlas: Atlas) -> Figure:
    """Two sections of the (d, u, v) space through the highest point, and the surface in it."""
    chart = atlas.topography
    v, u = highest_pixel(chart.mask)
    across, along = grid_lengths(atlas)
    low, high = shown_heights(chart)
    span = high - low
    stretch = int(np.clip(math.ceil(across / (7 * span)), 1, 4))
    heights = [8.0 * stretch * span / across + 0.7, 10.6 * (0.38 + 0.67 * span / across) + 0.5]
    to_scale = "d, u and v to scale" if stretch == 1 else f"d stretched × {stretch} in the sections"
    figure = new_figure(
        13.0,
        1.2 + sum(heights),
        "Topography: the surface over the reference, which is flat here",
        f"dashed: the reference (d = 0); {to_scale}; lengths of u and v as on a sphere of the "
        "reference's area",
    )
    grid = figure.add_gridspec(2, 2, width_ratios=(2, 1), height_ratios=heights)
    left = figure.add_subplot(grid[0, 0])
    right = figure.add_subplot(grid[0, 1], sharey=left)
    section(left, chart.mask[:, v, :], chart.d_um, across, f"section at v = {v}", "u")
    section(right, chart.mask[:, :, u], chart.d_um, along, f"section at u = {u}", "v")
    left.set_ylabel("d (µm)", fontsize=10)
    for axes in (left, right):
        axes.set_ylim(low, high)
        axes.set_aspect(stretch)
    flat_surface(atlas, figure, figure.add_subplot(grid[1, :]), along / chart.shape[1])
    return figure


# The stop --------------------------------------------------------------------


def draw_reference_stop(atlas: Atlas) -> Figure:
    """Total |K| over the iterations of the flow, and where it was stopped."""
    from matplotlib.ticker import LogLocator

    chart = atlas.reference
    curve = np.asarray(chart.total_curvature, dtype=float)
    figure = new_figure(8.0, 4.8, "Reference: where the smoothing was stopped")
    axes = figure.subplots()
    axes.plot(np.arange(len(curve)), curve, "-o", color=INK, markersize=4, linewidth=1.5)
    lines = [(1.0, "#777777", "1 = convex")]
    if chart.stopped_by == "total_curvature":
        limit = atlas.parameters.reference.curvature_limit
        lines.append((limit, ACCENT, f"limit {limit:g}"))
    for level, colour, text in lines:
        axes.axhline(level, color=colour, linewidth=1, linestyle="--")
        across = axes.get_yaxis_transform()
        axes.text(0.01, level, text, fontsize=10, color=colour, transform=across, va="bottom")
    if 0 <= chart.iteration < len(curve):
        at = curve[chart.iteration]
        axes.plot([chart.iteration], [at], "o", color=ACCENT, markersize=11, zorder=3)
        axes.annotate(
            f"iteration {chart.iteration}\ntotal |K| / 4π = {at:.2f}",
            (chart.iteration, at),
            xytext=(0, 34),
            textcoords="offset points",
            fontsize=11,
            color=ACCENT,
            ha="right" if chart.iteration > len(curve) / 2 else "left",
        )
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter("")
    axes.locator_params(axis="x", integer=True)
    flow = atlas.parameters.reference.flow
    axes.set_xlabel(f"iteration of the smoothing flow ({flow})", fontsize=11)
    axes.set_ylabel("total |K| / 4π", fontsize=11)
    rule = (chart.stopped_by or "not recorded").replace("_", " ")
    axes.set_title(f"stopped by: {rule}", fontsize=11, color="#555555")
    axes.spines[["top", "right"]].set_visible(False)
    return figure


# Everything ------------------------------------------------------------------


def draw_overview(atlas: Atlas) -> Figure:
    """One picture of the whole: surface, reference, sphere, uv, topography."""
    figure = new_figure(15.0, 8.6, "From the cell to its charts and back", "colour: mean curvature")
    grid = figure.add_gridspec(2, 6)
    panels = [figure.add_subplot(grid[0, 2 * i : 2 * i + 2]) for i in range(3)]
    values = curvature_field(atlas.surface)
    colours = curvature_colours(values) if values is not None else None
    extent = common_extents(
        np.concatenate([atlas.surface.vertices, atlas.reference.vertices]), ["z"]
    )[0]
    for axes, chart, title in (
        (panels[0], atlas.surface, "1  surface S(x, y, z)"),
        (panels[1], atlas.reference, "2  reference S_ref(x, y, z)"),
    ):
        mesh_panel(axes, chart.vertices, chart.faces, curvature_field(chart), colours, "z", extent)
        axes.set_title(title, fontsize=13, color=INK)
    front, _ = front_and_back(atlas.uv.rotation)
    mesh_panel(
        panels[2],
        atlas.sphere.vertices,
        atlas.sphere.faces,
        curvature_field(atlas.reference),
        colours,
        front,
        scale_bar_unit="",
    )
    panels[2].set_title("3  sphere S²", fontsize=13, color=INK)
    flat, topography = (figure.add_subplot(grid[1, 3 * i : 3 * i + 3]) for i in range(2))
    image = atlas.uv.fields.get("surface_mean_curvature_per_um")
    if image is not None and colours is not None:
        uv_panel(flat, image, colours, "4  uv image S(u, v)")
    _, along = grid_lengths(atlas)
    flat_surface(atlas, figure, topography, along / atlas.topography.shape[1])
    topography.set_title("5  topography S(d, u, v)", fontsize=13, color=INK)
    return figure


PICTURES: dict[str, tuple[Callable[[Atlas], Figure], tuple[str, ...]]] = {
    "overview": (draw_overview, ("surface", "reference", "sphere", "uv", "topography")),
    "surface": (draw_surface, ("surface",)),
    "reference": (draw_reference, ("reference",)),
    "reference_stop": (draw_reference_stop, ("reference",)),
    "sphere": (draw_sphere, ("sphere", "reference")),
    "uv": (draw_uv, ("uv",)),
    "sphere_distortion": (draw_sphere_distortion, ("reference", "sphere", "uv")),
    "uv_distortion": (draw_uv_distortion, ("uv",)),
    "chessboard": (draw_chessboard, ("reference", "sphere", "uv")),
    "topography": (draw_topography, ("topography", "uv")),
    "direct": (draw_direct, ("direct", "surface")),
    "protrusions": (draw_protrusions, ("protrusions", "surface", "uv", "topography")),
}
