"""From the protrusions of all timepoints to tracks, by either method."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Tracks
from ..charts.tracks import PLACE, SPACE, TIMEPOINT, TRACK
from ..parameters import Parameters, TrackingParameters
from ..pipeline import ProgressLike
from ..progress import Progress
from ..provenance import content_hash
from ..unwrapping.uv import direction_to_uv, uv_to_direction
from .detections import CERTAIN, FOOT, protrusions_key, protrusions_of_all, same_for_all
from .linking import Linked, link

if TYPE_CHECKING:
    from ..motion.movie import Movie

Columns = dict[str, npt.NDArray[Any]]

VERSION = 1
NAME = "protrusions"
LABEL = "label"
# Of a gap: these lie between the places before and after; what was measured is not known.
BETWEEN = (*SPACE, *FOOT)


def track_protrusions(
    movie: Movie, parameters: Parameters | None = None, progress: ProgressLike = None
) -> Tracks:
    """Follow the protrusions of a movie over time.

    Protrusions that were not found yet are found first. The tracks are kept in the movie's
    folder under the name "protrusions".

    Parameters
    ----------
    movie : Movie
    parameters : Parameters, optional
        Those of the movie unless given.
    progress : Progress, or callable(stage, fraction, message), optional

    Returns
    -------
    Tracks
        With the column ``label``, the protrusion at that timepoint (0: in a gap), and the
        columns of its table, which are NaN in a gap.

    Raises
    ------
    InputError
        A timepoint was not made and the source is not known.
    Cancelled
        The user asked to stop; protrusions that were found stay.
    """
    chosen = parameters or movie.parameters
    report = progress if isinstance(progress, Progress) else Progress(progress)
    chosen = same_for_all(movie, chosen, report.part(0.0, 0.05))
    found = protrusions_of_all(movie, chosen, report.part(0.05, 0.9))
    if chosen.tracking.method == "boxes":
        from .box_tracker import track_boxes

        tracks = track_boxes(movie, found, chosen, report.part(0.9, 0.98))
    else:
        tables = [(one.timepoint, dict(one.columns)) for one in found]
        report(0.9, "linking protrusions")
        tracks = link_tables(
            tables,
            chosen.tracking,
            time_step_s=movie.time_step_s,
            timepoints=len(movie),
            rows=movie.common.uv.shape[0],
        )
    linked = len(tracks.ids)
    tracks = lasting(tracks, chosen.tracking)
    told = {"kind": chosen.protrusions.kind, "threshold_um": chosen.protrusions.threshold_um}
    left_out = linked - len(tracks.ids)
    tracks = replace(tracks, numbers={**tracks.numbers, **told, "left_out": left_out})
    movie.keep_tracks(NAME, tracks, tracks_key(movie, chosen))
    report(1.0, f"{len(tracks.ids)} tracks")
    return tracks


def tracks_key(movie: Movie, parameters: Parameters) -> str:
    """What the tracks of a movie's protrusions are made from."""
    there = [timepoint for timepoint in range(len(movie)) if not movie.is_lost(timepoint)]
    found = [protrusions_key(movie, timepoint, parameters) for timepoint in there]
    groups = [parameters.tracking.model_dump_json(), parameters.boxes.model_dump_json()]
    return content_hash(VERSION, NAME, found, groups)


# Linking ----------------------------------------------------------------------------


def link_tables(
    tables: Sequence[tuple[int, Mapping[str, npt.NDArray[Any]]]],
    parameters: TrackingParameters,
    *,
    time_step_s: float,
    timepoints: int,
    rows: int,
) -> Tracks:
    """Tracks of the protrusions of several timepoints, linked on the common surface.

    Feet are linked by their distance in space: over as far as a protrusion moves from one
    timepoint to the next, the smooth reference surface is flat, and there it is neither seam
    nor pole.

    Parameters
    ----------
    tables : sequence of (int, mapping of str to ndarray)
        A timepoint and its protrusions' ``columns``, see :class:`.FrameProtrusions`.
    parameters : TrackingParameters
    time_step_s : float
    timepoints : int
        Of the movie.
    rows : int
        Of the uv image that the places are in.

    Returns
    -------
    Tracks
        Method "surface". All of them, however short.
    """
    columns = _one_table(tables)
    about: dict[str, Any] = {"time_step_s": time_step_s, "timepoints": timepoints, "rows": rows}
    if not columns:
        nothing: Columns = {name: np.zeros(0) for name in (*SPACE, *PLACE, *FOOT, LABEL)}
        nothing |= {TRACK: np.zeros(0, np.int64), TIMEPOINT: np.zeros(0, np.int64)}
        return Tracks(nothing, method="surface", **about)
    step = parameters.longest_step_um
    found = link(
        np.column_stack([columns[name] for name in FOOT]),
        columns[TIMEPOINT],
        longest_step_um=step,
        features_um=_features(columns, parameters),
        gap_timepoints=int(parameters.gap_s / time_step_s + 1e-9),
        split_um=parameters.split_um or None,
        merge_um=parameters.merge_um or None,
    )
    return _tracks(columns, found, about)


