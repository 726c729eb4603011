"""The common space of a movie in the window: its atlas is the cell of the session."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ..annotations.keeping import keeping
from ..files.project import adopting, looking
from ..session import session_of
from ..views.placing import chart_of
from .opened import OpenedMovie
from .session import movie_session_of
from .sources import SPACE_LAYER


def showing_movie(viewer: Any, opened: OpenedMovie) -> Iterator[None]:
    """Show a movie: its common space like any cell, and the frames that there are.

    Parameters
    ----------
    viewer : napari.Viewer
    opened : OpenedMovie

    Yields
    ------
    None
        Between two turns of the event loop.
    """
    session, movies = session_of(viewer), movie_session_of(viewer)
    before = _drawn_before(viewer, opened)
    movies.set_movie(None)
    _remove_space(viewer)
    yield from adopting(viewer, opened.space, until="")
    session.project_path = None
    yield
    # After what the session still has to do: the layers, and the end.
    session.turns.add(_following(viewer, opened, before))


def _following(viewer: Any, opened: OpenedMovie, before: Any) -> Iterator[None]:
    yield from looking(viewer, opened.space)
    if before is not None:
        # What was drawn while the space was made; the file has what was drawn before.
        yield from keeping(before, opened.space.atlas)
    movie_session_of(viewer).set_movie(opened.movie)
    yield


def _drawn_before(viewer: Any, opened: OpenedMovie) -> Any:
    """The atlas that is shown, if it is an earlier common space of this movie."""
    session, shown = session_of(viewer), movie_session_of(viewer).movie
    if shown is None or shown.folder != opened.movie.folder or session.atlas is None:
        return None
    return session.atlas


def _remove_space(viewer: Any) -> None:
    """The layer of the space before this one goes."""
    for layer in list(viewer.layers):
        if layer.metadata.get(SPACE_LAYER) and not chart_of(layer):
            viewer.layers.remove(layer)
