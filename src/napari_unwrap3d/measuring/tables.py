"""The tables of measurements: series, events, correlations and histograms as data frames."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

AROUND = ("event", "track_id", "time_s")


def mean_event_table(aligned: pd.DataFrame) -> pd.DataFrame:
    """The mean course of events, mean ± s.e.m., from a row per event and time.

    Parameters
    ----------
    aligned : DataFrame
        ``event``, ``track_id``, ``time_s`` and any columns.

    Returns
    -------
    DataFrame
        ``column``, ``time_s``, ``mean``, ``sem`` (NaN with fewer than two events), ``count``.
    """
    columns = [name for name in aligned.columns if name not in AROUND]
    long = aligned.melt(["time_s"], columns, var_name="column")
    found = long.groupby(["column", "time_s"], sort=False)["value"].agg(["mean", "sem", "count"])
    return found.reset_index()
