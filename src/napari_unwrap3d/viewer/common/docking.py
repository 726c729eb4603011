"""Our docks at one side of the window share the height as tabs: halves would be too small."""

from __future__ import annotations

from qtpy.QtGui import QShowEvent
from qtpy.QtWidgets import QDockWidget, QMainWindow, QWidget

from .turns import soon


class Docked(QWidget):
    """A widget whose dock joins those of ours as a tab when it is first shown."""

    _joined = False

    def showEvent(self, event: QShowEvent) -> None:
        """Join later: napari is still placing the dock."""
        super().showEvent(event)
        if not self._joined:
            self._joined = True
            soon(self, self._join).start()

    def _join(self) -> None:
        dock = dock_of(self)
        window = None if dock is None else dock.parentWidget()
        if dock is None or not isinstance(window, QMainWindow):
            return
        area = window.dockWidgetArea(dock)
        for other in window.findChildren(Docked):
            known = dock_of(other)
            if other is self or known is None or not other._joined:
                continue
            free = known.isFloating() or dock.isFloating() or known.isHidden()
            if not free and window.dockWidgetArea(known) == area:
                if dock not in window.tabifiedDockWidgets(known):
                    window.tabifyDockWidget(known, dock)
                dock.raise_()
                return


def dock_of(widget: QWidget) -> QDockWidget | None:
    """The dock that a widget is in."""
    parent = widget.parentWidget()
    while parent is not None and not isinstance(parent, QDockWidget):
        parent = parent.parentWidget()
    return parent
