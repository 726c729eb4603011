"""The tracks of one viewer: which are shown and selected, in which colours, and who has to know."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from qtpy.QtCore import QObject, Signal

from ...charts import Tracks
from ...motion.movie import Movie
from ...tracking.edits import TrackEdits
from ..annotations.colours import Colour
from ..common.per_viewer import OfViewer, PerViewer
from ..common.threads import Task, tell
from ..common.turns import soon
from ..movies.session import movie_session_of
from ..movies.time_axis import time_scale
from .colours import COLORMAP, UNKNOWN, TrackColours, colour_columns
from .editing import TrackEditing

if TYPE_CHECKING:
    from napari.components import ViewerModel

    from ...measuring.measurements import Measurements

FIRST = "protrusions"
# Edits that rest this long are written into the movie's folder.
REST_MS = 500
CLOSE_SECONDS = 5.0


class TracksSession(OfViewer):
    """What one viewer knows about tracks. Get it with :func:`tracks_session_of`.

    It follows the movie of the viewer: the tracks that were kept with a movie are shown with it.

    Attributes
    ----------
    movie : Movie or None
        That the tracks are of.
    name : str
        Of the tracks that are shown; empty without any.
    names : tuple of str
        Of all that were kept with the movie.
    tracks : Tracks or None
        All of them.
    shown : Tracks or None
        Those that the gate lets through.
    gate : frozenset of int, or None
        The tracks that may be shown; None for all.
    selection : frozenset of int
        Tracks; always some of those that are shown.
    column : str
        What colours them, of ``tracks.columns`` or ``tracks.track_table``; empty for a colour
        each.
    colormap : str
        Of napari, for that column.
    ids : bool
        Whether the numbers of all tracks are written beside them, or only of those selected.
    edits : TrackEdits or None
    editing : TrackEditing
        What is done to the tracks that are selected.
    measurements : Measurements or None
        Of `shown`; None until they are made, and again when the tracks change.

    Signals
    -------
    tracks_changed()
        Other tracks, or the same were edited. `shown_changed` follows.
    shown_changed()
        What is shown: other tracks, edited, or another gate.
    selection_changed()
    colouring_changed()
        `column`, `colormap` or `ids`.
    measured()
        `measurements`.
    names_changed()
        Tracks were kept with the movie, or it is another one.
    """

    tracks_changed = Signal()
    shown_changed = Signal()
    selection_changed = Signal()
    colouring_changed = Signal()
    measured = Signal()
    names_changed = Signal()

    def __init__(self, viewer: ViewerModel, parent: QObject | None = None) -> None:
        super().__init__(viewer, parent)
        self.movie: Movie | None = None
        self.name = ""
        self.names: tuple[str, ...] = ()
        self.tracks: Tracks | None = None
        self.shown: Tracks | None = None
        self.gate: frozenset[int] | None = None
        self.selection: frozenset[int] = frozenset()
        self.column, self.colormap = "", COLORMAP
        self._ids = False
        self.edits: TrackEdits | None = None
        self.measurements: Measurements | None = None
        self._colours: TrackColours | None = None
        self._of_tracks: dict[int, Colour] | None = None
        self._reading: Task | None = None
        self._keeping: Task | None = None
        self._keep_timer = soon(self, self._keep, REST_MS)
        self.editing = TrackEditing(self)
        self.movies = movie_session_of(viewer)
        self.movies.movie_changed.connect(self._on_movie)
        if self.movies.movie is not None:
            self._on_movie(self.movies.movie)

    @property
    def timepoint(self) -> int:
        """That is shown: of the movie, or without one of napari's own slider."""
        viewer = self._viewer()
        if self.movies.movie is not None or viewer is None or self.tracks is None:
            return self.movies.timepoint
        scale = time_scale(viewer, self.tracks.timepoints)
        return 0 if scale is None else scale.timepoint(viewer)

    # The tracks -----------------------------------------------------------------

    def set_tracks(self, name: str, tracks: Tracks | None) -> None:
        """Show other tracks, all of them; None shows none."""
        self._finish_keeping()
        self.name = name if tracks is not None else ""
        self._begin_edits(tracks)
        self.gate = None
        self._take(tracks)

    def _begin_edits(self, tracks: Tracks | None) -> None:
        if self.edits is not None:
            self.edits.changed.disconnect(self._on_edited)
            self.edits = None
        if tracks is not None:
            self.edits = TrackEdits(tracks, self.movie)
            self.edits.changed.connect(self._on_edited)

    def _on_edited(self, _: frozenset[int]) -> None:
        """Show what an edit made; a track that it made is shown whatever the gate."""
        assert self.edits is not None
        tracks = self.edits.tracks
        if self.gate is not None and self.tracks is not None:
            self.gate |= frozenset(tracks.ids.tolist()) - frozenset(self.tracks.ids.tolist())
        self._take(tracks)
        self._keep_timer.start()

    def _take(self, tracks: Tracks | None) -> None:
        """These are the tracks now."""
        self.tracks, self.measurements = tracks, None
        if tracks is not None and self.column not in ("", *colour_columns(tracks)):
            self.column = ""
        fewer = self._show()
        self.tracks_changed.emit()
        self._tell_shown(fewer)
        self.measured.emit()

    def _show(self) -> bool:
        """Apply the gate; whether some of what was selected is not there any more."""
        tracks, gate = self.tracks, self.gate
        if tracks is None or gate is None or gate.issuperset(tracks.ids.tolist()):
            self.shown = tracks
        else:
            self.shown = tracks.kept(gate)
        self._colours = self._of_tracks = None
        before, self.selection = self.selection, self.selection & self._there()
        return self.selection != before

    def _tell_shown(self, fewer: bool) -> None:
        self.shown_changed.emit()
        if fewer:
            self.selection_changed.emit()

    def _there(self) -> frozenset[int]:
        return frozenset() if self.shown is None else frozenset(self.shown.ids.tolist())

    def set_gate(self, ids: Iterable[int] | None) -> None:
        """Show only these tracks; None shows all."""
        gate = None if ids is None else frozenset(int(track) for track in ids)
        if gate != self.gate:
            self.gate = gate
            self._tell_shown(self._show())

    def set_measurements(self, measurements: Measurements | None) -> None:
        """These were measured of what is shown."""
        self.measurements = measurements
        self.measured.emit()

    # The selection --------------------------------------------------------------

    def select(self, ids: Iterable[int]) -> None:
        """Select these tracks, of those that are shown, and no others."""
        chosen = frozenset(int(track) for track in ids) & self._there()
        if chosen != self.selection:
            self.selection = chosen
            self.selection_changed.emit()

    def toggle(self, track: int) -> None:
        """Add a track to the selection, or take it away."""
        self.select(self.selection ^ {int(track)})

    # Colours --------------------------------------------------------------------

    def colour_by(self, column: str, colormap: str = "") -> None:
        """Colour every view by a column of ``tracks.columns`` or ``tracks.track_table``.

        An empty one gives each track its own colour; what is unknown does, too.
        """
        wanted = column if column in self.columns else "", colormap or self.colormap
        if wanted != (self.column, self.colormap):
            self.column, self.colormap = wanted
            self._colours = self._of_tracks = None
            self.colouring_changed.emit()

    @property
    def ids(self) -> bool:
        """Whether the numbers of all tracks are written beside them."""
        return self._ids

    @ids.setter
    def ids(self, wanted: bool) -> None:
        if wanted != self._ids:
            self._ids = wanted
            self.colouring_changed.emit()

    @property
    def columns(self) -> tuple[str, ...]:
        """What the tracks can be coloured by."""
        return () if self.tracks is None else colour_columns(self.tracks)

    @property
    def colours(self) -> TrackColours | None:
        """Of the rows of `shown`."""
        if self._colours is None and self.shown is not None:
            self._colours = TrackColours(self.shown, self.column, self.colormap)
        return self._colours

    def colour(self, track: int) -> Colour:
        """Of a track, as strong as if it were selected: for tables and plots."""
        if self._of_tracks is None:
            self._of_tracks = {} if self.colours is None else self.colours.of_tracks()
        return self._of_tracks.get(track, UNKNOWN)

    # The movie ------------------------------------------------------------------

    def _on_movie(self, movie: Movie | None) -> None:
        self._finish_keeping()
        self.movie, self._reading = movie, None
        if movie is not None or self.name:
            self.set_tracks("", None)
        self.look_for_tracks(show=True)

    def look_for_tracks(self, *, show: bool = False) -> None:
        """Find out, in a thread, which tracks were kept with the movie.

        Parameters
        ----------
        show : bool
            Show the first of them, "protrusions" before all others.
        """
        if self.movie is None:
            self._set_names(())
        else:
            self._read("", show)

    def open(self, name: str) -> None:
        """Show tracks that were kept with the movie; they are read in a thread."""
        if self.movie is not None:
            self._read(name, True)

    def _read(self, name: str, show: bool) -> None:
        self._reading = Task(_read, self.movie, name, show)
        self._reading.returned.connect(self._on_read)
        self._reading.failed.connect(tell)
        self._reading.start()

    def _on_read(self, found: tuple[Movie, tuple[str, ...], str, Tracks | None]) -> None:
        movie, names, name, tracks = found
        if movie is self.movie:
            self._reading = None
            self._set_names(names)
            if tracks is not None:
                self.set_tracks(name, tracks)

    def _set_names(self, names: tuple[str, ...]) -> None:
        if names != self.names:
            self.names = names
            self.names_changed.emit()

    # Keeping edits --------------------------------------------------------------

    def _keep(self) -> None:
        """Write the tracks into the movie's folder, in a thread."""
        if self._keeping is not None:
            self._keep_timer.start()
            return
        if self.movie is None or self.tracks is None:
            return
        self._keeping = Task(self.movie.keep_tracks, self.name, self.tracks)
        self._keeping.returned.connect(self._on_kept)
        self._keeping.failed.connect(self._on_not_kept)
        self._keeping.start()

    def _on_kept(self, _: Any = None) -> None:
        self._keeping = None
        self.look_for_tracks()

    def _on_not_kept(self, error: BaseException) -> None:
        self._keeping = None
        tell(error)

    def _finish_keeping(self) -> None:
        """Write at once what still waits to be written."""
        if self._keep_timer.isActive():
            self._keep_timer.stop()
            if self._keeping is not None:
                self._keeping.wait(CLOSE_SECONDS)
                self._keeping = None
            self._keep()

    # The end --------------------------------------------------------------------

    def close(self) -> None:
        """Leave no thread, and nothing unwritten."""
        self.editing.close()
        self._finish_keeping()
        for task in (self._keeping, self._reading):
            if task is not None:
                task.wait(CLOSE_SECONDS)
        self._keeping = self._reading = None


def _read(movie: Movie, name: str, show: bool) -> tuple[Movie, tuple[str, ...], str, Tracks | None]:
    """The names of all tracks of a movie, and one of them; runs in a thread."""
    names = movie.track_names
    if not name and names:
        name = FIRST if FIRST in names else names[0]
    return movie, names, name, movie.tracks(name) if show and name else None


def _begin(viewer: Any, session: TracksSession) -> None:
    from .layers import TrackLayers
    from .picking import TrackPicking

    TrackPicking(viewer, session, TrackLayers(viewer, session))


_SESSIONS: PerViewer[TracksSession] = PerViewer(TracksSession, _begin)


def open_tracks_session(viewer: Any) -> TracksSession | None:
    """The tracks of a viewer, if anyone asked for them before."""
    return _SESSIONS.known(viewer)


def tracks_session_of(viewer: Any) -> TracksSession:
    """The tracks of a viewer (or of napari's proxy of it); made when they are first asked for."""
    return _SESSIONS.of(viewer)
