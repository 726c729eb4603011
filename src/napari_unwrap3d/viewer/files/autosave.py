"""What is drawn is saved by itself: in its project, or in a file kept for the next start.

A file for the next start is locked by the process that writes it, so that two windows keep
their own, and what a crashed process left is told from what is still in use.
"""

from __future__ import annotations

import logging
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from qtpy.QtCore import QLockFile, QObject, QStandardPaths

from ...errors import Unwrap3DError
from ...files.autosave import save_annotations
from ...files.project import SUFFIX
from ..common.threads import Task
from ..common.turns import soon

if TYPE_CHECKING:
    from ...annotations import Annotations
    from ...atlas import Atlas
    from ..session import Session

logger = logging.getLogger(__name__)

REST_MS = 5_000
CLOSE_SECONDS = 20.0
FOLDER = "napari-unwrap3d/unsaved"
LOCK = ".lock"


def unsaved_folder() -> Path:
    """Where cells are kept that were drawn on, and movies that were made, but not saved."""
    place = QStandardPaths.writableLocation(QStandardPaths.StandardLocation.GenericDataLocation)
    return Path(place) / FOLDER


def left_behind() -> list[Path]:
    """Cells and movies of windows that are gone, the newest first."""
    files = sorted(unsaved_folder().glob(f"*{SUFFIX}"), key=lambda p: p.stat().st_mtime)
    return [path for path in reversed(files) if _is_free(path)]


def discard(path: Path) -> None:
    """Delete a cell or a movie that was left behind."""
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)
    path.with_suffix(LOCK).unlink(missing_ok=True)


def lock_on(path: Path) -> QLockFile:
    """What says that a process that is alive keeps its work there; not taken yet."""
    lock = QLockFile(str(path.with_suffix(LOCK)))
    lock.setStaleLockTime(0)
    return lock


def new_place(kind: str, owner: object) -> Path:
    """Where work is kept for the next start that was not saved: "cell" or "movie"."""
    folder = unsaved_folder()
    folder.mkdir(parents=True, exist_ok=True)
    return folder / f"{kind}-{time.strftime('%Y%m%d-%H%M%S')}-{id(owner):x}{SUFFIX}"


def _is_free(path: Path) -> bool:
    """Whether no process that is alive keeps its work there."""
    lock = lock_on(path)
    if not lock.tryLock(0):
        return False
    lock.unlock()
    return True


class Autosave(QObject):
    """Saves the annotations of a session some seconds after they were last drawn on.

    Parameters
    ----------
    session : Session
    save_whole : callable(path)
        Gives what saves the whole project at a path, to be called in a thread.
    """

    def __init__(self, session: Session, save_whole: Callable[[Path], Callable[[], Path]]) -> None:
        super().__init__(session)
        self._session = session
        self._save_whole = save_whole
        self._listening: Annotations | None = None
        self._in_file: tuple[Path, Atlas] | None = None
        self._kept: Path | None = None
        self._lock: QLockFile | None = None
        self._dirty = self._closed = self._ignoring = False
        self._task: Task | None = None
        self._timer = soon(self, self.save, REST_MS)
        session.finished.connect(self._on_atlas)
        session.steps_changed.connect(self._on_atlas)
        session.closing.connect(self.close)

    @property
    def dirty(self) -> bool:
        """Whether something was drawn that no file has."""
        return self._dirty

    def saved(self, path: Path) -> None:
        """The whole cell was saved by its user: from now on that file is kept up to date."""
        if self._closed:
            # A save that outlived its window.
            return
        self._follow(path)
        self._forget_kept()

    def opened(self, path: Path) -> None:
        """A project was opened. One that was left behind stays one until it is saved."""
        self._follow(path)
        self._forget_kept()
        if path.parent == unsaved_folder():
            self._kept = path
            self._lock_kept()

    def _follow(self, path: Path) -> None:
        atlas = self._session.atlas
        assert atlas is not None
        self._in_file = (path, atlas)
        self._dirty = False
        self._timer.stop()

    # Listening -------------------------------------------------------------------

    def _on_atlas(self, _: Any = None) -> None:
        atlas = self._session.atlas
        drawn = None if atlas is None or not atlas.has("surface") else atlas.annotations
        if drawn is self._listening:
            return
        self._leave()
        self._listening = drawn
        if drawn is not None:
            for signal in _signals(drawn):
                signal.connect(self._on_edit)

    def _leave(self) -> None:
        if self._listening is not None:
            drawn = self._listening
            for signal in _signals(drawn):
                signal.disconnect(self._on_edit)
            self._listening = None

    @contextmanager
    def ignoring(self) -> Iterator[None]:
        """What changes inside is no work of a person, which a file has to keep."""
        before, self._ignoring = self._ignoring, True
        try:
            yield
        finally:
            self._ignoring = before

    def _on_edit(self, _: Any = None) -> None:
        if self._ignoring:
            return
        self._dirty = True
        self._timer.start()

    # Saving ----------------------------------------------------------------------

    def save(self) -> None:
        """Save now, in a thread, what was drawn since the last time."""
        if not self._dirty or self._session.atlas is None:
            return
        if self._task is not None or self._session.running:
            self._timer.start()
            return
        self._dirty = False
        self._task = Task(self._work())
        self._task.returned.connect(self._on_saved)
        self._task.failed.connect(self._on_failed)
        self._task.start()

    def _work(self) -> Callable[[], Path]:
        """What saves: annotations alone where the file has the charts already."""
        atlas = self._session.atlas
        assert atlas is not None
        if self._in_file is not None and self._in_file[1] is atlas and self._in_file[0].is_file():
            path, state = self._in_file[0], atlas.annotations.state()
            return lambda: save_annotations(path, state)
        path = self._place()
        whole = self._save_whole(path)

        def keep() -> Path:
            path.parent.mkdir(parents=True, exist_ok=True)
            return whole()

        self._in_file = (path, atlas)
        return keep

    def _place(self) -> Path:
        """A file for the next start, locked by us."""
        if self._kept is None:
            self._kept = new_place("cell", self)
            self._lock_kept()
        return self._kept

    def _lock_kept(self) -> None:
        assert self._kept is not None
        self._lock = lock_on(self._kept)
        self._lock.tryLock(0)

    def _forget_kept(self) -> None:
        if self._kept is not None:
            kept, self._kept = self._kept, None
            if self._lock is not None:
                self._lock.unlock()
                self._lock = None
            discard(kept)

    def _on_saved(self, path: Path) -> None:
        self._task = None
        logger.info("Saved what was drawn in %s.", path)

    def _on_failed(self, error: BaseException) -> None:
        self._task = None
        self._dirty = True
        self._in_file = None
        self._session.told.emit(f"What was drawn could not be saved: {error}")

    def close(self) -> None:
        """The window closes: save what was drawn last, before everything is gone."""
        self._closed = True
        self._timer.stop()
        if self._task is not None:
            self._task.wait(CLOSE_SECONDS)
        if self._dirty and self._session.atlas is not None:
            try:
                self._work()()
            except (Unwrap3DError, OSError) as error:
                logger.error("What was drawn could not be saved: %s", error)
        self._leave()
        if self._lock is not None:
            self._lock.unlock()
            self._lock = None


def _signals(drawn: Annotations) -> tuple[Any, ...]:
    """Everything that tells of an edit."""
    return drawn.changed, drawn.listed, drawn.shaped, drawn.turned, drawn.points.changed
