"""What the annotations measure, where to write them, and the plane of a label."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from qtpy.QtCore import Qt
from qtpy.QtWidgets import (
    QAbstractItemView,
    QComboBox,
    QFileDialog,
    QGroupBox,
    QHBoxLayout,
    QHeaderView,
    QLabel,
    QPushButton,
    QSizePolicy,
    QTableWidget,
    QTableWidgetItem,
    QVBoxLayout,
    QWidget,
)

from ...annotations import Annotations, fit_plane, label_rows
from ...errors import Unwrap3DError
from ...fields import KNOWN
from ...files.annotation_export import export_annotations
from ..common.threads import Task, tell
from ..common.turns import soon
from .arrows import LENGTH_SHARE, direction_text, show_arrow

if TYPE_CHECKING:
    from .annotating import Annotating

DELAY_MS = 400
ROWS_SHOWN = 5
AXIS_TEXT = "Axis of lateral speeds:"
TITLES = {"annotation": "Annotation", "label": "Label", "area_um2": "Area (µm²)"}
MEAN, PREFIX = "Mean", "mean_"
MEANING = "Mean over the label, weighted by area."
# Endings of the names of fields → what stands in brackets below.
UNITS = {"_per_um": "1/µm", "_um2": "µm²", "_um": "µm"}


class MeasuresBox(QGroupBox):
    """A row per annotation and label; export, and the plane that fits a label.

    Parameters
    ----------
    annotating : Annotating
    """

    def __init__(self, annotating: Annotating, parent: QWidget | None = None) -> None:
        super().__init__("Measured on the surface", parent)
        self._annotating = annotating
        self._task: Task | None = None
        self._rows: list[dict[str, Any]] = []
        self._exporting: Task | None = None
        self._normal: tuple[float, float, float] | None = None
        self.table = QTableWidget()
        self.table.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        self.table.setToolTip("Areas and means are free of the distortion of the images.")
        self.table.verticalHeader().hide()
        # All means beside each other would not fit into a dock: one is shown, all are exported.
        self.mean_box = QComboBox()
        self.mean_box.setToolTip("The mean of what is shown in the last column.")
        self.mean_box.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
        self.table.setColumnCount(len(TITLES) + 1)
        self.table.setHorizontalHeaderLabels([*TITLES.values(), MEAN])
        self.table.horizontalHeaderItem(len(TITLES)).setToolTip(MEANING)
        self.table.horizontalHeader().setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        self.table.horizontalHeader().setSectionResizeMode(0, QHeaderView.ResizeMode.Stretch)
        self.table.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.table.setFixedHeight((ROWS_SHOWN + 2) * (self.table.fontMetrics().height() + 10))
        self.export_button = QPushButton("Export …")
        self.export_button.setToolTip(
            "Label images of every chart, labels per vertex, and tables, into a folder."
        )
        self.plane_button = QPushButton("Fit plane")
        self.plane_button.setToolTip(
            "Fit a plane to the current label, e.g. of “cell bottom”, and show its normal."
        )
        self.axis_button = QPushButton("Use as axis")
        self.axis_button.setToolTip(
            "Keep the plane's normal with the cell, as the axis of lateral speeds."
        )
        self.axis_button.setEnabled(False)
        self.clear_button = QPushButton("No axis")
        self.clear_button.setToolTip("Take the axis of lateral speeds away.")
        self.axis_text = QLabel()
        self.axis_text.setWordWrap(True)
        self.result = QLabel()
        self.result.setWordWrap(True)
        self.result.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        buttons = QHBoxLayout()
        buttons.addWidget(self.export_button)
        buttons.addWidget(self.plane_button)
        buttons.addWidget(self.axis_button)
        column = QVBoxLayout(self)
        mean = QHBoxLayout()
        mean.addWidget(QLabel("Mean of"))
        mean.addWidget(self.mean_box, 1)
        column.addLayout(mean)
        column.addWidget(self.table)
        column.addLayout(buttons)
        column.addWidget(self.result)
        column.addWidget(self.axis_text)
        column.addWidget(self.clear_button)
        self._timer = soon(self, self.measure, DELAY_MS)
        self.mean_box.currentIndexChanged.connect(self._fill)
        self.export_button.clicked.connect(self._on_export)
        self.plane_button.clicked.connect(self.fit)
        self.axis_button.clicked.connect(self.use_axis)
        self.clear_button.clicked.connect(self._on_clear_axis)
        annotating.edited.connect(self._update_axis)
        annotating.edited.connect(self._timer.start)
        annotating.listed.connect(self._on_listed)
        self._on_listed()

    def _on_listed(self) -> None:
        drawn = bool(self._annotating.names)
        self.setEnabled(drawn)
        self.result.setText("")
        self._normal = None
        self.axis_button.setEnabled(False)
        self._update_axis()
        self._timer.start()

    # The table -----------------------------------------------------------------------

    def measure(self) -> None:
        """Measure every label, in a thread."""
        if self._task is not None or self._annotating.atlas is None:
            return
        self._task = Task(label_rows, self._annotating.annotations)
        self._task.returned.connect(self._on_measured)
        self._task.failed.connect(self._on_failed)
        self._task.start()

    def _on_measured(self, rows: list[dict[str, Any]]) -> None:
        self._task = None
        self._rows = rows
        means = [key for key in (rows[0] if rows else {}) if key.startswith(PREFIX)]
        if means and means != [self.mean_box.itemData(k) for k in range(self.mean_box.count())]:
            chosen = self.mean_box.currentData()
            blocked = self.mean_box.blockSignals(True)
            self.mean_box.clear()
            for key in means:
                self.mean_box.addItem(_mean_title(key), key)
            self.mean_box.setCurrentIndex(max(self.mean_box.findData(chosen), 0))
            self.mean_box.blockSignals(blocked)
        self._fill()

    def _fill(self, _: int = 0) -> None:
        """Show what was measured, with the mean that is chosen."""
        columns = [*TITLES, self.mean_box.currentData()]
        self.table.setRowCount(len(self._rows))
        for line, row in enumerate(self._rows):
            for place, key in enumerate(columns):
                self.table.setItem(line, place, _item(row.get(key, "")))

    def _on_failed(self, error: BaseException) -> None:
        self._task = self._exporting = None
        self._on_exporting(False)
        if self._annotating.atlas is not None:
            tell(error)

    # Export --------------------------------------------------------------------------

    def _on_export(self) -> None:
        name = QFileDialog.getExistingDirectory(self, "Export annotations into a new folder")
        if name:
            self.export(name)

    def export(self, folder: str | Path) -> None:
        """Write everything into a folder, in a thread."""
        self._exporting = Task(_export, self._annotating.annotations, folder)
        self._exporting.returned.connect(self._on_exported)
        self._exporting.failed.connect(self._on_failed)
        self._exporting.start()
        self._on_exporting(True)

    def _on_exporting(self, running: bool) -> None:
        self.export_button.setEnabled(not running)

    def _on_exported(self, files: list[Path]) -> None:
        self._exporting = None
        self._on_exporting(False)
        self.result.setText(f"Wrote {len(files)} files into {files[0].parent}.")

    # The plane -----------------------------------------------------------------------

    def fit(self) -> None:
        """Fit a plane to the current label, and show its normal in the main canvas."""
        name, label = self._annotating.current, self._annotating.label
        try:
            plane = fit_plane(self._annotating.annotations, name, label)
        except Unwrap3DError as error:
            tell(error)
            return
        self._normal = plane.normal
        self.axis_button.setEnabled(True)
        self.result.setText(
            f"Plane of “{name}”, label {label}: normal {direction_text(plane.normal)}; "
            f"{plane.area_um2:.4g} µm² lie {plane.rms_um:.3g} µm (RMS) off it."
        )
        viewer, atlas = self._annotating.viewer, self._annotating.atlas
        if viewer is not None and atlas is not None:
            length = LENGTH_SHARE * float(np.ptp(atlas.surface.vertices, axis=0).max())
            arrow = np.multiply(length, plane.normal)
            show_arrow(viewer, f"normal of {name}", plane.centroid_um, arrow, "#ffd54f")

    # The axis ------------------------------------------------------------------------

    def use_axis(self) -> None:
        """Keep the normal of the plane that was fitted last as the axis of lateral speeds."""
        if self._normal is not None:
            self._annotating.annotations.axis = self._normal
            self._annotating.edited.emit()

    def _on_clear_axis(self) -> None:
        self._annotating.annotations.axis = None
        self._annotating.edited.emit()

    def _update_axis(self) -> None:
        there = self._annotating.atlas is not None
        axis = self._annotating.annotations.axis if there else None
        self.axis_text.setText("" if axis is None else f"{AXIS_TEXT} {direction_text(axis)}.")
        for widget in (self.axis_text, self.clear_button):
            widget.setVisible(axis is not None)


def _export(annotations: Annotations, folder: str | Path) -> list[Path]:
    return export_annotations(annotations, folder)


def _mean_title(column: str) -> str:
    """What a person reads for a mean, with its unit."""
    name = column.removeprefix(PREFIX)
    if name in KNOWN:
        title, unit = KNOWN[name]
        return f"{title} ({unit})" if unit else title
    unit = next((unit for ending, unit in UNITS.items() if name.endswith(ending)), "")
    ending = next((ending for ending in UNITS if name.endswith(ending)), "")
    title = name.removesuffix(ending).replace("_", " ").capitalize()
    return f"{title} ({unit})" if unit else title


def _item(value: Any) -> QTableWidgetItem:
    number = isinstance(value, int | float)
    item = QTableWidgetItem(f"{value:.4g}" if isinstance(value, float) else str(value))
    if number:
        item.setTextAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
    return item
