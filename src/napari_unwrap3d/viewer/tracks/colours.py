"""The colours of tracks: each its own, or by a property of them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from napari.utils.colormaps import ensure_colormap

from ...charts import Floats, Tracks
from ...charts.tracks import TRACK
from ...protrusions.colours import instance_colour
from ..annotations.colours import Colour

COLORMAP = "viridis"
UNKNOWN: Colour = (0.5, 0.5, 0.5, 1.0)
# How much of a track's colour is left while others are selected.
DIMMED = 0.15
# Columns of ``Tracks.track_table`` that are one number for each track.
OF_TRACKS = ("lifetime_s", "start_s", "first_timepoint", "last_timepoint", "timepoints")
# Values beyond these percentiles are coloured as those at them.
PERCENTILES = (2.0, 98.0)


@dataclass(frozen=True, eq=False)
class TrackColours:
    """A colour for every row of tracks.

    Attributes
    ----------
    tracks : Tracks
    column : str
        A column of its rows or of its ``track_table``; empty for a colour each.
    colormap : str
        Of napari.
    """

    tracks: Tracks
    column: str = ""
    colormap: str = COLORMAP

    def values(self) -> Floats:
        """Of the column, for every row (n,)."""
        return row_values(self.tracks, self.column)

    def limits(self) -> tuple[float, float]:
        """Between which values the colormap runs; (0, 1) where there are none."""
        values = self.values()
        known = values[np.isfinite(values)]
        if not len(known):
            return 0.0, 1.0
        low, high = np.percentile(known, PERCENTILES)
        return (float(low), float(high)) if high > low else (float(low) - 0.5, float(low) + 0.5)

    def rows(self, selection: Iterable[int] = ()) -> npt.NDArray[np.float32]:
        """(n, 4) RGBA of every row; those that are not selected are dimmed while some are."""
        if self.column:
            colours = self._mapped(self.values())
        else:
            own = np.array([instance_colour(int(track)) for track in self.tracks.ids], np.float32)
            places = np.searchsorted(self.tracks.ids, self.tracks.track_id)
            colours = own.reshape(-1, 4)[places]
        chosen = list(selection)
        if chosen:
            colours[~np.isin(self.tracks.track_id, chosen), 3] *= DIMMED
        return colours

    def of_tracks(self) -> dict[int, Colour]:
        """The colour of every track: its own, or of the mean of the column over its life."""
        if not self.column:
            return {int(track): instance_colour(int(track)) for track in self.tracks.ids}
        values = self.values()
        places = np.searchsorted(self.tracks.ids, self.tracks.track_id)
        known = np.isfinite(values)
        count = np.bincount(places[known], minlength=len(self.tracks.ids))
        total = np.bincount(places[known], values[known], minlength=len(self.tracks.ids))
        means = np.where(count > 0, total / np.maximum(count, 1), np.nan)
        colours = self._mapped(means).tolist()
        return {int(t): tuple(c) for t, c in zip(self.tracks.ids, colours, strict=True)}

    def _mapped(self, values: Floats) -> npt.NDArray[np.float32]:
        low, high = self.limits()
        known = np.isfinite(values)
        share = np.clip((np.where(known, values, low) - low) / (high - low), 0.0, 1.0)
        colours = np.array(ensure_colormap(self.colormap).map(share), np.float32).reshape(-1, 4)
        colours[~known] = UNKNOWN
        return colours


def colour_columns(tracks: Tracks) -> tuple[str, ...]:
    """The columns that tracks can be coloured by: of their rows, then of each track."""
    rows = [name for name, column in tracks.columns.items() if column.dtype.kind in "biuf"]
    return tuple(dict.fromkeys(name for name in (*rows, *OF_TRACKS) if name != TRACK))


def row_values(tracks: Tracks, column: str) -> Floats:
    """A column for every row (n,): of the row itself, or of its track.

    Raises
    ------
    KeyError
        There is no such column.
    """
    if column in tracks.columns:
        return np.asarray(tracks.columns[column], np.float64)
    table = tracks.track_table
    places = np.searchsorted(tracks.ids, tracks.track_id)
    values: Floats = np.asarray(table[column], np.float64)[places]
    return values
