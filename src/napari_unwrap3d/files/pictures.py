"""A picture of every chart of an atlas, as PNG, to see at a glance what came out."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Ints
from ..errors import ChartMissingError
from ..geometry.distortion import area_distortion
from ..geometry.mesh import face_areas
from ..progress import Progress, silent
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

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..atlas import Atlas

CURVATURE = "mean_curvature_per_um"
SIDES = ("z", "y", "x")


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
        if all(has_chart(atlas, chart) for chart in charts):
            written.append(save_figure(draw(atlas), folder / f"{name}.png"))
    report(1.0, "pictures")
    return written


def has_chart(atlas: Atlas, name: str) -> bool:
    """Whether the atlas has this chart."""
    try:
        return getattr(atlas, name) is not None
    except ChartMissingError:
        return False


def _curvature(chart: Any) -> npt.NDArray[Any] | None:
    field: npt.NDArray[Any] | None = chart.fields.get(CURVATURE)
    return field


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
        [atlas.surface.vertices] if has_chart(atlas, "surface") else [],
    )


def _three_sides(chart: Any, title: str, subtitle: str, beside: Sequence[Floats] = ()) -> Figure:
    figure = new_figure(13.0, 5.0, title, subtitle)
    panels = figure.subplots(1, 3)
    values = _curvature(chart)
    colours = curvature_colours(values) if values is not None else None
    extents = common_extents(np.concatenate([chart.vertices, *beside]), list(SIDES))
    for axes, side, extent in zip(panels, SIDES, extents, strict=True):
        mesh_panel(axes, chart.vertices, chart.faces, values, colours, side, extent)
        axes.set_title(f"seen along {side}", fontsize=12, color=INK)
    if colours is not None:
        colour_bar(figure, colours, list(panels))
    return figure


def draw_sphere(atlas: Atlas) -> Figure:
    """Conformal and equiareal state side by side: mean curvature above, area change below."""
    sphere, reference = atlas.sphere, atlas.reference
    final = "equiareal" if sphere.blend == 1 else f"blend {sphere.blend:g}"
    states = {"conformal (angles kept)": sphere.conformal, final: sphere.vertices}
    if sphere.blend == 1:
        states = {
            "conformal (angles kept)": sphere.conformal,
            "equiareal (areas kept)": sphere.vertices,
        }
    figure = new_figure(
        13.0,
        7.2,
        "Sphere S²",
        "the reference's mesh on the unit sphere, from both sides of the axis",
    )
    panels = figure.subplots(2, 4)
    curvature = _curvature(reference)
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
    axis = atlas.uv.rotation if has_chart(atlas, "uv") else np.eye(3)
    front, back = _front_and_back(axis)
    for column, (name, vertices) in enumerate(states.items()):
        for offset, (view, side) in enumerate(((front, "front"), (back, "back"))):
            top, below = panels[:, 2 * column + offset]
            mesh_panel(
                top, vertices, sphere.faces, curvature, bent, view, pixels=420, scale_bar_unit=""
            )
            mesh_panel(
                below,
                vertices,
                sphere.faces,
                distortion[name],
                spread,
                view,
                pixels=420,
                scale_bar_unit="",
            )
            top.set_title(f"{name}\n{side}", fontsize=12, color=INK)
    if bent is not None:
        colour_bar(figure, bent, list(panels[0]))
    colour_bar(figure, spread, list(panels[1]))
    return figure


def _front_and_back(axis: Floats) -> tuple[Floats, Floats]:
    """Views with the unwrapping axis upwards: u = 0 in the middle, and from behind."""
    up, y, x = axis
    # u runs to the right, as in the uv image; x is azimuth 0.
    front = np.stack([-x, -up, y])
    back = np.stack([x, -up, -y])
    return front, back


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


def _height_colours(values: npt.NDArray[Any]) -> Colours:
    return sequential(values, "height d (µm)", "cividis")


def draw_distortion(atlas: Atlas) -> Figure:
    """How much the uv image stretches angles and areas, and how much of the area is concerned."""
    fields = atlas.uv.fields
    area = np.asarray(fields["area_um2"], dtype=float).ravel()
    q, log_area = fields["conformal_error"], np.log(np.maximum(fields["area_distortion"], 1e-12))
    figure = new_figure(
        13.0, 7.6, "Distortion of the sphere", "each pixel weighs as much as the area it stands for"
    )
    panels = figure.subplots(2, 2, height_ratios=(3, 2))
    stretch = sequential(q, "conformal error Q (1 = angles kept)", "viridis", low=1.0)
    change = symmetric(log_area, "log λ (0 = areas kept)", name="PuOr_r", least=0.02)
    mean_q = float(np.average(q.ravel(), weights=area))
    mean_change = float(np.average(np.abs(log_area).ravel(), weights=area))
    uv_panel(panels[0, 0], q, stretch, "angles: conformal error Q")
    uv_panel(panels[0, 1], log_area, change, "areas: log λ")
    colour_bar(figure, stretch, panels[0, 0])
    colour_bar(figure, change, panels[0, 1])
    histogram_panel(
        panels[1, 0],
        q.ravel(),
        area,
        stretch,
        "conformal error Q",
        (mean_q, f"mean Q = {mean_q:.4f}"),
    )
    histogram_panel(
        panels[1, 1],
        log_area.ravel(),
        area,
        change,
        "log λ",
        (0.0, f"mean |log λ| = {mean_change:.4f}"),
    )
    return figure


# Topography ------------------------------------------------------------------


def draw_topography(atlas: Atlas) -> Figure:
    """Two sections of the (d, u, v) space through the highest point, and the surface in it."""
    chart = atlas.topography
    v, u = highest_pixel(chart.mask)
    across, along = _grid_lengths(atlas)
    span = float(chart.d_um[-1] - chart.d_um[0])
    stretch = int(np.clip(math.ceil(across / (7 * span)), 1, 4))
    heights = [8.0 * stretch * span / across + 0.7, 11.0 * (0.36 + 0.67 * span / across) + 0.4]
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
    _section(left, chart.mask[:, v, :], chart.d_um, across, f"section at v = {v}", "u")
    _section(right, chart.mask[:, :, u], chart.d_um, along, f"section at u = {u}", "v")
    left.set_ylabel("d (µm)", fontsize=10)
    for axes in (left, right):
        axes.set_aspect(stretch)
    _flat_surface(atlas, figure, figure.add_subplot(grid[1, :]), along / chart.shape[1])
    return figure


def highest_pixel(mask: npt.NDArray[np.bool_]) -> tuple[int, int]:
    """(v, u) of the column with the highest point, between 45° and 135° of inclination."""
    depth, rows, _ = mask.shape
    top = depth - np.argmax(mask[::-1], axis=0)
    top[~mask.any(axis=0)] = 0
    first = rows // 4
    band = top[first : rows - first]
    v, u = np.unravel_index(int(np.argmax(band)), band.shape)
    return int(v) + first, int(u)


def _grid_lengths(atlas: Atlas) -> tuple[float, float]:
    """Length (µm) of u once around the equator and of v from pole to pole."""
    if has_chart(atlas, "reference"):
        area = float(face_areas(atlas.reference.vertices, atlas.reference.faces).sum())
    else:
        area = float(np.sum(atlas.uv.fields["area_um2"]))
    radius = math.sqrt(area / (4 * math.pi))
    return 2 * math.pi * radius, math.pi * radius


def _section(
    axes: Axes, mask: npt.NDArray[np.bool_], d_um: Floats, length: float, title: str, name: str
) -> None:
    half = (d_um[1] - d_um[0]) / 2
    low, high = float(d_um[0] - half), float(d_um[-1] + half)
    columns = mask.shape[1]
    axes.imshow(
        np.where(mask, 0.78, 1.0),
        cmap="gray",
        vmin=0,
        vmax=1,
        origin="lower",
        extent=(0, length, low, high),
        interpolation="nearest",
        aspect="equal",
    )
    x = (np.arange(columns) + 0.5) * length / columns
    axes.contour(x, d_um, mask.astype(float), [0.5], colors=[ACCENT], linewidths=1.4)
    axes.axhline(0, color=INK, linewidth=1, linestyle="--")
    axes.set_title(title, fontsize=12, color=INK)
    axes.set_xlabel(f"{name} (µm)", fontsize=10)
    axes.tick_params(labelsize=9)


def _flat_surface(atlas: Atlas, figure: Any, axes: Axes, pixel: float) -> None:
    chart = atlas.topography
    # (depth, down, right) = (−d, v, u): seen from outside, as the uv image is.
    vertices = chart.surface_vertices * np.array([-1.0, pixel, pixel])
    faces = _seen_from_above(vertices, chart.surface_faces)
    values, colours = None, None
    if has_chart(atlas, "surface") and (found := _curvature(atlas.surface)) is not None:
        values = found[chart.surface_origin]
        colours = curvature_colours(found)
    tilt = math.radians(42)
    cosine, sine = math.cos(tilt), math.sin(tilt)
    view = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    mesh_panel(axes, vertices, faces, values, colours, view, pixels=1100)
    axes.set_title(
        "the topographic surface S(d, u, v), coloured by the curvature it has on the cell",
        fontsize=12,
        color=INK,
    )
    if colours is not None:
        colour_bar(figure, colours, axes)


def _seen_from_above(vertices: Floats, faces: Ints) -> Ints:
    """Faces turned so that most of them face −depth."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    towards = np.cross(b - a, c - a)[:, 0].sum()
    return faces if towards <= 0 else faces[:, ::-1]


