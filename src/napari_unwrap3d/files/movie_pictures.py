"""Pictures of a movie, one for each timepoint: one view of it, or all of them side by side.

Without a window and without OpenGL, so that they can be made anywhere, and from any thread.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from ..charts import Floats
from ..errors import ParameterError
from ..fields import CURVATURE, HEIGHT, SIGNED
from ..motion.kymograph import Kymograph, SurfaceLine
from ..motion.projections import Projections
from ..motion.uv_stacks import check_field, field_label, made_frames
from ..progress import Progress, silent
from ..unwrapping.uv_views import Pole
from .drawing import INK, Colours, Extent, colour_bar, new_figure, sequential, symmetric
from .movie_panels import (
    BRIGHTEST_PERCENT,
    KymographPanel,
    Panel,
    PolarPanel,
    ProjectionPanel,
    SurfacePanel,
    UvPanel,
)
from .rendering import VIEWS, extent_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..motion.movie import Movie

View = Literal["surface", "uv", "polar", "projection", "kymograph"]
VIEW_NAMES: tuple[View, ...] = ("surface", "uv", "polar", "projection", "kymograph")
ALL = "all"

DPI = 100
# Inches of a picture of one view.
SIZES: dict[str, tuple[float, float]] = {
    "surface": (7.6, 7.0),
    "uv": (9.6, 5.6),
    "polar": (7.6, 7.0),
    "projection": (7.0, 7.0),
    "kymograph": (7.6, 6.0),
}
ALL_SIZE = (16.0, 9.4)
NARROWER = 0.75
SAMPLES_PER_FRAME = 20_000
SURFACE_PIXELS = 520


@dataclass(frozen=True)
class Scales:
    """What is the same for all timepoints.

    Attributes
    ----------
    colours : Colours
        Of the field.
    extent : (left, right, bottom, top)
        Of the surface seen along the axis, in µm.
    """

    colours: Colours
    extent: Extent


def common_scales(
    movie: Movie,
    name: str = CURVATURE,
    axis: str = "z",
    limits: tuple[float, float] | None = None,
    progress: Progress | None = None,
) -> Scales:
    """Colour limits and extent for all timepoints; reads every frame once.

    Parameters
    ----------
    movie : Movie
    name : str
        Of the field.
    axis : "z", "y" or "x"
    limits : (float, float), optional
        The values at the ends of the colour bar, instead of those that the field has.
    progress : Progress, optional
    """
    check_field(movie, name)
    if axis not in VIEWS:
        raise ParameterError(f"There is no axis {axis!r}.", hint="Axes: z, y, x.")
    samples, extents = [], []
    for _, frame in made_frames(movie, progress):
        if frame is not None:
            values = np.asarray(frame.surface.fields[name], np.float64)
            samples.append(values[:: max(len(values) // SAMPLES_PER_FRAME, 1)])
            extents.append(extent_of(frame.surface.vertices @ VIEWS[axis].T))
    if not extents:
        raise ParameterError("No frame of the movie was made.", hint="Call movie.compute().")
    left, right, bottom, top = np.array(extents).T
    extent = float(left.min()), float(right.max()), float(bottom.max()), float(top.min())
    return Scales(field_colours(name, np.concatenate(samples), limits), extent)


def field_colours(
    name: str, values: npt.NDArray[Any], limits: tuple[float, float] | None = None
) -> Colours:
    """Colours of a field of a movie, by its values or between limits."""
    label = field_label(name)
    if name in SIGNED or name == "gaussian_curvature":
        colours = symmetric(values, label)
    else:
        colours = sequential(values, label, "cividis" if name == HEIGHT else "viridis")
    if limits is None:
        return colours
    if not limits[0] < limits[1]:
        raise ParameterError("The lower limit of the colours is below the upper.", limits=limits)
    return Colours(colours.name, *limits, colours.label, colours.ends)


@dataclass(eq=False)
class MoviePictures:
    """Draws the timepoints of a movie. Make it with :func:`movie_pictures`.

    Attributes
    ----------
    movie : Movie
    views : tuple of str
    figure : matplotlib Figure
    """

    movie: Movie
    views: tuple[View, ...]
    figure: Figure
    _panels: list[Panel] = field(default_factory=list)
    _stamp: Any = None

    def picture(self, timepoint: int) -> npt.NDArray[np.uint8]:
        """A timepoint as an RGB image (rows, columns, 3), all of one size.

        Raises
        ------
        InputError
            There is no such timepoint, or its frame cannot be made.
        """
        frame = self.movie.frame(timepoint)
        for panel in self._panels:
            panel.show(frame)
        self._stamp.set_text(f"t = {frame.time_s:.{self._decimals}f} s")
        return self._drawn()

    def pictures(self, progress: Progress | None = None) -> Iterator[npt.NDArray[np.uint8]]:
        """All timepoints whose frames are there or can be made, in order."""
        report = progress or silent()
        for timepoint in range(len(self.movie)):
            report(timepoint / len(self.movie), f"timepoint {timepoint}")
            if self.movie.work is not None or self.movie.has_frame(timepoint):
                yield self.picture(timepoint)

    @property
    def _decimals(self) -> int:
        """Enough to tell neighbouring timepoints apart."""
        step = self.movie.time_step_s
        return next((d for d in range(4) if abs(step - round(step, d)) < 1e-9), 3)

    def _drawn(self) -> npt.NDArray[np.uint8]:
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        canvas: Any = FigureCanvasAgg(self.figure)
        canvas.draw()
        # The places of the first picture are those of all.
        self.figure.set_layout_engine("none")
        return np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3])


def movie_pictures(
    movie: Movie,
    view: str = ALL,
    name: str = CURVATURE,
    *,
    scales: Scales | None = None,
    axis: str = "z",
    pole: Pole = "north",
    projections: Projections | None = None,
    kymograph: Kymograph | None = None,
    line: SurfaceLine | None = None,
    progress: Progress | None = None,
) -> MoviePictures:
    """Prepare the pictures of a movie.

    Parameters
    ----------
    movie : Movie
    view : str
        "surface", "uv", "polar", "projection", "kymograph", or "all": those that there is
        something for, side by side.
    name : str
        The field that colours them.
    scales : Scales, optional
        From :func:`common_scales`, where they are known.
    axis : "z", "y" or "x"
        Along which the surface is seen.
    pole : "north" or "south"
        In the middle of the polar view.
    projections : Projections, optional
        Of the projection.
    kymograph : Kymograph, optional
    line : SurfaceLine, optional
        Drawn in all views; the kymograph's, by default.
    progress : Progress, optional

    Raises
    ------
    ParameterError
        There is no such view, field or axis; or what a view needs was not given.
    """
    views = chosen_views(view, projections is not None, kymograph is not None)
    report = progress or silent()
    if scales is None:
        scales = common_scales(movie, name, axis, progress=report.part(0.0, 0.8))
    if line is None and kymograph is not None:
        line = kymograph.line
    title = movie.name if len(movie.name) < 60 else f"{movie.name[:57]}…"
    figure = new_figure(*_size(views), title)
    figure.set_dpi(DPI)
    made = MoviePictures(movie, views, figure)
    pixels = SURFACE_PIXELS
    rows = movie.common.uv.shape[0]
    coloured = []
    of_field = kymograph is not None and kymograph.field == name
    for part, axes in _axes(figure, views).items():
        if part == "surface":
            panel: Panel = SurfacePanel(
                axes, name, scales.colours, axis, scales.extent, pixels, movie.common, line
            )
        elif part == "uv":
            panel = UvPanel(axes, name, scales.colours, rows, line)
        elif part == "polar":
            panel = PolarPanel(axes, name, scales.colours, rows, pole, line)
        elif part == "projection":
            assert projections is not None
            dim, bright = _brightness(projections, report.part(0.8, 1.0))
            panel = ProjectionPanel(axes, projections, bright, dim)
        else:
            assert kymograph is not None
            panel = KymographPanel(axes, kymograph, _kymograph_colours(kymograph, name, scales))
        made._panels.append(panel)
        if part in ("surface", "uv", "polar") or (part == "kymograph" and of_field):
            coloured.append(axes)
    if coloured:
        colour_bar(figure, scales.colours, coloured[-1] if len(coloured) == 1 else figure.axes)
    made._stamp = figure.text(
        0.012, 0.985, "t = 0 s", fontsize=15, color=INK, ha="left", va="top", in_layout=False
    )
    return made


def chosen_views(view: str, projected: bool, kymograph: bool) -> tuple[View, ...]:
    """The views that a picture has.

    Raises
    ------
    ParameterError
        There is no such view, or what it needs was not given.
    """
    there = {"projection": projected, "kymograph": kymograph}
    if view == ALL:
        return tuple(each for each in VIEW_NAMES if there.get(each, True))
    for each in VIEW_NAMES:
        if view == each:
            if not there.get(each, True):
                raise ParameterError(
                    f"The view {view!r} needs something.",
                    hint="A projection needs the stack of the movie, a kymograph a line.",
                )
            return (each,)
    raise ParameterError(
        f"There is no view {view!r}.", hint=f"Views: {', '.join((*VIEW_NAMES, ALL))}."
    )


def _size(views: tuple[View, ...]) -> tuple[float, float]:
    """Width and height in inches."""
    if len(views) == 1:
        return SIZES[views[0]]
    width, height = ALL_SIZE
    return (width if len(views) > 3 else NARROWER * width), height


def _axes(figure: Figure, views: tuple[View, ...]) -> dict[View, Any]:
    """Square views above, long ones below."""
    if len(views) == 1:
        return {views[0]: figure.subplots()}
    above = [view for view in views if view in ("surface", "polar", "projection")]
    below = [view for view in views if view in ("uv", "kymograph")]
    # The uv image is as wide as two square ones.
    shares = {"uv": 4 if "kymograph" in below else 6, "kymograph": 2}
    grid = figure.add_gridspec(2, 6, height_ratios=(1.15, 1))
    found: dict[View, Any] = {}
    for row in range(2):
        start = 0
        for each in (above, below)[row]:
            stop = start + shares.get(each, 6 // len(above))
            found[each] = figure.add_subplot(grid[row, start:stop])
            start = stop
    return found


def _brightness(projections: Projections, progress: Progress) -> tuple[float, float]:
    """Grey limits for all timepoints."""
    samples: list[Floats] = []
    for found in projections.all(progress):
        values = found.image[np.isfinite(found.image)].astype(np.float64)
        samples.append(values[:: max(len(values) // SAMPLES_PER_FRAME, 1)])
    every = np.concatenate(samples)
    if not len(every):
        return 0.0, 1.0
    dim, bright = np.percentile(every, (1.0, BRIGHTEST_PERCENT))
    return float(dim), float(bright)


def _kymograph_colours(found: Kymograph, name: str, scales: Scales) -> Colours:
    return scales.colours if found.field == name else field_colours(found.field, found.values)
