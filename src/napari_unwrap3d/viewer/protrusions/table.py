"""The dock "Protrusions table": every protrusion and its measures, to select and to edit."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from qtpy.QtWidgets import (
    QCheckBox,
    QFileDialog,
    QHBoxLayout,
    QLabel,
    QProgressBar,
    QPushButton,
    QSizePolicy,
    QVBoxLayout,
    QWidget,
)

from ...errors import Unwrap3DError
from ...fields import WHICH
from ...files.export import export_protrusions
from ...protrusions.columns import COLUMNS
from ..common.connections import end_with_dock
from ..common.notice import small_button
from ..common.table_dock import WIDTH, TableDock
from ..common.threads import Task, tell
from ..steps.texts import NOT_FOUND, OTHERS
from ..views.canvas import canvas_of
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
EXPORT = "Export protrusions into a new folder"


class ProtrusionTable(TableDock):
    """The dock widget. Closing it loses nothing.

    Parameters
    ----------
    napari_viewer : napari.Viewer
    """

    def __init__(self, napari_viewer: napari.Viewer, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.instances = instances_of(napari_viewer)
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
        self._build_table(InstanceModel(instances, self), ShownRows(instances, self))
        self.colour_box.setToolTip("What colours the protrusions, in every view.")
        self.colour_box.addItem(INSTANCE, "")
        for name in COLUMNS:
            if name not in WHICH:
                self.colour_box.addItem(title(name), name)
        self.slices = QCheckBox("Slices")
        self.slices.setToolTip("Show slices of the stack in the main canvas, with the labels.")
        self.columns_button = small_button("Columns", "Which measures are shown.")
        self.columns_button.setMenu(self.columns_menu)
        self.filter_bar = FilterBar(instances)
        self.help.setText(HELP)
        self.edit_bar = EditBar(instances)
        self.square = SquareView(instances)
        self.export_button = QPushButton("Export …")
        self.export_button.setToolTip("Table, label images and closed meshes, into a folder.")
        self.copy_button.setToolTip("All rows that are shown, to paste into a spreadsheet.")
        header = self.table.horizontalHeader()
        for place, name in enumerate(COLUMNS_FIRST):
            header.moveSection(header.visualIndex(list(COLUMNS).index(name)), place)
        self._offer_columns()

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
        self._connect_table()
        self.slices.toggled.connect(self._on_slices)
        self.export_button.clicked.connect(self._on_export)
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
        instances = self.instances
        if instances.found is None:
            self.count.setText("")
            return
        shown, known = self.rows.rowCount(), len(instances.labels)
        some = shown if shown < known else None
        self._say_count(
            f"{known} protrusions", some, len(instances.selection), bool(instances.edited)
        )

    def _on_styled(self) -> None:
        self._syncing = True
        self.rows.hide(self.instances.hidden)
        self._syncing = False
        self.colour_box.setCurrentIndex(max(self.colour_box.findData(self.instances.measure), 0))
        self.table.viewport().update()
        self._tally()

    def title(self, column: str) -> str:
        """What a person reads for a measure, in one line."""
        return title(column)

    def is_shown(self, column: str) -> bool:
        """Whether a measure is shown."""
        return column in self.instances.columns

    def show_columns(self, names: Iterable[str]) -> None:
        """Show these measures."""
        self.instances.columns = tuple(dict.fromkeys([LABEL, *names]))
        self._show_columns()

    def _on_colour(self, _: int) -> None:
        self.instances.set_measure(str(self.colour_box.currentData()))

    def _on_slices(self, wanted: bool) -> None:
        if self.instances.edits is not None:
            self.instances.annotating.slices = wanted

    def _show_slices(self) -> None:
        self.slices.setChecked(self.instances.annotating.slices)

    # The selection -----------------------------------------------------------------

    def _on_chosen(self, ids: list[int]) -> None:
        # Those that were selected before keep their places: the first gives the label.
        before = [label for label in self.instances.selection if label in ids]
        self.instances.select([*before, *ids])

    def _show_selection(self) -> None:
        """Select the rows of what is selected, and scroll to the last."""
        self._select_rows(self.instances.selection, -1)

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
