"""Pictures of tracks on the unwrapped surface: a field at some timepoints with heads and tails."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..charts import Floats, Tracks
from ..fields import CURVATURE
from .drawing import colour_bar, uv_axes
from .movie_pictures import field_colours

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ..motion.movie import Movie

# So long a tail is drawn, as a part of the movie.
TAIL = 0.2
SHOWN = 3
TRACK_COLOUR, HEAD_COLOUR = "#111111", "#ffcc00"
# Of the images in a report: an SVG holds every pixel.
MOST_PIXELS = 400
# Of more, only tails are drawn.
MOST_HEADS = 300


def draw_tracks(
    movie: Movie,
    tracks: Tracks,
    field: str = CURVATURE,
    timepoints: Sequence[int] | None = None,
) -> Figure:
    """A field on the uv image at some timepoints, with the tracks that are there.

    Parameters
    ----------
    movie : Movie
    tracks : Tracks
        With (v, u).
    field : str
    timepoints : sequence of int, optional
        Three, spread over the movie, unless given.
    """
    from matplotlib.figure import Figure

    chosen = _spread(movie) if timepoints is None else list(timepoints)
    images = [_smaller(movie.frame(timepoint).uv[field]) for timepoint in chosen]
    colours = field_colours(field, np.concatenate([image.ravel() for image in images]))
    figure = Figure(figsize=(4.6, 2.45 * len(chosen)), layout="constrained", facecolor="white")
    every = figure.subplots(len(chosen), 1, squeeze=False)[:, 0]
    rows = movie.common.uv.shape[0]
    extent = (-0.5, 2 * rows - 0.5, rows - 0.5, -0.5)
    for axes, timepoint, image in zip(every, chosen, images, strict=True):
        axes.imshow(colours(image), extent=extent, interpolation="nearest", aspect="equal")
        uv_axes(axes, (rows, 2 * rows), f"{timepoint * movie.time_step_s:.4g} s")
        _draw(axes, tracks, timepoint, rows)
        axes.set_xlim(-0.5, 2 * rows - 0.5)
        axes.set_ylim(rows - 0.5, -0.5)
    colour_bar(figure, colours, list(every), shrink=0.6)
    return figure


def _spread(movie: Movie) -> list[int]:
    made = [timepoint for timepoint in range(len(movie)) if not movie.is_lost(timepoint)]
    middle = (np.arange(SHOWN) + 0.5) / SHOWN * len(made)
    return sorted({made[int(index)] for index in middle})


def _smaller(image: Any) -> Floats:
    step = max(1, int(np.ceil(image.shape[0] / MOST_PIXELS * 2)))
    return np.asarray(image[::step, ::step], np.float64)


def _draw(axes: Axes, tracks: Tracks, timepoint: int, rows: int) -> None:
    """Heads at a timepoint and tails before it; a tail is cut where it crosses the seam."""
    from matplotlib.collections import LineCollection

    length = max(1, round(TAIL * tracks.timepoints))
    there = np.isin(tracks.track_id, tracks.track_id[tracks.timepoint == timepoint])
    recent = there & (tracks.timepoint <= timepoint) & (tracks.timepoint >= timepoint - length)
    place, track = tracks.place_px[recent][:, ::-1], tracks.track_id[recent]
    step = np.abs(np.diff(place, axis=0))
    joined = (np.diff(track) == 0) & (step[:, 0] < rows) & (step[:, 1] < rows / 2)
    tails = np.stack([place[:-1][joined], place[1:][joined]], axis=1)
    heads = tracks.place_px[tracks.timepoint == timepoint]
    few = len(heads) <= MOST_HEADS
    axes.add_collection(
        LineCollection(
            list(tails), colors=TRACK_COLOUR, linewidths=1.2 if few else 0.5, rasterized=True
        )
    )
    if few:
        axes.plot(*heads.T[::-1], "o", ms=4, mfc=HEAD_COLOUR, mec=TRACK_COLOUR, mew=0.7)
