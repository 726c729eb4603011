"""Many files, cells and movies at once, with the parameters of the window."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any

from qtpy.QtCore import QEvent, QObject
from qtpy.QtGui import QBrush, QCloseEvent, QColor, QGuiApplication
from qtpy.QtWidgets import (
    QCheckBox,
    QDialog,
    QDoubleSpinBox,
    QFileDialog,
    QFormLayout,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QListWidget,
    QPushButton,
    QSpinBox,
    QTreeWidget,
    QTreeWidgetItem,
    QVBoxLayout,
    QWidget,
)

from ...batch.child import Request
from ...batch.inputs import Reading
from ...parameters import Parameters
from ..common.progress_bar import ProgressBar
from ..movies.source_chooser import TimeStepBox
from ..steps.source_chooser import VoxelSizeBox
from ..steps.texts import COLOURS
from .process import BatchProcess

COLUMNS = ("item", "t", "stage", "state", "s", "reason")
SIZE = (760, 720)
NO_INPUT = "Add files or a folder."
NO_OUTPUT = "Choose a folder for what is made."
STATE_COLOURS = {"failed": COLOURS["red"], "done": COLOURS["green"], "skipped": COLOURS["green"]}


class BatchDialog(QDialog):
    """Chooses what to run on, says what that takes, runs it, and lists what came of it.

    Parameters
    ----------
    parameters : Parameters
        Those of the window.
    parent : QWidget, optional
    """

    def __init__(self, parameters: Parameters, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWindowTitle("Batch")
        self.resize(*SIZE)
        self.parameters = parameters
        self.process: BatchProcess | None = None
        self._rows: dict[int, QTreeWidgetItem] = {}
        self._build()
        self._arrange()
        self._connect()
        self._on_changed()
        if parent is not None:
            parent.window().installEventFilter(self)

    # Building ----------------------------------------------------------------

    def _build(self) -> None:
        self.inputs = QListWidget()
        self.inputs.setSelectionMode(QListWidget.SelectionMode.ExtendedSelection)
        self.inputs.setToolTip(
            "Stacks, label images, masks or meshes; a stack over time is a movie."
        )
        self.inputs.setMaximumHeight(130)
        self.files_button, self.folder_button = QPushButton("Files …"), QPushButton("Folder …")
        self.remove_button = QPushButton("Remove")
        self.timelapse = QCheckBox("The files are the timepoints of one movie")
        self.mask = QCheckBox("Stacks are masks (not 0 is cell)")
        self.every_label = QCheckBox("Label images: one cell for each label")
        self.protrusions = QCheckBox("protrusions")
        self.protrusions.setToolTip("Of cells, and of every timepoint of movies.")
        self.protrusions.setChecked(self.parameters.protrusions.compute)
        self.track, self.measure = QCheckBox("tracks of movies"), QCheckBox("their measurements")
        self.track.setToolTip("Follow what measurement.tracks names: protrusions, or regions.")
        self.measure.setToolTip("Measure the tracks; tables and a report in OUTPUT/measurements.")
        self.time_step, self.voxel_size = TimeStepBox(), VoxelSizeBox()
        self.time_step.setSpecialValueText("as the files say")
        self.output = QLineEdit()
        self.output.setPlaceholderText("folder")
        self.output_button = QPushButton("…")
        self.workers, self.memory = QSpinBox(), QDoubleSpinBox()
        self.workers.setSpecialValueText("automatic")
        self.workers.setToolTip("Processes; automatic: as many as cores and memory allow.")
        self.memory.setSpecialValueText("automatic")
        self.memory.setSuffix(" GB")
        self.memory.setMaximum(10_000.0)
        self.memory.setToolTip("Of each worker; one that takes more is ended.")
        self.command = QLineEdit()
        self.command.setReadOnly(True)
        self.command.setToolTip("Does the same in a terminal, or on a cluster with --scheduler.")
        self.copy_button = QPushButton("Copy")
        self.note, self.message = QLabel(), QLabel()
        for label in (self.note, self.message):
            label.setWordWrap(True)
        self.progress_bar = ProgressBar()
        self.progress_bar.setRange(0, 1000)
        self.table = QTreeWidget()
        self.table.setHeaderLabels(list(COLUMNS))
        self.table.setRootIsDecorated(False)
        self.plan_button, self.start_button = QPushButton("Check"), QPushButton("Start")
        self.plan_button.setToolTip("Open the files, and say what it takes, without doing it.")
        self.start_button.setToolTip("What was made before is not made again.")
        self.cancel_button, self.close_button = QPushButton("Cancel"), QPushButton("Close")

    def _arrange(self) -> None:
        files = QHBoxLayout()
        files.addWidget(self.inputs, 1)
        buttons = QVBoxLayout()
        for button in (self.files_button, self.folder_button, self.remove_button):
            buttons.addWidget(button)
        buttons.addStretch(1)
        files.addLayout(buttons)
        form = QFormLayout()
        for box in (self.timelapse, self.mask, self.every_label):
            form.addRow("", box)
        form.addRow("Time step", self.time_step)
        form.addRow("Voxel size (µm)", self.voxel_size)
        form.addRow("Output", _row(self.output, self.output_button))
        form.addRow("Also", _row(self.protrusions, self.track, self.measure))
        form.addRow("Workers", self.workers)
        form.addRow("Memory of each", self.memory)
        form.addRow("Command", _row(self.command, self.copy_button))
        last = QHBoxLayout()
        last.addStretch(1)
        for button in (self.plan_button, self.start_button, self.cancel_button, self.close_button):
            last.addWidget(button)
        layout = QVBoxLayout(self)
        layout.addLayout(files)
        layout.addLayout(form)
        layout.addWidget(self.note)
        layout.addWidget(self.progress_bar)
        layout.addWidget(self.table, 1)
        layout.addWidget(self.message)
        layout.addLayout(last)

    def _connect(self) -> None:
        self.files_button.clicked.connect(self._on_files)
        self.folder_button.clicked.connect(self._on_folder)
        self.remove_button.clicked.connect(self._on_remove)
        self.output_button.clicked.connect(self._on_output)
        self.copy_button.clicked.connect(self._on_copy)
        self.plan_button.clicked.connect(self.plan)
        self.start_button.clicked.connect(self.start)
        self.cancel_button.clicked.connect(self.cancel)
        self.close_button.clicked.connect(self.close)
        marks = (self.timelapse, self.mask, self.every_label)
        self.measure.toggled.connect(self._on_measure)
        for box in (*marks, self.protrusions, self.track, self.measure):
            box.toggled.connect(self._on_changed)
        for number in (*self.voxel_size.boxes, self.time_step, self.workers, self.memory):
            number.valueChanged.connect(self._on_changed)
        self.output.textChanged.connect(self._on_changed)

    # What the user does ------------------------------------------------------

    def add(self, paths: list[str]) -> None:
        """Add files, folders or patterns."""
        self.inputs.addItems(paths)
        if paths and not self.output.text():
            self.output.setText(str(Path(paths[0]).parent / "unwrap3d-batch"))
        self._on_changed()

    def request(self, *, plan_only: bool = False) -> Request:
        """What is asked for."""
        return Request(
            inputs=[self.inputs.item(row).text() for row in range(self.inputs.count())],
            output=self.output.text().strip(),
            parameters=self._chosen_parameters().to_toml(),
            reading=Reading(
                voxel_size=self.voxel_size.value,
                time_step=self.time_step.value() or None,
                mask=self.mask.isChecked(),
            ),
            timelapse=self.timelapse.isChecked(),
            every_label=self.every_label.isChecked(),
            track=self.track.isChecked(),
            measure=self.measure.isChecked(),
            workers=self.workers.value() or None,
            memory_gb=self.memory.value() or None,
            plan_only=plan_only,
        )

    def _chosen_parameters(self) -> Parameters:
        """Those of the window, with protrusions as they are ticked here."""
        wanted = {"compute": self.protrusions.isChecked()}
        protrusions = self.parameters.protrusions.model_copy(update=wanted)
        return self.parameters.model_copy(update={"protrusions": protrusions})

    def plan(self) -> None:
        """Say what it takes."""
        self._start(self.request(plan_only=True))

    def start(self) -> None:
        """Run it."""
        self.table.clear()
        self._rows.clear()
        self._start(self.request())

    def cancel(self) -> None:
        """Stop it; what was made stays."""
        if self.process is not None:
            self.message.setText("Cancelling …")
            self.process.cancel()

    def _start(self, request: Request) -> None:
        self.message.setText("Looking at the files …")
        self.note.setText("")
        self.progress_bar.setValue(0)
        self.process = BatchProcess(request, self)
        self.process.told.connect(self._on_told)
        self.process.ended.connect(self._on_ended)
        self.process.start()
        self._on_changed()

    def _on_files(self) -> None:
        names, _ = QFileDialog.getOpenFileNames(self, "Files of the batch")
        self.add(names)

    def _on_folder(self) -> None:
        name = QFileDialog.getExistingDirectory(self, "Folder of the batch")
        self.add([name] if name else [])

    def _on_remove(self) -> None:
        for item in self.inputs.selectedItems():
            self.inputs.takeItem(self.inputs.row(item))
        self._on_changed()

    def _on_output(self) -> None:
        name = QFileDialog.getExistingDirectory(self, "Folder for what is made")
        if name:
            self.output.setText(name)

    def _on_copy(self) -> None:
        clipboard = QGuiApplication.clipboard()
        if clipboard is not None:
            clipboard.setText(self.command.text())

    def _on_measure(self, wanted: bool) -> None:
        """What is measured is tracked."""
        self.track.setChecked(wanted or self.track.isChecked())
        self.track.setEnabled(not wanted)

    def _on_changed(self, _: Any = None) -> None:
        request, running = self.request(), self.process is not None
        missing = NO_INPUT if not request.inputs else "" if request.output else NO_OUTPUT
        self.command.setText("" if missing else shlex.join(request.command()))
        self.command.setCursorPosition(0)
        if missing:
            self.message.setText(missing)
        elif self.message.text() in (NO_INPUT, NO_OUTPUT):
            self.message.setText("")
        for button in (self.plan_button, self.start_button):
            button.setEnabled(not running and not missing)
        self.copy_button.setEnabled(not missing)
        self.cancel_button.setEnabled(running)
        self.progress_bar.setVisible(running)

    # What the process says ---------------------------------------------------

    def _on_told(self, message: dict[str, Any]) -> None:
        kind = message["kind"]
        if kind == "plan":
            self.note.setText(message["text"])
        elif kind == "progress":
            self.progress_bar.setValue(round(1000 * message["fraction"]))
            self.message.setText(message["text"])
        elif kind == "rows":
            for place, row in message["rows"]:
                self._show_row(place, row)
        elif kind == "result":
            where = f"See summary.csv in {self.output.text().strip()}."
            self.message.setText(f"{message['text']}. {where}")

    def _show_row(self, place: int, row: dict[str, Any]) -> None:
        item = self._rows.get(place)
        if item is None:
            item = self._rows[place] = QTreeWidgetItem()
            self.table.addTopLevelItem(item)
        label = "" if row["label"] is None else f" (label {row['label']})"
        timepoint = "" if row["timepoint"] is None else str(row["timepoint"])
        seconds = f"{row['seconds']:.1f}" if row["seconds"] else ""
        texts = (f"{row['name']}{label}", timepoint, row["stage"], row["state"], seconds)
        for column, text in enumerate((*texts, row["reason"])):
            item.setText(column, text)
        item.setToolTip(len(COLUMNS) - 1, row["reason"])
        colour = STATE_COLOURS.get(row["state"])
        if colour is not None:
            item.setForeground(3, QBrush(QColor(colour)))

    def _on_ended(self, reason: str) -> None:
        if reason:
            self.message.setText(reason)
        elif self.message.text().startswith("Looking"):
            self.message.setText("")
        if self.process is not None:
            self.process.deleteLater()
        self.process = None
        self._on_changed()

    # The end -----------------------------------------------------------------

    def closeEvent(self, event: QCloseEvent | None) -> None:
        """Stop what is running."""
        self._end()
        if event is not None:
            super().closeEvent(event)

    def eventFilter(self, watched: QObject | None, event: QEvent | None) -> bool:
        """The window closes: leave no process behind."""
        if event is not None and event.type() == QEvent.Type.Close:
            self._end()
        return False

    def _end(self) -> None:
        if self.process is not None:
            self.process.close()
            self.process = None


def _row(*widgets: QWidget) -> QWidget:
    """Widgets side by side."""
    both = QWidget()
    row = QHBoxLayout(both)
    row.setContentsMargins(0, 0, 0, 0)
    for widget in widgets:
        row.addWidget(widget)
    return both
