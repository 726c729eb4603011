"""Reading and writing tracks in the window: what is asked, and the work in a thread."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from qtpy.QtWidgets import (
    QComboBox,
    QDialog,
    QDialogButtonBox,
    QFileDialog,
    QFormLayout,
    QLabel,
    QLineEdit,
    QVBoxLayout,
    QWidget,
)

from ...charts import Size3, check_voxel_size
from ...errors import Unwrap3DError
from ...files.movie import TRACKS_NAME
from ...progress import Progress
from ..common.threads import tell
from .run import TrackRun, counted, free_name

if TYPE_CHECKING:
    from ...charts import Tracks
    from ...motion.movie import Movie

_NUMBERS = re.compile(r"[\s,;×]+")
# So that a number still fits in.
LONGEST = 60
READING, WRITING = "Reading tracks", "Writing tracks"
TABLES = "*.csv *.parquet"
IMPORTED = f"Tracks (*.xml {TABLES});;TrackMate (*.xml);;Table ({TABLES});;All files (*)"
EXPORTED = "GEFF (*.geff);;TrackMate (*.xml);;Table (*.csv);;Table (*.parquet)"


@dataclass(frozen=True)
class Import:
    """What is to be read, and how.

    Attributes
    ----------
    path : Path
    name : str
        Under which the tracks are kept with the movie.
    voxel_size : (float, float, float) or None
        (z, y, x) in µm, where the file has places in pixels and does not say how large.
    recorded : bool
        Whether the places are those of the recording, before the movie was registered.
    """

    path: Path
    name: str
    voxel_size: Size3 | None = None
    recorded: bool = False


class ImportDialog(QDialog):
    """What tracks from a file are called, and where their places are."""

    def __init__(self, path: Path, taken: tuple[str, ...], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.path = path
        self.setWindowTitle("Import tracks")
        self.name = QLineEdit(free_name(_as_name(path.stem), taken))
        self.name.setToolTip("Under this name they are kept with the movie.")
        self.world = QComboBox()
        self.world.addItem("the registered movie", False)
        self.world.addItem("the stack, before registration", True)
        self.world.setToolTip(
            "Where the tracks were made. Those of the stack are moved as the movie was registered."
        )
        self.voxel_size = QLineEdit()
        self.voxel_size.setPlaceholderText("as the file says")
        self.voxel_size.setToolTip(
            "(z, y, x) in µm, for places in pixels of which the file does not say how large they "
            "are."
        )
        note = QLabel("Each place is laid on the nearest one of the surface of its timepoint.")
        note.setWordWrap(True)
        buttons = QDialogButtonBox(
            QDialogButtonBox.StandardButton.Ok | QDialogButtonBox.StandardButton.Cancel
        )
        buttons.accepted.connect(self.accept)
        buttons.rejected.connect(self.reject)
        form = QFormLayout()
        form.addRow("File", QLabel(path.name))
        form.addRow("Name", self.name)
        form.addRow("Places are of", self.world)
        form.addRow("Voxel size (µm)", self.voxel_size)
        column = QVBoxLayout(self)
        column.addLayout(form)
        column.addWidget(note)
        column.addWidget(buttons)
        self.ok = buttons.button(QDialogButtonBox.StandardButton.Ok)
        for line in (self.name, self.voxel_size):
            line.textChanged.connect(self._check)

    def _check(self, _: str) -> None:
        size, name = self.voxel_size.text().strip(), self.name.text().strip()
        known = not size or self._size() is not None
        self.ok.setEnabled(bool(TRACKS_NAME.fullmatch(name)) and known)

    def _size(self) -> Size3 | None:
        try:
            z, y, x = (float(part) for part in _NUMBERS.split(self.voxel_size.text().strip()))
            return check_voxel_size((z, y, x))
        except (ValueError, Unwrap3DError):
            return None

    def chosen(self) -> Import:
        """What was said."""
        name = self.name.text().strip()
        return Import(self.path, name, self._size(), bool(self.world.currentData()))


@dataclass(frozen=True, eq=False)
class Imported:
    """Tracks that were read and laid on the surface."""

    name: str
    tracks: Tracks


def _as_name(stem: str) -> str:
    """The name of a file as one of tracks: what these cannot hold becomes "_"."""
    name = re.sub(r"[^\w .-]", "_", stem).strip()
    return (name if TRACKS_NAME.fullmatch(name) else f"tracks {name}")[:LONGEST]


def ask_file(parent: QWidget) -> Path | None:
    """Which file to read."""
    name, _ = QFileDialog.getOpenFileName(parent, "Import tracks", "", IMPORTED)
    return Path(name) if name else None


def ask_folder(parent: QWidget) -> Path | None:
    """Which GEFF to read: it is a folder."""
    name = QFileDialog.getExistingDirectory(parent, "Import a GEFF folder")
    return Path(name) if name else None


def ask_how(parent: QWidget, run: TrackRun, path: Path) -> Import | None:
    """How a file is to be read; None to leave it."""
    dialog = ImportDialog(path, run.tracks.names, parent)
    return dialog.chosen() if dialog.exec() else None


def import_tracks(run: TrackRun, wanted: Import) -> None:
    """Read tracks, lay them on the surface, keep them with the movie, and show them."""
    movie = run.movie
    if movie is None:
        return
    begin_or_tell(run, READING, partial(_read, movie, wanted), partial(_show, run))


def _read(movie: Movie, wanted: Import, progress: Progress) -> Imported:
    """In a thread."""
    from ...files.tracks import read_tracks
    from ...tracking.laying import lay_tracks
    from ...tracking.recorded import in_common_world

    progress(0.0, wanted.path.name)
    tracks = read_tracks(
        wanted.path,
        voxel_size=wanted.voxel_size,
        time_step=movie.time_step_s,
        timepoints=len(movie),
    )
    if wanted.recorded:
        tracks = in_common_world(movie, tracks)
    # Ours know where they lie on the image of this movie.
    known = tracks.rows == movie.common.uv.shape[0] and np.isfinite(tracks.place_px).any()
    if wanted.recorded or not known:
        tracks = lay_tracks(movie, tracks, progress=progress.part(0.2, 1.0))
    movie.keep_tracks(wanted.name, tracks)
    return Imported(wanted.name, tracks)


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
        begin_or_tell(
            run,
            WRITING,
            partial(_write, run.movie, shown, run.tracks.name, path),
            partial(_said, run),
        )


def _write(movie: Movie | None, tracks: Tracks, name: str, path: Path, progress: Progress) -> Path:
    """In a thread."""
    from ...files.tracks import write_tracks

    progress(0.0, path.name)
    return write_tracks(path, tracks, movie, name=name)


def _said(run: TrackRun, path: Path) -> None:
    run.told.emit(f"Written to {path}")


def begin_or_tell(run: TrackRun, what: str, work: Any, done: Any) -> None:
    """Begin some work; what is wrong is shown as a notification."""
    try:
        run.begin(what, work, done)
    except Unwrap3DError as error:
        tell(error)
