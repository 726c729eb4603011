"""From the protrusions of all timepoints to tracks, by either method."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..charts import Tracks
from ..parameters import Parameters
from ..pipeline import ProgressLike

if TYPE_CHECKING:
    from ..motion.movie import Movie


def track_protrusions(
    movie: Movie, parameters: Parameters | None = None, progress: ProgressLike = None
) -> Tracks:
    """Follow the protrusions of a movie over time.

    Protrusions that were not found yet are found first. The tracks are kept in the movie's
    folder under the name "protrusions".

    Parameters
    ----------
    movie : Movie
    parameters : Parameters, optional
        Those of the movie unless given.
    progress : Progress, or callable(stage, fraction, message), optional

    Returns
    -------
    Tracks
        With the column ``label``, the protrusion at that timepoint (0: in a gap), and the
        columns of its table.
    """
    raise NotImplementedError
