"""What a person does to the tracks that are selected: cut, join, link anew, delete, move."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from qtpy.QtCore import QObject, Signal

from ...errors import Unwrap3DError
from ...motion.movie import Movie
from ...tracking.edits import TrackEdits
from ...tracking.laying import place_of, position_of
from ..common.threads import Task, tell
from ..protrusions.look import look_towards

if TYPE_CHECKING:
    from .session import TracksSession

IN_SPACE = "surface"
# In the place of a track, for a point that is of none yet.
NEW = 0
CLOSE_SECONDS = 5.0


class TrackEditing(QObject):
    """Edits of the tracks that are selected, at the timepoint that is shown.

    Parameters
    ----------
    session : TracksSession

    Signals
    -------
    working(bool)
        A point is being laid on the surface, in a thread, or that is over.
    """

    working = Signal(bool)

    def __init__(self, session: TracksSession) -> None:
        super().__init__(session)
        self._session = session
        self._task: Task | None = None

    @property
    def busy(self) -> bool:
        """Whether a point is being laid on the surface."""
        return self._task is not None

    # What can be done -------------------------------------------------------------

    def can(self, what: str) -> bool:
        """Whether "cut", "join", "relink", "delete", "undo", "redo" or "show" is possible now."""
        edits, chosen = self._session.edits, self._session.selection
        if edits is None or self.busy:
            return False
        if what == "undo":
            return edits.can_undo
        if what == "redo":
            return edits.can_redo
        if what == "cut":
            return any(self._is_cut(edits, track) for track in chosen)
        if what in ("join", "relink"):
            return len(chosen) == 2
        return bool(chosen)

    def _is_cut(self, edits: TrackEdits, track: int) -> bool:
        tracks = edits.tracks
        times = tracks.timepoint[tracks.rows_of(track)]
        return bool(times[0] < self._session.timepoint <= times[-1])

    # What is done -----------------------------------------------------------------

    def do(self, what: str) -> None:
        """Do what :meth:`can` names; what cannot be is told."""
        if self._session.edits is not None and self.can(what):
            getattr(self, what)()

    def cut(self) -> None:
        """Cut the selected tracks at the timepoint: what follows is tracks of their own."""

        def cut(edits: TrackEdits) -> list[int]:
            chosen = [t for t in sorted(self._session.selection) if self._is_cut(edits, t)]
            made = [edits.cut(track, self._session.timepoint) for track in chosen]
            return [*self._session.selection, *made]

        self._edit(cut)

    def join(self) -> None:
        """Make the two selected tracks one."""
        one, other = sorted(self._session.selection)
        self._edit(lambda edits: [edits.join(one, other)])

    def relink(self) -> None:
        """From the timepoint on, each of the two selected tracks goes on as the other one did."""
        edits, now = self._session.edits, self._session.timepoint
        assert edits is not None
        tracks = edits.tracks
        # The one that is there before goes first, as it must.
        one, other = sorted(
            self._session.selection,
            key=lambda track: (int(tracks.timepoint[tracks.rows_of(track)][0]) >= now, track),
        )

        def relink(edits: TrackEdits) -> list[int]:
            edits.relink(one, other, now)
            return [one, other]

        self._edit(relink)

    def delete(self) -> None:
        """Leave the selected tracks out."""
        chosen = sorted(self._session.selection)

        def delete(edits: TrackEdits) -> list[int]:
            edits.delete(chosen)
            return []

        self._edit(delete)

    def show(self) -> None:
        """Go to where and when the first selected track is there, and turn the cell to it."""
        session = self._session
        tracks, viewer = session.shown, session.viewer
        if tracks is None or viewer is None:
            return
        rows = tracks.rows_of(min(session.selection))
        times = tracks.timepoint[rows]
        nearest = int(np.argmin(np.abs(times - session.timepoint)))
        session.movies.set_timepoint(int(times[nearest]))
        look_towards(viewer, tracks.position_um[rows][nearest])

    def undo(self) -> None:
        """Take back the last edit."""
        if self._session.edits is not None:
            self._session.edits.undo()

    def redo(self) -> None:
        """Do again what was taken back last."""
        if self._session.edits is not None:
            self._session.edits.redo()

    def _edit(self, edit: Callable[[TrackEdits], list[int]]) -> None:
        """One step of the history; then select what came of it."""
        edits = self._session.edits
        if edits is None:
            return
        try:
            with edits.stroke():
                chosen = edit(edits)
        except Unwrap3DError as error:
            tell(error)
            return
        self._session.select(chosen)

    # Heads that were dragged ------------------------------------------------------

    def heads_changed(self, chart: str, moved: Mapping[int, Any], gone: list[int]) -> None:
        """A person dragged heads on a chart, or deleted some, at the timepoint that is shown.

        A head of :data:`NEW` was added: to the track that is selected, if that is a single one
        that is not there yet, or as the first point of another.

        Where the movie is known, what was dragged is laid on its surface, in a thread.
        """
        session, now = self._session, self._session.timepoint
        edits = session.edits
        if edits is None or self.busy or not (moved or gone):
            session.shown_changed.emit()
            return
        if gone:
            self._edit(lambda edits: self._remove(edits, gone, now))
        if not moved:
            return
        if session.movie is None:
            key = "position_um" if chart == IN_SPACE else "place_px"
            self._edit(
                lambda edits: self._move(edits, now, {t: {key: p} for t, p in moved.items()})
            )
            return
        self._task = Task(_laid, session.movie, edits, now, chart, dict(moved))
        self._task.returned.connect(self._on_laid)
        self._task.failed.connect(self._on_failed)
        self.working.emit(True)
        self._task.start()

    def _on_laid(self, result: tuple[TrackEdits, int, dict[int, dict[str, Any]]]) -> None:
        self._end()
        edits, timepoint, places = result
        if edits is self._session.edits:
            self._edit(lambda edits: self._move(edits, timepoint, places))

    def _on_failed(self, error: BaseException) -> None:
        self._end()
        tell(error)
        # What was dragged goes back to where it is.
        self._session.shown_changed.emit()

    def _end(self) -> None:
        self._task = None
        self.working.emit(False)

    def _move(
        self, edits: TrackEdits, timepoint: int, places: Mapping[int, Mapping[str, Any]]
    ) -> list[int]:
        chosen = []
        for track, place in places.items():
            if track == NEW:
                own = self._to_continue(edits, timepoint)
                chosen.append(edits.add(timepoint, track=own, **place))
            else:
                edits.move(track, timepoint, **place)
                chosen.append(track)
        return chosen

    def _to_continue(self, edits: TrackEdits, timepoint: int) -> int | None:
        """The single track that is selected and not there at a timepoint."""
        tracks, chosen = edits.tracks, list(self._session.selection)
        if len(chosen) != 1:
            return None
        there = tracks.timepoint[tracks.rows_of(chosen[0])]
        return None if timepoint in there else chosen[0]

    def _remove(self, edits: TrackEdits, gone: list[int], timepoint: int) -> list[int]:
        for track in gone:
            edits.remove(track, timepoint)
        return list(self._session.selection)

    def close(self) -> None:
        """Leave no thread."""
        if self._task is not None:
            self._task.wait(CLOSE_SECONDS)


def _laid(
    movie: Movie, edits: TrackEdits, timepoint: int, chart: str, moved: dict[int, Any]
) -> tuple[TrackEdits, int, dict[int, dict[str, Any]]]:
    """Both places of what was dragged on one chart; runs in a thread.

    What was dragged in space moves to the nearest place of the surface: it was dragged in a
    plane that faces the viewer.
    """
    points = np.array(list(moved.values()), np.float64)
    place = place_of(movie, timepoint, points)[0] if chart == IN_SPACE else points
    position = position_of(movie, timepoint, place)
    found = {
        track: {"position_um": position[i], "place_px": place[i]} for i, track in enumerate(moved)
    }
    return edits, timepoint, found
