"""Cells that were drawn on and not saved: offered again at the next start."""

from __future__ import annotations

import time
import weakref
from pathlib import Path
from typing import Any

from qtpy.QtWidgets import QHBoxLayout, QLabel, QPushButton, QVBoxLayout, QWidget

from ...errors import Unwrap3DError
from ..common.threads import tell
from .autosave import discard, left_behind


class LeftBehind(QWidget):
    """A row that offers the newest cell that was left behind; hidden where there is none.

    Parameters
    ----------
    viewer : napari.Viewer
    """

    def __init__(self, viewer: Any, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._viewer = weakref.ref(viewer)
        self._path: Path | None = None
        self.text = QLabel()
        self.text.setWordWrap(True)
        self.open_button, self.discard_button = QPushButton("Open"), QPushButton("Discard")
        self.open_button.setToolTip("Open it, to go on or to save it.")
        self.discard_button.setToolTip("Delete it.")
        buttons = QHBoxLayout()
        buttons.addStretch(1)
        buttons.addWidget(self.open_button)
        buttons.addWidget(self.discard_button)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.addWidget(self.text)
        column.addLayout(buttons)
        self.open_button.clicked.connect(self._on_open)
        self.discard_button.clicked.connect(self._on_discard)
        self._update()

    def _update(self) -> None:
        found = left_behind()
        self._path = found[0] if found else None
        if self._path is not None:
            when = time.strftime("%d %B, %H:%M", time.localtime(self._path.stat().st_mtime))
            movie = self._path.is_dir()
            what = "A movie that was made" if movie else "A cell that you drew on"
            self.text.setText(f"{what} was not saved ({when}).")
        self.setVisible(self._path is not None)

    def _on_open(self) -> None:
        from .project import open_project

        viewer = self._viewer()
        if viewer is None or self._path is None:
            return
        try:
            open_project(viewer, self._path)
        except Unwrap3DError as error:
            tell(error)
        self.hide()

    def _on_discard(self) -> None:
        if self._path is not None:
            discard(self._path)
        self._update()