def _one_table(tables: Sequence[tuple[int, Mapping[str, npt.NDArray[Any]]]]) -> Columns:
    """All rows below each other, with their timepoints."""
    filled = [(timepoint, table) for timepoint, table in tables if len(table[LABEL])]
    if not filled:
        return {}
    names = filled[0][1].keys()
    columns = {name: np.concatenate([table[name] for _, table in filled]) for name in names}
    counts = [len(table[LABEL]) for _, table in filled]
    columns[TIMEPOINT] = np.repeat([timepoint for timepoint, _ in filled], counts)
    return columns


def _features(columns: Mapping[str, npt.NDArray[Any]], parameters: TrackingParameters) -> Floats:
    """What should not change much from one timepoint to the next, in µm."""
    size = parameters.area_weight * np.sqrt(columns["area_um2"])
    height = parameters.height_weight * columns["height_max_um"]
    return np.column_stack([size, height])


def _tracks(columns: Columns, found: Linked, about: dict[str, Any]) -> Tracks:
    gaps = _gaps(columns, found, about["rows"])
    rows = {name: np.concatenate([columns[name], gaps[name]]) for name in columns}
    rows[TRACK] = np.concatenate([found.track_id, gaps[TRACK]])
    return Tracks.of(
        rows,
        splits=found.splits,
        merges=found.merges,
        method="surface",
        numbers={
            "protrusions": len(found.track_id),
            "tracks": len(np.unique(found.track_id)),
            "in_gaps": len(gaps[TRACK]),
        },
        **about,
    )


def _gaps(columns: Columns, found: Linked, uv_rows: int) -> Columns:
    """Rows for the timepoints at which tracks were lost: places between those before and after."""
    links = found.links(columns[TIMEPOINT])
    times = columns[TIMEPOINT]
    lost = times[links[:, 1]] - times[links[:, 0]] - 1
    before, after = np.repeat(links, lost, axis=0).T
    number = np.concatenate([np.arange(1, n + 1) for n in lost] or [np.zeros(0, int)])
    share = number / np.maximum(np.repeat(lost + 1, lost), 1)
    rows: Columns = {name: _unknown(column, len(before)) for name, column in columns.items()}
    rows |= {
        name: (1 - share) * columns[name][before] + share * columns[name][after]
        for name in BETWEEN
        if name in columns
    }
    first, last = (
        np.column_stack([columns[name][side] for name in PLACE]) for side in (before, after)
    )
    rows |= dict(zip(PLACE, _between(first, last, share, uv_rows).T, strict=True))
    rows[TRACK] = found.track_id[before]
    rows[TIMEPOINT] = times[before] + number.astype(np.int64)
    rows[LABEL] = np.zeros(len(before), columns[LABEL].dtype)
    return rows


def _unknown(like: npt.NDArray[Any], count: int) -> npt.NDArray[Any]:
    """Values that say nothing: NaN, or False where there is none."""
    if like.dtype == np.bool_:
        return np.zeros(count, np.bool_)
    return np.full(count, np.nan)


def _between(before: Floats, after: Floats, share: Floats, rows: int) -> Floats:
    """Places (n, 2) on the shortest way over the sphere from one (v, u) to another."""
    directions = [uv_to_direction(places, rows) for places in (before, after)]
    mixed = (1 - share)[:, None] * directions[0] + share[:, None] * directions[1]
    length = np.linalg.norm(mixed, axis=1)
    found = np.full((len(share), 2), np.nan)
    there = length > 0
    found[there] = direction_to_uv(mixed[there] / length[there, None], rows)
    return found


# Which tracks stay ------------------------------------------------------------------


def lasting(tracks: Tracks, parameters: TrackingParameters) -> Tracks:
    """Those that last long enough, and are once as high and as wide as protrusions have to be."""
    table = tracks.columns
    kept = tracks.lifetimes_s() >= parameters.least_lifetime_s - 1e-9
    index = np.searchsorted(tracks.ids, tracks.track_id)
    if CERTAIN in table:
        # In a gap it is NaN or False.
        certain = np.nan_to_num(np.asarray(table[CERTAIN], np.float64)) > 0
        kept &= np.bincount(index, certain, len(tracks.ids)) > 0
    if parameters.least_curvature_per_um is not None and "mean_curvature_per_um" in table:
        curvature = np.asarray(table["mean_curvature_per_um"], np.float64)
        known = np.isfinite(curvature)
        total = np.bincount(index[known], curvature[known], len(tracks.ids))
        count = np.bincount(index[known], minlength=len(tracks.ids))
        kept &= total >= parameters.least_curvature_per_um * np.maximum(count, 1)
    return tracks.kept(tracks.ids[kept].tolist())
