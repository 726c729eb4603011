"""Parameters of measurements: series, events, correlations and speeds of tracks."""

from __future__ import annotations

from typing import Literal

from .base import Positive, StepParameters, setting
from .movie import BLEBS, RUFFLES

SERIES = f"{BLEBS}, Bleb timeseries extraction"
EVENTS = f"{BLEBS}, Bleb event alignment"
CROSS = f"{RUFFLES}, Cross-correlation and curvature relationship"


class MeasurementParameters(StepParameters):
    """Measurements: what is sampled along tracks, and what is made of it."""

    tracks: str = setting(
        "protrusions",
        "Tracks",
        "Which tracks are measured: protrusions, flow, or a name; places: regions that are spread "
        "evenly over the surface and do not move.",
    )
    places: int = setting(
        2000, "Places", "How many regions do not move (tracks = places).", ge=4, le=50000
    )
    fields: str = setting(
        "all",
        "Fields",
        "Fields whose mean over each track's place is taken, by name and separated by commas; "
        "all: the mean curvature and every signal; a ratio is written as signal_a/signal_b.",
    )
    on: Literal["protrusion", "curvature"] = setting(
        "protrusion",
        "On a protrusion",
        "What of the box around a protrusion is on it; the rest is off it. protrusion: its own "
        "surface; curvature: the largest part of the box that is bent outwards (the paper's way).",
        source=SERIES,
    )
    region_um: Positive = setting(
        1.0,
        "Side of a region",
        "Of the square around tracks that have neither protrusions, boxes nor regions of their "
        "own, such as imported ones.",
        unit="µm",
    )
    beyond_s: float = setting(
        12.0,
        "Beyond the life",
        "For how long before its first and after its last timepoint the box of a protrusion is "
        "measured on, where it was: a signal that follows later is seen only so.",
        unit="s",
        ge=0,
    )
    regions: str = setting(
        "",
        "Regions",
        "Annotations whose series are measured, too, by name and separated by commas.",
    )
    inside: str = setting(
        "", "Inside", "Only tracks that stay inside this annotation; empty: everywhere."
    )
    outside: str = setting("", "Outside", "Only tracks that stay outside this annotation.")
    share: float = setting(
        1.0,
        "Share of the life",
        "For which part of its life a track must be inside (or outside).",
        gt=0,
        le=1,
    )
    event_series: Literal["on_area_um2", "area_um2", "height_max_um"] = setting(
        "on_area_um2",
        "Events of",
        "The series whose peaks are events: the area on the protrusion (of regions, their own), "
        "that of the whole box (the paper's way), or the height.",
        source=EVENTS,
    )
    prominence: float = setting(
        0.5,
        "Prominence",
        "By how much a peak stands out, in the unit of the series.",
        source=EVENTS,
        ge=0,
    )
    distance_s: float = setting(
        3.6, "Distance", "Least time between two events.", unit="s", source=EVENTS, ge=0
    )
    smoothing: int = setting(
        3, "Smoothing", "Timepoints of the moving average (odd).", source=EVENTS, ge=1
    )
    window_s: Positive = setting(
        17.5, "Window", "How long before and after an event is shown.", unit="s", source=EVENTS
    )
    longest_lag_s: Positive = setting(
        60.0, "Longest lag", "Of the correlations.", unit="s", source=CROSS
    )
    correlate: str = setting(
        "",
        "Correlated fields",
        "Two fields whose correlation in time is taken along every track, separated by a comma; "
        "empty: the mean curvature and the first signal. A ratio is written as "
        "signal_a/signal_b: to a diffuse marker, what the shape alone does to a signal is gone.",
        source=CROSS,
    )
    plane: str = setting(
        "",
        "Plane",
        "An annotation, such as the cell's flat bottom: speeds are also measured along the plane "
        "fitted to it; empty: along the surface only.",
        source=f"{RUFFLES}, Retrograde actin flow and mean ruffle travel speed",
    )
    speed_bins: int = setting(25, "Bins of speed", "Of the histogram.", source=CROSS, ge=3)
    fastest_um_per_min: Positive = setting(
        10.0, "Fastest", "Upper end of the histogram of speeds.", unit="µm/min", source=CROSS
    )
