"""Movies in the window: opened into the linked views, and saved in one file."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from ...atlas import Atlas
from ...errors import Unwrap3DError
from ...files.movie import unpack
from ...files.project import save_project
from ...motion.movie import Movie
from ...progress import Progress
from ..files.project import project_view
from ..session import session_of
from ..views.canvas import canvas_of
from .folders import WorkingFolder
from .opened import OpenedMovie, read_movie
from .run import MovieRun, movie_run_of

NOTHING = "There is no movie yet."


def open_movie(viewer: Any, path: str | Path) -> None:
    """Open a movie in a window, with its common space and all its frames.

    It is read in a thread; what is wrong with it is shown as a notification.

    Parameters
    ----------
    viewer : napari.Viewer
    path : path
        The folder of a movie, or the one file it was saved in.

    Raises
    ------
    Unwrap3DError
        A run is in progress.
    """
    from .wizard import open_movie_panel

    viewer = getattr(viewer, "__wrapped__", viewer)
    session, run = session_of(viewer), movie_run_of(viewer)
    if session.running or run.running:
        raise Unwrap3DError("A run is in progress.", hint="Cancel it, then open the movie.")
    open_movie_panel(viewer)
    canvas_of(viewer)
    path = Path(path)
    # A folder that was left behind is ours: it is gone on with, and saved by the user.
    working = WorkingFolder(path if path.is_dir() else None)
    session.told.emit(f"Opening {path.name} …")
    run.begin_task(
        f"Opening {path.name} …", partial(_read, path, working), _opened(viewer, working)
    )


def _read(path: Path, working: WorkingFolder, progress: Progress) -> OpenedMovie:
    if not path.is_dir():
        progress(0.0, f"Reading {path.name}")
        unpack(path, working.path)
        working.saved()
    return read_movie(Movie(working.folder))


def _opened(viewer: Any, working: WorkingFolder) -> Callable[[OpenedMovie | None], None]:
    there = weakref.ref(viewer)

    def opened(found: OpenedMovie | None) -> None:
        viewer = there()
        if found is None or viewer is None:
            working.close()
        else:
            session_of(viewer).turns.add(movie_run_of(viewer).adopt(found, working))
        if viewer is not None:
            session_of(viewer).told.emit("")

    return opened


def save_movie(viewer: Any, path: str | Path) -> None:
    """Save the movie of a window in one file, in a thread.

    Parameters
    ----------
    viewer : napari.Viewer
    path : path
        ``.unwrap3d`` is appended unless it is there.

    Raises
    ------
    Unwrap3DError
        There is no movie, or a run is in progress.
    """
    viewer = getattr(viewer, "__wrapped__", viewer)
    run = movie_run_of(viewer)
    if run.movie is None:
        raise Unwrap3DError(NOTHING, hint="Run the movie, or open one.")
    if run.running:
        raise Unwrap3DError("A run is in progress.", hint="Cancel it, then save the movie.")
    work = saving_movie(run, viewer, Path(path))
    run.begin_task(f"Saving {Path(path).name} …", work, partial(_saved, weakref.ref(viewer)))


def saving_movie(run: MovieRun, viewer: Any, path: Path) -> Callable[[Progress], Path]:
    """What saves a movie, to be called in a thread; the state of the window is taken now."""
    movie = run.movie
    atlas: Atlas | None = run.session.atlas
    assert movie is not None
    keep_space = None
    if atlas is not None and movie.has_common(atlas):
        annotated = atlas.annotated
        keep_space = partial(
            save_project,
            atlas,
            movie.folder.common_path,
            annotations=None if annotated is None else annotated.state(),
            view=project_view(run.session, viewer),
            source=run.session.source_data,
        )

    def save(progress: Progress) -> Path:
        if keep_space is not None:
            progress(0.0, "the common space")
            keep_space()
        return movie.save(path, progress.part(0.1, 1.0))

    return save


def _saved(viewer: weakref.ref[Any], path: Path | None) -> None:
    there = viewer()
    if there is None or path is None:
        return
    run = movie_run_of(there)
    if run.working is not None:
        run.working.saved()
    run.told.emit(f"Saved {path}.")