# The stop --------------------------------------------------------------------


def draw_reference_stop(atlas: Atlas) -> Figure:
    """Total |K| over the iterations of the flow, and where it was stopped."""
    chart = atlas.reference
    curve = np.asarray(chart.total_curvature, dtype=float)
    figure = new_figure(8.0, 4.6, "Reference: where the smoothing was stopped")
    axes = figure.subplots()
    axes.plot(np.arange(len(curve)), curve, "-o", color=INK, markersize=4, linewidth=1.5)
    axes.axhline(1.0, color="#777777", linewidth=1, linestyle=":")
    axes.text(
        0.99,
        1.0,
        "convex",
        transform=axes.get_yaxis_transform(),
        ha="right",
        va="bottom",
        fontsize=10,
        color="#555555",
    )
    if chart.stopped_by == "total_curvature":
        limit = atlas.parameters.reference.curvature_limit
        axes.axhline(limit, color=ACCENT, linewidth=1, linestyle="--")
        axes.text(
            0.99,
            limit,
            f"limit {limit:g}",
            transform=axes.get_yaxis_transform(),
            ha="right",
            va="bottom",
            fontsize=10,
            color=ACCENT,
        )
    if 0 <= chart.iteration < len(curve):
        at = curve[chart.iteration]
        axes.plot([chart.iteration], [at], "o", color=ACCENT, markersize=11, zorder=3)
        axes.annotate(
            f"iteration {chart.iteration}\ntotal |K| / 4π = {at:.2f}",
            (chart.iteration, at),
            xytext=(14, 26),
            textcoords="offset points",
            fontsize=11,
            color=ACCENT,
        )
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.set_xlabel("iteration of the smoothing flow (cMCF)", fontsize=11)
    axes.set_ylabel("total |K| / 4π", fontsize=11)
    axes.set_title(
        f"stopped by: {chart.stopped_by or 'not recorded'}", fontsize=11, color="#555555"
    )
    axes.spines[["top", "right"]].set_visible(False)
    return figure


