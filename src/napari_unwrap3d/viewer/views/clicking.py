"""A click in a canvas that picks what is under it, told from a drag.

Only a click that moves nothing: a drag turns or moves the view as ever. While a tool of the
active layer is in hand, clicks are the tool's.
"""

from __future__ import annotations

import weakref
from collections.abc import Iterator
from typing import Any

import numpy as np
from qtpy.QtCore import QEvent, QObject, Qt
from qtpy.QtWidgets import QMainWindow

ADDING = ("Shift", "Control")
# A hand is not quite still while it clicks.
STILL_PIXELS = 4.0
MOVES = "pan_zoom"


class Clicks(QObject):
    """Listens for clicks, and for Escape, in the canvases of a viewer until its window closes.

    Parameters
    ----------
    viewer : napari.Viewer
    parent : QObject
    """

    def __init__(self, viewer: Any, parent: QObject) -> None:
        super().__init__(parent)
        self._viewer = weakref.ref(viewer)
        self._models: list[Any] = []
        viewer.window._qt_window.installEventFilter(self)

    def listen(self, model: Any, native: Any) -> None:
        """Also listen in a canvas: its model, and the widget that gets its keys."""
        self._models.append(model)
        model.mouse_drag_callbacks.append(self._on_press)
        # Not as a key of napari's: that of the layer that is active goes before.
        native.installEventFilter(self)

    def may_pick(self, model: Any) -> bool:
        """Whether a click is for us, and not for a tool."""
        active = model.layers.selection.active
        return str(getattr(active, "mode", MOVES)) == MOVES

    def pick(self, model: Any, event: Any, adding: bool) -> None:
        """Something was clicked, to be added to what is selected or instead of it."""
        raise NotImplementedError

    def clear(self) -> None:
        """Select nothing."""
        raise NotImplementedError

    def _on_press(self, model: Any, event: Any) -> Iterator[None]:
        if event.button != 1 or not self.may_pick(model):
            return
        start, still = np.asarray(event.pos, dtype=float), True
        yield
        while event.type == "mouse_move":
            still &= bool(np.linalg.norm(np.asarray(event.pos) - start) <= STILL_PIXELS)
            yield
        if still:
            self.pick(model, event, any(key in ADDING for key in event.modifiers))

    def close(self) -> None:
        """Listen no longer."""
        models, self._models = self._models, []
        for model in models:
            if self._on_press in model.mouse_drag_callbacks:
                model.mouse_drag_callbacks.remove(self._on_press)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Escape over a canvas; the window closes."""
        kind = event.type()
        if kind == QEvent.Type.KeyPress and event.key() == Qt.Key.Key_Escape:
            self.clear()
        elif kind == QEvent.Type.Close and isinstance(watched, QMainWindow):
            self.close()
        return super().eventFilter(watched, event)
