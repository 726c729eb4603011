"""A section of a dock: a title that opens it, the state of a piece of work, Run and Cancel."""

from __future__ import annotations

from qtpy.QtCore import QEvent, Qt
from qtpy.QtGui import QMouseEvent
from qtpy.QtWidgets import (
    QFrame,
    QHBoxLayout,
    QLabel,
    QPushButton,
    QSizePolicy,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from .progress_bar import ProgressBar

HIGHLIGHT = "#42a5f5"


class Section(QFrame):
    """What the panels of steps and of a movie's stages have in common.

    Attributes
    ----------
    title : QToolButton
        Opens and closes the section.
    mark, seconds, status : QLabel
        Sign of the state; what stands beside the buttons; a line or two below.
    run_button, cancel_button : QPushButton
    progress_bar : ProgressBar
        From 0 to 1000.
    column : QVBoxLayout
        Of what is hidden until the section is opened.
    """

    def __init__(self, title: str, tooltip: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.title = QToolButton()
        self.title.setText(title)
        self.title.setCheckable(True)
        self.title.setAutoRaise(True)
        self.title.setToolButtonStyle(Qt.ToolButtonStyle.ToolButtonTextBesideIcon)
        self.title.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self.title.setToolTip(f"{tooltip}\nClick to see the parameters.")
        self.title.setStyleSheet(
            "QToolButton { font-weight: bold; text-align: left; border: none;"
            " background: transparent; padding: 2px; }"
        )
        self.seconds, self.mark, self.status = QLabel(), QLabel(), QLabel()
        self.run_button, self.cancel_button = QPushButton("Run"), QPushButton("Cancel")
        self.progress_bar = ProgressBar()
        self.progress_bar.setRange(0, 1000)
        self.progress_bar.setTextVisible(False)
        self.progress_bar.setFixedHeight(6)
        self.status.setWordWrap(True)
        self.description = QLabel(tooltip)
        self.description.setWordWrap(True)
        self._arrange_section()
        self.title.toggled.connect(self.expand)

    def _arrange_section(self) -> None:
        self.setObjectName("step")
        header = QHBoxLayout()
        header.setContentsMargins(0, 0, 0, 0)
        header.addWidget(self.mark)
        header.addWidget(self.title, 1)
        for widget in (self.seconds, self.run_button, self.cancel_button):
            header.addWidget(widget)
        self.body = QWidget()
        self.column = QVBoxLayout(self.body)
        self.column.setContentsMargins(18, 0, 0, 4)
        self.column.addWidget(self.description)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(6, 3, 4, 3)
        layout.setSpacing(2)
        layout.addLayout(header)
        layout.addWidget(self.progress_bar)
        layout.addWidget(self.status)
        layout.addWidget(self.body)
        self.status.setContentsMargins(18, 0, 0, 0)

    def expand(self, expanded: bool) -> None:
        """Show or hide the parameters."""
        self.title.setChecked(expanded)
        arrow = Qt.ArrowType.DownArrow if expanded else Qt.ArrowType.RightArrow
        self.title.setArrowType(arrow)
        self.body.setVisible(expanded)

    def show_mark(self, sign: str, colour: str, meaning: str) -> None:
        """Show a state."""
        self.mark.setText(sign)
        self.mark.setStyleSheet(f"color: {colour}; font-size: 14px;")
        self.mark.setToolTip(meaning)

    def highlight(self, highlight: bool) -> None:
        """What is sensible to run next stands out."""
        if self.property("next") == highlight:
            return
        self.setProperty("next", highlight)
        edge = HIGHLIGHT if highlight else "transparent"
        self.setStyleSheet(f"QFrame#step {{ border: none; border-left: 3px solid {edge}; }}")
        colour = f"background-color: {HIGHLIGHT}; color: white; font-weight: bold;"
        self.run_button.setStyleSheet(colour if highlight else "")

    def mousePressEvent(self, event: QMouseEvent | None) -> None:
        """A click beside the title opens the section, too."""
        if event is not None and event.type() == QEvent.Type.MouseButtonPress:
            below = self.title.geometry().bottom()
            if event.pos().y() <= below:
                self.title.toggle()
        super().mousePressEvent(event)
