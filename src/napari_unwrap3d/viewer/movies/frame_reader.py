"""Frames of a movie read in a thread, ahead of who looks at them."""

from __future__ import annotations

from collections import OrderedDict

from qtpy.QtCore import QObject, Signal

from ...motion.movie import Movie
from ...motion.shown_frames import ShownFrame, shown_frame
from ..common.threads import Task
from ..common.turns import soon

# The one that is shown, those ahead, and the last ones, in case somebody goes back.
KEPT, AHEAD = 6, 2
CLOSE_SECONDS = 5.0


class FrameReader(QObject):
    """Reads one frame at a time: the one that was asked for last, then those that follow it.

    Parameters
    ----------
    movie : Movie

    Signals
    -------
    ready(object)
        The :class:`ShownFrame` that was asked for last.
    failed(object)
        The exception that reading it raised.
    """

    ready = Signal(object)
    failed = Signal(object)

    def __init__(self, movie: Movie, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._movie = movie
        self._kept: OrderedDict[int, ShownFrame | None] = OrderedDict()
        self._wanted = -1
        self._direction = 1
        self._task: Task | None = None
        self._reading = -1
        self._told = self._closed = False
        self._stale = False  # what is being read belongs to frames that were made anew since
        # In the next turn of the event loop, so that a slider that is dragged is not held up.
        self._timer = soon(self, self._tell)

    @property
    def busy_with_wanted(self) -> bool:
        """Whether what was asked for is still to be shown."""
        return not self._told and not self._is_missing(self._wanted)

    def want(self, timepoint: int, direction: int = 1) -> None:
        """Ask for a timepoint; those in a direction (+1, −1, or 0: none) are read ahead."""
        self._wanted, self._direction, self._told = timepoint, direction, False
        if self._kept.get(timepoint) is not None:
            self._kept.move_to_end(timepoint)
            self._timer.start()
        self._read_next()

    def look_again(self) -> None:
        """Frames may have been made that were missing."""
        for timepoint in [t for t, shown in self._kept.items() if shown is None]:
            del self._kept[timepoint]
        self._read_next()

    def forget(self) -> None:
        """Frames were made anew: read again what was read."""
        self._kept.clear()
        self._stale = self._task is not None

    def close(self) -> None:
        """Read no more, and leave no thread."""
        self._closed = True
        self._timer.stop()
        self._kept.clear()
        if self._task is not None:
            self._task.wait(CLOSE_SECONDS)

    def _is_missing(self, timepoint: int) -> bool:
        return timepoint in self._kept and self._kept[timepoint] is None

    def _tell(self) -> None:
        shown = self._kept.get(self._wanted)
        if shown is not None and not self._told:
            self._told = True
            self.ready.emit(shown)

    def _read_next(self) -> None:
        if self._task is not None or self._closed:
            return
        ahead = (self._wanted + self._direction * k for k in range(AHEAD + 1))
        count = len(self._movie)
        following = [t % count for t in ahead if self._wanted >= 0]
        missing = next((t for t in following if t not in self._kept), None)
        if missing is None:
            return
        self._reading = missing
        self._task = Task(_read, self._movie, missing)
        self._task.returned.connect(self._on_read)
        self._task.failed.connect(self._on_failed)
        self._task.start()

    def _on_read(self, shown: ShownFrame | None) -> None:
        self._task = None
        if self._closed:
            return
        if self._stale:
            self._stale = False
            self._read_next()
            return
        self._kept[self._reading] = shown
        for timepoint in [*self._kept]:
            if len(self._kept) > KEPT and timepoint != self._wanted:
                del self._kept[timepoint]
        if self._reading == self._wanted:
            self._tell()
        self._read_next()

    def _on_failed(self, error: BaseException) -> None:
        self._task = None
        if self._closed:
            return
        # Not tried again before somebody looks for frames.
        self._kept[self._reading] = None
        if self._reading == self._wanted:
            self.failed.emit(error)
        self._read_next()


def _read(movie: Movie, timepoint: int) -> ShownFrame | None:
    """A frame with what views need of it, None for one that was not made."""
    if not movie.has_frame(timepoint):
        return None
    return shown_frame(movie.frame(timepoint))
