"""The table of protrusions for Qt: a row per protrusion, a column per measure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from qtpy.QtCore import QAbstractTableModel, QModelIndex, QSortFilterProxyModel, Qt

from ..protrusions.columns import COLUMNS
from .annotation_list import swatch

if TYPE_CHECKING:
    from ..charts import Protrusions
    from .instances import Instances

Role = Qt.ItemDataRole
LABEL = "label"
NOTHING = "–"


def title(column: str) -> str:
    """What a person reads for a column, in one line."""
    known = COLUMNS.get(column)
    if known is None:
        return column
    return f"{known.title} ({known.unit})" if known.unit else known.title


class InstanceModel(QAbstractTableModel):
    """The table as it was measured last.

    Parameters
    ----------
    instances : Instances
    """

    def __init__(self, instances: Instances, parent: Any = None) -> None:
        super().__init__(parent)
        self._instances = instances
        self.columns: tuple[str, ...] = tuple(COLUMNS)
        self._values: dict[str, list[Any]] = {}
        self.take(None)

    def take(self, found: Protrusions | None) -> None:
        """Show other rows."""
        self.beginResetModel()
        self._values = {name: [] for name in self.columns}
        if found is not None:
            table = found.table
            # Plain numbers and words: Qt asks for thousands of them.
            self._values = {
                name: table[name].tolist() if name in table else [math.nan] * len(table)
                for name in self.columns
            }
        self.endResetModel()

    @property
    def labels(self) -> list[int]:
        """Of the rows."""
        return [int(label) for label in self._values[LABEL]]

    def rowCount(self, parent: QModelIndex | None = None) -> int:
        """How many protrusions there are."""
        return 0 if parent is not None and parent.isValid() else len(self._values[LABEL])

    def columnCount(self, parent: QModelIndex | None = None) -> int:
        """How many measures there are."""
        return 0 if parent is not None and parent.isValid() else len(self.columns)

    def data(self, index: QModelIndex, role: int = Role.DisplayRole) -> Any:
        """Of a cell."""
        column = self.columns[index.column()]
        value = self._values[column][index.row()]
        if role == Role.DisplayRole:
            return text_of(value)
        if role == Role.UserRole:
            return -math.inf if isinstance(value, float) and math.isnan(value) else value
        if role == Role.TextAlignmentRole and not isinstance(value, str):
            return Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
        if role == Role.DecorationRole and column == LABEL:
            return swatch(self._instances.colour(int(value)))
        return None

    def plain(self, index: QModelIndex) -> str:
        """A cell with all of its digits, as a spreadsheet reads it."""
        value = self._values[self.columns[index.column()]][index.row()]
        return "" if isinstance(value, float) and math.isnan(value) else str(value)

    def headerData(
        self, section: int, orientation: Qt.Orientation, role: int = Role.DisplayRole
    ) -> Any:
        """Title and unit of a column, and its meaning."""
        if orientation != Qt.Orientation.Horizontal:
            return None
        known = COLUMNS[self.columns[section]]
        if role == Role.DisplayRole:
            return f"{known.title}\n({known.unit})" if known.unit else known.title
        if role == Role.ToolTipRole:
            return f"{title(self.columns[section])}: {known.meaning}"
        return None


class ShownRows(QSortFilterProxyModel):
    """Sorted by the numbers themselves, without the rows that the filter leaves out."""

    def __init__(self, instances: Instances, parent: Any = None) -> None:
        super().__init__(parent)
        self._hidden: frozenset[int] = instances.hidden
        self.setSortRole(Role.UserRole)

    def hide(self, labels: frozenset[int]) -> None:
        """Leave out the rows of these."""
        if labels != self._hidden:
            self._hidden = labels
            self.invalidate()

    def filterAcceptsRow(self, row: int, parent: QModelIndex) -> bool:
        """Whether a row is shown."""
        model = self.sourceModel()
        return not isinstance(model, InstanceModel) or model.labels[row] not in self._hidden


def text_of(value: Any) -> str:
    """A number as it is read."""
    if isinstance(value, float | np.floating):
        return NOTHING if math.isnan(value) else f"{value:.4g}".replace("-", "−")
    return str(value)
