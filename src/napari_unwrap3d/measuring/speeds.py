"""How fast tracks move, and the populations that their speeds fall into.

Paper, Methods, "Retrograde actin flow and mean ruffle travel speed": a histogram of 25 bins from
0 to 10 µm/min, and the two thresholds of Otsu's method with three classes as the mean speeds of a
slow and a fast population.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from skimage.filters import threshold_multiotsu

from ..charts import Floats, Tracks
from ..tracking.velocities import SPEED

CLASSES = 3


@dataclass(frozen=True)
class Populations:
    """Populations of speeds.

    Attributes
    ----------
    slow_um_per_min, fast_um_per_min : float
        The two thresholds: the paper's estimates of the speeds of the slower and the faster one.
    class_means_um_per_min : tuple of float
        Mean speed within each of the three classes.
    class_counts : tuple of int
    """

    slow_um_per_min: float
    fast_um_per_min: float
    class_means_um_per_min: tuple[float, ...]
    class_counts: tuple[int, ...]


def step_speeds(tracks: Tracks) -> Floats:
    """Speed (n,) in µm/min with which each row was reached; NaN where a track begins.

    That along the surface where the tracks know it, else from one position to the next.
    """
    if SPEED in tracks.columns:
        return np.asarray(tracks.columns[SPEED], np.float64)
    speed = np.full(len(tracks), np.nan)
    same = np.diff(tracks.track_id) == 0
    seconds = np.diff(tracks.times_s)
    length = np.linalg.norm(np.diff(tracks.position_um, axis=0), axis=1)
    speed[1:][same] = 60.0 * length[same] / seconds[same]
    return speed


def mean_by_track(tracks: Tracks, values: Floats) -> Floats:
    """Mean (m,) of a column over each track's rows; NaN do not count."""
    place = np.searchsorted(tracks.ids, tracks.track_id)
    known = np.isfinite(values)
    count = np.bincount(place[known], minlength=len(tracks.ids))
    total = np.bincount(place[known], values[known], minlength=len(tracks.ids))
    mean: Floats = np.divide(total, count, out=np.full(len(tracks.ids), np.nan), where=count > 0)
    return mean


def populations(
    speeds_um_per_min: npt.ArrayLike, fastest_um_per_min: float, bins: int
) -> Populations | None:
    """The populations of speeds up to the fastest; None where there are not three classes."""
    speeds = np.asarray(speeds_um_per_min, np.float64)
    speeds = speeds[np.isfinite(speeds) & (speeds <= fastest_um_per_min)]
    edges = np.linspace(0.0, fastest_um_per_min, bins + 1)
    count, _ = np.histogram(speeds, edges)
    if np.count_nonzero(count) < CLASSES:
        return None
    middles = 0.5 * (edges[1:] + edges[:-1])
    slow, fast = threshold_multiotsu(hist=(count, middles), classes=CLASSES).tolist()
    member = np.digitize(speeds, [slow, fast], right=True)
    means = tuple(
        float(speeds[member == k].mean()) if (member == k).any() else float("nan")
        for k in range(CLASSES)
    )
    counts = np.bincount(member, minlength=CLASSES).tolist()
    return Populations(float(slow), float(fast), means, tuple(counts))
