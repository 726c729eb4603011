"""The table of protrusions for Qt: a row per protrusion, a column per measure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from qtpy.QtCore import QModelIndex, QSortFilterProxyModel, Qt

from ...protrusions.columns import COLUMNS
from ..common.column_model import ColumnModel

if TYPE_CHECKING:
    from ...charts import Protrusions
    from .instances import Instances

Role = Qt.ItemDataRole
LABEL = "label"


def title(column: str) -> str:
    """What a person reads for a column, in one line."""
    known = COLUMNS.get(column)
    if known is None:
        return column
    return f"{known.title} ({known.unit})" if known.unit else known.title


class InstanceModel(ColumnModel):
    """The table as it was measured last.

    Parameters
    ----------
    instances : Instances
    """

    def __init__(self, instances: Instances, parent: Any = None) -> None:
        super().__init__(LABEL, tuple(COLUMNS), parent)
        self._instances = instances

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

    def colour(self, number: int) -> Any:
        """Of a protrusion."""
        return self._instances.colour(number)

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
        return not isinstance(model, InstanceModel) or model.ids[row] not in self._hidden
