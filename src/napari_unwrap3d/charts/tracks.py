"""Tracks: objects followed over time, and the protrusions of one timepoint that they join."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ..errors import AxesError, InputError
from .volumes import Floats, Ints

if TYPE_CHECKING:
    import pandas as pd

TRACK, TIMEPOINT = "track_id", "timepoint"
SPACE = ("z_um", "y_um", "x_um")
PLACE = ("v_px", "u_px")
BOX = ("top_px", "left_px", "bottom_px", "right_px")
NEEDED = (TRACK, TIMEPOINT, *SPACE)


@dataclass(frozen=True, eq=False)
class FrameProtrusions:
    """The protrusions of one timepoint of a movie.

    Attributes
    ----------
    timepoint : int
    labels : ndarray, (n,) int32
        One per vertex of the frame's surface, 0 = none. Numbers hold within the timepoint only.
    uv : ndarray, (N, 2N) int32
        The labels of what lies outermost over every pixel, 0 = none.
    columns : mapping of str to ndarray, (k,)
        A row per protrusion: those of :data:`..protrusions.columns.COLUMNS` with ``label``
        first, where its foot stands on the common reference surface, ``foot_z_um``,
        ``foot_y_um``, ``foot_x_um``, and ``certain``: whether it is as high and as wide as one
        of a single cell has to be. The others are followed because of what they become or were.
    numbers : mapping
        What was measured on the way, JSON-able.
    """

    timepoint: int
    labels: npt.NDArray[np.int32]
    uv: npt.NDArray[np.int32]
    columns: Mapping[str, npt.NDArray[Any]]
    numbers: Mapping[str, Any] = field(default_factory=dict)

    @property
    def table(self) -> pd.DataFrame:
        """A row per protrusion."""
        import pandas as pd

        return pd.DataFrame(dict(self.columns))


@dataclass(frozen=True, eq=False)
class Tracks:
    """Objects followed over time, on the surface and in space.

    Attributes
    ----------
    columns : mapping of str to ndarray, (n,)
        A row per object and timepoint, sorted by (``track_id``, ``timepoint``), at most one for
        each pair. Always there: ``track_id`` (from 1), ``timepoint``, ``z_um``, ``y_um``,
        ``x_um`` in the common world. Where they lie on the unwrapped surface: ``v_px``,
        ``u_px`` (NaN where unknown) and, of boxes, ``top_px``, ``left_px``, ``bottom_px``,
        ``right_px``. Further columns are properties; their names carry the unit.
    time_step_s : float
        Seconds between two timepoints.
    timepoints : int
        Of the movie.
    rows : int
        N of the uv image that ``v_px`` and ``u_px`` are in; 0 where there is none.
    splits : ndarray, (k, 2) int64
        (track, track that comes out of it).
    merges : ndarray, (k, 2) int64
        (track, track that it goes into).
    method : str
        How they were made: "surface", "boxes", "flow", "imported", "edited" …
    numbers : mapping
        Where they come from and what was measured on the way, JSON-able.
    """

    columns: Mapping[str, npt.NDArray[Any]]
    time_step_s: float
    timepoints: int
    rows: int = 0
    splits: Ints = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    merges: Ints = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    method: str = ""
    numbers: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        missing = [name for name in NEEDED if name not in self.columns]
        lengths = {name: len(column) for name, column in self.columns.items()}
        if missing or len(set(lengths.values())) > 1:
            raise InputError(
                "Tracks have a track, a timepoint and a place in every row.",
                missing=missing,
                rows=lengths,
            )
        for name in ("splits", "merges"):
            pairs = getattr(self, name)
            if pairs.ndim != 2 or pairs.shape[1] != 2:
                raise AxesError("Splits and merges are pairs of tracks.", **{name: pairs.shape})
            unknown = np.setdiff1d(pairs, self.ids)
            if len(unknown):
                raise InputError(f"Some {name} are of unknown tracks.", tracks=unknown.tolist())
        self._check_rows()

    def _check_rows(self) -> None:
        track, time = self.track_id, self.timepoint
        step = np.diff(track)
        if (step < 0).any() or ((step == 0) & (np.diff(time) <= 0)).any():
            raise InputError(
                "The rows of tracks are sorted by track and timepoint, and a track is at one "
                "place at a time.",
                hint="Build them with Tracks.of().",
            )
        if len(time) and (time.min() < 0 or time.max() >= self.timepoints or track.min() < 1):
            raise InputError(
                "Timepoints count from 0 to the last one of the movie, and tracks from 1.",
                timepoint=(int(time.min()), int(time.max())),
                timepoints=self.timepoints,
                track_id=int(track.min()),
            )

    @classmethod
    def of(cls, columns: Mapping[str, npt.ArrayLike], **others: Any) -> Tracks:
        """Tracks of rows in any order; `others` as for the class."""
        arrays = {name: np.asarray(column) for name, column in columns.items()}
        for name in (TRACK, TIMEPOINT):
            if name in arrays:
                arrays[name] = arrays[name].astype(np.int64)
        if all(name in arrays for name in (TRACK, TIMEPOINT)):
            order = np.lexsort((arrays[TIMEPOINT], arrays[TRACK]))
            arrays = {name: column[order] for name, column in arrays.items()}
        return cls(arrays, **others)

    # Rows --------------------------------------------------------------------------

    def __len__(self) -> int:
        """How many rows there are."""
        return len(self.columns[TRACK])

    @property
    def track_id(self) -> Ints:
        return self.columns[TRACK]

    @property
    def timepoint(self) -> Ints:
        return self.columns[TIMEPOINT]

    @property
    def position_um(self) -> Floats:
        """(n, 3): z, y, x in µm in the common world."""
        return _side_by_side(self.columns[name] for name in SPACE)

    @property
    def place_px(self) -> Floats:
        """(n, 2): v, u on the uv image; NaN where unknown."""
        nowhere = np.full(len(self), np.nan)
        return _side_by_side(self.columns.get(name, nowhere) for name in PLACE)

    @property
    def times_s(self) -> Floats:
        """(n,) seconds since the first timepoint."""
        times: Floats = self.timepoint * np.float64(self.time_step_s)
        return times

    # Tracks ------------------------------------------------------------------------

    @cached_property
    def ids(self) -> Ints:
        """The tracks (m,), in order."""
        return np.unique(self.columns[TRACK])

    @cached_property
    def _bounds(self) -> Ints:
        return np.append(np.searchsorted(self.track_id, self.ids), len(self))

    def rows_of(self, track: int) -> slice:
        """The rows of a track, in the order of time.

        Raises
        ------
        InputError
            There is no such track.
        """
        at = int(np.searchsorted(self.ids, track))
        if at == len(self.ids) or self.ids[at] != track:
            raise InputError(f"There is no track {track}.", tracks=len(self.ids))
        return slice(int(self._bounds[at]), int(self._bounds[at + 1]))

    def column_of(self, track: int, name: str) -> Floats:
        """A column of a track over the whole movie, (T,); NaN at timepoints without it."""
        rows = self.rows_of(track)
        values = np.full(self.timepoints, np.nan)
        values[self.timepoint[rows]] = self.columns[name][rows]
        return values

    def lifetimes_s(self) -> Floats:
        """How long each track (m,) lasts: the time that its timepoints stand for."""
        first, last = self._bounds[:-1], self._bounds[1:] - 1
        between = self.timepoint[last] - self.timepoint[first]
        lifetimes: Floats = (between + 1) * np.float64(self.time_step_s)
        return lifetimes

    def kept(self, tracks: Iterable[int]) -> Tracks:
        """Only some tracks, with their numbers, and the splits and merges among them."""
        chosen = np.array(sorted(set(tracks)), np.int64)
        rows = np.isin(self.track_id, chosen)
        return replace(
            self,
            columns={name: column[rows] for name, column in self.columns.items()},
            splits=self.splits[np.isin(self.splits, chosen).all(axis=1)],
            merges=self.merges[np.isin(self.merges, chosen).all(axis=1)],
        )

    def with_columns(self, **columns: npt.ArrayLike) -> Tracks:
        """The same with further columns (n,), or other values in some."""
        added = {name: np.asarray(column) for name, column in columns.items()}
        return replace(self, columns={**self.columns, **added})

    # Tables ------------------------------------------------------------------------

    @property
    def table(self) -> pd.DataFrame:
        """A row per object and timepoint, with ``time_s``."""
        import pandas as pd

        first = {TRACK: self.track_id, TIMEPOINT: self.timepoint, "time_s": self.times_s}
        return pd.DataFrame(first | dict(self.columns))

    @property
    def track_table(self) -> pd.DataFrame:
        """A row per track.

        Returns
        -------
        DataFrame
            ``track_id``, ``first_timepoint``, ``last_timepoint``, ``timepoints`` (at which it
            is there), ``start_s``, ``lifetime_s``, ``parent`` (the track it comes out of, or 0),
            ``into`` (the track it goes into, or 0), and the mean of every property.
        """
        import pandas as pd

        first, last = self._bounds[:-1], self._bounds[1:] - 1
        count = np.diff(self._bounds)
        table = {
            TRACK: self.ids,
            "first_timepoint": self.timepoint[first],
            "last_timepoint": self.timepoint[last],
            "timepoints": count,
            "start_s": self.timepoint[first] * self.time_step_s,
            "lifetime_s": self.lifetimes_s(),
            "parent": _partner(self.ids, self.splits[:, ::-1]),
            "into": _partner(self.ids, self.merges),
        }
        own = {*NEEDED, *PLACE, *BOX}
        more = {k: v for k, v in self.columns.items() if k not in own}
        rows = pd.DataFrame(more, index=range(len(self)))
        means = rows.select_dtypes("number").groupby(self.track_id).mean()
        means = means.add_prefix("mean_").reset_index(drop=True)
        return pd.concat([pd.DataFrame(table), means], axis=1)


def _side_by_side(columns: Iterable[npt.NDArray[Any]]) -> Floats:
    return np.stack([np.asarray(column, np.float64) for column in columns], axis=1)


def _partner(tracks: Ints, pairs: Ints) -> Ints:
    """The second of the pair whose first each track is, or 0."""
    found = dict(pairs[::-1].tolist())
    return np.array([found.get(track, 0) for track in tracks.tolist()], np.int64)
