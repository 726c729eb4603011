"""The dock "Track plots": what was measured along tracks, drawn; a click selects a track."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from qtpy.QtCore import Qt
from qtpy.QtWidgets import (
    QCheckBox,
    QComboBox,
    QFileDialog,
    QHBoxLayout,
    QLabel,
    QSizePolicy,
    QStackedWidget,
    QVBoxLayout,
)

from ...errors import Unwrap3DError
from ...measuring.plot_kinds import column_label
from ...progress import Progress
from ..common.connections import end_with_dock
from ..common.docking import Docked
from ..common.notice import Notice, small_button
from ..common.threads import tell
from ..common.turns import soon
from ..steps.texts import COLOURS
from .drawn_plot import DrawnPlot
from .run import NO_MOVIE, NO_TRACKS, run_or_tell, track_run_of

if TYPE_CHECKING:
    import napari

    from ...charts import Frame
    from ...measuring.measurements import Measurements

NAME = "Track plots"
TRACKS = "Tracks"
FILES = "Figure (*.svg);;Figure (*.pdf);;Picture (*.png);;Numbers (*.csv);;Numbers (*.parquet)"
NOT_MEASURED = "These tracks were not measured yet."
STALE = "Belongs to other parameters, or to other tracks."
WRITING = "Writing the plot"
# The plots follow the selection and the tracks when they have rested so long.
REST_MS, MEASURE_MS = 30, 600
# Plots that show all things together where none is chosen.
TOGETHER, EVERYTHING = ("aligned", "autocorrelation"), "everything"
PLOT_PAGE, NOTICE_PAGE = 0, 1
TIP = (
    "Click on a curve to select its track; with Ctrl or Shift, to add it. A click beside all "
    "curves selects none. In Series, a double click goes to that time."
)


class TrackPlotsDock(Docked):
    """Draws what was measured along the tracks of a viewer.

    Parameters
    ----------
    napari_viewer : napari.Viewer
    """

    def __init__(self, napari_viewer: napari.Viewer) -> None:
        super().__init__()
        self.viewer = getattr(napari_viewer, "__wrapped__", napari_viewer)
        self.run = track_run_of(napari_viewer)
        self.tracks = self.run.tracks
        self._kinds: dict[str, Any] = {}
        self._filled = ""
        self._choices: dict[str, str] = {}  # by kind: what was chosen last
        self._build()
        self._arrange()
        self._rest = soon(self, self._show, REST_MS)
        self._measure_later = soon(self, self._measure_again, MEASURE_MS)
        self._connect()
        self._show()
        end_with_dock(self)

    # Building ---------------------------------------------------------------------------

    def _build(self) -> None:
        from ...measuring.plots import PLOTS

        self._kinds = dict(PLOTS)
        self.kind_box, self.choice_box = QComboBox(), QComboBox()
        for name, kind in self._kinds.items():
            self.kind_box.addItem(kind.title, name)
            self.kind_box.setItemData(
                self.kind_box.count() - 1, kind.meaning, Qt.ItemDataRole.ToolTipRole
            )
        for box in (self.kind_box, self.choice_box):
            box.setSizeAdjustPolicy(
                QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon
            )
            box.setMinimumContentsLength(8)
        self.kind_box.setToolTip("Which plot is shown.")
        self.choice_box.setToolTip("What is plotted.")
        self.measure_button = small_button("Measure", "Measure the tracks that are shown.")
        self.automatic = QCheckBox("Update automatically")
        self.automatic.setToolTip(
            "Measure anew when tracks are edited or gated, or parameters changed."
        )
        self.export_button = small_button(
            "Export …", "The plot as SVG, PDF or PNG, or the numbers behind it as CSV or Parquet."
        )
        self.plot = DrawnPlot(self.viewer)
        self.plot.setToolTip(TIP)
        self.notice = Notice()
        self.pages = QStackedWidget()
        self.pages.addWidget(self.plot)
        self.pages.addWidget(self.notice)
        self.stale = QLabel(STALE)
        self.stale.setWordWrap(True)
        self.stale.setStyleSheet(f"color: {COLOURS['amber']};")
        self.status = QLabel()
        self.status.setWordWrap(True)
        self.status.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.message = QLabel()
        self.message.setWordWrap(True)
        self.message.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.message.hide()
        self.status.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)

    def _arrange(self) -> None:
        first, second = QHBoxLayout(), QHBoxLayout()
        first.addWidget(self.kind_box, 1)
        first.addWidget(self.choice_box, 1)
        second.addWidget(self.measure_button)
        second.addWidget(self.automatic)
        second.addStretch(1)
        second.addWidget(self.export_button)
        column = QVBoxLayout(self)
        column.addLayout(first)
        column.addLayout(second)
        column.addWidget(self.stale)
        column.addWidget(self.pages, 1)
        column.addWidget(self.status)
        column.addWidget(self.message)

    def _connect(self) -> None:
        self.kind_box.currentIndexChanged.connect(self._on_kind)
        self.choice_box.activated.connect(self._on_choice)
        self.measure_button.clicked.connect(self._on_measure)
        self.automatic.toggled.connect(self._on_automatic)
        self.export_button.clicked.connect(self._on_export)
        self.notice.pressed.connect(self._on_notice)
        self.plot.picked.connect(self._on_picked)
        self.plot.cleared.connect(self._on_cleared)
        self.plot.time_picked.connect(self._on_time)
        self.tracks.measured.connect(self._later)
        self.tracks.selection_changed.connect(self._later)
        self.tracks.shown_changed.connect(self._on_shown)
        self.run.state_changed.connect(self._on_state)
        self.run.progressed.connect(self._on_progress)
        self.run.movies.frame_changed.connect(self._on_frame)

    # What the user does -----------------------------------------------------------------

    @property
    def kind(self) -> str:
        """Which plot is shown."""
        return str(self.kind_box.currentData())

    @property
    def choice(self) -> str:
        """What is plotted; empty for the first thing, or all."""
        return str(self.choice_box.currentData() or "")

    def measure(self) -> None:
        """Measure the tracks that are shown; what is wrong is shown as a notification."""
        run_or_tell(self.run, "measure")

    def _on_measure(self) -> None:
        if self.run.busy_with == "measure":
            self.run.cancel()
        else:
            self.measure()

    def _on_kind(self, _: int) -> None:
        self._say("")
        self._show()

    def _on_choice(self, _: int) -> None:
        self._choices[self.kind] = self.choice
        self._show()

    def _on_automatic(self, _: bool) -> None:
        self._on_shown()

    def _on_notice(self, what: str) -> None:
        if what == TRACKS:
            dock, _ = self.viewer.window.add_plugin_dock_widget("napari-unwrap3d", TRACKS)
            dock.show()
            dock.raise_()
        else:
            self.measure()

    def _on_picked(self, track: int, add: bool) -> None:
        if add:
            self.tracks.toggle(track)
        else:
            self.tracks.select([track])

    def _on_cleared(self) -> None:
        self.tracks.select(())

    def _on_time(self, time_s: float) -> None:
        movie = self.run.movie
        if movie is not None:
            timepoint = round(time_s / movie.time_step_s)
            self.run.movies.set_timepoint(min(max(timepoint, 0), len(movie) - 1))

    def _on_export(self) -> None:
        start = self.kind
        name, chosen = QFileDialog.getSaveFileName(self, "Export plot", start, FILES)
        if name:
            path = Path(name)
            if not path.suffix:
                path = path.with_suffix(chosen[chosen.index("*") + 1 : -1])
            self.export(path)

    def export(self, path: Path) -> None:
        """Write the plot, or the numbers behind it, in a thread; the suffix tells what."""
        measured = self.tracks.measurements
        if measured is None:
            return
        work = partial(_written, measured, self.kind, path, self.tracks.selection, self.choice)
        try:
            self.run.begin(WRITING, work, self._on_written)
        except Unwrap3DError as error:
            tell(error)

    def _on_written(self, path: Path) -> None:
        self._say(f"Written to {path}")

    def _say(self, message: str) -> None:
        """What was done; until something else is looked at."""
        self.message.setText(message)
        self.message.setVisible(bool(message))

    # What is shown ----------------------------------------------------------------------

    def _later(self) -> None:
        self._rest.start()

    def _on_shown(self) -> None:
        self._on_state()
        if self.automatic.isChecked():
            self._measure_later.start()

    def _measure_again(self) -> None:
        """What was measured belongs to something else; wait while something is going on."""
        run = self.run
        if not self.automatic.isChecked() or run.blocked("measure"):
            return
        if run.busy_with:
            self._measure_later.start()
        elif run.failure is None and (not run.is_done("measure") or run.is_stale("measure")):
            self.measure()

    def _on_state(self) -> None:
        measuring = self.run.busy_with == "measure"
        blocked = self.run.blocked("measure")
        self.measure_button.setText("Cancel" if measuring else "Measure")
        self.measure_button.setEnabled(measuring or not (blocked or self.run.busy_with))
        self.stale.setVisible(self.run.is_stale("measure") and not measuring)
        self.export_button.setEnabled(not self.run.busy_with and self._missing() == "")
        if self.automatic.isChecked() and self.run.is_stale("measure"):
            self._measure_later.start()
        self._later()

    def _on_progress(self, what: str, fraction: float, message: str) -> None:
        if what == self.run.busy_with == "measure":
            self.status.setText(f"Measuring, {100 * fraction:.0f} %: {message}".rstrip(": "))

    def _on_frame(self, frame: Frame) -> None:
        self.plot.show_time(frame.time_s)

    def _missing(self) -> str:
        """Why there is nothing to draw, in words for the user; empty where there is something."""
        measured = self.tracks.measurements
        if self.run.movie is None:
            return NO_MOVIE
        if self.tracks.tracks is None:
            return NO_TRACKS
        if measured is None:
            return NOT_MEASURED
        return str(self._kinds[self.kind].missing(measured))

    def _show(self, _: Any = None) -> None:
        measured, missing = self.tracks.measurements, self._missing()
        self.export_button.setEnabled(not self.run.busy_with and missing == "")
        if missing or measured is None:
            self._show_notice(missing)
            return
        self._fill_choices(measured)
        self.pages.setCurrentIndex(PLOT_PAGE)
        self.plot.show_plot(self.kind, measured, self.tracks.selection, self.choice)
        if self.run.movies.frame is not None:
            self.plot.show_time(self.run.movies.frame.time_s)
        self.status.setText(self._says(measured))

    def _show_notice(self, missing: str) -> None:
        self.choice_box.setVisible(False)
        self.plot.show_nothing()
        self.pages.setCurrentIndex(NOTICE_PAGE)
        self.status.setText("")
        if self.run.busy_with == "measure":
            self.notice.wait("Measuring …")
        elif missing == NOT_MEASURED:
            self.notice.say(missing, "Measure", "measure")
        else:
            self.notice.say(missing, "Tracks …" if missing == NO_TRACKS else "", TRACKS)

    def _fill_choices(self, measured: Measurements) -> None:
        """Offer what can be plotted; the same as before stays chosen where it can be."""
        choices = self._kinds[self.kind].choices(measured)
        if choices and self.kind in TOGETHER:
            choices = ("", *choices)
        before = [self.choice_box.itemData(i) for i in range(self.choice_box.count())]
        if before != list(choices) or self._filled != self.kind:
            self._filled = self.kind
            chosen = self._choices.get(self.kind, "")
            self.choice_box.clear()
            for choice in choices:
                self.choice_box.addItem(column_label(choice) if choice else EVERYTHING, choice)
            self.choice_box.setCurrentIndex(max(self.choice_box.findData(chosen), 0))
        self.choice_box.setVisible(bool(choices))

    def _says(self, measured: Measurements) -> str:
        """What is seen, and which tracks are selected."""
        meaning: str = self._kinds[self.kind].meaning
        selected = sorted(self.tracks.selection)
        if not selected:
            return meaning
        some = ", ".join(str(track) for track in selected[:8])
        more = f" and {len(selected) - 8} more" if len(selected) > 8 else ""
        noun = "track" if len(selected) == 1 else "tracks"
        unknown = not set(selected) <= set(measured.tracks.ids.tolist())
        return f"{meaning} Selected: {noun} {some}{more}{' (not measured)' if unknown else ''}."


def _written(
    measured: Measurements,
    kind: str,
    path: Path,
    selection: frozenset[int],
    choice: str,
    progress: Progress,
) -> Path:
    """In a thread."""
    from ...measuring.plot_files import write_plot

    progress.check()
    return write_plot(measured, kind, path, selection, choice)
