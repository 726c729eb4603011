"""The tables of a movie, read in a thread whenever something of it was made."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from qtpy.QtCore import QObject, Signal

from ...motion.movie import Movie
from ..common.threads import Task, tell
from ..common.turns import soon

if TYPE_CHECKING:
    import pandas as pd

REST_MS = 500


@dataclass(frozen=True, eq=False)
class Tables:
    """What is known of every timepoint of a movie.

    Attributes
    ----------
    registration, check : DataFrame
        A row per timepoint, see :class:`Movie`.
    record : dict
        Of the common space; empty before there is one.
    proposal : str
        Why another common space is proposed; empty if none is.
    limit : float
        The share of a surface that may leave the common space.
    """

    registration: pd.DataFrame
    check: pd.DataFrame
    record: dict[str, object]
    proposal: str
    limit: float

    @classmethod
    def of(cls, movie: Movie) -> Tables:
        """Read everything; takes long where there are many timepoints."""
        record = movie.record
        return cls(
            movie.registration_table(),
            movie.check_table(),
            record,
            movie.proposal() if record else "",
            movie.parameters.movie.largest_outside,
        )


class TableReader(QObject):
    """Reads the tables of a movie some time after it was asked to.

    Signals
    -------
    read(object)
        The :class:`Tables`.
    """

    read = Signal(object)

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._movie: Movie | None = None
        self._task: Task | None = None
        self._again = False
        self._timer = soon(self, self._start, REST_MS)

    def want(self, movie: Movie) -> None:
        """Read the tables of a movie; what is asked for meanwhile is read once more."""
        self._movie = movie
        if not self._timer.isActive():
            self._timer.start()

    def forget(self) -> None:
        """Read no more."""
        self._movie, self._again = None, False
        self._timer.stop()

    def wait(self, seconds: float) -> None:
        """Wait for what is being read."""
        if self._task is not None:
            self._task.wait(seconds)

    def _start(self) -> None:
        if self._movie is None:
            return
        if self._task is not None:
            self._again = True
            return
        self._task = Task(Tables.of, self._movie)
        self._task.returned.connect(self._on_read)
        self._task.failed.connect(self._on_failed)
        self._task.start()

    def _on_read(self, tables: Tables) -> None:
        self._end()
        if self._movie is not None:
            self.read.emit(tables)

    def _on_failed(self, error: BaseException) -> None:
        self._end()
        if self._movie is not None:
            tell(error)

    def _end(self) -> None:
        self._task = None
        if self._again:
            self._again = False
            self._timer.start()
