"""The dock "Tracks table": every track and its properties, to select, colour and edit."""

from __future__ import annotations

from typing import TYPE_CHECKING

from qtpy.QtCore import (
    QItemSelection,
    QItemSelectionModel,
    QModelIndex,
    QSortFilterProxyModel,
    Qt,
)
from qtpy.QtWidgets import (
    QAbstractItemView,
    QApplication,
    QCheckBox,
    QComboBox,
    QHBoxLayout,
    QHeaderView,
    QLabel,
    QMenu,
    QPushButton,
    QSizePolicy,
    QVBoxLayout,
    QWidget,
)

from ..common.connections import end_with_dock
from ..common.docking import Docked
from ..protrusions.table import SELECTED, WIDTH, InstanceTable
from ..views.notice import small_button
from .edit_bar import TrackEditBar
from .model import TrackModel, title
from .session import tracks_session_of

if TYPE_CHECKING:
    import napari

EACH = "track (a colour each)"
NOTHING = (
    'No tracks are shown. Make or import them in the dock "Tracks" of a movie, '
    "or open a movie that has some."
)
HELP = (
    "Click a track in any view to select it, with Shift or Ctrl to add it; Esc selects nothing. "
    'To move one, take the tool "select points" of the layer "track heads" and drag its head.'
)
# Rows that are looked at for how wide a column must be.
MEASURED_ROWS = 50


