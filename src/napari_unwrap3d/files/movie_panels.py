"""The panels of a movie's pictures: each is drawn once, and then shows one timepoint after another.

Axes, scales and colours do not change in time, so that what changes is the cell.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ..charts import Floats, Frame
from ..motion.kymograph import Kymograph, SurfaceLine, broken_at_seam, line_on_surface
from ..motion.projections import Projections
from ..unwrapping.uv_views import Pole, polar_to_pixel, to_polar, uv_to_polar
from .drawing import INK, Colours, Extent, round_length, scale_bar, uv_axes, uv_panel
from .rendering import VIEWS, Rendering, render

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ..atlas import Atlas

LINE: dict[str, Any] = {"color": "#111111", "linewidth": 1.6}
NOW: dict[str, Any] = {"color": INK, "linewidth": 1.2, "linestyle": "--"}
# What lies deeper than this part of the picture below what is seen is hidden.
HIDDEN = 0.02
BRIGHTEST_PERCENT = 99.8


class Panel(Protocol):
    """One part of a picture."""

    def show(self, frame: Frame) -> None:
        """Show a timepoint."""


class SurfacePanel:
    """The surface S^t(x, y, z) from one side, coloured by a field, and a line on it."""

    def __init__(
        self,
        axes: Axes,
        field: str,
        colours: Colours,
        axis: str,
        extent: Extent,
        pixels: int,
        atlas: Atlas,
        line: SurfaceLine | None,
    ) -> None:
        self._field, self._colours, self._axis = field, colours, axis
        self._extent, self._pixels = extent, pixels
        self._atlas, self._line = atlas, line
        self._image = axes.imshow(
            np.zeros((1, 1, 4)), extent=extent, interpolation="antialiased", zorder=1
        )
        axes.set_axis_off()
        scale_bar(axes, extent)
        axes.set_title(f"surface, seen along {axis}", fontsize=12, color=INK)
        (self._drawn,) = axes.plot([], [], zorder=2, **LINE)

    def show(self, frame: Frame) -> None:
        cell = frame.surface
        drawn = render(cell.vertices, cell.faces, self._axis, self._pixels, self._extent)
        values = drawn.interpolate(np.asarray(cell.fields[self._field]))
        self._image.set_data(drawn.image(self._colours(values)))
        self._image.set_extent(drawn.extent)
        if self._line is not None:
            places = line_on_surface(self._atlas, self._line, frame)
            seen = self._in_front(drawn, places, cell.vertices)
            self._drawn.set_data(seen[:, 2], seen[:, 1])

    def _in_front(self, drawn: Rendering, places: Floats, vertices: Floats) -> Floats:
        """Places (depth, down, right) of a line in the picture, NaN where the cell hides them."""
        rotation = VIEWS[self._axis]
        where = places @ rotation.T
        depth = np.full(drawn.seen.shape, -np.inf)
        depth[drawn.seen] = drawn.interpolate(vertices @ rotation[0])
        left, right, bottom, top = drawn.extent
        rows, columns = drawn.seen.shape
        there = np.isfinite(where).all(axis=1)
        row = np.clip((where[there, 1] - top) / (bottom - top) * rows, 0, rows - 1)
        column = np.clip((where[there, 2] - left) / (right - left) * columns, 0, columns - 1)
        seen = depth[row.astype(int), column.astype(int)]
        hidden = where[there, 0] > seen + HIDDEN * (right - left)
        where[np.flatnonzero(there)[hidden]] = np.nan
        return where


class UvPanel:
    """The uv image of a field, and a line in it."""

    def __init__(
        self, axes: Axes, field: str, colours: Colours, rows: int, line: SurfaceLine | None
    ) -> None:
        self._field = field
        uv_panel(axes, np.full((rows, 2 * rows), np.nan), colours)
        uv_axes(axes, (rows, 2 * rows), "unwrapped, S(u, v)")
        (self._image,) = axes.images
        if line is not None:
            v, u = broken_at_seam(line.points, rows).T
            axes.plot(u, v, **LINE)

    def show(self, frame: Frame) -> None:
        self._image.set_data(np.ma.masked_invalid(frame.uv[self._field]))


class PolarPanel:
    """The uv image around one pole, the other pole being the rim (paper, Ext. Fig. 5b)."""

    def __init__(
        self, axes: Axes, field: str, colours: Colours, rows: int, pole: Pole, line: Any
    ) -> None:
        self._field, self._pole, self._size = field, pole, 2 * rows
        mappable = colours.mappable()
        self._image = axes.imshow(
            np.full((self._size, self._size), np.nan),
            cmap=mappable.cmap.with_extremes(bad=(0, 0, 0, 0)),
            vmin=colours.low,
            vmax=colours.high,
            interpolation="antialiased",
        )
        polar_grid(axes, self._size, pole)
        axes.set_title(f"polar (r, φ) around the {pole} pole", fontsize=12, color=INK)
        if line is not None:
            points = polar_to_pixel(uv_to_polar(line.points, rows, pole), self._size, pole)
            axes.plot(points[:, 1], points[:, 0], **LINE)

    def show(self, frame: Frame) -> None:
        self._image.set_data(
            np.ma.masked_invalid(to_polar(frame.uv[self._field], self._pole, self._size))
        )


class ProjectionPanel:
    """The surface-limited projection of a channel (paper, Fig. 4c)."""

    def __init__(self, axes: Axes, projections: Projections, brightest: float, dim: float) -> None:
        self._projections = projections
        first = projections.at(0)
        self._image = axes.imshow(
            np.zeros_like(first.image),
            cmap="gray",
            vmin=dim,
            vmax=brightest if brightest > dim else dim + 1,
            extent=first.extent,
            interpolation="antialiased",
        )
        axes.set_facecolor("black")
        axes.set_xticks([])
        axes.set_yticks([])
        white_scale_bar(axes, first.extent)
        how = "brightest" if projections.statistic == "max" else "mean"
        axes.set_title(
            f"channel {projections.channel}: {how} within ± {projections.reach_um:g} µm, "
            f"along {projections.axis}",
            fontsize=12,
            color=INK,
        )

    def show(self, frame: Frame) -> None:
        found = self._projections.at(frame.timepoint)
        self._image.set_data(np.ma.masked_invalid(found.image))


class KymographPanel:
    """A kymograph, with a line at the time that is shown."""

    def __init__(self, axes: Axes, found: Kymograph, colours: Colours) -> None:
        draw_kymograph(axes, found, colours)
        self._now = axes.axhline(0.0, **NOW)

    def show(self, frame: Frame) -> None:
        self._now.set_ydata([frame.time_s, frame.time_s])


# Parts ---------------------------------------------------------------------------------


def draw_kymograph(axes: Axes, found: Kymograph, colours: Colours) -> None:
    """A kymograph with the position in µm to the right and the time in s downwards."""
    times, step = found.times_s, found.line.step_um
    half = 0.5 * float(times[1] - times[0]) if len(times) > 1 else 0.5
    mappable = colours.mappable()
    axes.imshow(
        np.ma.masked_invalid(found.values),
        cmap=mappable.cmap,
        vmin=colours.low,
        vmax=colours.high,
        extent=(
            -step / 2,
            float(found.positions_um[-1]) + step / 2,
            float(times[-1]) + half,
            float(times[0]) - half,
        ),
        aspect="auto",
        interpolation="nearest",
    )
    axes.set_xlabel("position along the line (µm)", fontsize=10)
    axes.set_ylabel("time (s)", fontsize=10)
    axes.tick_params(labelsize=9)
    width = f", mean over {found.line.width_um:g} µm" if found.line.width_um else ""
    axes.set_title(f"kymograph{width}", fontsize=12, color=INK)


def polar_grid(axes: Axes, size: int, pole: Pole) -> None:
    """Rings at 45°, 90° and 135° from the pole, and φ at its four quarters."""
    turn = np.linspace(-np.pi, np.pi, 181)
    for r, style in ((0.25, ":"), (0.5, "--"), (0.75, ":"), (1.0, "-")):
        ring = polar_to_pixel(np.column_stack([np.full_like(turn, r), turn]), size, pole)
        axes.plot(ring[:, 1], ring[:, 0], color="#555555", linewidth=0.7, linestyle=style)
    for name, phi in (("0°", 0.0), ("90°", np.pi / 2), ("180°", np.pi), ("−90°", -np.pi / 2)):
        ((down, right),) = polar_to_pixel([[1.05, phi]], size, pole)
        axes.text(right, down, name, fontsize=8, color=INK, ha="center", va="center")
    axes.set_axis_off()
    margin = 0.07 * size
    axes.set_xlim(-margin, size + margin)
    axes.set_ylim(size + margin, -margin)


def white_scale_bar(axes: Axes, extent: Extent) -> None:
    """A bar of a round length in the lower left corner of a dark picture."""
    left, right, bottom, _ = extent
    length, room = round_length(right - left), 0.04 * (right - left)
    y = bottom - room
    axes.plot([left + room, left + room + length], [y, y], color="white", linewidth=3)
    axes.text(
        left + room, y - 0.5 * room, f"{length:g} µm", color="white", fontsize=10, va="bottom"
    )
    axes.set_xlim(left, right)
    axes.set_ylim(bottom, extent[3])
