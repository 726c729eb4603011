"""The dock "Tracks", and the page of the wizard: follow, keep some, measure; read and write."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from qtpy.QtCore import Qt
from qtpy.QtWidgets import (
    QComboBox,
    QHBoxLayout,
    QLabel,
    QMenu,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from ...charts import Frame
from ..common.connections import end_with_dock
from ..common.docking import Docked
from ..common.notice import small_button
from ..common.progress_bar import ProgressBar
from ..steps.panel import WIDTH, scrolling
from .files import (
    ask_export,
    ask_file,
    ask_folder,
    ask_how,
    export_tracks,
    import_tracks,
)
from .run import NO_MOVIE, WORKS, track_run_of
from .sections import GateSection, Numbers, WorkSection, headed, offered_fields

if TYPE_CHECKING:
    import napari

NAME = "Tracks"
PLUGIN = "napari-unwrap3d"
# Docks that show what is made here, as the manifest has them.
PLOTS, TABLE = "Track plots", "Tracks table"
NONE_YET = "none yet"


class TracksPanel(QWidget):
    """Everything about the tracks of a viewer; several of them show the same.

    Attributes
    ----------
    sections : dict
        Piece of work → its section, in order.
    """

    def __init__(self, viewer: Any, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.viewer = getattr(viewer, "__wrapped__", viewer)
        self.run = track_run_of(viewer)
        self.tracks = self.run.tracks
        self._offered: tuple[Any, ...] = ()
        self._build()
        self._arrange()
        self._connect()
        self._on_names()
        self._on_state()
        self._offer()

    # Building ---------------------------------------------------------------------------

    def _build(self) -> None:
        self.names_box = QComboBox()
        self.names_box.setToolTip("Which tracks of the movie are shown.")
        self.import_button = small_button(
            "Import …", "Lay tracks that were made elsewhere on the surface: GEFF, TrackMate, CSV."
        )
        self.export_button = small_button(
            "Export …", "The tracks that are shown as GEFF, TrackMate XML, CSV or Parquet."
        )
        menu = QMenu(self)
        menu.addAction("File …", lambda: self._on_import(ask_file))
        menu.addAction("GEFF folder …", lambda: self._on_import(ask_folder))
        self.import_button.setMenu(menu)
        self.sections = {work: WorkSection(self.run, work) for work in WORKS}
        self.gate, self.numbers = GateSection(self.viewer), Numbers(self.run)
        self.plots_button = QPushButton(PLOTS)
        self.plots_button.setToolTip("Series, events, histograms and correlations.")
        self.table_button = QPushButton(TABLE)
        self.table_button.setToolTip("A row for each track.")
        self.progress_bar = ProgressBar()
        self.progress_bar.setRange(0, 1000)
        self.cancel_button = QPushButton("Cancel")
        self.cancel_button.setToolTip("Stop; the tracks stay as they were.")
        self.message = QLabel()
        self.message.setWordWrap(True)
        self.message.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)

    def _arrange(self) -> None:
        parts = QWidget()
        column = QVBoxLayout(parts)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(3)
        for work, section in self.sections.items():
            if work == "measure":
                column.addWidget(headed("Which are kept", self.gate))
            column.addWidget(section)
        self.numbers_part = headed("Numbers", self.numbers)
        column.addWidget(self.numbers_part)
        column.addStretch(1)
        first, second, last = QHBoxLayout(), QHBoxLayout(), QHBoxLayout()
        first.addWidget(self.names_box, 1)
        first.addWidget(self.import_button)
        first.addWidget(self.export_button)
        second.addWidget(self.progress_bar, 1)
        second.addWidget(self.cancel_button)
        last.addWidget(self.plots_button, 1)
        last.addWidget(self.table_button, 1)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(6, 6, 6, 6)
        layout.addLayout(first)
        layout.addWidget(scrolling(parts), 1)
        layout.addLayout(second)
        layout.addWidget(self.message)
        layout.addLayout(last)
        self.setMinimumWidth(WIDTH)

    def _connect(self) -> None:
        self.names_box.activated.connect(self._on_chosen)
        self.export_button.clicked.connect(self._on_export)
        self.cancel_button.clicked.connect(self._on_cancel)
        self.plots_button.clicked.connect(lambda: self.open_dock(PLOTS))
        self.table_button.clicked.connect(lambda: self.open_dock(TABLE))
        self.run.state_changed.connect(self._on_state)
        self.run.progressed.connect(self._on_progress)
        self.run.told.connect(self._say)
        self.tracks.names_changed.connect(self._on_names)
        self.tracks.tracks_changed.connect(self._on_names)
        self.run.movies.frame_changed.connect(self._offer)
        self.gate.gate.listed.connect(self._offer)

    # What the user does -----------------------------------------------------------------

    def _on_chosen(self, _: int) -> None:
        name = self.names_box.currentData()
        if name and name != self.tracks.name:
            self.tracks.open(name)

    def _on_cancel(self) -> None:
        self._say("Cancelling …")
        self.run.cancel()

    def _on_import(self, ask: Callable[[QWidget], Path | None]) -> None:
        path = ask(self)
        wanted = None if path is None else ask_how(self, self.run, path)
        if wanted is not None:
            import_tracks(self.run, wanted)

    def _on_export(self) -> None:
        path = ask_export(self, self.run)
        if path is not None:
            self.export(path)

    def export(self, path: Path) -> None:
        """Write the tracks that are shown; the suffix tells how."""
        export_tracks(self.run, path)

    def open_dock(self, name: str) -> None:
        """Open a dock of ours, or bring it to the front."""
        dock, _ = self.viewer.window.add_plugin_dock_widget(PLUGIN, name)
        dock.show()
        dock.raise_()

    # What is going on -------------------------------------------------------------------

    def _on_names(self) -> None:
        shown = self.tracks.name
        names = [*self.tracks.names, *([shown] if shown not in ("", *self.tracks.names) else [])]
        self.names_box.clear()
        for name in names:
            self.names_box.addItem(_title(name), name)
        if not names:
            self.names_box.addItem(NONE_YET, "")
        self.names_box.setCurrentIndex(max(self.names_box.findData(shown), 0))
        self.names_box.setEnabled(bool(names))
        self._on_state()

    def _on_state(self) -> None:
        busy = bool(self.run.busy_with)
        there = self.run.movie is not None
        # The sections show their own.
        file = busy and self.run.busy_with not in WORKS
        self.progress_bar.setVisible(file)
        self.cancel_button.setVisible(file)
        if not file:
            self.progress_bar.setValue(0)
        self.progress_bar.setFormat(self.run.busy_with)
        self.numbers_part.setVisible(self.tracks.tracks is not None)
        self.import_button.setEnabled(there and not busy)
        self.export_button.setEnabled(self.tracks.shown is not None and not busy)
        if not there:
            self._say(NO_MOVIE)
        elif self.message.text() == NO_MOVIE:
            self._say("")

    def _on_progress(self, what: str, fraction: float, _: str) -> None:
        if what == self.run.busy_with:
            self.progress_bar.setValue(round(1000 * fraction))

    def _offer(self, _: Any = None) -> None:
        """Names of fields and annotations, where one is typed."""
        frame: Frame | None = self.run.movies.frame
        offered: tuple[Iterable[str], ...] = (offered_fields(frame), self.gate.gate.names)
        if offered != self._offered:
            self._offered = offered
            for section in self.sections.values():
                section.offer(*offered)

    def _say(self, message: str) -> None:
        self.message.setText(message)
        self.message.setVisible(bool(message))


class TracksDock(Docked):
    """The panel of the tracks in a dock of its own."""

    def __init__(self, napari_viewer: napari.Viewer) -> None:
        super().__init__()
        self.panel = TracksPanel(napari_viewer)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.panel)
        self.setMinimumWidth(WIDTH)
        end_with_dock(self)


def _title(name: str) -> str:
    """Tracks, as they are called in the list."""
    return {"protrusions": "Protrusions", "flow": "Flow regions"}.get(name, name)
