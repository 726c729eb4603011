"""The dock "Protrusions table": every protrusion and its measures, to select and to edit."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from qtpy.QtCore import QItemSelection, QItemSelectionModel, Qt
from qtpy.QtGui import QKeyEvent
from qtpy.QtWidgets import (
    QAbstractItemView,
    QApplication,
    QCheckBox,
    QComboBox,
    QFileDialog,
    QHBoxLayout,
    QHeaderView,
    QLabel,
    QMenu,
    QProgressBar,
    QPushButton,
    QSizePolicy,
    QTableView,
    QVBoxLayout,
    QWidget,
)

from ...errors import Unwrap3DError
from ...fields import WHICH
from ...files.export import export_protrusions
from ...protrusions.columns import COLUMNS
from ..common.connections import end_with_dock
from ..common.docking import Docked
from ..common.threads import Task, tell
from ..steps.texts import NOT_FOUND, OTHERS
from ..views.canvas import canvas_of
from ..views.notice import small_button
from .edits import EditBar
from .filter import COLUMNS_FIRST
from .filter_bar import FilterBar
from .instances import STEP, instances_of
from .model import LABEL, InstanceModel, ShownRows, title
from .square_view import SquareView

if TYPE_CHECKING:
    import napari

    from ...atlas import Atlas

INSTANCE = "instance (a colour each)"
HELP = (
    "Click a protrusion in any view to select it, with Shift or Ctrl to add it. "
    "Esc selects nothing."
)
WIDTH = 380
# napari's own is hardly seen beside the colours of the protrusions.
SELECTED = "QTableView::item:selected { background: #3d6fd6; color: white; }"
EXPORT = "Export protrusions into a new folder"


class InstanceTable(QTableView):
    """The rows; Escape selects nothing."""

    def keyPressEvent(self, event: QKeyEvent | None) -> None:
        """Let go of what is selected."""
        if event is not None and event.key() == Qt.Key.Key_Escape:
            self.clearSelection()
            return
        super().keyPressEvent(event)


class ProtrusionTable(Docked):
    """The dock widget. Closing it loses nothing.

    Parameters
    ----------
    napari_viewer : napari.Viewer
    """

    def __init__(self, napari_viewer: napari.Viewer, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.instances = instances_of(napari_viewer)
        self._syncing = False
        self._exporting: Task | None = None
        self._linked = False
        self._build()
        self._arrange()
        self._connect()
        self._take()
        end_with_dock(self)

    def _build(self) -> None:
        instances = self.instances
        self.message, self.run_button = QLabel(), QPushButton("Run")
        self.message.setWordWrap(True)
        self.run_button.setToolTip("Find and measure the protrusions of this cell.")
        self.run_button.setSizePolicy(QSizePolicy.Policy.Maximum, QSizePolicy.Policy.Fixed)
        self.busy = QProgressBar()
        self.busy.setRange(0, 0)
        self.busy.setMaximumHeight(6)
        self.busy.setTextVisible(False)
        self.busy.hide()
        self.colour_box = QComboBox()
        self.colour_box.setToolTip("What colours the protrusions, in every view.")
        self.colour_box.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
        self.colour_box.addItem(INSTANCE, "")
        for name in COLUMNS:
            if name not in WHICH:
                self.colour_box.addItem(title(name), name)
        self.slices = QCheckBox("Slices")
        self.slices.setToolTip("Show slices of the stack in the main canvas, with the labels.")
        self.columns_button = small_button("Columns", "Which measures are shown.")
        self.columns_menu = QMenu(self)
        self.columns_button.setMenu(self.columns_menu)
        self.filter_bar = FilterBar(instances)
        self.model = InstanceModel(instances, self)
        self.rows = ShownRows(instances, self)
        self.rows.setSourceModel(self.model)
        self.table = InstanceTable()
        self.table.setModel(self.rows)
        self.table.setSortingEnabled(True)
        self.table.sortByColumn(0, Qt.SortOrder.AscendingOrder)
        self.table.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        self.table.setSelectionMode(QAbstractItemView.SelectionMode.ExtendedSelection)
        self.table.setStyleSheet(SELECTED)
        self.table.verticalHeader().hide()
        self.table.verticalHeader().setDefaultSectionSize(self.fontMetrics().height() + 6)
        self.table.horizontalHeader().setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        self.count, self.help = QLabel(), QLabel(HELP)
        self.help.setWordWrap(True)
        self.edit_bar = EditBar(instances)
        self.square = SquareView(instances)
        self.export_button, self.copy_button = QPushButton("Export …"), QPushButton("Copy table")
        self.export_button.setToolTip("Table, label images and closed meshes, into a folder.")
        self.copy_button.setToolTip("All rows that are shown, to paste into a spreadsheet.")
        for name in COLUMNS:
            action = self.columns_menu.addAction(title(name))
            action.setCheckable(True)
            action.setData(name)
        header = self.table.horizontalHeader()
        header.setSectionsMovable(True)
        for place, name in enumerate(COLUMNS_FIRST):
            header.moveSection(header.visualIndex(list(COLUMNS).index(name)), place)
        self._show_columns()

    def _arrange(self) -> None:
        top, colours, files = QHBoxLayout(), QHBoxLayout(), QHBoxLayout()
        top.addWidget(self.message, 1)
        top.addWidget(self.run_button)
        colours.addWidget(QLabel("Colour by"))
        colours.addWidget(self.colour_box, 1)
        colours.addWidget(self.slices)
        colours.addWidget(self.columns_button)
        files.addWidget(self.export_button)
        files.addWidget(self.copy_button)
        column = QVBoxLayout(self)
        column.setContentsMargins(6, 6, 6, 6)
        column.setSpacing(4)
        column.addLayout(top)
        column.addWidget(self.busy)
        column.addLayout(colours)
        column.addWidget(self.filter_bar)
        column.addWidget(self.table, 1)
        column.addWidget(self.count)
        column.addWidget(self.help)
        column.addWidget(self.edit_bar)
        column.addWidget(self.square)
        column.addLayout(files)
        self.setMinimumWidth(WIDTH)

    def _connect(self) -> None:
        instances = self.instances
        self.run_button.clicked.connect(self._on_run)
        self.colour_box.activated.connect(self._on_colour)
        self.slices.toggled.connect(self._on_slices)
        self.columns_menu.triggered.connect(self._on_column)
        self.table.selectionModel().selectionChanged.connect(self._on_selected)
        self.export_button.clicked.connect(self._on_export)
        self.copy_button.clicked.connect(self.copy)
        instances.changed.connect(self._take)
        instances.selected.connect(self._show_selection)
        instances.styled.connect(self._on_styled)
        instances.working.connect(self._on_working)
        instances.session.running_changed.connect(self._update)

    # The table ---------------------------------------------------------------------

    def _take(self) -> None:
        """Show the table as it was measured last."""
        self._syncing = True
        self.rows.hide(self.instances.hidden)
        self.model.take(self.instances.found)
        self._syncing = False
        self._show_columns()
        self._show_selection()
        self._update()
        if self.instances.edits is not None and not self._linked:
            self._linked = True
            colouring = canvas_of(self.instances.viewer).colouring
            colouring.changed.connect(self.square.follow_colours)
            self.instances.annotating.chosen.connect(self._show_slices)
            self._show_slices()

    def _update(self, _: bool = False) -> None:
        """What can be used, and why not."""
        instances, reason = self.instances, self.instances.reason()
        busy = instances.session.running
        self.message.setText(reason)
        self.message.setVisible(bool(reason))
        self.run_button.setVisible(reason in (NOT_FOUND, OTHERS) and not busy)
        self.run_button.setEnabled(not instances.session.blocked())
        for widget in (self.table, self.colour_box, self.slices, self.filter_bar):
            widget.setEnabled(not reason)
        there = instances.found is not None
        self.copy_button.setEnabled(there)
        self.export_button.setEnabled(there and not reason and self._exporting is None)
        self.edit_bar.update_buttons()
        self._tally()

    def _tally(self) -> None:
        shown, known = self.rows.rowCount(), len(self.instances.labels)
        parts = [f"{known} protrusions"]
        if shown < known:
            parts.append(f"{shown} shown")
        if self.instances.selection:
            parts.append(f"{len(self.instances.selection)} selected")
        if self.instances.edited:
            parts.append("edited")
        self.count.setText(", ".join(parts) if self.instances.found is not None else "")

    def _on_styled(self) -> None:
        self._syncing = True
        self.rows.hide(self.instances.hidden)
        self._syncing = False
        self.colour_box.setCurrentIndex(max(self.colour_box.findData(self.instances.measure), 0))
        self.table.viewport().update()
        self._tally()

    def show_columns(self, names: Iterable[str]) -> None:
        """Show these measures."""
        self.instances.columns = tuple(dict.fromkeys([LABEL, *names]))
        self._show_columns()

    def _show_columns(self) -> None:
        shown = self.instances.columns
        for place, action in enumerate(self.columns_menu.actions()):
            self.table.setColumnHidden(place, action.data() not in shown)
            action.setChecked(action.data() in shown)

    def _on_column(self, _: object) -> None:
        self.show_columns(a.data() for a in self.columns_menu.actions() if a.isChecked())

    def _on_colour(self, _: int) -> None:
        self.instances.set_measure(str(self.colour_box.currentData()))

    def _on_slices(self, wanted: bool) -> None:
        if self.instances.edits is not None:
            self.instances.annotating.slices = wanted

    def _show_slices(self) -> None:
        self.slices.setChecked(self.instances.annotating.slices)

    # The selection -----------------------------------------------------------------

    def _on_selected(self, *_: object) -> None:
        if self._syncing:
            return
        labels = self.model.ids
        rows = self.table.selectionModel().selectedRows()
        chosen = [labels[self.rows.mapToSource(row).row()] for row in rows]
        # Those that were selected before keep their places: the first gives the label.
        before = [label for label in self.instances.selection if label in chosen]
        self.instances.select([*before, *chosen])

    def _show_selection(self) -> None:
        """Select the rows of what is selected, and scroll to the last."""
        labels, selection = self.model.ids, QItemSelection()
        last = None
        for label in self.instances.selection:
            if label in labels:
                source = self.model.index(labels.index(label), 0)
                row = self.rows.mapFromSource(source)
                if row.isValid():
                    selection.select(row, row)
                    last = row
        self._syncing = True
        flags = QItemSelectionModel.SelectionFlag
        self.table.selectionModel().select(selection, flags.ClearAndSelect | flags.Rows)
        if last is not None:
            self.table.scrollTo(last)
        self._syncing = False
        self._tally()

    # What a person does ------------------------------------------------------------

    def _on_run(self) -> None:
        try:
            self.instances.session.run(until=STEP)
        except Unwrap3DError as error:
            tell(error)

    def _on_working(self, message: str) -> None:
        self.busy.setVisible(bool(message))
        if message:
            self.message.setText(message)
            self.message.show()
        else:
            self._update()

    def copy(self) -> None:
        """Put the rows and columns that are shown on the clipboard, with their titles."""
        names = [name for name in COLUMNS if name in self.instances.columns]
        places = [list(COLUMNS).index(name) for name in names]
        lines = ["\t".join(title(name) for name in names)]
        for row in range(self.rows.rowCount()):
            sources = (self.rows.mapToSource(self.rows.index(row, place)) for place in places)
            lines.append("\t".join(self.model.plain(source) for source in sources))
        clipboard = QApplication.clipboard()
        if clipboard is not None:
            clipboard.setText("\n".join(lines))

    def _on_export(self) -> None:
        name = QFileDialog.getExistingDirectory(self, EXPORT)
        if name:
            self.export(name)

    def export(self, folder: str | Path) -> None:
        """Write table, label images and meshes into a folder, in a thread."""
        atlas = self.instances.session.atlas
        if atlas is None or self._exporting is not None:
            return
        self._exporting = Task(_export, atlas, folder)
        self._exporting.returned.connect(self._on_exported)
        self._exporting.failed.connect(self._on_not_exported)
        self._exporting.start()
        self._on_working("Exporting …")
        self.export_button.setEnabled(False)

    def _on_exported(self, files: list[Path]) -> None:
        self._exporting = None
        self._on_working("")
        self.count.setText(f"Wrote {len(files)} files.")

    def _on_not_exported(self, error: BaseException) -> None:
        self._exporting = None
        self._on_working("")
        tell(error)


def _export(atlas: Atlas, folder: str | Path) -> list[Path]:
    return export_protrusions(atlas, folder)
