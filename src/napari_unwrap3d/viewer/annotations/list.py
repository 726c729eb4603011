"""The list of annotations: add, rename, delete, show and hide, colour."""

from __future__ import annotations

from typing import TYPE_CHECKING

from qtpy.QtCore import Qt
from qtpy.QtGui import QColor
from qtpy.QtWidgets import (
    QAbstractItemView,
    QCheckBox,
    QColorDialog,
    QComboBox,
    QHBoxLayout,
    QListWidget,
    QListWidgetItem,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from ...errors import Unwrap3DError
from ..common.swatch import swatch
from ..common.threads import tell

if TYPE_CHECKING:
    from .annotating import Annotating

SUGGESTED = ("out of focus", "cell bottom", "protrusion", "region")
ROWS_SHOWN = 4


class AnnotationList(QWidget):
    """A row per annotation: the tick shows it, a double click renames it.

    Parameters
    ----------
    annotating : Annotating
    """

    def __init__(self, annotating: Annotating, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._annotating = annotating
        self.name_box = QComboBox()
        self.name_box.setEditable(True)
        self.name_box.addItems(SUGGESTED)
        self.name_box.setToolTip("A suggested name, or one of your own.")
        self.add_button = QPushButton("Add")
        self.add_button.setToolTip("Add an annotation of this name.")
        self.list = QListWidget()
        self.list.setEditTriggers(QAbstractItemView.EditTrigger.DoubleClicked)
        self.list.setToolTip("Ticked ones are seen, in every view. Double-click to rename.")
        self.colour_button = QPushButton("Colour …")
        self.colour_button.setToolTip("The colour of the current label, in every view.")
        self.delete_button = QPushButton("Delete")
        self.delete_button.setToolTip("Delete the annotation that is selected. Can be undone.")
        self.time_box = QCheckBox("This timepoint only")
        self.time_box.setToolTip(
            "Of a movie: draw the selected annotation on each timepoint by itself. Unticked, it "
            "is the same at every timepoint. What you see stays; the choice can be undone."
        )
        self._filling = False
        self._arrange()
        self.add_button.clicked.connect(self.add)
        self.delete_button.clicked.connect(self.delete)
        self.colour_button.clicked.connect(self._on_colour)
        self.time_box.clicked.connect(self._on_time)
        self.list.currentRowChanged.connect(self._on_row)
        self.list.itemChanged.connect(self._on_item)
        for signal in (annotating.listed, annotating.styled, annotating.chosen):
            signal.connect(self.fill)
        self.fill()

    def _arrange(self) -> None:
        row = QHBoxLayout()
        row.addWidget(self.name_box, 1)
        row.addWidget(self.add_button)
        buttons = QHBoxLayout()
        buttons.addWidget(self.colour_button)
        buttons.addWidget(self.delete_button)
        buttons.addStretch(1)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.addLayout(row)
        column.addWidget(self.list)
        column.addWidget(self.time_box)
        column.addLayout(buttons)
        height = self.list.fontMetrics().height() + 8
        self.list.setFixedHeight(ROWS_SHOWN * height)

    def fill(self) -> None:
        """Show the annotations that there are."""
        self._filling = True
        names, current = self._annotating.names, self._annotating.current
        if [self.list.item(k).data(Qt.ItemDataRole.UserRole) for k in range(self.list.count())] != [
            *names
        ]:
            self.list.clear()
            for name in names:
                item = QListWidgetItem(name)
                item.setData(Qt.ItemDataRole.UserRole, name)
                item.setFlags(
                    item.flags() | Qt.ItemFlag.ItemIsUserCheckable | Qt.ItemFlag.ItemIsEditable
                )
                self.list.addItem(item)
        for row, name in enumerate(names):
            item = self.list.item(row)
            colours, visible = self._annotating.style(name)
            ticked = Qt.CheckState.Checked if visible else Qt.CheckState.Unchecked
            item.setCheckState(ticked)
            self._show_time(item, name)
            item.setIcon(swatch(colours[self._annotating.label if name == current else 1]))
        if current in names:
            self.list.setCurrentRow(names.index(current))
        self._filling = False
        self._fill_time(current)
        there = self._annotating.atlas is not None
        self.add_button.setEnabled(there)
        for button in (self.colour_button, self.delete_button):
            button.setEnabled(bool(current))
        self._suggest(names)

    def _show_time(self, item: QListWidgetItem, name: str) -> None:
        """What is another one at every timepoint is written in italics."""
        times, font = self._annotating.annotations.times, item.font()
        font.setItalic(times.one_by_one(name))
        item.setFont(font)
        count = len(times.drawn(name))
        drawn = f"Drawn on {count} timepoint{'' if count == 1 else 's'}, each by itself."
        item.setToolTip(drawn if font.italic() else "")

    def _fill_time(self, current: str) -> None:
        """The choice, where there is a movie."""
        known = self._annotating.atlas is not None
        times = self._annotating.annotations.times if known else None
        self.time_box.setVisible(times is not None and times.timepoint is not None)
        self.time_box.setEnabled(bool(current))
        self.time_box.setChecked(bool(current) and times is not None and times.one_by_one(current))

    def _on_time(self, wanted: bool) -> None:
        self._annotating.annotations.times.set_one_by_one(self._annotating.current, wanted)

    def _suggest(self, names: tuple[str, ...]) -> None:
        """Propose a name that is not taken, unless the person is writing one."""
        if self.name_box.currentText() in names:
            free = [name for name in SUGGESTED if name not in names]
            number = 2
            while f"region {number}" in names:
                number += 1
            self.name_box.setEditText(free[0] if free else f"region {number}")

    def add(self) -> None:
        """Add an annotation of the name in the box, and draw it from now on."""
        name = self.name_box.currentText().strip()
        try:
            self._annotating.annotations.add(name)
        except Unwrap3DError as error:
            tell(error)
            return
        self._annotating.current = name

    def delete(self) -> None:
        """Delete the current annotation."""
        if self._annotating.current:
            self._annotating.annotations.remove(self._annotating.current)

    def _on_row(self, row: int) -> None:
        if not self._filling and 0 <= row < len(self._annotating.names):
            self._annotating.current = self._annotating.names[row]

    def _on_item(self, item: QListWidgetItem) -> None:
        if self._filling:
            return
        name, new = str(item.data(Qt.ItemDataRole.UserRole)), item.text().strip()
        visible = item.checkState() == Qt.CheckState.Checked
        if visible != self._annotating.style(name)[1]:
            self._annotating.set_visible(name, visible)
        if new != name:
            try:
                self._annotating.rename(name, new)
            except Unwrap3DError as error:
                tell(error)
                self._filling = True
                item.setText(name)
                self._filling = False

    def _on_colour(self) -> None:
        name, label = self._annotating.current, self._annotating.label
        old = self._annotating.style(name)[0][label]
        chosen = QColorDialog.getColor(QColor.fromRgbF(*old), self, f"{name}: label {label}")
        if chosen.isValid():
            rgba = chosen.getRgbF()
            self._annotating.set_colour(name, label, (rgba[0], rgba[1], rgba[2], 1.0))
