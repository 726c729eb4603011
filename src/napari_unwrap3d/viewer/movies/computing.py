"""The work on a movie in a thread, piece by piece: what is done comes out as Qt signals.

The thread holds the pieces of work and this object, never the viewer, so that a window closed
during a run can be freed.
"""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass

from qtpy.QtCore import QObject, Signal

from ...charts import Size3
from ...errors import Cancelled, Unwrap3DError
from ...geometry.apart import apart
from ...motion.movie import Movie
from ...motion.stages import MovieWork, Stage, stages
from ...motion.state import DONE, MovieState, piece_state, state_of
from ...progress import Progress
from ..common.threads import Task
from .opened import read_movie

logger = logging.getLogger(__name__)

REPORT_SECONDS = 0.05
# What a piece of work can fail with that is no fault of the others.
FAILURES = (Unwrap3DError, ArithmeticError, LookupError, OSError, RuntimeError, ValueError)
LOOKING = "looking"


@dataclass(frozen=True)
class Failure:
    """A piece of work that could not be made, and why."""

    stage: Stage
    timepoint: int
    reason: str


class MovieComputation(QObject):
    """A run over the pieces of work of one movie, or a look at what of them is there.

    Parameters
    ----------
    work : MovieWork
    until : str
        The last stage to run; empty only looks.
    timepoints : collection of int, optional
        Frames are made of these only.
    shown : str
        The key of the common space that is shown already.
    origin : (float, float, float), optional
        Where the timelapse lies in the viewer, (z, y, x) in µm.

    Signals
    -------
    looked(object)
        The :class:`MovieState` before anything is made.
    progressed(str, int, float, str)
        Stage, timepoint, fraction 0..1 of that stage and message, at most twenty times a second.
    piece_ended(str, int, object)
        Stage, timepoint, and the :class:`Failure`, or None.
    space_ready(object)
        The :class:`OpenedMovie` whose common space is there.
    ended(object)
        The error that stopped the run (cancelling is one), or None.
    """

    looked = Signal(object)
    progressed = Signal(str, int, float, str)
    piece_ended = Signal(str, int, object)
    space_ready = Signal(object)
    ended = Signal(object)

    def __init__(
        self,
        work: MovieWork,
        until: Stage | str = "",
        timepoints: frozenset[int] | None = None,
        shown: str = "",
        origin: Size3 | None = None,
    ) -> None:
        super().__init__()
        self.work, self.until = work, until
        self._timepoints, self._shown, self._origin = timepoints, shown, origin
        self._reported = 0.0
        self._failed: set[int] = set()
        self._progress = Progress()
        self._task = Task(self._compute)
        self._task.returned.connect(lambda _: self.ended.emit(None))
        self._task.failed.connect(self.ended.emit)

    def start(self) -> None:
        """Start the thread."""
        self._task.start()

    def cancel(self) -> None:
        """Ask to stop; pieces that are done stay."""
        self._progress.cancel()

    def wait(self, seconds: float) -> bool:
        """Wait for the thread; True when it has ended."""
        return self._task.wait(seconds)

    # In the thread -----------------------------------------------------------

    def _compute(self) -> None:
        state = state_of(self.work, self._reporter(LOOKING, 0))
        self.looked.emit(state)
        if not self.until:
            if state.of("common") == DONE:
                self._show_space()
            return
        self.work.begin()
        with apart():
            for stage, timepoints in stages(len(self.work.lapse)):
                self._run_stage(stage, timepoints, state)
                if stage == "common":
                    self._show_space()
                if stage == self.until:
                    break

    def _run_stage(self, stage: Stage, timepoints: range, state: MovieState) -> None:
        wanted = [t for t in timepoints if self._is_wanted(stage, t, state)]
        for index, timepoint in enumerate(wanted):
            report = self._reporter(stage, timepoint)
            part = report.part(index / len(wanted), (index + 1) / len(wanted))
            part(0.0)
            self._run_piece(stage, timepoint, part)

    def _is_wanted(self, stage: Stage, timepoint: int, state: MovieState) -> bool:
        if timepoint in self._failed and stage != "common":
            return False
        if stage == "frame" and self._timepoints is not None and timepoint not in self._timepoints:
            return False
        # What a piece is made from may have been made anew in this run.
        later = stage in ("common", "frame")
        now = piece_state(self.work, stage, timepoint) if later else None
        return (now or state.pieces[stage][timepoint]) != DONE

    def _run_piece(self, stage: Stage, timepoint: int, progress: Progress) -> None:
        failure = None
        try:
            self.work.run(stage, timepoint, progress)
        except Cancelled:
            raise
        except FAILURES as error:
            if stage == "common":
                raise
            failure = Failure(stage, timepoint, _reason(error))
            self._failed.add(timepoint)
        self.piece_ended.emit(stage, timepoint, failure)

    def _show_space(self) -> None:
        record = self.work.folder.common()
        if record is None or record["key"] == self._shown:
            return
        self._shown = record["key"]
        movie = Movie(self.work.folder, self.work)
        report = self._reporter("common", 0)
        report(0.0, "reading the common space")
        self.space_ready.emit(read_movie(movie, self._origin))

    def _reporter(self, stage: str, timepoint: int) -> Progress:
        def report(_: str, fraction: float, message: str) -> None:
            now = time.monotonic()
            if fraction == 0.0 or now - self._reported >= REPORT_SECONDS:
                self._reported = now
                self.progressed.emit(stage, timepoint, fraction, message)

        return Progress(report, stage, self._progress.cancelled)


def _reason(error: BaseException) -> str:
    """What is told of a piece that failed; what we did not foresee is logged as a whole."""
    if isinstance(error, Unwrap3DError):
        return str(error)
    logger.error("A piece of work on a movie failed.", exc_info=error)
    return f"{type(error).__name__}: {error}"
