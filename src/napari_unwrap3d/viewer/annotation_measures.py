"""What the annotations measure, where to write them, and the plane of a label."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from qtpy.QtCore import Qt, QTimer
from qtpy.QtWidgets import (
    QAbstractItemView,
    QFileDialog,
    QGroupBox,
    QHBoxLayout,
    QLabel,
    QPushButton,
    QTableWidget,
    QTableWidgetItem,
    QVBoxLayout,
    QWidget,
)

from ..annotations import Annotations, fit_plane, label_rows
from ..errors import Unwrap3DError
from ..files.annotation_export import export_annotations
from .layers import KEY, SPACE, UNIT
from .placing import chart_of
from .threads import Task, tell

if TYPE_CHECKING:
    from .annotating import Annotating

DELAY_MS = 400
ROWS_SHOWN = 5
NORMAL_SHARE = 0.4
ARROW = 8.0
TITLES = {"annotation": "Annotation", "label": "Label", "area_um2": "Area\n(µm²)"}
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
        self._exporting: Task | None = None
        self.table = QTableWidget()
        self.table.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        self.table.setToolTip("Areas and means are free of the distortion of the images.")
        self.table.verticalHeader().hide()
        self.table.setFixedHeight((ROWS_SHOWN + 2) * (self.table.fontMetrics().height() + 10))
        self.export_button = QPushButton("Export …")
        self.export_button.setToolTip(
            "Label images of every chart, labels per vertex, and tables, into a folder."
        )
        self.plane_button = QPushButton("Fit plane")
        self.plane_button.setToolTip(
            "Fit a plane to the current label, e.g. of “cell bottom”, and show its normal."
        )
        self.result = QLabel()
        self.result.setWordWrap(True)
        self.result.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        buttons = QHBoxLayout()
        buttons.addWidget(self.export_button)
        buttons.addWidget(self.plane_button)
        column = QVBoxLayout(self)
        column.addWidget(self.table)
        column.addLayout(buttons)
        column.addWidget(self.result)
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.setInterval(DELAY_MS)
        self._timer.timeout.connect(self.measure)
        self.export_button.clicked.connect(self._on_export)
        self.plane_button.clicked.connect(self.fit)
        annotating.edited.connect(self._timer.start)
        annotating.listed.connect(self._on_listed)
        self._on_listed()

    def _on_listed(self) -> None:
        drawn = bool(self._annotating.names)
        self.setEnabled(drawn)
        self.result.setText("")
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
        means = [key for key in (rows[0] if rows else {}) if key.startswith("mean_")]
        columns = [*TITLES, *means]
        self.table.setColumnCount(len(columns))
        self.table.setHorizontalHeaderLabels(
            [TITLES.get(key) or _mean_title(key) for key in columns]
        )
        for place, key in enumerate(columns):
            self.table.horizontalHeaderItem(place).setToolTip(_meaning(key))
        self.table.setRowCount(len(rows))
        for line, row in enumerate(rows):
            for place, key in enumerate(columns):
                self.table.setItem(line, place, _item(row[key]))
        self.table.resizeColumnsToContents()

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
        z, y, x = plane.normal
        self.result.setText(
            f"Plane of “{name}”, label {label}: normal (z, y, x) = ({z:.3f}, {y:.3f}, {x:.3f}), "
            f"{math.degrees(math.acos(min(abs(z), 1.0))):.1f}° from the z axis; "
            f"{plane.area_um2:.4g} µm² lie {plane.rms_um:.3g} µm (RMS) off it."
        )
        self._show_normal(f"normal of {name}", plane)

    def _show_normal(self, name: str, plane: Any) -> None:
        viewer, atlas = self._annotating.viewer, self._annotating.atlas
        if viewer is None or atlas is None:
            return
        length = NORMAL_SHARE * float(np.ptp(atlas.surface.vertices, axis=0).max())
        vector = np.array([[plane.centroid_um, np.multiply(length, plane.normal)]])
        if name in viewer.layers:
            viewer.layers[name].data = vector
            return
        surface = [layer for layer in viewer.layers if chart_of(layer) == "surface"]
        viewer.add_vectors(
            vector,
            name=name,
            translate=surface[0].translate if surface else (0.0, 0.0, 0.0),
            units=(UNIT,) * 3,
            axis_labels=SPACE,
            edge_width=length / ARROW,
            edge_color="#ffd54f",
            vector_style="arrow",
            metadata={KEY: {"layer": name, "chart": "", "field": ""}},
        )


def _export(annotations: Annotations, folder: str | Path) -> list[Path]:
    return export_annotations(annotations, folder)


def _mean_title(column: str) -> str:
    """The name of a field in two or three short lines, the unit in the last."""
    name, unit = column.removeprefix("mean_"), ""
    ending = next((ending for ending in UNITS if name.endswith(ending)), "")
    if ending:
        name, unit = name.removesuffix(ending), f"\n({UNITS[ending]})"
    first, *rest = name.replace("_", " ").capitalize().split()
    return "\n".join([first, *([" ".join(rest)] if rest else [])]) + unit


def _meaning(column: str) -> str:
    mean = column.startswith("mean_")
    return "The mean over the label, every place weighed by its area." if mean else ""


def _item(value: Any) -> QTableWidgetItem:
    number = isinstance(value, int | float)
    item = QTableWidgetItem(f"{value:.4g}" if isinstance(value, float) else str(value))
    if number:
        item.setTextAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
    return item
