"""Annotations of a movie: those of single timepoints follow the frame, and are kept with it."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Any

from qtpy.QtCore import QObject

from ...annotations import Annotations
from ...errors import Unwrap3DError
from ...files.movie import MovieFolder
from ...files.movie_annotations import keep_timed
from ..common.threads import Task, tell
from ..common.turns import soon
from ..files.autosave import REST_MS, Autosave
from .session import MovieSession

logger = logging.getLogger(__name__)

CLOSE_SECONDS = 20.0


class MovieAnnotations(QObject):
    """Shows the annotations of the timepoint, and saves them some seconds after they were drawn.

    Parameters
    ----------
    session : MovieSession
    annotations : Annotations
        Of the common space.
    autosave : Autosave
        Of the annotations that are the same at every timepoint.
    """

    def __init__(
        self,
        session: MovieSession,
        annotations: Annotations,
        autosave: Autosave,
        parent: QObject | None = None,
    ) -> None:
        super().__init__(parent)
        assert session.movie is not None
        self._session, self._annotations, self._autosave = session, annotations, autosave
        self._folder: MovieFolder = session.movie.folder
        self._showing = self._dirty = False
        self._task: Task | None = None
        self._timer = soon(self, self.save, REST_MS)
        annotations.times.edited.connect(self._on_edited)
        for signal in self._signals():
            signal.connect(self._on_edit)

    def _signals(self) -> tuple[Any, ...]:
        drawn = self._annotations
        return drawn.changed, drawn.listed, drawn.shaped, drawn.times.edited

    def show(self, timepoint: int) -> None:
        """Show what was drawn on a timepoint; drawing goes on there."""
        self._showing = True
        try:
            with self._autosave.ignoring():
                self._annotations.times.show(timepoint)
        finally:
            self._showing = False

    def _on_edited(self, timepoint: int) -> None:
        """A stroke of another timepoint was taken back: show where."""
        self._session.set_timepoint(timepoint)

    # Saving ----------------------------------------------------------------------

    @property
    def dirty(self) -> bool:
        """Whether something was drawn that the movie's folder does not have."""
        return self._dirty

    def _on_edit(self, _: Any = None) -> None:
        if not self._showing:
            self._dirty = True
            self._timer.start()

    def save(self) -> None:
        """Save now, in a thread, what was drawn on single timepoints since the last time."""
        if not self._dirty:
            return
        if self._task is not None:
            self._timer.start()
            return
        self._dirty = False
        self._task = Task(self._work())
        self._task.returned.connect(self._on_saved)
        self._task.failed.connect(self._on_failed)
        self._task.start()

    def _work(self) -> Callable[[], None]:
        folder, timed = self._folder, self._annotations.times.state()
        return lambda: keep_timed(folder, timed)

    def _on_saved(self, _: Any) -> None:
        self._task = None

    def _on_failed(self, error: BaseException) -> None:
        self._task = None
        self._dirty = True
        tell(error)

    def close(self) -> None:
        """Save what was drawn last, and show no timepoint any more."""
        self._timer.stop()
        if self._task is not None:
            self._task.wait(CLOSE_SECONDS)
        if self._dirty:
            try:
                self._work()()
            except (Unwrap3DError, OSError) as error:
                logger.error("What was drawn on single timepoints could not be saved: %s", error)
        self._annotations.times.edited.disconnect(self._on_edited)
        for signal in self._signals():
            signal.disconnect(self._on_edit)
        with self._autosave.ignoring():
            self._annotations.times.show(None)
