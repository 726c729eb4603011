"""The table of tracks for Qt: a row per track, a column per property."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from qtpy.QtCore import QAbstractTableModel, QModelIndex, Qt

from ..charts.tracks import TRACK
from ..measuring.plot_kinds import column_label
from .annotation_list import swatch
from .instance_model import text_of

if TYPE_CHECKING:
    from .tracks_session import TracksSession

Role = Qt.ItemDataRole
MEAN = "mean_"
NONE = "–"
# Columns whose 0 says that there is none.
PARTNERS = ("parent", "into")
TITLES = {
    TRACK: "Track",
    "first_timepoint": "First",
    "last_timepoint": "Last",
    "timepoints": "Seen",
    "parent": "Out of",
    "into": "Into",
}
MEANINGS = {
    TRACK: "The number of the track.",
    "first_timepoint": "The timepoint at which it is first seen.",
    "last_timepoint": "The timepoint at which it is last seen.",
    "timepoints": "At how many timepoints it is seen; fewer than it lasts where there are gaps.",
    "start_s": "When it is first seen.",
    "lifetime_s": "How long it lasts: the time that its timepoints stand for.",
    "parent": "The track that it came out of.",
    "into": "The track that it went into.",
}


def title(column: str) -> str:
    """What a person reads for a column."""
    if column.startswith(MEAN) and column.removeprefix(MEAN):
        return f"Mean {column_label(column.removeprefix(MEAN))}"
    return TITLES.get(column) or column_label(column)


class TrackModel(QAbstractTableModel):
    """A row per track that is shown, as the session has them.

    Parameters
    ----------
    session : TracksSession
    """

    def __init__(self, session: TracksSession, parent: Any = None) -> None:
        super().__init__(parent)
        self._session = session
        self.columns: tuple[str, ...] = (TRACK,)
        self._values: dict[str, list[Any]] = {TRACK: []}

    def take(self) -> None:
        """Show the rows of what the session shows now."""
        self.beginResetModel()
        self.columns, self._values = (TRACK,), {TRACK: []}
        tracks = self._session.shown
        if tracks is not None:
            table = tracks.track_table
            # Plain numbers: Qt asks for thousands of them.
            self._values = {str(name): table[name].tolist() for name in table}
            self.columns = tuple(self._values)
        self.endResetModel()

    @property
    def ids(self) -> list[int]:
        """The tracks of the rows."""
        return [int(track) for track in self._values[TRACK]]

    def colours_changed(self) -> None:
        """The swatches have other colours."""
        if self.rowCount():
            last = self.index(self.rowCount() - 1, 0)
            self.dataChanged.emit(self.index(0, 0), last, [Role.DecorationRole])

    def rowCount(self, parent: QModelIndex | None = None) -> int:
        """How many tracks there are."""
        return 0 if parent is not None and parent.isValid() else len(self._values[TRACK])

    def columnCount(self, parent: QModelIndex | None = None) -> int:
        """How many properties there are."""
        return 0 if parent is not None and parent.isValid() else len(self.columns)

    def data(self, index: QModelIndex, role: int = Role.DisplayRole) -> Any:
        """Of a cell."""
        column = self.columns[index.column()]
        value = self._values[column][index.row()]
        if role == Role.DisplayRole:
            return NONE if column in PARTNERS and value == 0 else text_of(value)
        if role == Role.UserRole:
            return -math.inf if isinstance(value, float) and math.isnan(value) else value
        if role == Role.TextAlignmentRole and not isinstance(value, str):
            return Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
        if role == Role.DecorationRole and column == TRACK:
            return swatch(self._session.colour(int(value)))
        return None

    def plain(self, index: QModelIndex) -> str:
        """A cell with all of its digits, as a spreadsheet reads it."""
        value = self._values[self.columns[index.column()]][index.row()]
        return "" if isinstance(value, float) and math.isnan(value) else str(value)

    def headerData(
        self, section: int, orientation: Qt.Orientation, role: int = Role.DisplayRole
    ) -> Any:
        """Title of a column, with its unit, and its meaning."""
        if orientation != Qt.Orientation.Horizontal or section >= len(self.columns):
            return None
        column = self.columns[section]
        if role == Role.DisplayRole:
            return title(column).replace(" (", "\n(")
        if role == Role.ToolTipRole:
            return MEANINGS.get(column, title(column))
        return None
