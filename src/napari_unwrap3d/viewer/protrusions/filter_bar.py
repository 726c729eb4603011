"""The filter of the table of protrusions: a motif, and a range of one measure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from qtpy.QtGui import QDoubleValidator
from qtpy.QtWidgets import QComboBox, QHBoxLayout, QLabel, QLineEdit, QSizePolicy, QWidget

from ...charts import MOTIFS
from ...fields import WHICH
from ...protrusions.columns import COLUMNS
from ..common.notice import small_button
from .filter import Filter
from .model import title

if TYPE_CHECKING:
    from .instances import Instances

ALL, NO_RANGE = "all motifs", "no range"
END_WIDTH = 56


class FilterBar(QWidget):
    """What is left out is neither in the table nor in the views.

    Parameters
    ----------
    instances : Instances
    """

    def __init__(self, instances: Instances, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._instances = instances
        self.motif, self.column = QComboBox(), QComboBox()
        self.motif.addItem(ALL, "")
        for motif in MOTIFS:
            self.motif.addItem(motif, motif)
        self.column.addItem(NO_RANGE, "")
        for name in COLUMNS:
            if name not in WHICH:
                self.column.addItem(title(name), name)
        self.low, self.high = _end("from"), _end("to")
        self.clear_button = small_button("✕", "Show all protrusions again.")
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(3)
        row.addWidget(QLabel("Only"))
        for box in (self.motif, self.column):
            box.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
            row.addWidget(box, 1)
            box.activated.connect(self._on_changed)
        for end in (self.low, self.high):
            row.addWidget(end)
            end.editingFinished.connect(self._on_changed)
        row.addWidget(self.clear_button)
        self.clear_button.clicked.connect(self._on_clear)
        self.motif.setToolTip("Show protrusions of this motif only, in the table and the views.")
        self.column.setToolTip("Show protrusions within a range of this measure only.")
        instances.styled.connect(self.fill)
        self.fill()

    def fill(self) -> None:
        """Show the filter as it is."""
        shown = self._instances.filter
        self.motif.setCurrentIndex(max(self.motif.findData(shown.motif), 0))
        self.column.setCurrentIndex(max(self.column.findData(shown.column), 0))
        for box, end in ((self.low, shown.low), (self.high, shown.high)):
            box.setEnabled(bool(shown.column))
            if not box.hasFocus():
                box.setText("" if end is None else f"{end:.6g}")
        self.clear_button.setEnabled(shown != Filter())

    def _on_changed(self, _: int = 0) -> None:
        column = str(self.column.currentData())
        low, high = (_number(box.text()) if column else None for box in (self.low, self.high))
        self._instances.set_filter(Filter(str(self.motif.currentData()), column, low, high))

    def _on_clear(self) -> None:
        for box in (self.low, self.high):
            box.clear()
        self._instances.set_filter(Filter())


def _end(text: str) -> QLineEdit:
    box = QLineEdit()
    box.setPlaceholderText(text)
    box.setFixedWidth(END_WIDTH)
    box.setValidator(QDoubleValidator())
    return box


def _number(text: str) -> float | None:
    try:
        return float(text.replace(",", "."))
    except ValueError:
        return None
