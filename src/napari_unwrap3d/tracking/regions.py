"""Regions of the surface that are carried by the optical flow of a field."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..charts import Tracks
from ..parameters import Parameters
from ..pipeline import ProgressLike

if TYPE_CHECKING:
    from ..motion.movie import Movie


def track_flow(
    movie: Movie, parameters: Parameters | None = None, progress: ProgressLike = None
) -> Tracks:
    """Follow regions of the surface by the optical flow of a field.

    The tracks are kept in the movie's folder under the name "flow".

    Parameters
    ----------
    movie : Movie
    parameters : Parameters, optional
        Those of the movie unless given.
    progress : Progress, or callable(stage, fraction, message), optional

    Returns
    -------
    Tracks
        With ``velocity_z_um_per_min``, ``velocity_y_um_per_min``, ``velocity_x_um_per_min`` and
        ``speed_um_per_min`` along the surface, and ``side_px`` of the region.
    """
    raise NotImplementedError
