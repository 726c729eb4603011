"""From the world of a recording to the common one of its movie."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..charts import Tracks
from ..charts.tracks import SPACE

if TYPE_CHECKING:
    from ..motion.movie import Movie


def in_common_world(movie: Movie, tracks: Tracks) -> Tracks:
    """Move tracks that were made on the stack to where the movie was registered.

    Rows of timepoints beyond the movie's end, or that were never registered, stay.
    """
    places = tracks.position_um.copy()
    for timepoint in np.unique(tracks.timepoint).tolist():
        found = movie.folder.registered(timepoint) if timepoint < len(movie) else None
        if found is not None:
            rows = tracks.timepoint == timepoint
            places[rows] = found.pose.apply(places[rows])
    return tracks.with_columns(**dict(zip(SPACE, places.T, strict=True)))
