"""Events: single cycles of extension and retraction within a track, and their mean course.

Paper, Methods, "Bleb event alignment": peaks of the area, after a central moving average of
three timepoints, with a prominence above 0.5 and at least three timepoints apart; aligned on the
peak with a window of 14 timepoints on either side.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage, signal

from ..charts import Floats, Ints
from ..errors import AxesError, ParameterError
from .rows import count_of_rows, mean_of_rows, sem_of_rows


@dataclass(frozen=True)
class Events:
    """The peaks of one series.

    Attributes
    ----------
    timepoint : ndarray, (k,) int64
        Index of each peak.
    prominence : ndarray, (k,)
        How far each stands out, in the unit of the series.
    """

    timepoint: Ints
    prominence: Floats

    def __len__(self) -> int:
        return len(self.timepoint)


def moving_average(series: npt.ArrayLike, timepoints: int) -> Floats:
    """Central moving average (T,) over an odd number of timepoints; NaN do not count.

    At the ends it is taken of what there is.
    """
    values = np.asarray(series, dtype=np.float64)
    if timepoints < 1 or timepoints % 2 == 0:
        raise ParameterError(
            "A central moving average is of an odd number of timepoints.", timepoints=timepoints
        )
    known = np.isfinite(values)
    window = np.ones(timepoints)
    # Sums of what is there, over how many that are: neither ends nor gaps pull towards 0.
    total = ndimage.convolve1d(np.where(known, values, 0.0), window, mode="constant")
    count = ndimage.convolve1d(known.astype(np.float64), window, mode="constant")
    average: Floats = np.divide(total, count, out=np.full(len(values), np.nan), where=count > 0)
    return average


def find_events(
    series: npt.ArrayLike,
    time_step_s: float,
    *,
    prominence: float = 0.5,
    distance_s: float = 3.6,
    smoothing: int = 3,
    cut: tuple[bool, bool] = (False, False),
) -> Events:
    """The events of a series: its peaks.

    Parameters
    ----------
    series : array-like, (T,)
        Of one track, e.g. its area; NaN where it is not known.
    time_step_s : float
    prominence : float
        Least prominence of a peak, in the unit of the series.
    distance_s : float
        Least time between two peaks; of closer ones the highest counts.
    smoothing : int
        Timepoints of the central moving average before (odd).
    cut : (bool, bool)
        Whether the recording cuts the series off at its start and at its end. There it is not
        known how far a peak stands out: the other side decides. The first and the last
        timepoint themselves are no peaks.

    Returns
    -------
    Events

    Raises
    ------
    AxesError
        The series has more than one axis.
    ParameterError
        A number is out of its range.
    """
    values = np.asarray(series, dtype=np.float64)
    if values.ndim != 1:
        raise AxesError("A series has one value for each timepoint.", shape=values.shape)
    if not (prominence >= 0 and distance_s >= 0 and time_step_s > 0):
        raise ParameterError(
            "Prominence and distance are not negative, and the time step is positive.",
            prominence=prominence,
            distance_s=distance_s,
            time_step_s=time_step_s,
        )
    smooth = moving_average(values, smoothing)
    known = np.flatnonzero(np.isfinite(smooth))
    if len(known) < 3:
        return Events(np.zeros(0, np.int64), np.zeros(0))
    # Over gaps in a straight line, which makes no peak.
    filled = np.interp(np.arange(len(smooth)), known, smooth[known])
    apart = max(int(np.ceil(distance_s / time_step_s - 1e-9)), 1)
    low = float(filled.min()) - prominence - 1.0
    padded = np.concatenate([[low] * cut[0], filled, [low] * cut[1]])
    peaks, measured = signal.find_peaks(padded, prominence=prominence, distance=apart)
    peaks = peaks - int(cut[0])
    there = np.isfinite(values[peaks])
    if any(cut):
        there &= (peaks > 0) & (peaks < len(values) - 1)
    return Events(peaks[there].astype(np.int64), measured["prominences"][there])


@dataclass(frozen=True, eq=False)
class Aligned:
    """Series around events, one row per event, 0 s at the peak.

    Attributes
    ----------
    time_s : ndarray, (w,)
        From before the peak to after it.
    values : ndarray, (k, w)
        NaN where a track does not reach.
    """

    time_s: Floats
    values: Floats

    @property
    def count(self) -> Ints:
        """How many events have a value at each time (w,)."""
        return count_of_rows(self.values)

    @property
    def mean(self) -> Floats:
        """Mean over the events (w,); NaN without any."""
        return mean_of_rows(self.values)

    @property
    def sem(self) -> Floats:
        """Standard error of the mean (w,); NaN with fewer than two events."""
        return sem_of_rows(self.values)


def align(
    series: Sequence[npt.ArrayLike],
    events: Sequence[Events],
    time_step_s: float,
    *,
    before_s: float = 17.5,
    after_s: float = 17.5,
) -> Aligned:
    """Cut a window around every event of every track.

    Parameters
    ----------
    series : sequence of array-like (T,)
        One per track, on a common clock; NaN outside of the track's life.
    events : sequence of Events
        Of the same tracks.
    time_step_s : float
    before_s, after_s : float
        How far the window reaches.

    Raises
    ------
    AxesError
        There are not as many series as lists of events.
    """
    if len(series) != len(events):
        raise AxesError("Every series has its events.", series=len(series), events=len(events))
    first = -int(np.floor(before_s / time_step_s + 1e-9))
    last = int(np.floor(after_s / time_step_s + 1e-9))
    window = np.arange(first, last + 1)
    rows = [np.zeros((0, len(window)))]
    for values, found in zip(series, events, strict=True):
        track = np.asarray(values, dtype=np.float64)
        place = found.timepoint[:, None] + window
        inside = (place >= 0) & (place < len(track))
        cut = track[np.clip(place, 0, len(track) - 1)] if len(track) else np.zeros(place.shape)
        rows.append(np.where(inside, cut, np.nan))
    time_s: Floats = window.astype(np.float64) * time_step_s
    return Aligned(time_s, np.concatenate(rows))


def event_columns(events: Mapping[int, Events], time_step_s: float) -> dict[str, npt.NDArray[Any]]:
    """The table of events: ``track_id``, ``timepoint``, ``time_s`` and ``prominence``."""
    ids = [np.full(len(found), track) for track, found in events.items()]
    timepoints = [found.timepoint for found in events.values()]
    timepoint = np.concatenate([np.zeros(0, np.int64), *timepoints])
    return {
        "track_id": np.concatenate([np.zeros(0, np.int64), *ids]),
        "timepoint": timepoint,
        "time_s": timepoint * time_step_s,
        "prominence": np.concatenate(
            [np.zeros(0), *(found.prominence for found in events.values())]
        ),
    }
