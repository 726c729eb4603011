"""Where a movie is kept while it is made: a folder that outlives a crash until it is saved."""

from __future__ import annotations

from pathlib import Path

from ...files.movie import MovieFolder, is_movie
from ...motion.timelapse import Timelapse
from ..files.autosave import discard, lock_on, new_place, unsaved_folder


class WorkingFolder:
    """The folder of a window's movie: one of ours, or where the user's movie was opened.

    Ours is locked by this process, and offered again at the next start unless it was saved.

    Parameters
    ----------
    path : Path, optional
        Of a movie that is there; by default a new place of ours.
    """

    def __init__(self, path: Path | None = None) -> None:
        self.path = new_place("movie", self) if path is None else path
        self.ours = self.path.parent == unsaved_folder()
        self._saved_at: int | None = None
        self._lock = lock_on(self.path) if self.ours else None
        if self._lock is not None:
            self._lock.tryLock(0)

    @property
    def folder(self) -> MovieFolder:
        return MovieFolder(self.path)

    def is_of(self, lapse: Timelapse) -> bool:
        """Whether the movie in it can be of a timelapse; keys tell which pieces really are."""
        if not is_movie(self.path):
            return True
        known = self.folder.manifest()
        # Layers do not know what channels are called.
        return (known["timepoints"], known["time_step_s"], len(known["channels"])) == (
            len(lapse),
            lapse.time_step_s,
            len(lapse.channels),
        )

    def saved(self) -> None:
        """Everything in it was saved in a file of the user's."""
        self._saved_at = self._newest()

    @property
    def has_unsaved(self) -> bool:
        """Whether something in it is in no file of the user's."""
        if not self.ours:
            return False
        there = (self.path / "common.json").is_file()
        return there and (self._saved_at is None or self._newest() > self._saved_at)

    def close(self) -> None:
        """Let go of it; what need not be kept is deleted."""
        if self._lock is not None:
            keep = self.has_unsaved
            self._lock.unlock()
            self._lock = None
            if not keep:
                discard(self.path)

    def _newest(self) -> int:
        """When something in it was last written, in ns."""
        times = [each.stat().st_mtime_ns for each in self.path.rglob("*") if each.is_file()]
        return max(times, default=0)
