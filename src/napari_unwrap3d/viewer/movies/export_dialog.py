"""The dock "Export movie": MP4 or PNG frames of what is shown, or of drawn pictures."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from qtpy.QtWidgets import (
    QCheckBox,
    QComboBox,
    QDoubleSpinBox,
    QFileDialog,
    QFormLayout,
    QHBoxLayout,
    QLabel,
    QPushButton,
    QVBoxLayout,
)

from ...charts import Stack
from ...errors import InputError, Unwrap3DError
from ...files.movie_export import FPS, QUALITY
from ...motion.uv_stacks import field_names
from ...progress import Progress
from ..common.connections import end_with_dock
from ..common.docking import Docked
from ..common.progress_bar import ProgressBar
from ..common.threads import Task, tell
from ..views.canvas import open_canvas
from .kymograph_view import KymographDock
from .recording import BOTH, MAIN, SECOND, DrawnRecording, Recording, WindowRecording
from .session import movie_session_of

if TYPE_CHECKING:
    import napari

    from ...motion.kymograph import Kymograph
    from ...motion.movie import Movie

DRAWN = "drawn: "
SHOWN = {
    MAIN: "3D view, as shown",
    SECOND: "unwrapped image, as shown",
    BOTH: "both side by side, as shown",
}
PICTURES = {
    "all": "everything side by side, drawn",
    "surface": "surface, drawn",
    "uv": "uv image, drawn",
    "polar": "polar view, drawn",
    "projection": "surface-limited projection, drawn",
    "kymograph": "kymograph, drawn",
}
MP4, PNG = "MP4", "PNG frames"
WHAT_TIP = (
    "As shown: pictures of the window's canvases, with the view and the layers as they are. "
    "Drawn: on white, with the time, a colour bar and a scale, the same in every frame."
)


class MovieExportDock(Docked):
    """Writes the movie of the viewer into a file, or a folder of frames.

    Parameters
    ----------
    napari_viewer : napari.Viewer
    """

    def __init__(self, napari_viewer: napari.Viewer) -> None:
        super().__init__()
        self.session = movie_session_of(getattr(napari_viewer, "__wrapped__", napari_viewer))
        self.recording: Recording | None = None
        self._task: Task | None = None
        self._build()
        self.export_button.clicked.connect(self._on_export)
        self.cancel_button.clicked.connect(self.cancel)
        self.what_box.currentIndexChanged.connect(self._update)
        self.session.movie_changed.connect(self._update)
        self._update()
        end_with_dock(self)

    def _build(self) -> None:
        self.what_box = QComboBox()
        for key, text in SHOWN.items():
            self.what_box.addItem(text, key)
        for key, text in PICTURES.items():
            self.what_box.addItem(text, DRAWN + key)
        self.what_box.setCurrentIndex(self.what_box.findData(BOTH))
        self.what_box.setToolTip(WHAT_TIP)
        self.format_box = QComboBox()
        self.format_box.addItems([MP4, PNG])
        self.fps_box = QDoubleSpinBox()
        self.fps_box.setRange(0.5, 120.0)
        self.fps_box.setDecimals(1)
        self.fps_box.setValue(FPS)
        self.fps_box.setSuffix(" frames/s")
        self.stamp_box = QCheckBox("Write the time into the picture")
        self.stamp_box.setChecked(True)
        self.export_button = QPushButton("Export…")
        self.cancel_button = QPushButton("Cancel")
        self.cancel_button.setEnabled(False)
        self.bar = ProgressBar()
        self.bar.hide()
        self.status = QLabel()
        self.status.setWordWrap(True)
        form = QFormLayout()
        form.addRow("What", self.what_box)
        form.addRow("Format", self.format_box)
        form.addRow("Speed", self.fps_box)
        form.addRow(self.stamp_box)
        row = QHBoxLayout()
        row.addWidget(self.export_button, 1)
        row.addWidget(self.cancel_button)
        column = QVBoxLayout(self)
        column.addLayout(form)
        column.addLayout(row)
        column.addWidget(self.bar)
        column.addWidget(self.status)
        column.addStretch(1)

    def _update(self, _: Any = None) -> None:
        running = self.recording is not None or self._task is not None
        there = self.session.movie is not None
        self.export_button.setEnabled(there and not running)
        self.cancel_button.setEnabled(self.recording is not None)
        self.stamp_box.setEnabled(not self.what.startswith(DRAWN))
        self.bar.setVisible(running)
        if not there:
            self.status.setText("There is no movie.")
        elif self.status.text() == "There is no movie.":
            self.status.setText("")

    @property
    def what(self) -> str:
        """Which canvas is recorded, or which pictures are drawn."""
        return str(self.what_box.currentData())

    # Exporting ----------------------------------------------------------------------

    def _on_export(self) -> None:
        if self.format_box.currentText() == MP4:
            name, _ = QFileDialog.getSaveFileName(self, "Export movie", "movie.mp4", "MP4 (*.mp4)")
            if name and not name.lower().endswith(".mp4"):
                name += ".mp4"
        else:
            name = QFileDialog.getExistingDirectory(self, "Folder for the frames")
        if name:
            self.export(Path(name))

    def export(self, path: Path) -> None:
        """Record every timepoint whose frame was made.

        Parameters
        ----------
        path : Path
            ``*.mp4``, or an empty folder.
        """
        movie = self.session.movie
        if movie is None or self.recording is not None or self._task is not None:
            return
        self.status.setText("Looking at the frames…")
        self.bar.setRange(0, 0)
        self._task = Task(_made, movie)
        self._task.returned.connect(partial(self._record, movie, path))
        self._task.failed.connect(self._on_failed)
        self._task.start()
        self._update()

    def _record(self, movie: Movie, path: Path, timepoints: list[int]) -> None:
        self._task = None
        try:
            if not timepoints:
                raise InputError("No frame of the movie was made.", hint="Compute it first.")
            recording = self._recording(movie, path, timepoints)
        except (Unwrap3DError, OSError) as error:
            self._on_failed(error)
            return
        self.recording = recording
        self.bar.setRange(0, len(timepoints))
        self.bar.setValue(0)
        recording.progressed.connect(self._on_progress)
        recording.ended.connect(self._on_ended)
        recording.failed.connect(self._on_failed)
        recording.start()
        self._update()

    def _recording(self, movie: Movie, path: Path, timepoints: list[int]) -> Recording:
        common = (timepoints, path, self.fps_box.value(), QUALITY, self)
        if not self.what.startswith(DRAWN):
            return WindowRecording(self.session, self.what, self.stamp_box.isChecked(), *common)
        view = self.what.removeprefix(DRAWN)
        viewer = self.session.viewer
        canvas = None if viewer is None else open_canvas(viewer)
        field = "" if canvas is None else canvas.colouring.field
        limits = None if canvas is None else canvas.colouring.limits
        docks = self.window().findChildren(KymographDock)
        found = next((dock.found for dock in docks if dock.found is not None), None)
        self._progress = Progress()
        prepare = partial(_prepared, movie, view, field, limits, found, self._progress)
        return DrawnRecording(prepare, *common)

    def cancel(self) -> None:
        """Stop; nothing is written."""
        if self.recording is not None:
            self.status.setText("Stopping…")
            progress = getattr(self, "_progress", None)
            if progress is not None:
                progress.cancel()
            self.recording.cancel()

    def _on_progress(self, done: int, count: int) -> None:
        self.bar.setValue(done)
        self.status.setText(f"Frame {done} of {count}")

    def _on_ended(self, path: Path | None) -> None:
        self._forget()
        self.status.setText("Stopped. Nothing was written." if path is None else f"Wrote {path}")

    def _on_failed(self, error: BaseException) -> None:
        self._forget()
        self.status.setText("Nothing was written.")
        tell(error)

    def _forget(self) -> None:
        self._task = None
        if self.recording is not None:
            self.recording.deleteLater()
            self.recording = None
        self._update()


def _made(movie: Movie) -> list[int]:
    """In a thread: a look into as many files."""
    return [timepoint for timepoint in range(len(movie)) if movie.has_frame(timepoint)]


def _prepared(
    movie: Movie,
    view: str,
    field: str,
    limits: tuple[float, float] | None,
    found: Kymograph | None,
    progress: Progress,
) -> Callable[[int], Any]:
    """In a thread: what draws a timepoint. The field and its limits are those of the views."""
    from ...files.movie_pictures import ALL, common_scales, movie_pictures
    from ...motion.projections import Projections

    names = field_names(movie)
    if field not in names:
        field, limits = names[0], None
    scales = common_scales(movie, field, limits=limits, progress=progress.part(0.0, 0.5))
    projections = None
    of_stack = movie.work is not None and isinstance(movie.work.lapse.at(0), Stack)
    if view == "projection" or (view == ALL and of_stack):
        projections = Projections.of(movie, progress=progress.part(0.5, 0.7))
    pictures = movie_pictures(
        movie,
        view,
        field,
        scales=scales,
        projections=projections,
        kymograph=found,
        progress=progress.part(0.7, 1.0),
    )
    return pictures.picture
