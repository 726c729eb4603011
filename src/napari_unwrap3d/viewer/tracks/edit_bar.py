"""Buttons and keys that edit the tracks which are selected; undo and redo."""

from __future__ import annotations

from typing import TYPE_CHECKING

from qtpy.QtCore import QEvent, QObject
from qtpy.QtGui import QKeyEvent, QKeySequence
from qtpy.QtWidgets import QGridLayout, QPushButton, QWidget

if TYPE_CHECKING:
    from .session import TracksSession

TEXTS = {
    "cut": "Cut",
    "join": "Join",
    "relink": "Re-link",
    "delete": "Delete",
    "undo": "Undo",
    "redo": "Redo",
    "show": "Show",
}
TIPS = {
    "cut": "What follows from this timepoint on becomes a track of its own.",
    "join": "Make one track of the two that are selected.",
    "relink": "From this timepoint on, each of the two selected tracks goes on as the other did.",
    "delete": "Leave the selected tracks out.",
    "undo": "Take back the last edit of a track.",
    "redo": "Make it again.",
    "show": "Go to a timepoint at which the selected track is there, and turn the cell to it.",
}
KEYS = {
    "cut": "C",
    "join": "J",
    "relink": "L",
    "delete": "Del",
    "undo": "Ctrl+Z",
    "redo": "Ctrl+Shift+Z",
    "show": "Return",
}
WHY_NOT = {
    "cut": "Select a track that is there at this timepoint and before it.",
    "join": "Select two tracks.",
    "relink": "Select two tracks.",
    "delete": "Select a track.",
    "undo": "There is nothing to undo.",
    "redo": "There is nothing to redo.",
    "show": "Select a track.",
}
PER_ROW = 4


class TrackEditBar(QWidget):
    """Buttons that are pressed only where that makes sense; their tips say why not.

    Parameters
    ----------
    session : TracksSession
    """

    def __init__(self, session: TracksSession, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._session = session
        self.buttons = {name: QPushButton(text) for name, text in TEXTS.items()}
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setSpacing(3)
        self._keys = {QKeySequence(key).toString(): name for name, key in KEYS.items()}
        for place, (name, button) in enumerate(self.buttons.items()):
            grid.addWidget(button, *divmod(place, PER_ROW))
            button.clicked.connect(lambda _=False, name=name: self._do(name))
        for signal in (session.shown_changed, session.selection_changed, session.editing.working):
            signal.connect(self.update_buttons)
        session.movies.frame_changed.connect(self.update_buttons)
        self.update_buttons()

    def listen(self, *widgets: QWidget) -> None:
        """Let the keys hold while one of these has the focus."""
        for widget in widgets:
            widget.installEventFilter(self)

    def eventFilter(self, watched: QObject | None, event: QEvent | None) -> bool:
        """A key: before napari's own meaning of it, and before a table looks for its letter."""
        if not isinstance(event, QKeyEvent):
            return False
        name = self._keys.get(QKeySequence(event.keyCombination()).toString())
        if name is None:
            return False
        if event.type() == QEvent.Type.ShortcutOverride:
            event.accept()
        elif event.type() == QEvent.Type.KeyPress:
            self._do(name)
        return event.type() in (QEvent.Type.ShortcutOverride, QEvent.Type.KeyPress)

    def update_buttons(self, _: object = None) -> None:
        """Which can be pressed, and why not."""
        for name, button in self.buttons.items():
            possible = self._session.editing.can(name)
            button.setEnabled(possible)
            why = "" if possible else f"\n{WHY_NOT[name]}"
            button.setToolTip(f"{TIPS[name]} ({KEYS[name]}){why}")

    def _do(self, name: str) -> None:
        self._session.editing.do(name)
        self.update_buttons()
