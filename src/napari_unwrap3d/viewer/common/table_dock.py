"""A dock with a table of things on the cell: its columns, its selection, and copying."""

from __future__ import annotations

from collections.abc import Iterable

from qtpy.QtCore import QItemSelection, QItemSelectionModel, QSortFilterProxyModel, Qt
from qtpy.QtGui import QKeyEvent
from qtpy.QtWidgets import (
    QAbstractItemView,
    QApplication,
    QComboBox,
    QHeaderView,
    QLabel,
    QMenu,
    QPushButton,
    QSizePolicy,
    QTableView,
)

from .column_model import ColumnModel
from .docking import Docked

WIDTH = 380
# napari's own is hardly seen beside the colours of what is in the table.
SELECTED = "QTableView::item:selected { background: #3d6fd6; color: white; }"


class RowTable(QTableView):
    """Rows that are sorted by a click on a title, and selected whole; Escape selects nothing."""

    def __init__(self, rows: QSortFilterProxyModel) -> None:
        super().__init__()
        self.setModel(rows)
        self.setSortingEnabled(True)
        self.sortByColumn(0, Qt.SortOrder.AscendingOrder)
        self.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        self.setSelectionMode(QAbstractItemView.SelectionMode.ExtendedSelection)
        self.setStyleSheet(SELECTED)
        self.verticalHeader().hide()

    def keyPressEvent(self, event: QKeyEvent | None) -> None:
        """Let go of what is selected."""
        if event is not None and event.key() == Qt.Key.Key_Escape:
            self.clearSelection()
            return
        super().keyPressEvent(event)


class TableDock(Docked):
    """What docks with a table share; they say whose rows and columns these are.

    Attributes
    ----------
    model : ColumnModel
    rows : QSortFilterProxyModel
        Sorts the rows of `model`, and filters them.
    table : RowTable
    colour_box : QComboBox
    columns_menu : QMenu
        A column each, ticked where it is shown.
    count, help : QLabel
    copy_button : QPushButton
    """

    model: ColumnModel
    rows: QSortFilterProxyModel

    def _build_table(self, model: ColumnModel, rows: QSortFilterProxyModel) -> None:
        """Make what every such dock has."""
        self._syncing = False
        self.model, self.rows = model, rows
        rows.setSourceModel(model)
        self.table = RowTable(rows)
        self.table.verticalHeader().setDefaultSectionSize(self.fontMetrics().height() + 6)
        header = self.table.horizontalHeader()
        header.setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        header.setSectionsMovable(True)
        self.colour_box = QComboBox()
        self.colour_box.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
        self.columns_menu = QMenu(self)
        self.count, self.help = QLabel(), QLabel()
        self.help.setWordWrap(True)
        self.copy_button = QPushButton("Copy table")

    def _connect_table(self) -> None:
        self.colour_box.activated.connect(self._on_colour)
        self.columns_menu.triggered.connect(self._on_column)
        self.table.selectionModel().selectionChanged.connect(self._on_selected)
        self.copy_button.clicked.connect(self.copy)

    # What a dock says ----------------------------------------------------------------

    def title(self, column: str) -> str:
        """What a person reads for a column, in one line."""
        raise NotImplementedError

    def is_shown(self, column: str) -> bool:
        """Whether a column is shown."""
        raise NotImplementedError

    def show_columns(self, names: Iterable[str]) -> None:
        """Show these columns."""
        raise NotImplementedError

    def _on_colour(self, place: int) -> None:
        """Colour by what was chosen."""
        raise NotImplementedError

    def _on_chosen(self, ids: list[int]) -> None:
        """A person selected the rows of these."""
        raise NotImplementedError

    def _tally(self) -> None:
        """Say how many there are."""
        raise NotImplementedError

    # The columns -----------------------------------------------------------------------

    def _offer_columns(self) -> None:
        self.columns_menu.clear()
        for name in self.model.columns:
            action = self.columns_menu.addAction(self.title(name))
            action.setCheckable(True)
            action.setData(name)
        self._show_columns()

    def _show_columns(self) -> None:
        for place, action in enumerate(self.columns_menu.actions()):
            shown = self.is_shown(action.data())
            self.table.setColumnHidden(place, not shown)
            action.setChecked(shown)

    def _on_column(self, _: object) -> None:
        self.show_columns(a.data() for a in self.columns_menu.actions() if a.isChecked())

    # The selection ---------------------------------------------------------------------

    def _on_selected(self, *_: object) -> None:
        if self._syncing:
            return
        ids = self.model.ids
        rows = self.table.selectionModel().selectedRows()
        self._on_chosen([ids[self.rows.mapToSource(row).row()] for row in rows])

    def _select_rows(self, ids: Iterable[int], seen: int) -> None:
        """Select the rows of these; scroll to the first (0) or last (-1) of them."""
        places = {number: place for place, number in enumerate(self.model.ids)}
        sources = [self.model.index(places[number], 0) for number in ids if number in places]
        rows = [row for row in map(self.rows.mapFromSource, sources) if row.isValid()]
        selection = QItemSelection()
        for row in rows:
            selection.select(row, row)
        self._syncing = True
        flags = QItemSelectionModel.SelectionFlag
        self.table.selectionModel().select(selection, flags.ClearAndSelect | flags.Rows)
        if rows:
            self.table.scrollTo(rows[seen])
        self._syncing = False
        self._tally()

    def _say_count(self, known: str, shown: int | None, selected: int, edited: bool) -> None:
        """Say how many there are; `shown` where these are not all."""
        parts = [known]
        if shown is not None:
            parts.append(f"{shown} shown")
        if selected:
            parts.append(f"{selected} selected")
        if edited:
            parts.append("edited")
        self.count.setText(", ".join(parts))

    # Copying ---------------------------------------------------------------------------

    def copy(self) -> None:
        """Put the rows and columns that are shown on the clipboard, with their titles."""
        columns = self.model.columns
        places = [place for place, name in enumerate(columns) if self.is_shown(name)]
        lines = ["\t".join(self.title(columns[place]) for place in places)]
        for row in range(self.rows.rowCount()):
            sources = (self.rows.mapToSource(self.rows.index(row, place)) for place in places)
            lines.append("\t".join(self.model.plain(source) for source in sources))
        clipboard = QApplication.clipboard()
        if clipboard is not None:
            clipboard.setText("\n".join(lines))
