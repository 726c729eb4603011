"""The dock widget "Movie", and the page of the wizard: from a timelapse to its movie."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from qtpy.QtCore import Qt
from qtpy.QtWidgets import (
    QFileDialog,
    QHBoxLayout,
    QLabel,
    QMenu,
    QPushButton,
    QTreeWidget,
    QTreeWidgetItem,
    QVBoxLayout,
    QWidget,
)

from ...errors import Unwrap3DError
from ...files.project import SUFFIX
from ..common.connections import end_with_dock
from ..common.docking import Docked
from ..common.progress_bar import ProgressBar
from ..common.threads import tell
from ..steps.panel import WIDTH, scrolling
from .project import open_movie, save_movie
from .run import STAGES, movie_run_of
from .sections import TITLES, FramesSection, go_to, make_section, run_or_tell
from .session import movie_session_of
from .source_chooser import MovieSourceChooser

if TYPE_CHECKING:
    import napari

    from ...charts import Frame

NAME = "Movie"
FILES = f"unwrap3d movie (*{SUFFIX} movie.json)"
SAVED_FILES = f"unwrap3d movie (*{SUFFIX})"
FAILURES_HEIGHT = 110


class MoviePanel(QWidget):
    """Everything about the movie of a viewer; several of them show the same.

    Attributes
    ----------
    sections : dict
        Stage → its section, in order.
    failures : QTreeWidget
        Timepoints that failed, with the stage and the reason.
    """

    def __init__(self, viewer: Any, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.viewer = getattr(viewer, "__wrapped__", viewer)
        self.run = movie_run_of(viewer)
        self.movies = movie_session_of(viewer)
        self._build()
        self._arrange()
        self._connect()
        self._on_running(self.run.running)
        self._on_movie()

    # Building ----------------------------------------------------------------

    def _build(self) -> None:
        self.chooser = MovieSourceChooser(self.run)
        self.sections = {stage: make_section(self.run, stage) for stage in STAGES}
        self.failures = QTreeWidget()
        self.failures.setHeaderLabels(["t", "stage", "reason"])
        self.failures.setRootIsDecorated(False)
        self.failures.setMaximumHeight(FAILURES_HEIGHT)
        self.failures.setWordWrap(True)
        self.failures.setToolTip("Timepoints that failed; the others go on without them.")
        self.progress_bar = ProgressBar()
        self.progress_bar.setRange(0, 1000)
        self.message = QLabel()
        self.message.setWordWrap(True)
        self.message.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.run_button, self.cancel_button = QPushButton("Run all"), QPushButton("Cancel")
        self.run_button.setToolTip("Make everything that is missing or out of date.")
        self.cancel_button.setToolTip("Stop; what was made stays.")
        self.open_button, self.save_button = QPushButton("Open …"), QPushButton("Save …")
        self.open_button.setToolTip("Open a movie: its *.unwrap3d file, or its folder.")
        self.save_button.setToolTip("The whole movie in one *.unwrap3d file.")
        self.batch_button = QPushButton("Batch …")
        self.batch_button.setToolTip("Run many files or cells with these parameters.")
        menu = QMenu(self)
        menu.addAction("File …", self._on_open_file)
        menu.addAction("Folder …", self._on_open_folder)
        self.open_button.setMenu(menu)

    def _arrange(self) -> None:
        sections = QWidget()
        column = QVBoxLayout(sections)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(3)
        for section in self.sections.values():
            column.addWidget(section)
        column.addStretch(1)
        first, second = QHBoxLayout(), QHBoxLayout()
        first.addWidget(self.run_button, 1)
        first.addWidget(self.cancel_button)
        for button in (self.open_button, self.save_button, self.batch_button):
            second.addWidget(button, 1)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(6, 6, 6, 6)
        layout.addWidget(self.chooser)
        layout.addWidget(scrolling(sections), 1)
        for widget in (self.failures, self.progress_bar, self.message):
            layout.addWidget(widget)
        layout.addLayout(first)
        layout.addLayout(second)
        self.setMinimumWidth(WIDTH)

    def _connect(self) -> None:
        self.run_button.clicked.connect(self._on_run)
        self.cancel_button.clicked.connect(self._on_cancel)
        self.save_button.clicked.connect(self._on_save)
        self.batch_button.clicked.connect(self._on_batch)
        self.failures.itemActivated.connect(self._on_failure)
        self.run.running_changed.connect(self._on_running)
        self.run.progressed.connect(self._on_progress)
        self.run.state_changed.connect(self._on_state)
        self.run.source_changed.connect(self._on_state)
        self.run.movie_changed.connect(self._on_movie)
        self.run.told.connect(self._say)
        self.movies.frame_changed.connect(self._on_frame)
        for section in self.sections.values():
            section.picked.connect(self._on_picked)

    # What the user does ------------------------------------------------------

    def _on_run(self) -> None:
        run_or_tell(self.run, "frame")

    def _on_cancel(self) -> None:
        self._say("Cancelling …")
        self.run.cancel()

    def _on_picked(self, timepoint: int) -> None:
        go_to(self.run, timepoint)

    def _on_failure(self, item: QTreeWidgetItem, _: int) -> None:
        go_to(self.run, int(item.text(0)))

    def open(self, path: str | Path) -> None:
        """Open a movie; what is wrong is shown as a notification."""
        try:
            open_movie(self.viewer, path)
        except Unwrap3DError as error:
            tell(error)

    def save(self, path: str | Path) -> None:
        """Save the movie in a thread; what is wrong is shown as a notification."""
        try:
            save_movie(self.viewer, path)
        except Unwrap3DError as error:
            tell(error)

    def _on_open_file(self) -> None:
        name, _ = QFileDialog.getOpenFileName(self, "Open movie", "", FILES)
        if name:
            path = Path(name)
            self.open(path if path.suffix == SUFFIX else path.parent)

    def _on_open_folder(self) -> None:
        name = QFileDialog.getExistingDirectory(self, "Open the folder of a movie")
        if name:
            self.open(name)

    def _on_save(self) -> None:
        start = f"{self.run.movie.name if self.run.movie else 'movie'}{SUFFIX}"
        name, _ = QFileDialog.getSaveFileName(self, "Save movie", start, SAVED_FILES)
        if name:
            self.save(name)

    def _on_batch(self) -> None:
        # The options of a batch bring libraries of their own.
        from ..batch.dialog import BatchDialog

        dialog = BatchDialog(self.run.parameters, self)
        dialog.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        dialog.show()

    # What the run says -------------------------------------------------------

    def _on_running(self, running: bool) -> None:
        self.progress_bar.setValue(0)
        self.progress_bar.setFormat("starting")
        if running:
            self._say("")
        self._on_state()

    def _on_state(self) -> None:
        busy = self.run.running or bool(self.run.busy_with)
        self.progress_bar.setVisible(busy)
        self.cancel_button.setEnabled(busy)
        self.run_button.setEnabled(not busy and not self.run.chosen.blocked())
        self.save_button.setEnabled(not busy and self.run.movie is not None)
        self.open_button.setEnabled(not busy)
        self._show_failures()

    def _show_failures(self) -> None:
        if self.failures.topLevelItemCount() == len(self.run.failures):
            self.failures.setVisible(bool(self.run.failures))
            return
        self.failures.clear()
        for failure in self.run.failures:
            texts = [str(failure.timepoint), TITLES[failure.stage], failure.reason]
            item = QTreeWidgetItem(texts)
            item.setToolTip(2, failure.reason)
            self.failures.addTopLevelItem(item)
        self.failures.setVisible(bool(self.run.failures))
        for narrow in (0, 1):
            self.failures.resizeColumnToContents(narrow)

    def _on_progress(self, stage: str, timepoint: int, fraction: float, message: str) -> None:
        if stage in TITLES:
            part = f"{STAGES.index(stage) + 1}/{len(STAGES)} {TITLES[stage]}"
            done = (STAGES.index(stage) + fraction) / len(STAGES)
            left = self.run.seconds_left(stage, fraction)
            tail = "" if left is None else f", {duration(left)} left of it"
            self.progress_bar.setValue(round(1000 * done))
            self.progress_bar.setFormat(f"{part}{tail}")
        else:
            self.progress_bar.setValue(round(1000 * fraction))
            self.progress_bar.setFormat(message or self.run.busy_with)

    def _on_movie(self) -> None:
        shown = self.movies.frame
        if shown is not None:
            self._on_frame(shown)
        self._on_state()

    def _on_frame(self, frame: Frame) -> None:
        for section in self.sections.values():
            section.plot.show_timepoint(frame.timepoint)
        frames = self.sections["frame"]
        assert isinstance(frames, FramesSection)
        frames.show_timepoint(frame.timepoint)

    def _say(self, message: str) -> None:
        self.message.setText(message)
        self.message.setVisible(bool(message))


class MovieDock(Docked):
    """The panel of the movie in a dock of its own."""

    def __init__(self, napari_viewer: napari.Viewer) -> None:
        super().__init__()
        self.panel = MoviePanel(napari_viewer)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.panel)
        self.setMinimumWidth(WIDTH)
        end_with_dock(self)


def duration(seconds: float) -> str:
    """A time that is left, as people say it."""
    if seconds < 90:
        return f"{max(round(seconds), 1)} s"
    minutes = seconds / 60
    return f"{round(minutes)} min" if minutes < 90 else f"{minutes / 60:.1f} h"


def open_movie_panel(viewer: Any) -> MoviePanel:
    """The panel of a window's movie, opened as a page of the wizard if it is not there yet."""
    from ..wizard import open_wizard

    viewer = getattr(viewer, "__wrapped__", viewer)
    docks = viewer.window._qt_window.findChildren(MovieDock)
    if docks:
        panel: MoviePanel = docks[0].panel
        return panel
    return open_wizard(viewer).show_movie()