# Everything ------------------------------------------------------------------


def draw_overview(atlas: Atlas) -> Figure:
    """One picture of the whole: surface, reference, sphere, uv, topography."""
    figure = new_figure(15.0, 8.6, "From the cell to its charts and back", "colour: mean curvature")
    rows = figure.subfigures(2, 1, height_ratios=(1, 1))
    panels = rows[0].subplots(1, 3)
    values = _curvature(atlas.surface)
    colours = curvature_colours(values) if values is not None else None
    extent = common_extents(
        np.concatenate([atlas.surface.vertices, atlas.reference.vertices]), ["z"]
    )[0]
    for axes, chart, title in (
        (panels[0], atlas.surface, "1  surface S(x, y, z)"),
        (panels[1], atlas.reference, "2  reference S_ref(x, y, z)"),
    ):
        mesh_panel(axes, chart.vertices, chart.faces, _curvature(chart), colours, "z", extent)
        axes.set_title(title, fontsize=13, color=INK)
    front, _ = _front_and_back(atlas.uv.rotation)
    mesh_panel(
        panels[2],
        atlas.sphere.vertices,
        atlas.sphere.faces,
        _curvature(atlas.reference),
        colours,
        front,
        scale_bar_unit="",
    )
    panels[2].set_title("3  sphere S²", fontsize=13, color=INK)
    flat, topography = rows[1].subplots(1, 2)
    image = atlas.uv.fields.get("surface_mean_curvature_per_um")
    if image is not None and colours is not None:
        uv_panel(flat, image, colours, "4  uv image S(u, v)")
    _, along = _grid_lengths(atlas)
    _flat_surface(atlas, rows[1], topography, along / atlas.topography.shape[1])
    topography.set_title("5  topography S(d, u, v)", fontsize=13, color=INK)
    return figure


PICTURES: dict[str, tuple[Callable[[Atlas], Figure], tuple[str, ...]]] = {
    "overview": (draw_overview, ("surface", "reference", "sphere", "uv", "topography")),
    "surface": (draw_surface, ("surface",)),
    "reference": (draw_reference, ("reference",)),
    "reference_stop": (draw_reference_stop, ("reference",)),
    "sphere": (draw_sphere, ("sphere", "reference")),
    "uv": (draw_uv, ("uv",)),
    "distortion": (draw_distortion, ("uv",)),
    "topography": (draw_topography, ("topography", "uv")),
}
