"""The features of spots, edges and tracks that TrackMate's files carry, and their numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Ints, Tracks
from .track_graph import TrackGraph

# (feature, name, short name, dimension, whether it is a whole number).
SPOT_FEATURES = (
    ("QUALITY", "Quality", "Quality", "QUALITY", "false"),
    ("POSITION_X", "X", "X", "POSITION", "false"),
    ("POSITION_Y", "Y", "Y", "POSITION", "false"),
    ("POSITION_Z", "Z", "Z", "POSITION", "false"),
    ("POSITION_T", "T", "T", "TIME", "false"),
    ("FRAME", "Frame", "Frame", "NONE", "true"),
    ("RADIUS", "Radius", "R", "LENGTH", "false"),
    ("VISIBILITY", "Visibility", "Visibility", "NONE", "true"),
)
EDGE_FEATURES = (
    ("SPOT_SOURCE_ID", "Source spot ID", "Source ID", "NONE", "true"),
    ("SPOT_TARGET_ID", "Target spot ID", "Target ID", "NONE", "true"),
    ("LINK_COST", "Link cost", "Cost", "NONE", "false"),
    ("EDGE_TIME", "Time (mean)", "T", "TIME", "false"),
    ("EDGE_X_LOCATION", "X Location (mean)", "X", "POSITION", "false"),
    ("EDGE_Y_LOCATION", "Y Location (mean)", "Y", "POSITION", "false"),
    ("EDGE_Z_LOCATION", "Z Location (mean)", "Z", "POSITION", "false"),
    ("VELOCITY", "Velocity", "V", "VELOCITY", "false"),
    ("DISPLACEMENT", "Displacement", "D", "LENGTH", "false"),
)
TRACK_FEATURES = (
    ("NUMBER_SPOTS", "Number of spots in track", "N spots", "NONE", "true"),
    ("NUMBER_GAPS", "Number of gaps", "Gaps", "NONE", "true"),
    ("LONGEST_GAP", "Longest gap", "Longest gap", "NONE", "true"),
    ("NUMBER_SPLITS", "Number of split events", "Splits", "NONE", "true"),
    ("NUMBER_MERGES", "Number of merge events", "Merges", "NONE", "true"),
    ("NUMBER_COMPLEX", "Complex points", "Complex", "NONE", "true"),
    ("TRACK_DURATION", "Duration of track", "Duration", "TIME", "false"),
    ("TRACK_START", "Track start", "T start", "TIME", "false"),
    ("TRACK_STOP", "Track stop", "T stop", "TIME", "false"),
    ("TRACK_DISPLACEMENT", "Track displacement", "Displacement", "LENGTH", "false"),
    ("TRACK_INDEX", "Track index", "Index", "NONE", "true"),
    ("TRACK_ID", "Track ID", "ID", "NONE", "true"),
    ("TRACK_X_LOCATION", "X Location (mean)", "X", "POSITION", "false"),
    ("TRACK_Y_LOCATION", "Y Location (mean)", "Y", "POSITION", "false"),
    ("TRACK_Z_LOCATION", "Z Location (mean)", "Z", "POSITION", "false"),
    ("TRACK_MEAN_SPEED", "Mean velocity", "Mean V", "VELOCITY", "false"),
    ("TRACK_MAX_SPEED", "Maximal velocity", "Max V", "VELOCITY", "false"),
    ("TRACK_MIN_SPEED", "Minimal velocity", "Min V", "VELOCITY", "false"),
    ("TRACK_MEDIAN_SPEED", "Median velocity", "Median V", "VELOCITY", "false"),
    ("TRACK_STD_SPEED", "Velocity standard deviation", "V std", "VELOCITY", "false"),
    ("TRACK_MEAN_QUALITY", "Mean quality", "Mean Q", "QUALITY", "false"),
    ("TRACK_MAX_QUALITY", "Maximal quality", "Max Q", "QUALITY", "false"),
    ("TRACK_MIN_QUALITY", "Minimal quality", "Min Q", "QUALITY", "false"),
    ("TRACK_MEDIAN_QUALITY", "Median quality", "Median Q", "QUALITY", "false"),
    ("TRACK_STD_QUALITY", "Quality standard deviation", "Q std", "QUALITY", "false"),
)


def edge_features(tracks: Tracks, graph: TrackGraph) -> dict[str, npt.NDArray[Any]]:
    """Features of all edges (m,): ends, cost (squared distance), time, place and speed."""
    one, other = graph.edges.T
    position, times = tracks.position_um, tracks.times_s
    distance = np.linalg.norm(position[other] - position[one], axis=1)
    middle = (position[one] + position[other]) / 2
    return {
        "SPOT_SOURCE_ID": one,
        "SPOT_TARGET_ID": other,
        "LINK_COST": distance**2,
        "EDGE_TIME": (times[one] + times[other]) / 2,
        "EDGE_X_LOCATION": middle[:, 2],
        "EDGE_Y_LOCATION": middle[:, 1],
        "EDGE_Z_LOCATION": middle[:, 0],
        "VELOCITY": distance / (times[other] - times[one]),
        "DISPLACEMENT": distance,
    }


def track_features(
    tracks: Tracks, edges: Ints, rows: Ints, distance_um: Floats
) -> dict[str, float | int]:
    """Features of one of TrackMate's tracks.

    Parameters
    ----------
    tracks : Tracks
    edges : ndarray, (k, 2)
        Its edges.
    rows : ndarray, (r,)
        Its spots.
    distance_um : ndarray, (k,)
        Lengths of its edges.
    """
    time, times, position = tracks.timepoint, tracks.times_s, tracks.position_um
    gaps = time[edges[:, 1]] - time[edges[:, 0]] - 1
    outward = np.bincount(edges[:, 0], minlength=len(tracks))[rows]
    inward = np.bincount(edges[:, 1], minlength=len(tracks))[rows]
    first, last = rows[np.argmin(times[rows])], rows[np.argmax(times[rows])]
    speed = distance_um / (times[edges[:, 1]] - times[edges[:, 0]])
    middle = position[rows].mean(axis=0)
    return {
        "NUMBER_SPOTS": len(rows),
        "NUMBER_GAPS": int((gaps > 0).sum()),
        "LONGEST_GAP": int(gaps.max(initial=0)),
        "NUMBER_SPLITS": int(((outward > 1) & (inward <= 1)).sum()),
        "NUMBER_MERGES": int(((inward > 1) & (outward <= 1)).sum()),
        "NUMBER_COMPLEX": int(((inward > 1) & (outward > 1)).sum()),
        "TRACK_DURATION": float(times[last] - times[first]),
        "TRACK_START": float(times[first]),
        "TRACK_STOP": float(times[last]),
        "TRACK_DISPLACEMENT": float(np.linalg.norm(position[last] - position[first])),
        "TRACK_X_LOCATION": float(middle[2]),
        "TRACK_Y_LOCATION": float(middle[1]),
        "TRACK_Z_LOCATION": float(middle[0]),
        **_statistics("SPEED", speed),
        **_statistics("QUALITY", np.ones(len(rows))),
    }


def _statistics(what: str, values: Floats) -> dict[str, float]:
    spread = float(values.std(ddof=1)) if len(values) > 1 else 0.0
    return {
        f"TRACK_MEAN_{what}": float(values.mean()),
        f"TRACK_MAX_{what}": float(values.max()),
        f"TRACK_MIN_{what}": float(values.min()),
        f"TRACK_MEDIAN_{what}": float(np.median(values)),
        f"TRACK_STD_{what}": spread,
    }
