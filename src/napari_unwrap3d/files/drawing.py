"""What the pictures are made of: figures, shaded meshes, maps, scale and colour bars.

Only matplotlib's object interface with the Agg canvas, so that no window, no display
and no global state is involved, and pictures can be drawn from any thread.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Ints
from .atomic import replacing
from .rendering import VIEWS, extent_of, render

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

DPI = 130
PLAIN = (0.72, 0.72, 0.70)
NOTHING = "#e6e6e6"
INK = "#222222"
ACCENT = "#b2182b"

Extent = tuple[float, float, float, float]


@dataclass(frozen=True)
class Colours:
    """A colour map, its limits and what it shows (with its unit)."""

    name: str
    low: float
    high: float
    label: str
    ends: tuple[str, str] = ("", "")

    def mappable(self) -> ScalarMappable:
        from matplotlib import colormaps
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import Normalize

        cmap = colormaps[self.name].with_extremes(bad=NOTHING)
        return ScalarMappable(Normalize(self.low, self.high), cmap)

    def __call__(self, values: npt.NDArray[Any]) -> Floats:
        rgba = self.mappable().to_rgba(np.ma.masked_invalid(values))
        return np.asarray(rgba, dtype=float)[..., :3]


def symmetric(
    values: npt.NDArray[Any],
    label: str,
    name: str = "RdBu_r",
    ends: tuple[str, str] = ("", ""),
    least: float = 1e-3,
    weights: npt.NDArray[Any] | None = None,
) -> Colours:
    """Red where positive, blue where negative, white at 0; the outermost 2 % saturate.

    The limits are at least ± `least`, so that nothing is made of rounding errors, and
    wide enough that a constant does not look extreme.
    """
    size = np.abs(values)
    middle, high = (_percentile(size, percent, weights) for percent in (50.0, 98.0))
    high = max(high, 1.7 * middle, least)
    return Colours(name, -high, high, label, ends)


def sequential(
    values: npt.NDArray[Any],
    label: str,
    name: str = "viridis",
    low: float | None = None,
    weights: npt.NDArray[Any] | None = None,
) -> Colours:
    """From the lowest (or `low`) to the highest values; the outermost 1 % saturate."""
    start = _percentile(values, 1.0, weights) if low is None else low
    stop = _percentile(values, 99.0, weights)
    return Colours(name, start, stop if stop > start else start + 1e-3, label)


def curvature_colours(values: npt.NDArray[Any]) -> Colours:
    """Mean curvature, symmetric about 0."""
    return symmetric(values, "mean curvature H (µm⁻¹)", ends=("hollow", "bulging"))


def _percentile(
    values: npt.NDArray[Any], percent: float, weights: npt.NDArray[Any] | None = None
) -> float:
    """Percentile of the finite values; with weights, of the weight."""
    flat = np.asarray(values, dtype=float).ravel()
    share = np.ones(len(flat)) if weights is None else np.asarray(weights, dtype=float).ravel()
    keep = np.isfinite(flat) & np.isfinite(share)
    if not keep.any():
        return 0.0
    order = np.argsort(flat[keep])
    total = np.cumsum(share[keep][order])
    index = np.searchsorted(total, percent / 100 * total[-1])
    return float(flat[keep][order][min(index, len(order) - 1)])


def new_figure(width: float, height: float, title: str, subtitle: str = "") -> Figure:
    """An empty figure (inches) with its title."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=DPI, facecolor="white", layout="constrained")
    figure.suptitle(title, fontsize=15, fontweight="bold", color=INK)
    if subtitle:
        figure.supxlabel(subtitle, fontsize=10, color="#555555")
    return figure


