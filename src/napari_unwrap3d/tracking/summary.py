"""Key numbers of tracks: how many, how long, how fast."""

from __future__ import annotations

import numpy as np

from ..charts import Tracks

SPEED = "speed_um_per_min"


def summary(tracks: Tracks) -> dict[str, float]:
    """Numbers of some tracks, with their units in the names.

    Returns
    -------
    dict
        ``tracks``, ``places`` (rows), ``at_a_time`` (mean number of tracks at a timepoint),
        ``lifetime_mean_s``, ``lifetime_sd_s``, ``lifetime_median_s``, ``splits``, ``merges``, and,
        where the tracks have them, the means over all rows ``area_mean_um2``,
        ``height_mean_um`` and ``speed_mean_um_per_min``. What cannot be said is NaN.
    """
    lifetimes = tracks.lifetimes_s()
    several = len(lifetimes) > 1
    found = {
        "tracks": len(tracks.ids),
        "places": len(tracks),
        "at_a_time": len(tracks) / tracks.timepoints if tracks.timepoints else np.nan,
        "lifetime_mean_s": float(lifetimes.mean()) if len(lifetimes) else np.nan,
        "lifetime_sd_s": float(lifetimes.std(ddof=1)) if several else np.nan,
        "lifetime_median_s": float(np.median(lifetimes)) if len(lifetimes) else np.nan,
        "splits": len(tracks.splits),
        "merges": len(tracks.merges),
    }
    for name, column in (
        ("area_mean_um2", "area_um2"),
        ("height_mean_um", "height_max_um"),
        ("speed_mean_um_per_min", SPEED),
    ):
        if column in tracks.columns:
            found[name] = _mean(np.asarray(tracks.columns[column], float))
    return found


def _mean(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else np.nan
