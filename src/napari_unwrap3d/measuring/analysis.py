"""Everything that is measured along the tracks of a movie, as tables and as figures."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..charts import Tracks
from ..parameters import Parameters
from ..pipeline import ProgressLike

if TYPE_CHECKING:
    from ..motion.movie import Movie
    from .measurements import Measurements


def measure_tracks(
    movie: Movie,
    tracks: Tracks | None = None,
    parameters: Parameters | None = None,
    progress: ProgressLike = None,
) -> Measurements:
    """Measure what was tracked: series, events, correlations, lifetimes and speeds.

    Parameters
    ----------
    movie : Movie
    tracks : Tracks, optional
        Those that ``parameters.measurement.tracks`` names unless given.
    parameters : Parameters, optional
        Those of the movie unless given.
    progress : Progress, or callable(stage, fraction, message), optional
    """
    raise NotImplementedError
