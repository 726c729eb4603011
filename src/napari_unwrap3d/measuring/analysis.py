"""Everything that is measured along the tracks of a movie, as tables and as figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from ..charts import Floats, Tracks
from ..errors import InputError
from ..parameters import MeasurementParameters, Parameters
from ..pipeline import ProgressLike
from ..progress import Progress
from ..provenance import environment
from ..tracking.gating import Side, gated
from ..tracking.velocities import (
    LATERAL,
    SPEED,
    annotated_plane,
    with_lateral,
    with_velocities,
)
from . import tables
from .correlation import (
    FEWEST_PAIRS,
    Correlation,
    autocorrelation,
    cross_correlation,
    first_side_lobe_s,
    relationship,
)
from .events import Events, event_columns, find_events
from .fields import correlated_fields, fields_of, names_in
from .measurements import Measurements
from .places import Places, places_of
from .sampling import Sampled, sample
from .speeds import mean_by_track, populations, step_speeds
from .still import STILL, groups_of, still_tracks

if TYPE_CHECKING:
    import pandas as pd

    from ..motion.movie import Movie

AREA, ON_AREA, HEIGHT = "area_um2", "on_area_um2", "height_max_um"
# The paper's range of mean curvatures is widened to this part of what there is.
MIDDLE_PERCENT = (1.0, 99.0)


def measure_tracks(
    movie: Movie,
    tracks: Tracks | None = None,
    parameters: Parameters | None = None,
    progress: ProgressLike = None,
) -> Measurements:
    """Measure what was tracked: series, events, correlations, lifetimes and speeds.

    Parameters
    ----------
    movie : Movie
    tracks : Tracks, optional
        Those that ``parameters.measurement.tracks`` names unless given.
    parameters : Parameters, optional
        Those of the movie unless given.
    progress : Progress, or callable(stage, fraction, message), optional

    Returns
    -------
    Measurements

    Raises
    ------
    ParameterError
        There is no such field or annotation.
    InputError
        There are no tracks of that name, or they lie nowhere on the surface.
    """
    report = progress if isinstance(progress, Progress) else Progress(progress)
    report = report.named("measurement")
    given = parameters or movie.parameters
    chosen = given.measurement
    if tracks is None:
        tracks = _named_tracks(movie, chosen, report.part(0.0, 0.05))
    measured = gated_tracks(movie, tracks, given)
    fields, pair = fields_of(movie, chosen), correlated_fields(movie, chosen)
    regions = names_in(chosen.regions)
    for region in regions:
        movie.common.annotations.annotation(region)
    measured = _with_speeds(movie, measured, chosen, report.part(0.05, 0.1))
    places = places_of(movie, measured, given, report.part(0.1, 0.25))
    wanted = tuple(dict.fromkeys((*fields, *pair)))
    sampled = sample(movie, places, wanted, given, report.part(0.25, 0.9), regions)
    report(0.9, "events and correlations")
    work = _Analysis(measured, places, sampled, chosen, wanted, pair)
    return Measurements(
        tracks=measured,
        parameters=given,
        tables=work.tables,
        numbers={**work.numbers, "made_with": environment()},
        name=movie.name,
        fields=wanted,
        correlated=pair,
    )


def _named_tracks(movie: Movie, chosen: MeasurementParameters, progress: Progress) -> Tracks:
    """Tracks that were kept, or places that do not move."""
    if chosen.tracks == STILL and STILL not in movie.track_names:
        return still_tracks(movie, chosen.places, progress)
    return movie.tracks(chosen.tracks)


def gated_tracks(movie: Movie, tracks: Tracks, parameters: Parameters) -> Tracks:
    """The tracks that stay inside and outside of the annotations that the parameters name."""
    chosen = parameters.measurement
    sides: tuple[tuple[Side, str], ...] = (("inside", chosen.inside), ("outside", chosen.outside))
    for side, name in sides:
        if name:
            kept = gated(movie, tracks, name, side=side, share=chosen.share)
            tracks = tracks.kept(kept.tolist())
    return tracks


def _with_speeds(
    movie: Movie, tracks: Tracks, chosen: MeasurementParameters, progress: Progress
) -> Tracks:
    """Tracks that know their speed along the surface, and along the plane of an annotation."""
    on_surface = np.isfinite(tracks.place_px).all() and len(tracks) > 0
    if SPEED not in tracks.columns and on_surface and tracks.method != STILL:
        tracks = with_velocities(movie, tracks, progress)
    return with_lateral(tracks, annotated_plane(movie, chosen.plane)) if chosen.plane else tracks


@dataclass(frozen=True, eq=False)
class _Analysis:
    """What is made of the samples of one movie."""

    tracks: Tracks
    places: Places
    sampled: Sampled
    chosen: MeasurementParameters
    fields: tuple[str, ...]
    pair: tuple[str, ...]

    @property
    def step_s(self) -> float:
        return self.tracks.time_step_s

    # Series and events -------------------------------------------------------------

    @cached_property
    def series(self) -> dict[str, Floats]:
        """Every column as series (k, T), a row per track."""
        columns = dict(self.sampled.columns)
        found = {
            name: tables.by_track(
                self.tracks.ids,
                self.places.track_id,
                self.places.timepoint,
                values,
                self.tracks.timepoints,
            )
            for name, values in columns.items()
        }
        if HEIGHT in self.tracks.columns:
            track, time = self.tracks.track_id, self.tracks.timepoint
            height = self.tracks.columns[HEIGHT]
            found[HEIGHT] = tables.by_track(
                self.tracks.ids, track, time, height, self.tracks.timepoints
            )
        return found

    @cached_property
    def series_table(self) -> pd.DataFrame:
        import pandas as pd

        rows = np.searchsorted(self.tracks.ids, self.places.track_id)
        time = self.places.timepoint
        keys = {
            "track_id": self.places.track_id,
            "timepoint": time,
            "time_s": time * self.step_s,
            "alive": self.places.alive,
        }
        return pd.DataFrame(
            {**keys, **{name: values[rows, time] for name, values in self.series.items()}}
        )

    @property
    def event_series(self) -> str:
        """The series whose peaks are events; regions have nothing that is on them."""
        name: str = self.chosen.event_series
        if self.places.kind == "region" and name == ON_AREA:
            name = AREA
        if name not in self.series:
            hint = f"Set measurement.event_series to {AREA}."
            raise InputError(f"The tracks have no {name}.", hint=hint)
        return name

    @cached_property
    def events(self) -> dict[int, Events]:
        """The events of every track, within its life."""
        chosen, name = self.chosen, self.event_series
        found = {}
        for track, values in zip(self.tracks.ids.tolist(), self.series[name], strict=True):
            time = self.tracks.timepoint[self.tracks.rows_of(track)]
            first, last = int(time[0]), int(time[-1])
            found[track] = find_events(
                self._course(values, first, last),
                self.step_s,
                prominence=chosen.prominence,
                distance_s=chosen.distance_s,
                smoothing=chosen.smoothing,
                # What is there at the first or last timepoint was, or will be, there beyond it.
                cut=(self._own and first == 0, self._own and last == self.tracks.timepoints - 1),
            )
        return found

    @property
    def _own(self) -> bool:
        """Whether events are those of a protrusion itself, and not of the box around it."""
        return self.places.kind == "protrusion" and self.event_series != AREA

    def _course(self, values: Floats, first: int, last: int) -> Floats:
        """The series in which events are looked for: that of the track's life.

        Before its first and after its last timepoint a protrusion has neither area nor height;
        a box or a region has what lies there, which is not the track's.
        """
        outside = 0.0 if self._own else np.nan
        course = np.full(len(values), outside)
        course[first : last + 1] = values[first : last + 1]
        return course

    @cached_property
    def aligned(self) -> pd.DataFrame:
        return tables.aligned_table(
            self.tracks.ids, self.events, self.series, self.step_s, self.chosen.window_s
        )

    # Correlations ------------------------------------------------------------------

    @cached_property
    def cross(self) -> Correlation | None:
        """Of the two fields along every track."""
        if not self.pair:
            return None
        first, second = (self.series[name] for name in self.pair)
        found = cross_correlation(first, second, self.step_s, self.chosen.longest_lag_s)
        # Protrusions come and go by themselves; neighbouring regions change together.
        crowded = self.places.kind == "region" and self.tracks.rows > 0 and len(self.tracks)
        return replace(found, groups=groups_of(self.tracks)) if crowded else found

    @cached_property
    def at_no_lag(self) -> Floats:
        """Correlation (k,) of every track at lag 0."""
        if self.cross is None:
            return np.full(len(self.tracks.ids), np.nan)
        return self.cross.values[:, len(self.cross.lag_s) // 2]

    @cached_property
    def auto(self) -> dict[str, Correlation]:
        """Autocorrelations of the fields over the surface."""
        if self.tracks.timepoints < FEWEST_PAIRS:
            return {}
        longest = self.chosen.longest_lag_s
        return {
            name: autocorrelation(values, self.step_s, longest)
            for name, values in self.sampled.spots.items()
        }

    @cached_property
    def related(self) -> dict[str, pd.DataFrame]:
        """How the correlation depends on the first field."""
        if not self.pair:
            return {}
        x = self.means[self.pair[0]]
        known = np.isfinite(x) & np.isfinite(self.at_no_lag)
        if known.sum() < FEWEST_PAIRS or np.ptp(x[known]) == 0:
            return {}
        low, high = np.percentile(x[known], MIDDLE_PERCENT).tolist()
        if np.ptp(self.at_no_lag[known]) == 0 or low == high:
            return {}
        found = relationship(x, self.at_no_lag, x_range=(low, high), y_range=(-1.0, 1.0))
        return tables.relationship_tables(self.pair[0], found)

    # Tracks ------------------------------------------------------------------------

    @cached_property
    def means(self) -> dict[str, Floats]:
        """Mean (k,) of every series over the track's life."""
        alive = tables.by_track(
            self.tracks.ids,
            self.places.track_id,
            self.places.timepoint,
            self.places.alive,
            self.tracks.timepoints,
        )
        found = {}
        for name, values in self.series.items():
            known = np.isfinite(values) & (alive == 1)
            count = known.sum(axis=1)
            total = np.where(known, values, 0.0).sum(axis=1)
            found[name] = np.divide(total, count, out=np.full(len(count), np.nan), where=count > 0)
        return found

    @cached_property
    def speeds(self) -> dict[str, Floats]:
        """Mean speed (k,) of every track, along the surface and along the plane."""
        found = {SPEED: mean_by_track(self.tracks, step_speeds(self.tracks))}
        if self.chosen.plane:
            lateral = np.asarray(self.tracks.columns[LATERAL], np.float64)
            found[LATERAL] = mean_by_track(self.tracks, lateral)
        return found

    @cached_property
    def track_table(self) -> pd.DataFrame:
        import pandas as pd

        table = self.tracks.track_table
        more = {
            "events": [len(self.events[track]) for track in self.tracks.ids.tolist()],
            **{f"series_{name}": values for name, values in self.means.items()},
            "correlation": self.at_no_lag,
            **self.speeds,
        }
        return pd.concat([table, pd.DataFrame(more)], axis=1)

    # Everything --------------------------------------------------------------------

    @cached_property
    def tables(self) -> dict[str, pd.DataFrame]:
        import pandas as pd

        chosen = self.chosen
        regions = pd.DataFrame(self.sampled.regions)
        if len(regions):
            regions.insert(3, "time_s", regions["timepoint"] * self.step_s)
        found = {
            "series": self.series_table,
            "tracks": self.track_table,
            "events": pd.DataFrame(event_columns(self.events, self.step_s)),
            "aligned": self.aligned,
            "mean_event": tables.mean_event_table(self.aligned),
            "autocorrelation": tables.autocorrelation_table(self.auto),
            "regions": regions,
        }
        if self.cross is not None:
            found |= tables.correlation_tables(self.tracks.ids, self.cross)
        lifetimes = self.tracks.lifetimes_s()
        edges = tables.lifetime_edges(lifetimes, self.step_s)
        found["lifetimes"] = tables.histogram_table(lifetimes, edges, "s")
        bins = np.linspace(0.0, chosen.fastest_um_per_min, chosen.speed_bins + 1)
        found["speeds"] = tables.histogram_table(self.speeds[self._speed], bins, "um_per_min")
        return found | self.related

    @property
    def _speed(self) -> str:
        return LATERAL if self.chosen.plane else SPEED

    @cached_property
    def numbers(self) -> dict[str, Any]:
        lifetimes = self.tracks.lifetimes_s()
        count = sum(len(found) for found in self.events.values())
        along = f"the plane of {self.chosen.plane}" if self.chosen.plane else "the surface"
        found: dict[str, Any] = {
            "tracks": len(self.tracks.ids),
            "place": self.places.kind,
            "events": count,
            "events_per_track": _ratio(count, len(self.tracks.ids)),
            "mean_lifetime_s": _finite(lifetimes.mean() if len(lifetimes) else None),
            "median_lifetime_s": _finite(np.median(lifetimes) if len(lifetimes) else None),
            "curvature_threshold_per_um": self.sampled.threshold_per_um,
            "side_lobe_s": {
                name: _finite(first_side_lobe_s(one)) for name, one in self.auto.items()
            },
            "speed_column": self._speed,
            "speed_label": f"Mean speed along {along} (µm/min)",
            **self._correlation_numbers(),
        }
        classes = populations(
            self.speeds[self._speed], self.chosen.fastest_um_per_min, self.chosen.speed_bins
        )
        return found | (asdict(classes) if classes is not None else {})

    def _correlation_numbers(self) -> Mapping[str, Any]:
        if self.cross is None:
            return {}
        middle = len(self.cross.lag_s) // 2
        low, high = self.cross.interval()
        return {
            "correlated": list(self.pair),
            "correlation": _finite(self.cross.mean[middle]),
            "correlation_low": _finite(low[middle]),
            "correlation_high": _finite(high[middle]),
            "correlation_tracks": int(self.cross.count[middle]),
            "lag_s": _finite(self.cross.best_lag_s),
        }


def _finite(value: Any) -> float | None:
    return float(value) if value is not None and np.isfinite(value) else None


def _ratio(above: int, below: int) -> float | None:
    return above / below if below else None
