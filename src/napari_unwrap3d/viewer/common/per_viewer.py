"""What there is one of for each viewer, from when it is first asked for until the window closes."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Any, Generic, TypeVar

from qtpy.QtCore import QEvent, QObject


class OfViewer(QObject):
    """What there is one of for a viewer; it lives in the viewer's window, and closes with it.

    Parameters
    ----------
    viewer : napari.Viewer
        No reference to it is kept.
    parent : QObject, optional
        The window.
    """

    def __init__(self, viewer: Any, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._viewer = weakref.ref(viewer)

    @property
    def viewer(self) -> Any:
        """The viewer; None once it is gone."""
        return self._viewer()

    def close(self) -> None:
        """Let go of the viewer, and leave no thread behind."""
        raise NotImplementedError

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """The window closes."""
        if event.type() == QEvent.Type.Close:
            self.close()
        return super().eventFilter(watched, event)


One = TypeVar("One", bound=OfViewer)


class PerViewer(Generic[One]):
    """One object for each viewer, which watches the events of the viewer's window.

    Parameters
    ----------
    make : callable
        Makes it for a viewer and the Qt window of it.
    begin : callable
        What it does for a viewer as soon as it is known.
    """

    def __init__(
        self, make: Callable[[Any, QObject], One], begin: Callable[[Any, One], object]
    ) -> None:
        self._make, self._begin = make, begin
        self._known: weakref.WeakKeyDictionary[Any, One] = weakref.WeakKeyDictionary()

    def known(self, viewer: Any) -> One | None:
        """That of a viewer, or of the proxy of it that napari hands to plugins; None if none."""
        return self._known.get(getattr(viewer, "__wrapped__", viewer))

    def of(self, viewer: Any) -> One:
        """That of a viewer, made now if there is none."""
        viewer = getattr(viewer, "__wrapped__", viewer)
        one = self._known.get(viewer)
        if one is None:
            # napari has no public signal for a closing window; its documentation uses this too.
            window = viewer.window._qt_window
            one = self._known[viewer] = self._make(viewer, window)
            window.installEventFilter(one)
            self._begin(viewer, one)
        return one
