"""From places on the uv image to places in space, at a timepoint of a movie."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..charts import Floats
from ..geometry.padding import sample_uv_linear, sample_uv_nearest
from ..motion.frames import HEIGHT
from ..unwrapping.topography import topography_to_world

if TYPE_CHECKING:
    from ..motion.movie import Movie


def on_surface(movie: Movie, height: Floats, places: Floats) -> Floats:
    """Positions (n, 3) in µm of what lies outermost over places of a movie's common space.

    Parameters
    ----------
    movie : Movie
    height : ndarray, (N, 2N)
        d of the surface over every pixel, ``frame.uv["height_um"]``; where it is unknown the
        place is on the reference surface.
    places : ndarray, (n, 2)
        (v, u) in pixels.
    """
    smooth, nearest = (sample(height, places) for sample in (sample_uv_linear, sample_uv_nearest))
    d = np.where(np.isfinite(smooth), smooth, nearest)
    known = np.isfinite(d)
    chart = movie.common.topography
    points, valid = topography_to_world(chart, np.column_stack([np.where(known, d, 0.0), places]))
    if not valid.all():
        points[~valid] = movie.common.map(places[~valid], "uv", "reference")[0]
    return points


def height_at(movie: Movie, timepoint: int) -> Floats:
    """Height d (N, 2N) in µm of what lies outermost over every pixel at a timepoint."""
    return np.asarray(movie.frame(timepoint).uv[HEIGHT], np.float64)
