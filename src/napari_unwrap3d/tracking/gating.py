"""Which tracks stay inside, or outside, of an annotated region.

Paper, "Individual blebs dynamically recruit Septins": only the tracks that remain within the
in-focus region, which was annotated by hand, are analysed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
import numpy.typing as npt

from ..annotations.lookup import Labels
from ..charts import Ints, Tracks
from ..errors import InputError, ParameterError
from ..geometry.padding import sample_uv_nearest

if TYPE_CHECKING:
    from ..motion.movie import Movie

Bools = npt.NDArray[np.bool_]
Side = Literal["inside", "outside"]
SIDES = ("inside", "outside")


def gated(
    movie: Movie,
    tracks: Tracks,
    annotation: str,
    *,
    label: int | None = None,
    side: Side = "inside",
    share: float = 1.0,
) -> Ints:
    """The tracks (k,) that are inside (or outside) of a region for a part of their life.

    Where a track is on the uv image decides; for that it does not matter in which view the
    region was drawn, nor where the seam and the poles are.

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
        Part of a track's timepoints, 0 … 1; one at which its place is unknown is on neither
        side.

    Raises
    ------
    ParameterError
        There is no such annotation or side, or the share is none.
    InputError
        The tracks do not lie on the uv image of this movie.
    """
    if side not in SIDES:
        raise ParameterError(f"There is no side {side!r}.", hint=f"Choose {' or '.join(SIDES)}.")
    if not 0 <= share <= 1:
        raise ParameterError("The share of a track's life is 0 … 1.", share=share)
    annotations = movie.common.annotations
    annotations.annotation(annotation)
    rows = movie.common.uv.shape[0]
    if len(tracks) and tracks.rows != rows:
        raise InputError(
            "The tracks do not lie on the uv image of this movie.",
            rows_of_tracks=tracks.rows,
            rows_of_movie=rows,
            hint="Lay them on the surface first.",
        )
    timed = annotations.times.one_by_one(annotation)
    places = tracks.place_px
    known = np.isfinite(places).all(axis=1)
    within = np.zeros(len(tracks), bool)
    for timepoint in np.unique(tracks.timepoint).tolist() if timed else [None]:
        now = known if timepoint is None else known & (tracks.timepoint == timepoint)
        image = annotations.times.image(annotation, timepoint or 0)
        within[now] = _inside(image, label, places[now])
    meets = known & (within if side == "inside" else ~within)
    return _for_part_of_life(tracks, meets, share)


def _inside(image: Labels, label: int | None, places: npt.NDArray[np.float64]) -> Bools:
    found = sample_uv_nearest(image, places)
    inside: Bools = found > 0 if label is None else found == label
    return inside


def _for_part_of_life(tracks: Tracks, meets: Bools, share: float) -> Ints:
    """The tracks whose rows (n,) meet something for a part of their timepoints, or more."""
    track = np.searchsorted(tracks.ids, tracks.track_id)
    rows = np.bincount(track, minlength=len(tracks.ids))
    count = np.bincount(track[meets], minlength=len(tracks.ids))
    kept: Ints = tracks.ids[count >= share * rows - 1e-9]
    return kept
