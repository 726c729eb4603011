"""Parts of the pictures that know the charts: sections, the flat surface, views of the sphere."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Ints, Topography
from ..geometry.mesh import face_areas
from .drawing import ACCENT, INK, colour_bar, curvature_colours, mesh_panel

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..atlas import Atlas

CURVATURE = "mean_curvature_per_um"


def curvature_field(chart: Any) -> npt.NDArray[Any] | None:
    """The chart's mean curvature (n,) in 1/µm, or None."""
    field: npt.NDArray[Any] | None = chart.fields.get(CURVATURE)
    return field


def front_and_back(axis: Floats) -> tuple[Floats, Floats]:
    """Views with the unwrapping axis upwards: u = 0 in the middle, and from behind."""
    up, y, x = axis
    # u runs to the right, as in the uv image; x is azimuth 0.
    front = np.stack([-x, -up, y])
    back = np.stack([x, -up, -y])
    return front, back


def highest_pixel(mask: npt.NDArray[np.bool_]) -> tuple[int, int]:
    """(v, u) of the column with the highest point, between 45° and 135° of inclination."""
    depth, rows, _ = mask.shape
    top = depth - np.argmax(mask[::-1], axis=0)
    top[~mask.any(axis=0)] = 0
    first = rows // 4
    band = top[first : rows - first]
    v, u = np.unravel_index(int(np.argmax(band)), band.shape)
    return int(v) + first, int(u)


def shown_heights(chart: Topography) -> tuple[float, float]:
    """The heights d (µm) worth showing: a little more than the surface takes."""
    d = chart.surface[:, 0]
    low, high = float(np.nanmin(d)), float(np.nanmax(d))
    room = 0.12 * (high - low) + 2 * float(chart.d_um[1] - chart.d_um[0])
    return max(low - room, float(chart.d_um[0])), high + room


def grid_lengths(atlas: Atlas) -> tuple[float, float]:
    """Length (µm) of u once around the equator and of v from pole to pole."""
    if atlas.has("reference"):
        area = float(face_areas(atlas.reference.vertices, atlas.reference.faces).sum())
    else:
        area = float(np.sum(atlas.uv.fields["area_um2"]))
    radius = math.sqrt(area / (4 * math.pi))
    return 2 * math.pi * radius, math.pi * radius


def section(
    axes: Axes, mask: npt.NDArray[np.bool_], d_um: Floats, length: float, title: str, name: str
) -> None:
    """A section (D, n) of the mapped mask over `length` µm: the cell, its outline, d = 0."""
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


def flat_surface(atlas: Atlas, figure: Any, axes: Axes, pixel: float) -> None:
    """The surface in (d, u, v), seen obliquely from outside; `pixel` is the length of a pixel."""
    chart = atlas.topography
    columns = chart.shape[2]
    # The mesh is cut unevenly along the seam: draw it on both sides, and show one turn.
    turns = np.array([[0.0, 0.0, turn * columns] for turn in (-1, 0, 1)])
    vertices = (chart.cut_vertices + turns[:, None]).reshape(-1, 3)
    count = len(chart.cut_vertices)
    faces = np.concatenate([chart.cut_faces + turn * count for turn in range(3)])
    # (depth, down, right) = (−d, v, u): seen from outside, as the uv image is.
    vertices = vertices * np.array([-1.0, pixel, pixel])
    faces = _seen_from_above(vertices, faces)
    values, colours = None, None
    if atlas.has("surface") and (found := curvature_field(atlas.surface)) is not None:
        values = np.tile(found[chart.cut_origin], 3)
        colours = curvature_colours(found)
    tilt = math.radians(42)
    cosine, sine = math.cos(tilt), math.sin(tilt)
    view = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    down = vertices @ view[1]
    room = 0.01 * columns * pixel
    extent = (
        -0.5 * pixel,
        (columns - 0.5) * pixel,
        float(down.max()) + room,
        float(down.min()) - room,
    )
    mesh_panel(axes, vertices, faces, values, colours, view, extent, pixels=1100)
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