class TrackTable(Docked):
    """The dock widget. Closing it loses nothing.

    Parameters
    ----------
    napari_viewer : napari.Viewer
    """

    def __init__(self, napari_viewer: napari.Viewer, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.session = tracks_session_of(napari_viewer)
        self._syncing = False
        self._left_out: set[str] = set()
        self._build()
        self._arrange()
        self._connect()
        self._take()
        end_with_dock(self)

    def _build(self) -> None:
        self.message = QLabel(NOTHING)
        self.message.setWordWrap(True)
        self.colour_box = QComboBox()
        self.colour_box.setToolTip("What colours the tracks, in every view.")
        self.colour_box.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
        self.limits = QLabel()
        self.ids = QCheckBox("Ids")
        self.ids.setToolTip("Write the numbers of all tracks, not only of those selected.")
        self.columns_button = small_button("Columns", "Which properties are shown.")
        self.columns_menu = QMenu(self)
        self.columns_button.setMenu(self.columns_menu)
        self.model = TrackModel(self.session, self)
        self.rows = QSortFilterProxyModel(self)
        self.rows.setSortRole(Qt.ItemDataRole.UserRole)
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
        header = self.table.horizontalHeader()
        header.setResizeContentsPrecision(MEASURED_ROWS)
        header.setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        header.setSectionsMovable(True)
        self.count, self.help = QLabel(), QLabel(HELP)
        self.help.setWordWrap(True)
        self.edit_bar = TrackEditBar(self.session)
        self.edit_bar.listen(self, self.table)
        self.copy_button = QPushButton("Copy table")
        self.copy_button.setToolTip("All rows and columns that are shown, for a spreadsheet.")

    def _arrange(self) -> None:
        colours, shown = QHBoxLayout(), QHBoxLayout()
        colours.addWidget(QLabel("Colour by"))
        colours.addWidget(self.colour_box, 1)
        colours.addWidget(self.limits)
        shown.addWidget(self.count, 1)
        shown.addWidget(self.ids)
        shown.addWidget(self.columns_button)
        column = QVBoxLayout(self)
        column.setContentsMargins(6, 6, 6, 6)
        column.setSpacing(4)
        column.addWidget(self.message)
        column.addLayout(colours)
        column.addLayout(shown)
        column.addWidget(self.table, 1)
        column.addWidget(self.help)
        column.addWidget(self.edit_bar)
        column.addWidget(self.copy_button)
        self.setMinimumWidth(WIDTH)

    def _connect(self) -> None:
        session = self.session
        self.colour_box.activated.connect(self._on_colour)
        self.ids.toggled.connect(self._on_ids)
        self.columns_menu.triggered.connect(self._on_column)
        self.table.selectionModel().selectionChanged.connect(self._on_selected)
        self.table.doubleClicked.connect(self._on_double)
        self.copy_button.clicked.connect(self.copy)
        session.shown_changed.connect(self._take)
        session.selection_changed.connect(self._show_selection)
        session.colouring_changed.connect(self._show_colours)

    # What is there -----------------------------------------------------------------

    def _take(self) -> None:
        """Show the rows of what is shown now."""
        before = self.model.columns
        self._syncing = True
        self.model.take()
        self._syncing = False
        there = self.session.tracks is not None
        self.message.setVisible(not there)
        for widget in (self.table, self.colour_box, self.ids, self.columns_button):
            widget.setEnabled(there)
        self.copy_button.setEnabled(there)
        if self.model.columns != before:
            self._offer_columns()
        self._offer_colours()
        self._show_selection()

    def _offer_columns(self) -> None:
        self.columns_menu.clear()
        for name in self.model.columns:
            action = self.columns_menu.addAction(title(name))
            action.setCheckable(True)
            action.setData(name)
        self._show_columns()

    def _show_columns(self) -> None:
        for place, action in enumerate(self.columns_menu.actions()):
            left_out = action.data() in self._left_out
            self.table.setColumnHidden(place, left_out)
            action.setChecked(not left_out)

    def _offer_colours(self) -> None:
        wanted = ["", *self.session.columns]
        known = [self.colour_box.itemData(i) for i in range(self.colour_box.count())]
        if wanted != known:
            self.colour_box.clear()
            for name in wanted:
                self.colour_box.addItem(title(name) if name else EACH, name)
        self._show_colours()

    def _show_colours(self) -> None:
        """What colours the tracks, and from which value to which."""
        session = self.session
        self.colour_box.setCurrentIndex(max(self.colour_box.findData(session.column), 0))
        self.ids.setChecked(session.ids)
        text = ""
        if session.column and session.colours is not None:
            low, high = session.colours.limits()
            text = f"{low:.3g} – {high:.3g}".replace("-", "−")
        self.limits.setText(text)
        self.model.colours_changed()

    def _tally(self) -> None:
        session = self.session
        if session.tracks is None or session.shown is None:
            self.count.setText("")
            return
        parts = [f"{len(session.tracks.ids)} tracks"]
        if session.shown is not session.tracks:
            parts.append(f"{len(session.shown.ids)} shown")
        if session.selection:
            parts.append(f"{len(session.selection)} selected")
        if session.edits is not None and session.edits.is_edited:
            parts.append("edited")
        self.count.setText(", ".join(parts))

    # The selection -----------------------------------------------------------------

    def _on_selected(self, *_: object) -> None:
        if not self._syncing:
            ids = self.model.ids
            rows = self.table.selectionModel().selectedRows()
            self.session.select(ids[self.rows.mapToSource(row).row()] for row in rows)

    def _show_selection(self) -> None:
        """Select the rows of what is selected, and scroll to the first."""
        places = {track: place for place, track in enumerate(self.model.ids)}
        selection, first = QItemSelection(), QModelIndex()
        for track in sorted(self.session.selection & places.keys()):
            row = self.rows.mapFromSource(self.model.index(places[track], 0))
            selection.select(row, row)
            first = first if first.isValid() else row
        self._syncing = True
        flags = QItemSelectionModel.SelectionFlag
        self.table.selectionModel().select(selection, flags.ClearAndSelect | flags.Rows)
        if first.isValid():
            self.table.scrollTo(first)
        self._syncing = False
        self._tally()

    # What a person does ------------------------------------------------------------

    def _on_colour(self, _: int) -> None:
        self.session.colour_by(str(self.colour_box.currentData()))

    def _on_ids(self, wanted: bool) -> None:
        self.session.ids = wanted

    def _on_column(self, _: object) -> None:
        actions = self.columns_menu.actions()
        self._left_out = {str(a.data()) for a in actions if not a.isChecked()}
        self._show_columns()

    def _on_double(self, _: object) -> None:
        self.session.editing.do("show")

    def copy(self) -> None:
        """Put the rows and columns that are shown on the clipboard, with their titles."""
        places = [
            place for place, name in enumerate(self.model.columns) if name not in self._left_out
        ]
        lines = ["\t".join(title(self.model.columns[place]) for place in places)]
        for row in range(self.rows.rowCount()):
            sources = (self.rows.mapToSource(self.rows.index(row, place)) for place in places)
            lines.append("\t".join(self.model.plain(source) for source in sources))
        clipboard = QApplication.clipboard()
        if clipboard is not None:
            clipboard.setText("\n".join(lines))
