"""The table of tracks for Qt: a row per track, a column per property."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from qtpy.QtCore import Qt

from ...charts.tracks import TRACK
from ...measuring.plot_kinds import column_label
from ..common.column_model import NOTHING, ColumnModel, text_of

if TYPE_CHECKING:
    from .session import TracksSession

Role = Qt.ItemDataRole
MEAN = "mean_"
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


class TrackModel(ColumnModel):
    """A row per track that is shown, as the session has them.

    Parameters
    ----------
    session : TracksSession
    """

    def __init__(self, session: TracksSession, parent: Any = None) -> None:
        super().__init__(TRACK, (TRACK,), parent)
        self._session = session

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

    def colours_changed(self) -> None:
        """The swatches have other colours."""
        if self.rowCount():
            last = self.index(self.rowCount() - 1, 0)
            self.dataChanged.emit(self.index(0, 0), last, [Role.DecorationRole])

    def colour(self, number: int) -> Any:
        """Of a track."""
        return self._session.colour(number)

    def text(self, column: str, value: Any) -> str:
        """What a person reads in a cell."""
        return NOTHING if column in PARTNERS and value == 0 else text_of(value)

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
