"""Which tracks stay inside, or outside, of an annotated region."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from ..charts import Ints, Tracks

if TYPE_CHECKING:
    from ..motion.movie import Movie


def gated(
    movie: Movie,
    tracks: Tracks,
    annotation: str,
    *,
    label: int | None = None,
    side: Literal["inside", "outside"] = "inside",
    share: float = 1.0,
) -> Ints:
    """The tracks (k,) that are inside (or outside) of a region for a part of their life.

    Parameters
    ----------
    movie : Movie
    tracks : Tracks
    annotation : str
        By its name in ``movie.common.annotations``; of the movie, or of single timepoints.
    label : int, optional
        Of the annotation; any unless given.
    side : {"inside", "outside"}
    share : float
        Part of a track's timepoints, 0 … 1.
    """
    raise NotImplementedError
