"""Reading and writing tracks in the window: what is asked, and the work in a thread."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from qtpy.QtWidgets import (
    QDialog,
    QDialogButtonBox,
    QFileDialog,
    QFormLayout,
    QLabel,
    QLineEdit,
    QVBoxLayout,
    QWidget,
)

from ..errors import Unwrap3DError
from ..progress import Progress
from .threads import tell
from .track_run import TrackRun, counted

if TYPE_CHECKING:
    from ..charts import Tracks
    from ..motion.movie import Movie

READING, WRITING = "Reading tracks", "Writing tracks"
TABLES = "*.csv *.parquet"
IMPORTED = f"Tracks (*.xml {TABLES});;TrackMate (*.xml);;Table ({TABLES});;All files (*)"
EXPORTED = "GEFF (*.geff);;TrackMate (*.xml);;Table (*.csv);;Table (*.parquet)"


class ImportDialog(QDialog):
    """What tracks from a file are called."""

    def __init__(self, path: Path, taken: tuple[str, ...], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle("Import tracks")
        self.name = QLineEdit(free_name(path.stem, taken))
        self.name.setToolTip("Under this name they are kept with the movie.")
        note = QLabel(
            "Places in space are those of the movie's common world. Each is laid on the nearest "
            "place of the surface of its timepoint."
        )
        note.setWordWrap(True)
        buttons = QDialogButtonBox(
            QDialogButtonBox.StandardButton.Ok | QDialogButtonBox.StandardButton.Cancel
        )
        buttons.accepted.connect(self.accept)
        buttons.rejected.connect(self.reject)
        form = QFormLayout()
        form.addRow("File", QLabel(path.name))
        form.addRow("Name", self.name)
        column = QVBoxLayout(self)
        column.addLayout(form)
        column.addWidget(note)
        column.addWidget(buttons)
        self.ok = buttons.button(QDialogButtonBox.StandardButton.Ok)
        self.name.textChanged.connect(self._on_name)

    def _on_name(self, name: str) -> None:
        self.ok.setEnabled(bool(name.strip()))


@dataclass(frozen=True, eq=False)
class Imported:
    """Tracks that were read and laid on the surface."""

    name: str
    tracks: Tracks


def free_name(stem: str, taken: tuple[str, ...]) -> str:
    """A name that no tracks of the movie have."""
    name, number = stem, 2
    while name in taken:
        name, number = f"{stem} {number}", number + 1
    return name


def ask_file(parent: QWidget) -> Path | None:
    """Which file to read."""
    name, _ = QFileDialog.getOpenFileName(parent, "Import tracks", "", IMPORTED)
    return Path(name) if name else None


def ask_folder(parent: QWidget) -> Path | None:
    """Which GEFF to read: it is a folder."""
    name = QFileDialog.getExistingDirectory(parent, "Import a GEFF folder")
    return Path(name) if name else None


def ask_name(parent: QWidget, run: TrackRun, path: Path) -> str | None:
    """What the tracks of a file are to be called; None to leave it."""
    dialog = ImportDialog(path, run.tracks.names, parent)
    return dialog.name.text().strip() if dialog.exec() else None


def import_tracks(run: TrackRun, path: Path, name: str) -> None:
    """Read tracks, lay them on the surface, keep them with the movie, and show them."""
    movie = run.movie
    if movie is None:
        return
    begin_or_tell(run, READING, partial(_read, movie, path, name), partial(_show, run))


def _read(movie: Movie, path: Path, name: str, progress: Progress) -> Imported:
    """In a thread."""
    from ..files.tracks import read_tracks
    from ..tracking.laying import lay

    progress(0.0, path.name)
    tracks = read_tracks(path, time_step_s=movie.time_step_s)
    laid = lay(movie, tracks, progress=progress.part(0.2, 1.0))
    movie.keep_tracks(name, laid)
    return Imported(name, laid)


def _show(run: TrackRun, imported: Imported) -> None:
    run.tracks.set_tracks(imported.name, imported.tracks)
    run.tracks.look_for_tracks()
    far = imported.tracks.numbers.get("laying", {}).get("off_surface_um_mean")
    away = "" if far is None else f" They are {far:.2g} µm from the surface on average."
    run.told.emit(f"Read {counted(len(imported.tracks.ids), 'track')}.{away}")


def ask_export(parent: QWidget, run: TrackRun) -> Path | None:
    """Where the tracks are to be written."""
    start = run.tracks.name or "tracks"
    name, chosen = QFileDialog.getSaveFileName(parent, "Export tracks", start, EXPORTED)
    if not name:
        return None
    path = Path(name)
    return path if path.suffix else path.with_suffix(chosen[chosen.index("*") + 1 : -1])


def export_tracks(run: TrackRun, path: Path) -> None:
    """Write the tracks that are shown, in a thread; the suffix tells how."""
    shown = run.tracks.shown
    if shown is not None:
        begin_or_tell(run, WRITING, partial(_write, run.movie, shown, path), partial(_said, run))


def _write(movie: Movie | None, tracks: Tracks, path: Path, progress: Progress) -> Path:
    """In a thread."""
    from ..files.tracks import write_tracks

    progress(0.0, path.name)
    write_tracks(path, tracks, movie=movie)
    return path


def _said(run: TrackRun, path: Path) -> None:
    run.told.emit(f"Written to {path}")


def begin_or_tell(run: TrackRun, what: str, work: Any, done: Any) -> None:
    """Begin some work; what is wrong is shown as a notification."""
    try:
        run.begin(what, work, done)
    except Unwrap3DError as error:
        tell(error)
