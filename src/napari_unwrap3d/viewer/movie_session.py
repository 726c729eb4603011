"""The movie of one viewer: which it is, which timepoint is shown, and who has to know."""

from __future__ import annotations

import weakref
from typing import TYPE_CHECKING

from qtpy.QtCore import QEvent, QObject, Signal

from ..charts import Frame
from ..motion.movie import Movie
from .per_viewer import PerViewer

if TYPE_CHECKING:
    from napari.components import ViewerModel


class MovieSession(QObject):
    """What one viewer knows about its movie. Get it with :func:`movie_session_of`.

    The common space is the cell of the viewer's :class:`~.session.Session`; the movie adds what
    changes in time.

    Attributes
    ----------
    movie : Movie or None
    timepoint : int
        That is shown.
    frame : Frame or None
        Of it.

    Signals
    -------
    movie_changed(object)
        Another movie, or None.
    frame_changed(object)
        Another timepoint is shown; the :class:`Frame` of it.
    """

    movie_changed = Signal(object)
    frame_changed = Signal(object)

    def __init__(self, viewer: ViewerModel, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._viewer = weakref.ref(viewer)
        self.movie: Movie | None = None
        self.timepoint = 0
        self.frame: Frame | None = None

    @property
    def viewer(self) -> ViewerModel | None:
        """The viewer; None once it is gone."""
        return self._viewer()

    def set_movie(self, movie: Movie | None) -> None:
        """Show another movie from its first timepoint on."""
        self.movie, self.frame = movie, None
        self.movie_changed.emit(movie)
        if movie is not None:
            self.set_timepoint(0)

    def set_timepoint(self, timepoint: int) -> None:
        """Show a timepoint, if its frame was made."""
        if self.movie is None or not self.movie.has_frame(timepoint):
            return
        self.timepoint = timepoint
        self.frame = self.movie.frame(timepoint)
        self.frame_changed.emit(self.frame)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """The window closes: let go of the movie."""
        if event.type() == QEvent.Type.Close:
            self.movie, self.frame = None, None
        return super().eventFilter(watched, event)


_SESSIONS: PerViewer[MovieSession] = PerViewer(MovieSession, lambda viewer, session: None)


def movie_session_of(viewer: ViewerModel) -> MovieSession:
    """The movie session of a viewer."""
    return _SESSIONS.of(viewer)
