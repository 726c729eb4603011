"""The dock "Tracks table": every track and its properties, to select, colour and edit."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from qtpy.QtCore import (
    QSortFilterProxyModel,
    Qt,
)
from qtpy.QtWidgets import (
    QCheckBox,
    QHBoxLayout,
    QLabel,
    QVBoxLayout,
    QWidget,
)

from ..common.connections import end_with_dock
from ..common.notice import small_button
from ..common.table_dock import WIDTH, TableDock
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


class TrackTable(TableDock):
    """The dock widget. Closing it loses nothing.

    Parameters
    ----------
    napari_viewer : napari.Viewer
    """

    def __init__(self, napari_viewer: napari.Viewer, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.session = tracks_session_of(napari_viewer)
        self._left_out: set[str] = set()
        self._build()
        self._arrange()
        self._connect()
        self._take()
        end_with_dock(self)

    def _build(self) -> None:
        self.message = QLabel(NOTHING)
        self.message.setWordWrap(True)
        rows = QSortFilterProxyModel(self)
        rows.setSortRole(Qt.ItemDataRole.UserRole)
        self._build_table(TrackModel(self.session, self), rows)
        self.table.horizontalHeader().setResizeContentsPrecision(MEASURED_ROWS)
        self.colour_box.setToolTip("What colours the tracks, in every view.")
        self.limits = QLabel()
        self.ids = QCheckBox("Ids")
        self.ids.setToolTip("Write the numbers of all tracks, not only of those selected.")
        self.columns_button = small_button("Columns", "Which properties are shown.")
        self.columns_button.setMenu(self.columns_menu)
        self.help.setText(HELP)
        self.edit_bar = TrackEditBar(self.session)
        self.edit_bar.listen(self, self.table)
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
        self._connect_table()
        self.ids.toggled.connect(self._on_ids)
        self.table.doubleClicked.connect(self._on_double)
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

    def title(self, column: str) -> str:
        """What a person reads for a property."""
        return title(column)

    def is_shown(self, column: str) -> bool:
        """Whether a property is shown."""
        return column not in self._left_out

    def show_columns(self, names: Iterable[str]) -> None:
        """Show these properties, and leave out the others."""
        self._left_out = set(self.model.columns) - set(names)
        self._show_columns()

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
        some = None if session.shown is session.tracks else len(session.shown.ids)
        edited = session.edits is not None and session.edits.is_edited
        self._say_count(f"{len(session.tracks.ids)} tracks", some, len(session.selection), edited)

    # The selection -----------------------------------------------------------------

    def _on_chosen(self, ids: list[int]) -> None:
        self.session.select(ids)

    def _show_selection(self) -> None:
        """Select the rows of what is selected, and scroll to the first."""
        self._select_rows(sorted(self.session.selection), 0)

    # What a person does ------------------------------------------------------------

    def _on_colour(self, _: int) -> None:
        self.session.colour_by(str(self.colour_box.currentData()))

    def _on_ids(self, wanted: bool) -> None:
        self.session.ids = wanted

    def _on_double(self, _: object) -> None:
        self.session.editing.do("show")
