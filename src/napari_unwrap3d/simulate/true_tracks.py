"""The true tracks of a simulated movie."""

from __future__ import annotations

from typing import Literal

import numpy as np

from ..charts import Tracks
from ..charts.tracks import SPACE, TIMEPOINT, TRACK
from .moving import SimulatedMovie

PROPERTIES = ("height_um", "speed_um_per_min", "curvature_per_um", "signal")
OWN, STACK = "cell", "stack"


def true_tracks(movie: SimulatedMovie, world: Literal["cell", "stack"] = "cell") -> Tracks:
    """Where the feet of all protrusions are over time, as tracks.

    Parameters
    ----------
    movie : SimulatedMovie
    world : {"cell", "stack"}
        The cell's own, which does not move and is that of timepoint 0 (a registered movie's
        common world, too); or the world of every timepoint of the stack.

    Returns
    -------
    Tracks
        ``track_id`` are the identities of the truth; properties are those of its protrusions.
    """
    courses = movie.courses
    places = courses[list(SPACE)].to_numpy(float, copy=True)
    timepoints = courses[TIMEPOINT].to_numpy()
    if world == STACK:
        for timepoint in np.unique(timepoints):
            rows = timepoints == timepoint
            places[rows] = movie.poses[timepoint].apply(places[rows])
    columns = {TRACK: courses["id"].to_numpy(), TIMEPOINT: timepoints}
    columns |= dict(zip(SPACE, places.T, strict=True))
    columns |= {name: courses[name].to_numpy(float) for name in PROPERTIES if name in courses}
    return Tracks.of(
        columns,
        time_step_s=movie.time_step_s,
        timepoints=len(movie),
        method="simulated",
        numbers={"kind": movie.kind, "seed": movie.seed, "world": world},
    )
