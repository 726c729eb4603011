"""Measurements of tracks that are made at once, with what the plots need."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from napari_unwrap3d.charts import Tracks
from napari_unwrap3d.measuring.measurements import Measurements
from napari_unwrap3d.measuring.tables import mean_event_table
from napari_unwrap3d.parameters import Parameters

SERIES = ("area_um2", "height_um")


def measured(tracks: Tracks, parameters: Parameters | None = None) -> Measurements:
    """The area as it is in the tracks, a height, an event at every peak, and lifetimes."""
    table = tracks.table
    series = table[["track_id", "timepoint", "time_s", "area_um2"]].copy()
    series["height_um"] = 10.0 - series.area_um2
    events, aligned = [], []
    for track, own in series.groupby("track_id"):
        peak = own.loc[own.area_um2.idxmax()]
        events.append((track, peak.timepoint, peak.time_s, 1.0))
        rows = own[["track_id", "time_s", *SERIES]].assign(event=len(events))
        aligned.append(rows.assign(time_s=rows.time_s - peak.time_s))
    together = pd.concat(aligned)
    counts, edges = np.histogram(tracks.lifetimes_s(), 5)
    names = ["track_id", "timepoint", "time_s", "prominence"]
    tables = {
        "series": series,
        "events": pd.DataFrame(events, columns=names),
        "aligned": together,
        "mean_event": mean_event_table(together),
        "lifetimes": pd.DataFrame({"from_s": edges[:-1], "to_s": edges[1:], "tracks": counts}),
    }
    numbers: dict[str, Any] = {
        "mean_lifetime_s": float(tracks.lifetimes_s().mean()),
        "events": len(events),
    }
    return Measurements(tracks, parameters or Parameters(), tables, numbers, "breathing")
