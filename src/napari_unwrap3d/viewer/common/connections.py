"""What ends with a widget: its connections to a viewer's events; and the widget, with its dock."""

from __future__ import annotations

from typing import Any

from qtpy.QtCore import QEvent, QObject
from qtpy.QtWidgets import QWidget

from .turns import soon


def disconnect(connections: list[tuple[Any, Any]], *_: Any) -> None:
    """Undo connections (emitter, callback), and forget them."""
    for emitter, callback in connections:
        emitter.disconnect(callback)
    connections.clear()


def end_with_dock(widget: QWidget) -> None:
    """Delete a dock widget when its dock is closed.

    napari takes it out of the dock and forgets it: it would go on listening, unseen, beside
    the one that is opened next. One that is docked again at once is left alone.
    """
    _Undocked(widget)


class _Undocked(QObject):
    def __init__(self, widget: QWidget) -> None:
        super().__init__(widget)
        self._timer = soon(self, self._on_rest)
        widget.installEventFilter(self)

    def eventFilter(self, watched: QObject | None, event: QEvent | None) -> bool:
        if event is not None and event.type() == QEvent.Type.ParentChange:
            self._timer.start()
        return False

    def _on_rest(self) -> None:
        widget = self.parent()
        if widget is not None and widget.parent() is None:
            widget.deleteLater()
