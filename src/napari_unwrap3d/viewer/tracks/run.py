"""What tracks and measures the movie of one viewer, in a thread: one piece of work at a time.

Widgets read everything here and listen to the signals; they hold no state of their own.
Parameters are those of the viewer's :class:`~..session.Session`, tracks those of its
:class:`~.session.TracksSession`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

from qtpy.QtCore import QObject, Signal

from ...charts import Surface, Tracks
from ...errors import Cancelled, Unwrap3DError
from ...geometry.apart import apart
from ...parameters import Parameters
from ...progress import Progress
from ..common.per_viewer import OfViewer, PerViewer
from ..common.threads import ProgressTask, quiet_collector, tell
from ..movies.run import movie_run_of
from ..movies.session import movie_session_of
from ..session import session_of
from .flow_layers import show_flow
from .session import tracks_session_of

if TYPE_CHECKING:
    from ...measuring.measurements import Measurements
    from ...motion.movie import Movie

Work = Literal["protrusions", "flow", "measure"]
WORKS: tuple[Work, ...] = ("protrusions", "flow", "measure")
# Groups of parameters that a piece of work depends on.
GROUPS: dict[Work, tuple[str, ...]] = {
    "protrusions": ("protrusions", "topographic", "refinement", "tracking", "boxes"),
    "flow": ("flow",),
    "measure": ("measurement",),
}
CLOSE_SECONDS = 5.0
REPORT_SECONDS = 0.05
NO_MOVIE = "Open a movie, or unwrap a timelapse on the page Movie."
NO_TRACKS = "Track protrusions or regions first, or import tracks."
BUSY_MOVIE = "The movie is being made. Wait for it, or cancel it."
CANCELLED = "Cancelled; the tracks are as they were."


class TrackRun(OfViewer):
    """What tracks and measures the movie of one viewer. Get it with :func:`track_run_of`.

    Attributes
    ----------
    busy_with : str
        The piece of work that is going on: "protrusions", "flow", "measure", or in words what is
        read or written; empty if nothing is.
    failure : (str, str) or None
        The piece of work that failed last, and why.

    Signals
    -------
    progressed(str, float, str)
        Piece of work, fraction 0..1, and message.
    state_changed()
        Something began or ended, or belongs to other parameters now.
    told(str)
        What the user should know; empty: nothing.
    """

    progressed = Signal(str, float, str)
    state_changed = Signal()
    told = Signal(str)

    def __init__(self, viewer: Any, parent: QObject | None = None) -> None:
        super().__init__(viewer, parent)
        self.session = session_of(viewer)
        self.movies = movie_session_of(viewer)
        self.tracks = tracks_session_of(viewer)
        self.busy_with = ""
        self.failure: tuple[str, str] | None = None
        self._task: ProgressTask | None = None
        self._made: dict[str, dict[str, Any]] = {}  # by piece of work: the parameters it was of
        self._measured: Tracks | None = None
        self._closed = False
        self.session.parameters_changed.connect(self._on_state)
        self.movies.movie_changed.connect(self._on_movie)
        self.tracks.shown_changed.connect(self._on_state)
        movie_run_of(viewer).running_changed.connect(self._on_state)

    @property
    def movie(self) -> Movie | None:
        """Whose tracks these are."""
        return self.movies.movie

    @property
    def parameters(self) -> Parameters:
        """As they are set, with the label of a timelapse of labels."""
        viewer = self._viewer()
        return self.session.parameters if viewer is None else movie_run_of(viewer).parameters

    # What can be done ---------------------------------------------------------------

    def blocked(self, work: str = "") -> str:
        """Why a piece of work cannot begin, in words for the user; empty if it can."""
        if self.movie is None:
            return NO_MOVIE
        viewer = self._viewer()
        if viewer is not None and movie_run_of(viewer).running:
            return BUSY_MOVIE
        if work == "measure" and self.tracks.tracks is None:
            return NO_TRACKS
        return ""

    def is_done(self, work: Work) -> bool:
        """Whether there is a result, of these parameters or others."""
        if work == "measure":
            return self.tracks.measurements is not None
        return self.movie is not None and work in self.movie.track_names

    def is_stale(self, work: Work) -> bool:
        """Whether the result belongs to other parameters, or to other tracks."""
        if not self.is_done(work):
            return False
        made = self._made.get(work)
        if work == "measure" and self._measured is not self.tracks.shown:
            return True
        return made is not None and made != self._chosen(work)

    def _chosen(self, work: Work) -> dict[str, Any]:
        return self.parameters.model_dump(include=set(GROUPS[work]))

    def _on_state(self, _: Any = None) -> None:
        if not self._closed:
            self.state_changed.emit()

    def _on_movie(self, _: Any = None) -> None:
        self.cancel()
        self._made, self._measured, self.failure = {}, None, None
        self._on_state()

    # Tracking and measuring ---------------------------------------------------------

    def run(self, work: Work) -> None:
        """Track or measure with the parameters as they are set.

        Raises
        ------
        Unwrap3DError
            There is no movie, or nothing to measure; or something is going on.
        """
        movie, tracks, reason = self.movie, self.tracks.shown, self.blocked(work)
        if movie is None or reason:
            raise Unwrap3DError("There is nothing to run on.", hint=reason)
        edited = self.tracks.tracks if self.tracks.name == work else None
        function = partial(_worked, work, movie, tracks, edited, self.parameters)
        chosen = self._chosen(work)
        self._begin(work, function, partial(self._on_worked, work, chosen, tracks))

    def _on_worked(
        self, work: Work, chosen: dict[str, Any], of: Tracks | None, result: Any
    ) -> None:
        self._made[work] = chosen
        if work == "measure":
            self._measured = of
            self.tracks.set_measurements(result)
            count = len(result.tracks.ids)
            self.told.emit(f"Measured {counted(count, 'track')}.")
        else:
            self.tracks.set_tracks(work, result)
            self.tracks.look_for_tracks()
            self.told.emit(f"Found {counted(len(result.ids), 'track')}.")

    def show_fields(self) -> None:
        """Show the flow of a field over the movie on the common surface.

        Raises
        ------
        Unwrap3DError
            There is no movie; or something is going on.
        """
        movie, reason = self.movie, self.blocked("flow")
        if movie is None or reason:
            raise Unwrap3DError("There is nothing to show.", hint=reason)
        self._begin("fields of the flow", partial(_flow, movie, self.parameters), self._on_flow)

    def _on_flow(self, surface: Surface) -> None:
        viewer = self._viewer()
        if viewer is not None:
            show_flow(viewer, surface)
            self.told.emit("The flow is shown as layers: speed, direction, divergence.")

    def cancel(self) -> None:
        """Stop what is going on; returns at once."""
        if self._task is not None:
            self._task.cancel()

    # Any work in a thread -----------------------------------------------------------

    def begin(
        self, what: str, work: Callable[[Progress], Any], done: Callable[[Any], None]
    ) -> None:
        """Do something else in the thread, such as reading or writing a file.

        Parameters
        ----------
        what : str
            Said while it goes on.
        work : callable(Progress)
            Called in the thread.
        done : callable
            Called in the window's with what `work` returned.

        Raises
        ------
        Unwrap3DError
            Something is going on.
        """
        self._begin(what, work, done)

    def _begin(
        self, what: str, work: Callable[[Progress], Any], done: Callable[[Any], None]
    ) -> None:
        if self.busy_with:
            raise Unwrap3DError("Something is going on.", hint="Wait for it, or cancel it.")
        self.busy_with, self.failure = what, None
        self._task = ProgressTask(work, _Reporter(what, self.progressed.emit))
        self._task.returned.connect(partial(self._on_returned, self.movie, done))
        self._task.failed.connect(self._on_failed)
        quiet_collector.hold(self)
        self._task.start()
        self.told.emit("")
        self.state_changed.emit()

    def _end(self) -> None:
        self.busy_with, self._task = "", None
        quiet_collector.release(self)

    def _on_returned(self, of: Movie | None, done: Callable[[Any], None], result: Any) -> None:
        self._end()
        if not self._closed and of is self.movie:
            done(result)
        self._on_state()

    def _on_failed(self, error: BaseException) -> None:
        what = self.busy_with
        self._end()
        if self._closed:
            return
        if isinstance(error, Cancelled):
            self.told.emit(CANCELLED)
        else:
            self.failure = (what, str(error))
            self.told.emit(str(error))
            tell(error)
        self._on_state()

    # The end ------------------------------------------------------------------------

    def close(self) -> None:
        """Cancel, and wait for the thread."""
        if self._closed:
            return
        self._closed = True
        self.cancel()
        if self._task is not None:
            self._task.wait(CLOSE_SECONDS)
        quiet_collector.release(self)


class _Reporter:
    """Hands progress on, at most twenty times a second; called in the thread."""

    def __init__(self, what: str, emit: Callable[[str, float, str], object]) -> None:
        self._what, self._emit = what, emit
        self._last = 0.0

    def __call__(self, _: str, fraction: float, message: str) -> None:
        now = time.monotonic()
        if now - self._last >= REPORT_SECONDS:
            self._last = now
            self._emit(self._what, fraction, message)


def _worked(
    work: Work,
    movie: Movie,
    tracks: Tracks | None,
    edited: Tracks | None,
    parameters: Parameters,
    progress: Progress,
) -> Tracks | Measurements:
    """In a thread; what it needs takes long to import."""
    with apart():
        if work != "measure":
            _set_aside(movie, work, edited)
        if work == "measure":
            from ...measuring.analysis import measure_tracks

            return measure_tracks(movie, tracks, parameters, progress)
        if work == "flow":
            from ...tracking.regions import track_flow

            return track_flow(movie, parameters, progress)
        from ...tracking.objects import track_protrusions

        return track_protrusions(movie, parameters, progress)


def _flow(movie: Movie, parameters: Parameters, progress: Progress) -> Surface:
    with apart():
        from ...tracking.flow_fields import flow_surface

        return flow_surface(movie, parameters, progress)


def _set_aside(movie: Movie, name: str, shown: Tracks | None) -> None:
    """Tracks that a person edited are not lost when they are made anew: they get another name."""
    from ...tracking.relations import EDITED

    names = movie.track_names
    before = movie.tracks(name) if shown is None and name in names else shown
    if before is not None and before.method == EDITED:
        movie.keep_tracks(free_name(f"{name} edited", names), before)


def free_name(stem: str, taken: Collection[str]) -> str:
    """A name that no tracks of the movie have."""
    name, number = stem, 2
    while name in taken:
        name, number = f"{stem} {number}", number + 1
    return name


def counted(count: int, noun: str) -> str:
    """One track, or several tracks."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def run_or_tell(run: TrackRun, work: Work) -> None:
    """Run; what is wrong is shown as a notification."""
    try:
        run.run(work)
    except Unwrap3DError as error:
        run.told.emit(str(error))
        tell(error)


_RUNS: PerViewer[TrackRun] = PerViewer(TrackRun, lambda viewer, run: None)


def track_run_of(viewer: Any) -> TrackRun:
    """What tracks the movie of a viewer (or of napari's proxy of it); made when first asked for."""
    return _RUNS.of(viewer)
