"""Where the tracks of a movie are on its uv images: a box at every timepoint, and what it is of."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from ..charts import Floats, Ints, Tracks
from ..charts.tracks import BOX
from ..errors import InputError
from ..geometry.padding import sample_uv_nearest
from ..parameters import MeasurementParameters, Parameters
from ..progress import Progress
from ..tracking.boxes import Box, bounding_boxes
from .still import pixel_lengths

if TYPE_CHECKING:
    from ..motion.movie import Movie

LABEL, SIDE = "label", "side_px"
NO_LABEL = -1


@dataclass(frozen=True, eq=False)
class Places:
    """The places of tracks: a row per track and timepoint, sorted by track and timepoint.

    Attributes
    ----------
    track_id, timepoint : ndarray, (m,) int64
    corners : ndarray, (m, 4)
        Top, left, bottom and right of the box in an endless uv image; NaN where it is unknown.
    label : ndarray, (m,) int64
        The protrusion that the track is at that timepoint; −1: none.
    alive : ndarray, (m,) bool
        False before and after the life of the track.
    kind : str
        "protrusion", "box" or "region".
    """

    track_id: Ints
    timepoint: Ints
    corners: Floats
    label: Ints
    alive: npt.NDArray[np.bool_]
    kind: str

    def __len__(self) -> int:
        return len(self.track_id)

    def at(self, timepoint: int) -> Ints:
        """The rows at a timepoint whose box is known."""
        here = (self.timepoint == timepoint) & np.isfinite(self.corners).all(axis=1)
        return np.flatnonzero(here)


def places_of(
    movie: Movie, tracks: Tracks, parameters: Parameters, progress: Progress | None = None
) -> Places:
    """Where the tracks of a movie are.

    Tracks that know their protrusions are at the box around each, tracks with boxes in them, and
    all others in squares around their (v, u): of their own side, or ``measurement.region_um``
    on the common reference. Where a track was lost, its box lies between those before and after.

    Parameters
    ----------
    movie : Movie
    tracks : Tracks
    parameters : Parameters
    progress : Progress, optional

    Raises
    ------
    InputError
        The tracks lie on images of another size, or nowhere on the surface.
    """
    rows = movie.common.uv.shape[0]
    if tracks.rows not in (0, rows):
        raise InputError(
            "The tracks lie on uv images of another size.", tracks=tracks.rows, movie=rows
        )
    label = _labels(tracks)
    kind = "region" if label is None else "protrusion"
    if all(name in tracks.columns for name in BOX):
        corners = np.column_stack([tracks.columns[name] for name in BOX]).astype(np.float64)
        if kind == "region" and SIDE not in tracks.columns:
            kind = "box"
    elif label is not None:
        corners = _around_labels(movie, tracks, label, parameters, progress)
    else:
        corners = _squares(movie, tracks, parameters.measurement)
    if kind != "region":
        _fill_gaps(tracks, corners, rows)
    chosen = parameters.measurement
    if chosen.on == "curvature" and kind == "protrusion":
        kind = "box"
    found = Places(
        tracks.track_id,
        tracks.timepoint,
        corners,
        np.full(len(tracks), NO_LABEL) if label is None else label,
        np.ones(len(tracks), bool),
        kind,
    )
    # What flows on is somewhere else before and after its life.
    beyond = int(np.floor(chosen.beyond_s / tracks.time_step_s + 1e-9)) * (kind != "region")
    return found if beyond == 0 else _lengthened(found, tracks, beyond)


def _labels(tracks: Tracks) -> Ints | None:
    """The protrusion of every row, −1 for none; None where no track knows any."""
    if LABEL not in tracks.columns:
        return None
    given = np.nan_to_num(np.asarray(tracks.columns[LABEL], np.float64), nan=0.0)
    label = np.where(given > 0, given, NO_LABEL).astype(np.int64)
    return label if (label > 0).any() else None


def _around_labels(
    movie: Movie,
    tracks: Tracks,
    label: Ints,
    parameters: Parameters,
    progress: Progress | None,
) -> Floats:
    """Boxes (n, 4) around the protrusions of the rows."""
    corners = np.full((len(tracks), 4), np.nan)
    for timepoint, rows in _by_timepoint(tracks.timepoint, movie, progress):
        boxes = bounding_boxes(movie.protrusions(timepoint, parameters).uv)
        for row in rows.tolist():
            box = boxes.get(int(label[row]))
            if box is not None:
                corners[row] = box.top, box.left, box.bottom, box.right
    return corners


def _by_timepoint(
    timepoint: Ints, movie: Movie, progress: Progress | None
) -> Iterator[tuple[int, Ints]]:
    present = np.unique(timepoint)
    for number, time in enumerate(present.tolist()):
        if progress is not None:
            progress(number / len(present), f"places at timepoint {time}")
        if not movie.is_lost(time):
            yield time, np.flatnonzero(timepoint == time)


def _squares(movie: Movie, tracks: Tracks, chosen: MeasurementParameters) -> Floats:
    """Boxes (n, 4) around the (v, u) of the rows: squares in pixels where they have a side.

    Else they are as high and as wide on the common reference as the parameters say, also near
    a pole, where that takes many columns.
    """
    middle = tracks.place_px
    known = np.isfinite(middle).all(axis=1)
    if len(tracks) and not known.any():
        raise InputError(
            "The tracks have no place on the surface.",
            hint="Lay them on the surface when they are imported.",
        )
    if SIDE in tracks.columns:
        side = np.maximum(np.rint(np.asarray(tracks.columns[SIDE], np.float64)), 1.0)
        size = np.column_stack([side, side])
    else:
        lengths = np.stack(pixel_lengths(movie.common.uv.positions), axis=-1)
        size = np.ones((len(tracks), 2))
        length = sample_uv_nearest(lengths, middle[known])
        size[known] = np.rint(chosen.region_um / np.maximum(length, 1e-9))
        rows = len(lengths)
        size = np.clip(size, 1.0, (2 * rows, 2 * rows))
    low = np.rint(middle - (size - 1) / 2)
    return np.column_stack([low, low + size])


def _fill_gaps(tracks: Tracks, corners: Floats, rows: int) -> None:
    """Boxes where there is none, between the neighbours of the same track; in place."""
    missing = np.asarray(~np.isfinite(corners).all(axis=1))
    for track in np.unique(tracks.track_id[missing]).tolist():
        part = tracks.rows_of(track)
        known = np.flatnonzero(~missing[part])
        if len(known) == 0:
            continue
        boxes = _written_alike([Box(*c) for c in corners[part][known].tolist()], rows)
        times = tracks.timepoint[part]
        for column in range(4):
            values = [(b.top, b.left, b.bottom, b.right)[column] for b in boxes]
            filled = np.interp(times, times[known], values)
            corners[part, column] = np.where(missing[part], filled, corners[part, column])


def _written_alike(boxes: Sequence[Box], rows: int) -> list[Box]:
    """Boxes, each in the coordinates that lie nearest to the one before."""
    found = [boxes[0]]
    for box in boxes[1:]:
        found.append(box.near(found[-1], rows))
    return found


def _lengthened(places: Places, tracks: Tracks, beyond: int) -> Places:
    """The places and, for some timepoints before and after each life, its first and last box."""
    parts = []
    for track in tracks.ids.tolist():
        rows = np.arange(len(tracks))[tracks.rows_of(track)]
        first, last = int(places.timepoint[rows[0]]), int(places.timepoint[rows[-1]])
        before = np.arange(max(first - beyond, 0), first)
        after = np.arange(last + 1, min(last + 1 + beyond, tracks.timepoints))
        row = np.concatenate([np.full(len(before), rows[0]), rows, np.full(len(after), rows[-1])])
        time = np.concatenate([before, places.timepoint[rows], after])
        parts.append(np.column_stack([row, time]))
    row, time = np.concatenate([np.zeros((0, 2), np.int64), *parts]).T
    alive = places.timepoint[row] == time
    return Places(
        places.track_id[row],
        time,
        places.corners[row],
        np.where(alive, places.label[row], NO_LABEL),
        alive,
        places.kind,
    )
