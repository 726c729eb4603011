"""The movie of one viewer while it is made: its source, the run in progress, what is done.

Widgets read everything here and listen to the signals; they hold no state of their own.
Parameters are those of the viewer's :class:`~.session.Session`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator
from functools import partial
from typing import Any

from qtpy.QtCore import QObject, Signal

from ...charts import Size3
from ...errors import Cancelled, Unwrap3DError
from ...files.movie import is_movie
from ...motion.movie import Movie
from ...motion.stages import MovieWork, Stage
from ...motion.state import DONE, STALE, MovieState, state_in
from ...motion.timelapse import Timelapse
from ...parameters import Parameters
from ...progress import Progress
from ..common.per_viewer import OfViewer, PerViewer
from ..common.threads import ProgressTask, quiet_collector, tell
from ..common.turns import soon
from ..session import session_of
from .chosen import ChosenTimelapse
from .computing import LOOKING, Failure, MovieComputation
from .folders import WorkingFolder
from .opened import OpenedMovie
from .session import movie_session_of
from .showing import showing_movie
from .tables import TableReader, Tables

CLOSE_SECONDS = 5.0
DEBOUNCE_MS = 300
STAGES: tuple[Stage, ...] = ("register", "segment", "common", "frame")

CANCELLED = "Cancelled. Run again to go on; what was made stays."


class MovieRun(OfViewer):
    """What makes the movie of one viewer. Get it with :func:`movie_run_of`.

    Attributes
    ----------
    chosen : ChosenTimelapse
        The layers of the timelapse.
    state : MovieState or None
        What of the movie is done, for the parameters as they are.
    failures : list of Failure
        Of the last run.
    movie : Movie or None
        That is shown; its common space is there.
    tables : Tables or None
        What is known of every timepoint.

    Signals
    -------
    source_changed()
        Other layers, another voxel size or time step; or what can be chosen.
    state_changed()
        Pieces were made, or belong to other parameters now.
    movie_changed()
        Another movie is shown, or another common space of it.
    progressed(str, int, float, str)
        Stage, timepoint, fraction 0..1 of that stage, and message.
    running_changed(bool)
    told(str)
        What the user should know; empty: nothing.
    tables_changed()
        `tables` were read.
    """

    source_changed = Signal()
    state_changed = Signal()
    movie_changed = Signal()
    progressed = Signal(str, int, float, str)
    running_changed = Signal(bool)
    told = Signal(str)
    tables_changed = Signal()

    def __init__(self, viewer: Any, parent: QObject | None = None) -> None:
        super().__init__(viewer, parent)
        self.session = session_of(viewer)
        self.state: MovieState | None = None
        self.failures: list[Failure] = []
        self.movie: Movie | None = None
        self.busy_with = ""  # opening or saving
        self._lapse: tuple[Timelapse, Size3] | None = None
        self._work: MovieWork | None = None
        self._working: WorkingFolder | None = None
        self._before: list[WorkingFolder] = []
        self._waiting: OpenedMovie | None = None  # for the end of a run of the session
        self._computation: MovieComputation | None = None
        self._ended: MovieComputation | None = None
        self._task: ProgressTask | None = None
        self._again = self._closed = False
        self._began: dict[str, float] = {}
        self.tables: Tables | None = None
        self._reader = TableReader(self)
        self._reader.read.connect(self._on_tables)
        self._rest = soon(self, self._look, DEBOUNCE_MS)
        self.session.parameters_changed.connect(self._on_parameters)
        self.session.running_changed.connect(self._on_session)
        self.chosen = ChosenTimelapse(viewer, self)
        self.chosen.changed.connect(self._on_source)
        self.chosen.listed.connect(self.source_changed)

    @property
    def parameters(self) -> Parameters:
        """The session's, with a label where the timelapse is of labels."""
        return self.chosen.labelled(self.session.parameters)

    def _on_source(self, another: bool) -> None:
        self._lapse = None
        if another:
            self._work, self.state, self.failures = None, None, []
        self.source_changed.emit()
        self.state_changed.emit()

    # Running ---------------------------------------------------------------------

    @property
    def running(self) -> bool:
        """Whether pieces are made; looking for what is there is not meant."""
        return self._computation is not None and bool(self._computation.until)

    @property
    def looking(self) -> bool:
        """Whether it is being found out, or will be, which pieces are there."""
        return self._rest.isActive() or (self._computation is not None and not self.running)

    def run(self, until: Stage = "frame", timepoints: Collection[int] | None = None) -> None:
        """Make what is missing or stale, up to a stage.

        Parameters
        ----------
        until : str
            "register", "segment", "common" or "frame".
        timepoints : collection of int, optional
            Whose frames are made; by default all.

        Raises
        ------
        Unwrap3DError
            There is no timelapse, or the layers cannot be one; or a run is in progress.
        """
        if self.running:
            raise Unwrap3DError("A run is in progress.", hint="Cancel it first.")
        if reason := self.chosen.blocked():
            raise Unwrap3DError("There is nothing to run on.", hint=reason)
        self._lapse = self.chosen.read()
        self._choose_folder(self._lapse[0])
        self._work = self._new_work({})
        self.failures = []
        self._again = False
        wanted = None if timepoints is None else frozenset(timepoints)
        self._start(self._work, until, wanted)

    def _choose_folder(self, lapse: Timelapse) -> None:
        """Another timelapse is made in another folder; the one before stays until the end."""
        working = self._working
        if working is not None and not working.is_of(lapse):
            self._before.append(working)
            self._working = None

    def _new_work(self, keys: dict[int, str]) -> MovieWork:
        assert self._lapse is not None
        if self._working is None:
            self._working = WorkingFolder()
        return MovieWork(self._lapse[0], self.parameters, self._working.folder, keys)

    def _start(
        self, work: MovieWork, until: Stage | str, timepoints: frozenset[int] | None = None
    ) -> None:
        origin = None if self._lapse is None else self._lapse[1]
        shown = ""
        if self.movie is not None and self.movie.folder == work.folder and self._is_shown():
            shown = str(self.movie.record.get("key", ""))
        computation = MovieComputation(work, until, timepoints, shown, origin)
        computation.looked.connect(self._on_looked)
        computation.progressed.connect(self._on_progress)
        computation.piece_ended.connect(self._on_piece)
        computation.space_ready.connect(self._on_space)
        computation.ended.connect(self._on_ended)
        self._computation = computation
        self._began = {}
        if until:
            quiet_collector.hold(self)
        computation.start()
        if until:
            self.running_changed.emit(True)

    def _is_shown(self) -> bool:
        """Whether the movie is in the views: another cell may have been unwrapped since."""
        viewer = self._viewer()
        return viewer is not None and movie_session_of(viewer).movie is self.movie

    def cancel(self) -> None:
        """Stop the run in progress; returns at once."""
        self._again = False
        if self._computation is not None:
            self._computation.cancel()
        if self._task is not None:
            self._task.cancel()

    # What parameters change ------------------------------------------------------

    def _on_parameters(self, _: Parameters) -> None:
        if self._work is not None:
            self._rest.start()

    def _look(self) -> None:
        """The parameters have come to rest: which pieces belong to others now?"""
        if self._closed or self._work is None or self._lapse is None:
            return
        if self._computation is not None:
            self._again = True
            return
        if self.state is not None and self.parameters == self._work.parameters:
            return
        self._work = self._new_work(self._work._keys)
        self._start(self._work, "")

    # What the thread sends -------------------------------------------------------

    def _on_looked(self, state: MovieState) -> None:
        self.state = state
        self.state_changed.emit()

    def _on_progress(self, stage: str, timepoint: int, fraction: float, message: str) -> None:
        if stage != LOOKING:
            self._began.setdefault(stage, time.monotonic())
        if self.running:
            self.progressed.emit(stage, timepoint, fraction, message)

    def seconds_left(self, stage: str, fraction: float) -> float | None:
        """How long a stage will still take; None where it is too early to say."""
        began = self._began.get(stage)
        if began is None or fraction < 0.02:
            return None
        return (time.monotonic() - began) * (1.0 - fraction) / fraction

    def _on_piece(self, stage: Stage, timepoint: int, failure: Failure | None) -> None:
        if failure is not None:
            self.failures.append(failure)
        elif self.state is not None:
            self.state.set(stage, timepoint, DONE)
            if stage == "common":
                self._age_frames()
        self.state_changed.emit()
        self._want_tables()
        if stage == "frame" and failure is None:
            viewer = self._viewer()
            if viewer is not None:
                movie_session_of(viewer).look_for_frames()

    def _want_tables(self) -> None:
        """Read what is known of the movie that is made, or shown."""
        movie = self.movie
        if self._work is not None and is_movie(self._work.folder.path):
            movie = Movie(self._work.folder, self._work)
        if movie is not None and not self._closed:
            self._reader.want(movie)

    def _on_tables(self, tables: Tables) -> None:
        self.tables = tables
        self.tables_changed.emit()

    def _age_frames(self) -> None:
        """Another common space: no frame is of it."""
        assert self.state is not None
        frames = self.state.pieces["frame"]
        frames[:] = [STALE if piece == DONE else piece for piece in frames]

    def _on_space(self, opened: OpenedMovie) -> None:
        if self._closed:
            return
        if self.session.running:
            # What it computes is of the cell that gives place.
            self._waiting = opened
            self.session.cancel_by_user()
        else:
            self.session.turns.add(self._showing(opened))

    def _on_session(self, running: bool) -> None:
        if not running and self._waiting is not None:
            opened, self._waiting = self._waiting, None
            self._on_space(opened)

    def _showing(self, opened: OpenedMovie) -> Iterator[None]:
        viewer = self._viewer()
        if viewer is None or self._closed:
            return
        chosen = self.session.parameters
        yield from showing_movie(viewer, opened)
        self._show(opened.movie)
        # What was changed while the space was made is not forgotten.
        self.session.set_parameters(chosen)

    def _show(self, movie: Movie) -> None:
        self.movie = movie
        self.movie_changed.emit()
        self._want_tables()

    def _on_ended(self, error: BaseException | None) -> None:
        ran, self._ended, self._computation = self.running, self._computation, None
        quiet_collector.release(self)
        if error is None:
            self._say_end(ran)
        elif isinstance(error, Cancelled):
            self.told.emit(CANCELLED if ran else "")
        else:
            self.told.emit(str(error))
            tell(error)
        if ran:
            self._renew_movie()
            self.running_changed.emit(False)
        self.state_changed.emit()
        if self._again or (self._work and self._work.parameters != self.parameters):
            self._again = False
            self._rest.start()

    def _say_end(self, ran: bool) -> None:
        if ran:
            failed = len({failure.timepoint for failure in self.failures})
            noun = "timepoint" if failed == 1 else "timepoints"
            self.told.emit(f"Done; {failed} {noun} failed." if failed else "Done.")

    def _renew_movie(self) -> None:
        """The frames of the work that ran are shown, where the common space stayed the same."""
        if self.movie is None or self._work is None or self._closed:
            return
        if self.movie.work is self._work or self.movie.folder != self._work.folder:
            return
        self.movie.go_on_with(self._work)
        viewer = self._viewer()
        if viewer is not None and self._is_shown():
            movie_session_of(viewer).frames_made_anew()
        self.movie_changed.emit()
        self._want_tables()

    # Opening and saving --------------------------------------------------------------

    def begin_task(
        self,
        what: str,
        work: Callable[[Progress], Any],
        done: Callable[[Any], None],
    ) -> None:
        """Open or save in a thread: cancelled like a run, and its errors are told.

        Parameters
        ----------
        what : str
            Said while it goes on.
        work : callable(Progress)
            Called in the thread.
        done : callable
            Called in the window's with what `work` returned, or with None if it failed.

        Raises
        ------
        Unwrap3DError
            Another movie is being opened or saved.
        """
        if self.busy_with:
            raise Unwrap3DError(self.busy_with, hint="Wait for it, or cancel it.")
        self.busy_with = what
        self._task = ProgressTask(work, self._report_task)
        self._task.returned.connect(partial(self._on_task, done))
        self._task.failed.connect(partial(self._on_task_failed, done))
        self._task.start()
        self.told.emit(what)
        self.state_changed.emit()

    def _report_task(self, _: str, fraction: float, message: str) -> None:
        self.progressed.emit("", 0, fraction, message)

    def _on_task(self, done: Callable[[Any], None], result: Any) -> None:
        self.busy_with = ""
        self.told.emit("")
        done(result)
        self.state_changed.emit()

    def _on_task_failed(self, done: Callable[[Any], None], error: BaseException) -> None:
        if not isinstance(error, Cancelled):
            tell(error)
        self._on_task(done, None)

    # A movie that was opened -------------------------------------------------------

    @property
    def working(self) -> WorkingFolder | None:
        """Where the movie is kept."""
        return self._working

    def adopt(self, opened: OpenedMovie, working: WorkingFolder) -> Iterator[None]:
        """Go on with a movie that was made before, a piece per turn of the event loop."""
        viewer = self._viewer()
        if viewer is None or self._closed:
            working.close()
            return
        if self._working is not None:
            self._before.append(self._working)
        self._working, self._work, self.failures = working, None, []
        self.state = state_in(working.folder)
        yield from showing_movie(viewer, opened)
        self._show(opened.movie)
        self.state_changed.emit()

    # The end -----------------------------------------------------------------------

    def close(self) -> None:
        """Cancel and wait for the thread; what was not saved is kept for the next start."""
        if self._closed:
            return
        self._closed = True
        self._rest.stop()
        self._reader.forget()
        self._reader.wait(CLOSE_SECONDS)
        self.chosen.close()
        if self._computation is not None:
            self._computation.cancel()
            self._computation.wait(CLOSE_SECONDS)
        if self._task is not None:
            self._task.cancel()
            self._task.wait(CLOSE_SECONDS)
        quiet_collector.release(self)
        self._lapse = self._work = self.movie = None
        for working in [*self._before, *([self._working] if self._working else [])]:
            working.close()


_RUNS: PerViewer[MovieRun] = PerViewer(MovieRun, lambda viewer, run: None)


def movie_run_of(viewer: Any) -> MovieRun:
    """What makes the movie of a viewer (or of napari's proxy of it); made when first asked for."""
    return _RUNS.of(viewer)
