"""Measurements of a made-up movie of few frames, for what draws and writes them."""

from __future__ import annotations

import numpy as np
import pandas as pd

from napari_unwrap3d import Parameters
from napari_unwrap3d.charts import Tracks
from napari_unwrap3d.measuring import tables
from napari_unwrap3d.measuring.correlation import autocorrelation, cross_correlation, relationship
from napari_unwrap3d.measuring.events import event_columns, find_events
from napari_unwrap3d.measuring.measurements import Measurements

TRACKS, TIMEPOINTS, STEP_S = 12, 40, 1.5
FIELD, OTHER = "mean_curvature_per_um", "signal_septin"


def made_up() -> Measurements:
    """Twelve tracks whose area rises and falls once, with a signal that follows the curvature."""
    rng = np.random.default_rng(1)
    ids, time = np.arange(1, TRACKS + 1), np.arange(TIMEPOINTS)
    peaks = np.linspace(12, 28, TRACKS)[:, None]
    area = 4.0 * np.exp(-0.5 * ((time - peaks) / 4) ** 2) + 0.05 * rng.normal(size=(TRACKS, 40))
    field = 0.3 + 0.1 * rng.normal(size=(TRACKS, TIMEPOINTS)) + 0.02 * ids[:, None]
    other = 1.0 - 0.5 * field + 0.03 * rng.normal(size=(TRACKS, TIMEPOINTS))
    series = {"area_um2": area, FIELD: field, OTHER: other}
    series |= {
        f"{side}_{name}": values for side in ("on", "off") for name, values in series.items()
    }
    track, timepoint = np.repeat(ids, TIMEPOINTS), np.tile(time, TRACKS)
    columns = {"track_id": track, "timepoint": timepoint}
    columns |= {f"{axis}_um": 0.1 * timepoint.astype(float) for axis in "zyx"}
    tracks = Tracks.of(columns, time_step_s=STEP_S, timepoints=TIMEPOINTS, method="surface")
    events = {k: find_events(area[k - 1], STEP_S) for k in ids.tolist()}
    aligned = tables.aligned_table(ids, events, series, STEP_S, 10.0)
    cross = cross_correlation(field, other, STEP_S, 12.0)
    middle = cross.values[:, len(cross.lag_s) // 2]
    related = relationship(field.mean(axis=1), middle, x_range=(0.3, 0.6), y_range=(-1, 1))
    keys = {"track_id": track, "timepoint": timepoint, "time_s": timepoint * STEP_S}
    per_track = {"events": 1, f"series_{FIELD}": field.mean(axis=1), "correlation": middle}
    speeds = np.linspace(0.5, 8.0, TRACKS)
    made = {
        "series": pd.DataFrame(keys | {name: v.ravel() for name, v in series.items()}),
        "tracks": tracks.track_table.assign(**per_track, speed_um_per_min=speeds),
        "events": pd.DataFrame(event_columns(events, STEP_S)),
        "aligned": aligned,
        "mean_event": tables.mean_event_table(aligned),
        "autocorrelation": tables.autocorrelation_table(
            {FIELD: autocorrelation(field, STEP_S, 20.0)}
        ),
        "lifetimes": tables.histogram_table(
            tracks.lifetimes_s(), tables.lifetime_edges(tracks.lifetimes_s(), STEP_S), "s"
        ),
        "speeds": tables.histogram_table(speeds, np.linspace(0, 10, 26), "um_per_min"),
    }
    made |= tables.correlation_tables(ids, cross) | tables.relationship_tables(FIELD, related)
    numbers = {
        "mean_lifetime_s": 60.0,
        "side_lobe_s": {FIELD: 6.0},
        "speed_column": "speed_um_per_min",
        "speed_label": "Mean speed (µm/min)",
        "slow_um_per_min": 1.0,
        "fast_um_per_min": 4.0,
        "unknown": None,
    }
    return Measurements(
        tracks, Parameters(), made, numbers, "made <up>", (FIELD, OTHER), (FIELD, OTHER)
    )


def nothing() -> Measurements:
    """Measurements without any track."""
    names = ("track_id", "timepoint", "z_um", "y_um", "x_um")
    none = Tracks.of({name: [] for name in names}, time_step_s=1.0, timepoints=3)
    return Measurements(none, Parameters(), {}, {"mean_lifetime_s": None})
