"""What was measured along the tracks of a movie."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from ..charts import Tracks
from ..parameters import Parameters

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False)
class Measurements:
    """Tables of what was measured along tracks.

    Attributes
    ----------
    tracks : Tracks
        Those that were measured, gated.
    parameters : Parameters
    tables : mapping of str to DataFrame
        By name, with units in the names of their columns; a table is there also if it is empty.

        ``series``: a row per track and timepoint of its life (or beyond it, where ``alive`` is
        False): ``track_id``, ``timepoint``, ``time_s``, ``area_um2`` of the surface at the
        track's place, ``area_px`` of its pixels in uv, the distortion-corrected mean of every
        field under its own name; and, of boxes and boxes around protrusions, the same of what is
        on the protrusion and what is off it: ``on_area_um2``, ``on_<field>``, ``off_<field>``.
        ``tracks``: a row per track: as :attr:`Tracks.track_table`, with ``events``,
        ``series_<column>``: the mean of each series, ``correlation`` of the two correlated
        fields at lag 0, and ``speed_um_per_min``.
        ``events``: ``track_id``, ``timepoint``, ``time_s``, ``prominence``.
        ``aligned``: a row per event and time around it: ``event``, ``track_id``, ``time_s``
        (0 at the peak), and the columns of the series. ``mean_event``: ``column``, ``time_s``,
        ``mean``, ``sem``, ``count``.
        ``autocorrelation``: ``field``, ``lag_s``, ``mean``, ``std``, ``count`` over the surface.
        ``cross_correlation``: ``lag_s``, ``mean``, ``low`` and ``high`` end of the 95 %
        confidence interval, ``count``; ``track_correlation``: ``track_id``, ``lag_s``,
        ``correlation``.
        ``relationship``: the first correlated field in bins, ``mean`` and ``std`` of the
        correlation given it; ``density``: the field, ``correlation``, ``density``.
        ``regions``: of annotations: ``region``, ``label``, ``timepoint``, ``time_s``, ``area_um2``,
        ``area_px`` and the mean of every field.
        ``lifetimes``, ``speeds``: histograms: ``from_s``/``from_um_per_min``, ``to_…``, ``tracks``.
    numbers : mapping
        Single numbers with their units in the names, JSON-able.
    name : str
        Of the movie.
    fields : tuple of str
        Whose means were taken.
    correlated : tuple of str
        The two fields that were correlated; empty where there are not two.
    """

    tracks: Tracks
    parameters: Parameters
    tables: Mapping[str, pd.DataFrame]
    numbers: Mapping[str, Any] = field(default_factory=dict)
    name: str = ""
    fields: tuple[str, ...] = ()
    correlated: tuple[str, ...] = ()

    def table(self, name: str) -> pd.DataFrame:
        """A table; an empty one where it was not measured."""
        import pandas as pd

        return self.tables.get(name, pd.DataFrame())