def save_figure(figure: Figure, path: Path) -> Path:
    """Write a PNG atomically; the same figure gives the same bytes."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.image import imsave

    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()  # once; savefig would draw everything a second time for the layout
    image = np.asarray(canvas.buffer_rgba())[..., :3]
    options: dict[str, Any] = {"metadata": {"Software": None}, "pil_kwargs": {"compress_level": 1}}
    with replacing(path) as partial:
        imsave(partial, np.ascontiguousarray(image), format="png", dpi=DPI, **options)
    return path


def colour_bar(figure: Figure, colours: Colours, axes: Any, **options: Any) -> None:
    """A colour bar with its label, and words at its ends where they help."""
    shrink = options.pop("shrink", 0.8)
    bar = figure.colorbar(
        colours.mappable(), ax=axes, extend="both", shrink=shrink, pad=0.02, **options
    )
    bar.set_label(colours.label, fontsize=11, color=INK)
    bar.ax.tick_params(labelsize=9)
    bar.outline.set_linewidth(0.5)
    flat = bar.orientation == "horizontal"
    for position, word in zip((-0.075, 1.075), colours.ends, strict=True):
        x, y = (position, 0.5) if flat else (0.5, position)
        outer = ("right", "left") if flat else ("top", "bottom")
        towards = outer[0] if position < 0 else outer[1]
        horizontal, vertical = (towards, "center") if flat else ("center", towards)
        bar.ax.text(
            x,
            y,
            word,
            transform=bar.ax.transAxes,
            fontsize=9,
            color="#555555",
            ha=horizontal,
            va=vertical,
        )


# Meshes ------------------------------------------------------------------------


def common_extents(vertices: Floats, views: list[Any]) -> list[Extent]:
    """An extent for each view of a mesh, all of the same size, so all of one scale."""
    extents = []
    for view in views:
        rotation = VIEWS[view] if isinstance(view, str) else view
        extents.append(extent_of(vertices @ rotation.T))
    half_width = max(right - left for left, right, _, _ in extents) / 2
    half_height = max(bottom - top for _, _, bottom, top in extents) / 2
    result = []
    for left, right, bottom, top in extents:
        x, y = (left + right) / 2, (top + bottom) / 2
        result.append((x - half_width, x + half_width, y + half_height, y - half_height))
    return result


def mesh_panel(
    axes: Axes,
    vertices: Floats,
    faces: Ints,
    values: npt.NDArray[Any] | None,
    colours: Callable[[npt.NDArray[Any]], Floats] | None,
    view: Any = "z",
    extent: Extent | None = None,
    pixels: int = 520,
    scale_bar_unit: str = "µm",
    normals: Floats | None = None,
) -> None:
    """Draw a mesh coloured by `values` per vertex (n,) or per face (m,), shaded.

    Without values the mesh is grey. `scale_bar_unit` empty leaves the scale bar out.
    `normals` are computed unless given.
    """
    drawn = render(vertices, faces, view, pixels, extent, normals)
    if values is None or colours is None:
        rgb = np.broadcast_to(np.asarray(PLAIN), (len(drawn.face), 3))
    elif len(values) == len(vertices):
        rgb = colours(drawn.interpolate(values))
    else:
        rgb = colours(np.asarray(values)[drawn.face])
    axes.imshow(drawn.image(rgb), extent=drawn.extent, interpolation="antialiased")
    axes.set_axis_off()
    if scale_bar_unit:
        scale_bar(axes, drawn.extent, scale_bar_unit)


def round_length(span: float) -> float:
    """1, 2 or 5 times a power of ten, about a fifth of `span`."""
    power = 10.0 ** np.floor(np.log10(max(span / 5, 1e-12)))
    return float(max(n * power for n in (1, 2, 5) if n * power <= span / 5))


def scale_bar(axes: Axes, extent: Extent, unit: str = "µm") -> None:
    """A black bar of a round length at the lower left, under what is drawn."""
    left, right, bottom, top = extent
    length, room = round_length(right - left), 0.03 * (right - left)
    x, y = left + room, bottom + room
    axes.plot([x, x + length], [y, y], color=INK, linewidth=3, solid_capstyle="butt")
    axes.annotate(
        f"{length:g} {unit}",
        (x + length, y),
        xytext=(6, 0),
        textcoords="offset points",
        ha="left",
        va="center",
        fontsize=10,
        color=INK,
    )
    axes.set_xlim(left, right)
    axes.set_ylim(bottom + 2 * room, top)


# Images --------------------------------------------------------------------------


def uv_panel(axes: Axes, image: npt.NDArray[Any], colours: Colours, title: str = "") -> None:
    """Draw a uv image with its two coordinates; pixels without a value are light grey."""
    rows, columns = image.shape
    mappable = colours.mappable()
    axes.imshow(
        np.ma.masked_invalid(image),
        cmap=mappable.cmap,
        vmin=colours.low,
        vmax=colours.high,
        extent=(-0.5, columns - 0.5, rows - 0.5, -0.5),
        interpolation="antialiased",
    )
    uv_axes(axes, (rows, columns), title)


def uv_axes(axes: Axes, shape: tuple[int, int], title: str) -> None:
    """The two coordinates of a uv image, and its title."""
    rows, columns = shape
    axes.set_title(title, fontsize=12, color=INK)
    axes.set_xlabel("u, around the axis (pixels)", fontsize=10)
    axes.set_ylabel("v, pole to pole (pixels)", fontsize=10)
    axes.set_xticks([0, columns // 4, columns // 2, 3 * columns // 4, columns - 1])
    axes.set_yticks([0, rows // 2, rows - 1])
    axes.tick_params(labelsize=9)


def histogram_panel(
    axes: Axes,
    values: npt.NDArray[Any],
    weights: npt.NDArray[Any],
    colours: Colours,
    label: str,
    mark: tuple[float, str],
) -> None:
    """Share of the area over the values, in the colours of the map above it."""
    keep = np.isfinite(values) & np.isfinite(weights)
    clipped = np.clip(values[keep], colours.low, colours.high)
    share, edges = np.histogram(clipped, 48, (colours.low, colours.high), weights=weights[keep])
    share = 100 * share / max(share.sum(), 1e-300)
    middle = (edges[1:] + edges[:-1]) / 2
    axes.bar(
        middle, share, np.diff(edges), color=colours(middle), edgecolor="#777777", linewidth=0.4
    )
    axes.set_ylim(0, 1.2 * share.max())
    at, text = mark
    axes.axvline(at, color=INK, linewidth=1.2, linestyle="--")
    side = "left" if at < (colours.low + colours.high) / 2 else "right"
    axes.annotate(
        text,
        (at, 0.98),
        xycoords=("data", "axes fraction"),
        xytext=(6 if side == "left" else -6, 0),
        textcoords="offset points",
        ha=side,
        va="top",
        fontsize=10,
        color=INK,
    )
    axes.set_xlabel(label, fontsize=10)
    axes.set_ylabel("share of the area (%)", fontsize=10)
    axes.tick_params(labelsize=9)
    axes.spines[["top", "right"]].set_visible(False)
