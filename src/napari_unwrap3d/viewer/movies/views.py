"""A movie in the window: its common space in the views as any cell, and what changes in time."""

from __future__ import annotations

import weakref
from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING, Any

from qtpy.QtCore import QEvent, QObject

from ...motion.frame_fields import FrameFields, MovieColours
from ...motion.movie import Movie
from ..common.threads import Task, tell
from .annotations import MovieAnnotations

if TYPE_CHECKING:
    from ...atlas import Atlas
    from ...charts import Stack
    from ...fields import Fields
    from ..files.project import Opened
    from .layers import MovieLayers
    from .session import MovieSession
    from .time_axis import TimeAxis


CLOSE_SECONDS = 5.0
# The layer of what the common space was made from.
COMMON = "common space"


class MovieViews(QObject):
    """Brings the movie of a session into both canvases of its viewer.

    Parameters
    ----------
    viewer : napari.Viewer
    session : MovieSession
    """

    def __init__(self, viewer: Any, session: MovieSession) -> None:
        super().__init__(session)
        self._viewer = weakref.ref(viewer)
        self._session = session
        self._opening: Task | None = None
        self.colours: MovieColours | None = None
        self.layers: MovieLayers | None = None
        self.annotations: MovieAnnotations | None = None
        self._atlas: Atlas | None = None
        self._axes: list[TimeAxis] = []
        session.movie_changed.connect(self._on_movie)
        session.frame_changed.connect(self._on_frame)
        session.made_changed.connect(self._on_made)
        viewer.window._qt_window.installEventFilter(self)

    # Opening --------------------------------------------------------------------

    def _on_movie(self, movie: Movie | None) -> None:
        self._leave()
        if movie is None:
            return
        self.colours = MovieColours(movie)
        if not self._show_at_once(movie):
            self._opening = Task(_read_common, movie)
            self._opening.returned.connect(partial(self._open, movie))
            self._opening.failed.connect(self._on_failed)
            self._opening.start()

    def _show_at_once(self, movie: Movie) -> bool:
        """Show the frames of a movie whose common space is the cell of the viewer already."""
        from ..session import session_of

        viewer = self._viewer()
        atlas = None if viewer is None else session_of(viewer).atlas
        if atlas is None or not movie.has_common(atlas):
            return False
        session_of(viewer).turns.add(self._show_movie(viewer, atlas))
        return True

    def _on_failed(self, error: BaseException) -> None:
        self._opening = None
        tell(error)

    def _open(self, movie: Movie, opened: Opened) -> None:
        from ..session import session_of

        self._opening = None
        viewer = self._viewer()
        if viewer is not None and movie is self._session.movie:
            session_of(viewer).turns.add(self._show_common(viewer, opened))

    def _show_common(self, viewer: Any, opened: Opened) -> Iterator[None]:
        """Show the atlas of the common space, a piece per turn of the event loop."""
        from napari.layers import Layer

        from ..session import session_of
        from ..views.canvas import opening

        session = session_of(viewer)
        yield from opening(viewer)
        data, attributes, kind = opened.source_layer
        layer = Layer.create(data, attributes | {"name": COMMON, "visible": False}, kind)
        yield
        viewer.layers.append(layer)
        yield
        session.adopt(opened.known, opened.atlas, layer, opened.layers)
        session.project_path = None
        session.turns.add(self._follow(viewer, opened))

    def _follow(self, viewer: Any, opened: Opened) -> Iterator[None]:
        """What is drawn goes into the file of the common space."""
        from ..files.project import autosave_of

        autosave_of(viewer).opened(opened.path)
        yield from self._show_movie(viewer, opened.atlas)

    def _show_movie(self, viewer: Any, atlas: Atlas) -> Iterator[None]:
        from ..annotations.annotating import annotating_of
        from ..files.project import autosave_of
        from ..session import session_of
        from ..views.canvas import canvas_of
        from .layers import MovieLayers
        from .time_axis import TimeAxis
        from .timeline import open_timeline

        if self.colours is None:
            return
        annotating = annotating_of(viewer)
        yield
        canvas = canvas_of(viewer)
        self._atlas = atlas
        self._axes = [TimeAxis(model, self._session) for model in (viewer, canvas.model)]
        open_timeline(viewer)
        yield
        autosave = autosave_of(viewer)
        self.annotations = MovieAnnotations(self._session, atlas.annotations, autosave, self)
        if self._session.shown is not None:
            self.annotations.show(self._session.timepoint)
        self.layers = MovieLayers(viewer, canvas, annotating, self.colours, self)
        canvas.colouring.catalogue = self._fields
        # The last one is asked first: what the layers use is still there when the window closes.
        viewer.window._qt_window.installEventFilter(self)
        session_of(viewer).finished.connect(self._on_atlas)
        yield
        if self._session.shown is not None:
            yield from self._begin()

    def _begin(self) -> Iterator[None]:
        layers = self.layers
        if layers is not None and self._session.shown is not None:
            yield from layers.begin(self._session.shown)

    def _fields(self, atlas: Atlas, stack: Stack | None) -> Fields:
        """What the views can be coloured by."""
        from ...fields import fields_of

        shown = self._session.shown
        if shown is None or self.colours is None:
            return fields_of(atlas, stack)
        return FrameFields(atlas, shown, self.colours)

    # While it is shown ----------------------------------------------------------

    def _on_frame(self, _: Any) -> None:
        shown = self._session.shown
        if self.layers is None or self.annotations is None or shown is None:
            return
        self.annotations.show(shown.frame.timepoint)
        if self.layers.shown is None:
            from ..session import session_of

            viewer = self._viewer()
            if viewer is not None:
                session_of(viewer).turns.add(self._begin())
            return
        self.layers.show(shown)

    def _on_made(self) -> None:
        if self.colours is not None:
            self.colours.renew()

    def _on_atlas(self, atlas: Atlas) -> None:
        """Another cell is shown in the place of the common space."""
        if (
            self._atlas is not None
            and not self._atlas.completed(atlas)
            and atlas is not self._atlas
        ):
            self._session.set_movie(None)

    # The end --------------------------------------------------------------------

    def _leave(self) -> None:
        from ...fields import fields_of
        from ..session import session_of
        from ..views.canvas import open_canvas

        viewer = self._viewer()
        if self.annotations is not None:
            self.annotations.close()
            self.annotations.deleteLater()
            self.annotations = None
        if self.layers is not None and viewer is not None:
            self.layers.close()
            self.layers.deleteLater()
            session_of(viewer).finished.disconnect(self._on_atlas)
            canvas = open_canvas(viewer)
            if canvas is not None:
                canvas.colouring.catalogue = fields_of
        for axis in self._axes:
            axis.close()
            axis.deleteLater()
        self._axes = []
        self.layers = self.colours = self._atlas = None

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """The window closes: leave no thread."""
        if event.type() == QEvent.Type.Close:
            self._leave()
            if self._opening is not None:
                self._opening.wait(CLOSE_SECONDS)
        return super().eventFilter(watched, event)


def _read_common(movie: Movie) -> Opened:
    """Make the layers of the common space; runs in a thread."""
    from ..files.project import read_opened

    return read_opened(movie.folder.common_path, movie.common)
