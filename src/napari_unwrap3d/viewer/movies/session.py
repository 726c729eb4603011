"""The movie of one viewer: which it is, which timepoint is shown, and who has to know."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from qtpy.QtCore import QObject, QTimer, Signal

from ...charts import Frame
from ...motion.movie import Movie
from ...motion.shown_frames import ShownFrame
from ..common.per_viewer import OfViewer, PerViewer
from ..common.threads import Task, tell
from .frame_reader import FrameReader

if TYPE_CHECKING:
    from napari.components import ViewerModel

# So far on is the next timepoint of a scrub; farther is a jump.
NEXT = 2
FPS = 8.0
LOWEST_FPS, HIGHEST_FPS = 1.0, 30.0


class MovieSession(OfViewer):
    """What one viewer knows about its movie. Get it with :func:`movie_session_of`.

    The common space is the cell of the viewer's :class:`~.session.Session`; the movie adds what
    changes in time. Frames are read in a thread: `timepoint` and `frame` are those that are
    shown, which follow :meth:`set_timepoint` when the frame is there.

    Attributes
    ----------
    movie : Movie or None
    timepoint : int
        That is shown.
    frame : Frame or None
        Of it.
    shown : ShownFrame or None
        The frame with what views need of it.
    made : frozenset of int
        The timepoints whose frames were made.
    fps : float
        Of the playback.
    loop : bool
        Whether the playback begins again at the end.

    Signals
    -------
    movie_changed(object)
        Another movie, or None.
    frame_changed(object)
        Another timepoint is shown; the :class:`Frame` of it.
    wanted_changed(int)
        A timepoint was asked for, whose frame may still have to be read.
    made_changed()
        Frames were made, see :meth:`look_for_frames`.
    playing_changed(bool)
    playback_changed()
        `fps` or `loop`.
    """

    movie_changed = Signal(object)
    frame_changed = Signal(object)
    wanted_changed = Signal(int)
    made_changed = Signal()
    playing_changed = Signal(bool)
    playback_changed = Signal()

    def __init__(self, viewer: ViewerModel, parent: QObject | None = None) -> None:
        super().__init__(viewer, parent)
        self.movie: Movie | None = None
        self.timepoint = self.wanted = 0
        self.frame: Frame | None = None
        self.shown: ShownFrame | None = None
        self.made: frozenset[int] = frozenset()
        self._loop = True
        self._reader: FrameReader | None = None
        self._looking: Task | None = None
        self._look_again = False
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._on_tick)
        self._timer.setInterval(round(1000.0 / FPS))

    def set_movie(self, movie: Movie | None) -> None:
        """Show another movie from its first timepoint on."""
        self.pause()
        self._leave()
        self.movie = movie
        self.made = frozenset()
        self.timepoint = self.wanted = 0
        if movie is not None:
            self._reader = FrameReader(movie, self)
            self._reader.ready.connect(self._on_ready)
            self._reader.failed.connect(self._on_failed)
        self.movie_changed.emit(movie)
        if movie is not None:
            self.look_for_frames()
            self.set_timepoint(0)

    def _leave(self) -> None:
        if self._reader is not None:
            self._reader.close()
            self._reader.deleteLater()
            self._reader = None
        self.frame = self.shown = None

    # The timepoint --------------------------------------------------------------

    def set_timepoint(self, timepoint: int) -> None:
        """Show a timepoint as soon as its frame is read; one that was not made is passed over.

        Of several that are asked for in a row only the last is read.
        """
        if self.movie is None or self._reader is None or not 0 <= timepoint < len(self.movie):
            return
        moved, self.wanted = timepoint - self.wanted, timepoint
        # Who jumps goes on from there anywhere.
        self._reader.want(timepoint, int(np.sign(moved)) if abs(moved) <= NEXT else 0)
        self.wanted_changed.emit(timepoint)

    def step(self, by: int) -> None:
        """Go on by some timepoints, and stop at the first and the last."""
        if self.movie is not None:
            self.set_timepoint(min(max(self.wanted + by, 0), len(self.movie) - 1))

    def _on_ready(self, shown: ShownFrame) -> None:
        self.shown, self.frame = shown, shown.frame
        self.timepoint = shown.frame.timepoint
        if self.timepoint not in self.made:
            self.made |= {self.timepoint}
            self.made_changed.emit()
        self.frame_changed.emit(self.frame)

    def _on_failed(self, error: BaseException) -> None:
        self.pause()
        tell(error)

    # Frames that were made ------------------------------------------------------

    def look_for_frames(self) -> None:
        """Find out, in a thread, which frames there are; call it when some were made."""
        if self.movie is None:
            return
        if self._looking is not None:
            self._look_again = True
            return
        self._look_again = False
        self._looking = Task(_made, self.movie)
        self._looking.returned.connect(self._on_looked)
        self._looking.failed.connect(partial(self._on_looked, None))
        self._looking.start()

    def frames_made_anew(self) -> None:
        """Frames that may have been read were made anew, with other parameters."""
        if self._reader is not None:
            self._reader.forget()
            self.look_for_frames()
            self.set_timepoint(self.wanted)

    def _on_looked(self, found: tuple[Movie, frozenset[int]] | None, *_: Any) -> None:
        self._looking = None
        if found is None or found[0] is not self.movie or self._look_again:
            self.look_for_frames() if found is not None else None
            return
        self.made = found[1]
        if self._reader is not None:
            self._reader.look_again()
        self.made_changed.emit()

    # Playback -------------------------------------------------------------------

    @property
    def fps(self) -> float:
        """Timepoints a second while playing."""
        return 1000.0 / self._timer.interval()

    @fps.setter
    def fps(self, value: float) -> None:
        value = min(max(float(value), LOWEST_FPS), HIGHEST_FPS)
        self._timer.setInterval(round(1000.0 / value))
        self.playback_changed.emit()

    @property
    def loop(self) -> bool:
        """Whether the playback begins again at the end."""
        return self._loop

    @loop.setter
    def loop(self, wanted: bool) -> None:
        self._loop = wanted
        self.playback_changed.emit()

    @property
    def playing(self) -> bool:
        return self._timer.isActive()

    def play(self) -> None:
        """Show one timepoint after the other."""
        if self.movie is None or self.playing:
            return
        if self.wanted == len(self.movie) - 1:
            self.set_timepoint(0)
        self._timer.start()
        self.playing_changed.emit(True)

    def pause(self) -> None:
        """Stay at the timepoint that is shown."""
        if self.playing:
            self._timer.stop()
            self.playing_changed.emit(False)

    def toggle(self) -> None:
        """Play, or pause."""
        (self.pause if self.playing else self.play)()

    def _on_tick(self) -> None:
        """The next frame, unless the last one is still being read."""
        if self.movie is None or self._reader is None or self._reader.busy_with_wanted:
            return
        following = self._following()
        if following is None:
            self.pause()
        else:
            self.set_timepoint(following)

    def _following(self) -> int | None:
        """The next timepoint with a frame; None at the end."""
        assert self.movie is not None
        later = sorted(t for t in self.made if t > self.wanted)
        if later:
            return later[0]
        first = min(self.made, default=None)
        return first if self.loop and first != self.wanted else None

    # The end --------------------------------------------------------------------

    def close(self) -> None:
        """Let go of the movie."""
        self.pause()
        self._leave()
        self.movie = None


def _made(movie: Movie) -> tuple[Movie, frozenset[int]]:
    """Which frames a movie has; runs in a thread, because it looks into as many files."""
    return movie, frozenset(t for t in range(len(movie)) if movie.has_frame(t))


def _begin(viewer: Any, session: MovieSession) -> None:
    from .views import MovieViews

    MovieViews(viewer, session)


_SESSIONS: PerViewer[MovieSession] = PerViewer(MovieSession, _begin)


def movie_session_of(viewer: Any) -> MovieSession:
    """The movie session of a viewer (or of napari's proxy of it); made when first asked for."""
    return _SESSIONS.of(viewer)
