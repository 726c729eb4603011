"""The tables of measurements: series, events, correlations and histograms as data frames."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Ints
from .correlation import Correlation, Relationship
from .events import Events, align

if TYPE_CHECKING:
    import pandas as pd

AROUND = ("event", "track_id", "time_s")
BINS_OF_LIFETIME = 25


def by_track(
    ids: Ints, track_id: Ints, timepoint: Ints, values: npt.ArrayLike, timepoints: int
) -> Floats:
    """A column of rows as series (k, T), a row per track; NaN at timepoints without one."""
    series = np.full((len(ids), timepoints), np.nan)
    series[np.searchsorted(ids, track_id), timepoint] = np.asarray(values, np.float64)
    return series


def aligned_table(
    ids: Ints,
    events: Mapping[int, Events],
    series: Mapping[str, Floats],
    time_step_s: float,
    window_s: float,
) -> pd.DataFrame:
    """A row per event and time around it, of every series (k, T) by name.

    Returns
    -------
    DataFrame
        ``event`` (from 1), ``track_id``, ``time_s``, and a column per series.
    """
    import pandas as pd

    found = [events[track] for track in ids.tolist()]
    count = sum(len(one) for one in found)
    track = np.repeat(ids, [len(one) for one in found])
    table: dict[str, npt.NDArray[np.generic]] = {}
    for name, values in series.items():
        cut = align(list(values), found, time_step_s, before_s=window_s, after_s=window_s)
        width = len(cut.time_s)
        if not table:
            table["event"] = np.repeat(np.arange(1, count + 1), width)
            table["track_id"] = np.repeat(track, width)
            table["time_s"] = np.tile(cut.time_s, count)
        table[name] = cut.values.ravel()
    return pd.DataFrame(table)


def mean_event_table(aligned: pd.DataFrame) -> pd.DataFrame:
    """The mean course of events, mean ± s.e.m., from a row per event and time.

    Parameters
    ----------
    aligned : DataFrame
        As :func:`aligned_table` makes it.

    Returns
    -------
    DataFrame
        ``column``, ``time_s``, ``mean``, ``sem`` (NaN with fewer than two events), ``count``.
    """
    columns = [name for name in aligned.columns if name not in AROUND]
    long = aligned.melt(["time_s"], columns, var_name="column")
    # Steps of time that were multiplied are the same only up to rounding.
    long["time_s"] = long["time_s"].round(6)
    found = long.groupby(["column", "time_s"], sort=False)["value"].agg(["mean", "sem", "count"])
    return found.reset_index()


def autocorrelation_table(found: Mapping[str, Correlation]) -> pd.DataFrame:
    """``field``, ``lag_s``, ``mean``, ``std`` and ``count`` of autocorrelations by field."""
    import pandas as pd

    parts = [
        pd.DataFrame(
            {
                "field": name,
                "lag_s": one.lag_s,
                "mean": one.mean,
                "std": one.std,
                "count": one.count,
            }
        )
        for name, one in found.items()
    ]
    empty = pd.DataFrame(columns=["field", "lag_s", "mean", "std", "count"])
    return pd.concat(parts, ignore_index=True) if parts else empty


def correlation_tables(ids: Ints, found: Correlation) -> dict[str, pd.DataFrame]:
    """``cross_correlation`` with its mean and interval, ``track_correlation`` of every track."""
    import pandas as pd

    low, high = found.interval()
    mean = {"lag_s": found.lag_s, "mean": found.mean, "low": low, "high": high}
    known = np.isfinite(found.values).any(axis=1)
    single = {
        "track_id": np.repeat(ids[known], len(found.lag_s)),
        "lag_s": np.tile(found.lag_s, int(known.sum())),
        "correlation": found.values[known].ravel(),
    }
    return {
        "cross_correlation": pd.DataFrame({**mean, "count": found.count}),
        "track_correlation": pd.DataFrame(single),
    }


def relationship_tables(name: str, found: Relationship) -> dict[str, pd.DataFrame]:
    """``relationship``: conditional mean and deviation; ``density``: the joint density."""
    import pandas as pd

    x, y = np.meshgrid(found.x, found.y, indexing="ij")
    density = {name: x.ravel(), "correlation": y.ravel(), "density": found.density.ravel()}
    return {
        "relationship": pd.DataFrame({name: found.x, "mean": found.mean, "std": found.std}),
        "density": pd.DataFrame(density),
    }


def histogram_table(values: npt.ArrayLike, edges: Floats, unit: str) -> pd.DataFrame:
    """``from_<unit>``, ``to_<unit>`` and ``tracks``: how many values there are in every bin.

    What lies beyond the last edge counts into the last bin.
    """
    import pandas as pd

    given = np.asarray(values, np.float64)
    inside = np.minimum(given[np.isfinite(given)], edges[-1])
    count, _ = np.histogram(inside, edges)
    return pd.DataFrame({f"from_{unit}": edges[:-1], f"to_{unit}": edges[1:], "tracks": count})


def lifetime_edges(lifetimes_s: Floats, time_step_s: float) -> Floats:
    """Edges of bins of whole timepoints, from the shortest possible life to the longest."""
    longest = int(np.rint(float(lifetimes_s.max(initial=time_step_s)) / time_step_s))
    step = max(int(np.ceil(longest / BINS_OF_LIFETIME)), 1)
    # Lives are whole numbers of timepoints: between those, no life lies on an edge.
    edges: Floats = np.arange(0, longest + step, step, dtype=np.float64)
    edges = (edges + 0.5) * time_step_s
    return edges
