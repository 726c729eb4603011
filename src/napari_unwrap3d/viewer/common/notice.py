"""What stands in place of a chart that is not there: why, and what can be done."""

from __future__ import annotations

from qtpy.QtCore import Qt, Signal
from qtpy.QtWidgets import QLabel, QProgressBar, QPushButton, QSizePolicy, QVBoxLayout, QWidget


class Notice(QWidget):
    """Some words and a button.

    Signals
    -------
    pressed(str)
        The button, with the chart that the words are about.
    """

    pressed = Signal(str)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.text = QLabel()
        self.text.setWordWrap(True)
        self.text.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.button = QPushButton()
        self.button.clicked.connect(self._on_clicked)
        self.bar = QProgressBar()
        self.bar.setRange(0, 0)
        self.bar.setMaximumWidth(240)
        self._chart = ""
        column = QVBoxLayout(self)
        column.addStretch(1)
        column.addWidget(self.text)
        column.addWidget(self.button, 0, Qt.AlignmentFlag.AlignHCenter)
        column.addWidget(self.bar, 0, Qt.AlignmentFlag.AlignHCenter)
        column.addStretch(1)

    def say(self, text: str, button: str, chart: str) -> None:
        """Say something, with a button unless its text is empty."""
        self._chart = chart
        self.text.setText(text)
        self.button.setText(button)
        self.button.setVisible(bool(button))
        self.bar.setVisible(False)

    def wait(self, text: str) -> None:
        """Say what is going on."""
        self.text.setText(text)
        self.button.setVisible(False)
        self.bar.setVisible(True)

    def _on_clicked(self) -> None:
        self.pressed.emit(self._chart)


def small_button(text: str, tip: str, *, checkable: bool = False) -> QPushButton:
    """A button for a row of many."""
    button = QPushButton(text)
    button.setToolTip(tip)
    button.setCheckable(checkable)
    button.setSizePolicy(QSizePolicy.Policy.Maximum, QSizePolicy.Policy.Fixed)
    return button
