"""Tracks edited by a person: cut, joined, deleted, moved, linked anew; all of it can be undone."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt
from psygnal import Signal

from ..annotations.history import History
from ..charts import Floats, Ints, Tracks
from ..charts.tracks import BOX, PLACE, SPACE, TIMEPOINT, TRACK
from ..errors import InputError, ParameterError
from .relations import EDITED, exchanged, possible, renamed, spans

if TYPE_CHECKING:
    from ..motion.movie import Movie

MOVED = "moved"
Columns = dict[str, npt.NDArray[Any]]


class TrackEdits:
    """Edits of tracks, which can be undone.

    Every method is one step of the history. The tracks that are edited stay as they were: each
    edit makes new ones, whose ``method`` is "edited" and whose ``numbers["edits"]`` tells what
    was done.

    Parameters
    ----------
    tracks : Tracks
    movie : Movie, optional
        On whose surface moved points are laid; without one, a point that is moved in space has
        no (v, u), and one that is moved on the image keeps its place in space.

    Attributes
    ----------
    changed : Signal(frozenset of int)
        The numbers of the tracks that an edit was made to, or a step that was undone or redone.
    """

    changed = Signal(frozenset)

    def __init__(self, tracks: Tracks, movie: Movie | None = None) -> None:
        self._base, self._now = tracks, tracks
        self._movie = movie
        self._touched: frozenset[int] = frozenset()
        self._history = History(self._settle)

    # What there is -----------------------------------------------------------------

    @property
    def tracks(self) -> Tracks:
        """The tracks as edited so far."""
        return self._now

    @property
    def base(self) -> Tracks:
        """The tracks before the first edit."""
        return self._base

    @property
    def is_edited(self) -> bool:
        return self._now is not self._base

    @property
    def unused(self) -> int:
        """A number that no track has or had."""
        return 1 + int(max(self._now.ids.max(initial=0), self._base.ids.max(initial=0)))

    # History -----------------------------------------------------------------------

    @property
    def can_undo(self) -> bool:
        return self._history.can_undo

    @property
    def can_redo(self) -> bool:
        return self._history.can_redo

    def undo(self) -> None:
        """Take back the last step, if there is one."""
        self._history.undo()

    def redo(self) -> None:
        """Do again what was taken back last."""
        self._history.redo()

    @contextmanager
    def stroke(self) -> Iterator[None]:
        """All edits inside are one step of the history."""
        with self._history.stroke():
            yield

    # Whole tracks ------------------------------------------------------------------

    def cut(self, track: int, timepoint: int) -> int:
        """Make what a track is from a timepoint on a track of its own, whose number is returned.

        Raises
        ------
        ParameterError
            Nothing of the track would lie before, or after.
        """
        times = self._times(track)
        if not times[0] < timepoint <= times[-1]:
            raise ParameterError(
                f"Track {track} cannot be cut at timepoint {timepoint}.",
                first=int(times[0]),
                last=int(times[-1]),
                hint="Cut after its first timepoint, and up to its last one.",
            )
        new = self.unused
        self._exchange(track, new, timepoint, "cut")
        return new

    def join(self, one: int, other: int) -> int:
        """Make two tracks one, which has the number of the earlier one; that is returned.

        Raises
        ------
        ParameterError
            Both are somewhere at the same timepoint.
        """
        if one == other:
            raise ParameterError("A track cannot be joined with itself.", track=one)
        first, second = sorted((one, other), key=lambda track: int(self._times(track)[0]))
        both = np.intersect1d(self._times(first), self._times(second))
        if len(both):
            raise ParameterError(
                f"Tracks {first} and {second} are both there at {len(both)} timepoints.",
                first_timepoint=int(both[0]),
                hint="Cut one of them first, or link them anew at a timepoint.",
            )
        columns = self._columns()
        columns[TRACK][columns[TRACK] == second] = first
        now = self._now
        last = self._times(second)[-1] > self._times(first)[-1]
        # Of the joined track the first begins it, and the later of both ends it.
        splits = now.splits[now.splits[:, 1] != second]
        merges = now.merges[now.merges[:, 0] != (first if last else second)]
        self._put(
            columns,
            renamed(splits, {second: first}),
            renamed(merges, {second: first}),
            {"edit": "join", "tracks": [first, second]},
            {first, second},
        )
        return first

    def delete(self, tracks: int | Iterable[int]) -> None:
        """Leave tracks out, and the splits and merges that they take part in."""
        chosen = sorted(set(self._chosen(tracks)))
        for track in chosen:
            self._now.rows_of(track)
        kept = self._now.kept(np.setdiff1d(self._now.ids, chosen).tolist())
        record = {"edit": "delete", "tracks": chosen}
        self._put(dict(kept.columns), kept.splits, kept.merges, record, set(chosen))

    def relink(self, track: int, other: int, timepoint: int) -> None:
        """From a timepoint on, a track goes on as another one does, and that one as it did.

        What is left with nothing at all goes: where the other track begins at the timepoint or
        later, and this one is not there any more, the two become one.

        Raises
        ------
        ParameterError
            Both have nothing from this timepoint on, or this track has nothing before it.
        """
        if track == other:
            raise ParameterError("A track cannot be linked with itself.", track=track)
        mine, its = self._times(track), self._times(other)
        if not (mine < timepoint).any() or not ((its >= timepoint).any() or mine[-1] >= timepoint):
            raise ParameterError(
                f"Track {track} cannot go on as track {other} from timepoint {timepoint}.",
                first=int(mine[0]),
                other_last=int(its[-1]),
                hint="The one must be there before the timepoint, and one of them from it on.",
            )
        self._exchange(track, other, timepoint, "relink")

    def _exchange(self, one: int, other: int, timepoint: int, edit: str) -> None:
        """What two tracks are from a timepoint on changes hands; `other` may be a new number."""
        columns = self._columns()
        now, track = self._now, columns[TRACK]
        after = columns[TIMEPOINT] >= timepoint
        was_one, was_other = after & (track == one), after & (track == other)
        track[was_one], track[was_other] = other, one
        lives = spans(track, columns[TIMEPOINT])
        splits, merges = exchanged(now, one, other, timepoint, lives)
        record = {"edit": edit, "tracks": [one, other], TIMEPOINT: int(timepoint)}
        self._put(columns, splits, merges, record, {one, other})

    # Splits and merges -------------------------------------------------------------

    def link(self, track: int, other: int, kind: Literal["split", "merge"] = "split") -> None:
        """Let another track come out of this one (split), or this one go into it (merge).

        A track comes out of one, and goes into one: what it had before is replaced.

        Raises
        ------
        ParameterError
            In time it cannot be: the track that comes out begins before the other, or the one
            that it goes into has ended before.
        """
        if kind not in ("split", "merge"):
            raise ParameterError(f"There is no link {kind!r}.", hint="split or merge.")
        mine, its = self._times(track), self._times(other)
        possible = mine[0] < its[0] if kind == "split" else its[-1] > mine[-1]
        if track == other or not possible:
            raise ParameterError(
                f"Tracks {track} and {other} cannot be linked as a {kind}.",
                first=(int(mine[0]), int(its[0])),
                last=(int(mine[-1]), int(its[-1])),
                hint="What comes out of a track begins later; what it goes into lasts longer.",
            )
        now, pair = self._now, np.array([[track, other]], np.int64)
        splits, merges = now.splits, now.merges
        if kind == "split":
            splits = np.concatenate([splits[splits[:, 1] != other], pair])
        else:
            merges = np.concatenate([merges[merges[:, 0] != track], pair])
        record = {"edit": kind, "tracks": [track, other]}
        self._put(self._columns(), splits, merges, record, {track, other})

    def unlink(self, track: int, other: int) -> None:
        """Remove the splits and merges between two tracks.

        Raises
        ------
        ParameterError
            There are none.
        """
        now, pair = self._now, [track, other]
        splits = now.splits[~np.isin(now.splits, pair).all(axis=1)]
        merges = now.merges[~np.isin(now.merges, pair).all(axis=1)]
        if len(splits) == len(now.splits) and len(merges) == len(now.merges):
            raise ParameterError(f"Tracks {track} and {other} are not linked.")
        record = {"edit": "unlink", "tracks": pair}
        self._put(self._columns(), splits, merges, record, set(pair))

    # Points ------------------------------------------------------------------------

    def move(
        self,
        track: int,
        timepoint: int,
        *,
        position_um: npt.ArrayLike | None = None,
        place_px: npt.ArrayLike | None = None,
    ) -> None:
        """Move a track at a timepoint, in space or on the uv image.

        With a movie, the other follows: a point in space is laid on the nearest place of the
        timepoint's surface, and a place on the image is where that surface lies outermost. A
        box goes along. What was measured of the object stays; the column ``moved`` tells which
        rows were moved by hand.

        Parameters
        ----------
        track, timepoint : int
        position_um : array-like, (3,), optional
            z, y, x in the common world.
        place_px : array-like, (2,), optional
            v, u.

        Raises
        ------
        InputError
            The track is not there at the timepoint.
        ParameterError
            It is not said where to.
        """
        row = self._row(track, timepoint)
        position, place = self._laid(timepoint, position_um, place_px)
        columns = self._columns()
        if place is not None:
            self._move_box(columns, row, place)
            _set(columns, row, PLACE, place)
        if position is not None:
            _set(columns, row, SPACE, position)
        moved = columns.get(MOVED, np.zeros(len(self._now), np.int64)).copy()
        moved[row] = 1
        columns[MOVED] = moved
        record = {"edit": "move", "tracks": [track], TIMEPOINT: int(timepoint)}
        self._put(columns, self._now.splits, self._now.merges, record, {track})

    def add(
        self,
        timepoint: int,
        *,
        track: int | None = None,
        position_um: npt.ArrayLike | None = None,
        place_px: npt.ArrayLike | None = None,
    ) -> int:
        """Put a point at a timepoint, of a track or of a new one; its number is returned.

        Properties of the row are unknown: NaN, 0 or an empty text.

        Raises
        ------
        ParameterError
            The track is there already, there is no such timepoint, or it is not said where.
        """
        number = self.unused if track is None else int(track)
        if track is not None and timepoint in self._times(number):
            raise ParameterError(
                f"Track {number} is already there at timepoint {timepoint}.", hint="Move it."
            )
        if not 0 <= timepoint < self._now.timepoints:
            raise ParameterError(
                f"There is no timepoint {timepoint}.", timepoints=self._now.timepoints
            )
        position, place = self._laid(timepoint, position_um, place_px)
        if position is None:
            raise ParameterError("A new point needs a place in space.", hint="Give position_um.")
        columns = {name: _longer(column) for name, column in self._now.columns.items()}
        columns[TRACK][-1], columns[TIMEPOINT][-1] = number, timepoint
        _set(columns, -1, SPACE, position)
        if place is not None and all(name in columns for name in PLACE):
            _set(columns, -1, PLACE, place)
        if MOVED in columns:
            columns[MOVED][-1] = 1
        record = {"edit": "add", "tracks": [number], TIMEPOINT: int(timepoint)}
        self._put(columns, self._now.splits, self._now.merges, record, {number})
        return number

    def remove(self, track: int, timepoint: int) -> None:
        """Take a track's point at a timepoint away, and the track with its last point."""
        row = self._row(track, timepoint)
        if len(self._times(track)) == 1:
            self.delete(track)
            return
        columns = {name: np.delete(column, row) for name, column in self._now.columns.items()}
        record = {"edit": "remove", "tracks": [track], TIMEPOINT: int(timepoint)}
        self._put(columns, self._now.splits, self._now.merges, record, {track})

    def _laid(
        self, timepoint: int, position_um: npt.ArrayLike | None, place_px: npt.ArrayLike | None
    ) -> tuple[Floats | None, Floats | None]:
        """Position and place, one from the other where there is a movie."""
        if position_um is None and place_px is None:
            raise ParameterError("It is not said where the point is.", hint="position_um, place_px")
        position = None if position_um is None else _checked(position_um, 3)
        place = None if place_px is None else _checked(place_px, 2)
        if self._movie is not None:
            from .laying import place_of, position_of

            if place is None and position is not None:
                place = place_of(self._movie, timepoint, position[None])[0][0]
            elif position is None and place is not None:
                position = position_of(self._movie, timepoint, place[None])[0]
        elif place is None:
            place = np.full(2, np.nan)
        return position, place

    def _move_box(self, columns: Columns, row: int, place: Floats) -> None:
        if not all(name in columns for name in (*BOX, *PLACE)) or self._now.rows == 0:
            return
        from .boxes import Box

        old = [float(columns[name][row]) for name in PLACE]
        sides = [float(columns[name][row]) for name in BOX]
        if not np.isfinite([*old, *sides, *place]).all():
            return
        box = Box(*sides)
        unit = Box(old[0], old[1], old[0] + 1, old[1] + 1)
        goal = Box(place[0], place[1], place[0] + 1, place[1] + 1).near(unit, self._now.rows)
        moved = box.moved(goal.top - unit.top, goal.left - unit.left)
        _set(columns, row, BOX, np.array([moved.top, moved.left, moved.bottom, moved.right]))

    # Inside ------------------------------------------------------------------------

    def _chosen(self, tracks: int | Iterable[int]) -> list[int]:
        if isinstance(tracks, int | np.integer):
            return [int(tracks)]
        return [int(track) for track in tracks]

    def _times(self, track: int) -> Ints:
        return self._now.timepoint[self._now.rows_of(track)]

    def _row(self, track: int, timepoint: int) -> int:
        rows = self._now.rows_of(track)
        at = np.flatnonzero(self._now.timepoint[rows] == timepoint)
        if len(at) == 0:
            raise InputError(f"Track {track} is not there at timepoint {timepoint}.")
        return int(rows.start + at[0])

    def _columns(self) -> Columns:
        """The columns, of which those that identify rows may be written to."""
        columns = dict(self._now.columns)
        columns[TRACK] = columns[TRACK].copy()
        return columns

    def _put(
        self,
        columns: Mapping[str, npt.NDArray[Any]],
        splits: Ints,
        merges: Ints,
        record: Mapping[str, Any],
        touched: set[int],
    ) -> None:
        """Make new tracks the present ones, as one step."""
        before = self._now
        lives = spans(columns[TRACK], columns[TIMEPOINT])
        done = [*before.numbers.get("edits", ()), dict(record)]
        after = Tracks.of(
            columns,
            time_step_s=before.time_step_s,
            timepoints=before.timepoints,
            rows=before.rows,
            splits=possible(splits, lives, 0),
            merges=possible(merges, lives, 1),
            method=EDITED,
            numbers={"edited_from": before.method, **before.numbers, "edits": done},
        )
        self._history.record(_Step(self._show, before, after, frozenset(touched)))
        self._show(after, frozenset(touched))
        self._settle()

    def _show(self, tracks: Tracks, touched: frozenset[int]) -> None:
        self._now = tracks
        self._touched |= touched

    def _settle(self) -> None:
        touched, self._touched = self._touched, frozenset()
        self.changed.emit(touched)


@dataclass(frozen=True, eq=False)
class _Step:
    """One state of the tracks put in the place of another."""

    show: Callable[[Tracks, frozenset[int]], None]
    before: Tracks
    after: Tracks
    touched: frozenset[int]

    @property
    def nbytes(self) -> int:
        return sum(int(column.nbytes) for column in self.after.columns.values())

    def apply(self, *, forward: bool) -> None:
        self.show(self.after if forward else self.before, self.touched)


def _checked(values: npt.ArrayLike, count: int) -> Floats:
    found = np.asarray(values, np.float64).ravel()
    if len(found) != count or not np.isfinite(found).all():
        raise ParameterError(f"A point has {count} finite coordinates.", got=found.tolist())
    return found


def _set(columns: Columns, row: int, names: Iterable[str], values: Floats) -> None:
    for name, value in zip(names, values, strict=True):
        if name in columns:
            columns[name] = columns[name].astype(np.float64)
            columns[name][row] = value


def _longer(column: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """A column with one more row, of which nothing is known."""
    unknown: Any = np.nan if column.dtype.kind == "f" else 0
    if column.dtype.kind in "OUS":
        unknown = ""
    return np.append(column, np.array([unknown], column.dtype))
