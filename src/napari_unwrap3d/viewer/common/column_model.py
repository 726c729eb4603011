"""A table by its columns for Qt, with a swatch per row; sorted as numbers, read as text."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from qtpy.QtCore import QAbstractTableModel, QModelIndex, Qt

from .swatch import swatch

Role = Qt.ItemDataRole
NOTHING = "–"


class ColumnModel(QAbstractTableModel):
    """Columns of numbers and words, one of which names the row.

    Attributes
    ----------
    columns : tuple of str
    """

    def __init__(self, key: str, columns: tuple[str, ...], parent: Any = None) -> None:
        super().__init__(parent)
        self._key = key
        self.columns = columns
        self._values: dict[str, list[Any]] = {name: [] for name in columns}

    @property
    def ids(self) -> list[int]:
        """Whose the rows are."""
        return [int(value) for value in self._values[self._key]]

    def colour(self, number: int) -> Any:
        """Of a row's swatch."""
        raise NotImplementedError

    def text(self, column: str, value: Any) -> str:
        """What a person reads in a cell."""
        return text_of(value)

    def rowCount(self, parent: QModelIndex | None = None) -> int:
        """How many rows there are."""
        return 0 if parent is not None and parent.isValid() else len(self._values[self._key])

    def columnCount(self, parent: QModelIndex | None = None) -> int:
        """How many columns there are."""
        return 0 if parent is not None and parent.isValid() else len(self.columns)

    def data(self, index: QModelIndex, role: int = Role.DisplayRole) -> Any:
        """Of a cell."""
        column = self.columns[index.column()]
        value = self._values[column][index.row()]
        if role == Role.DisplayRole:
            return self.text(column, value)
        if role == Role.UserRole:
            return -math.inf if isinstance(value, float) and math.isnan(value) else value
        if role == Role.TextAlignmentRole and not isinstance(value, str):
            return Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
        if role == Role.DecorationRole and column == self._key:
            return swatch(self.colour(int(value)))
        return None

    def plain(self, index: QModelIndex) -> str:
        """A cell with all of its digits, as a spreadsheet reads it."""
        value = self._values[self.columns[index.column()]][index.row()]
        return "" if isinstance(value, float) and math.isnan(value) else str(value)


def text_of(value: Any) -> str:
    """A number as it is read."""
    if isinstance(value, float | np.floating):
        return NOTHING if math.isnan(value) else f"{value:.4g}".replace("-", "−")
    return str(value)
