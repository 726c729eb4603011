"""A window in which a movie is made: the dock Movie, and what a user does with it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import mouse
import numpy as np
from qtpy.QtCore import Qt
from qtpy.QtTest import QTest

from napari_unwrap3d.viewer.movies.run import MovieRun
from napari_unwrap3d.viewer.movies.session import MovieSession, movie_session_of
from napari_unwrap3d.viewer.movies.wizard import MovieDock, MoviePanel
from napari_unwrap3d.viewer.session import session_of
from viewer.playing import PARAMETERS, TIME_STEP_S, VOXEL_UM, breathing, breathing_stack

TIMEPOINTS = 4
SECONDS = 30_000
UM = ("µm",) * 3
SCALE = (VOXEL_UM,) * 3
TIMED: dict[str, Any] = {
    "scale": (TIME_STEP_S, *SCALE),
    "units": ("second", *UM),
    "axis_labels": tuple("tzyx"),
}


def add_stack(viewer: Any) -> Any:
    """The timelapse that the movie of the fixture was made from."""
    stack = breathing_stack()
    units, axes = ("second", "pixel", *UM), tuple(stack.axes)
    scale = (TIME_STEP_S, 1.0, *SCALE)
    return viewer.add_image(
        stack.data, name="breathing", scale=scale, units=units, axis_labels=axes
    )


def cells() -> np.ndarray:
    """The masks of the breathing cell, (t, z, y, x)."""
    return np.stack([breathing(t) for t in range(TIMEPOINTS)])


class Director:
    """A viewer with the dock of the movie, and a hand."""

    def __init__(self, viewer: Any, qtbot: Any) -> None:
        self.viewer, self.qtbot = viewer, qtbot
        viewer.window.resize(1400, 1000)
        self.dock = MovieDock(viewer)
        viewer.window.add_dock_widget(self.dock, name="Movie", area="right")
        self.session = session_of(viewer)
        self.session.set_parameters(PARAMETERS)

    @property
    def panel(self) -> MoviePanel:
        return self.dock.panel

    @property
    def run(self) -> MovieRun:
        return self.panel.run

    @property
    def movies(self) -> MovieSession:
        return movie_session_of(self.viewer)

    def wait(self, condition: Callable[[], Any]) -> None:
        self.qtbot.waitUntil(condition, timeout=SECONDS)

    def click(self, button: Any) -> None:
        """Press a button that can be pressed."""
        assert button.isEnabled()
        QTest.mouseClick(button, mouse.LEFT)

    def open(self, path: Path) -> None:
        """Open a movie, and wait until it is shown."""
        self.panel.open(path)
        self.wait(lambda: self.movies.movie is not None)
        self.settle()

    def run_all(self) -> None:
        """Press Run all, and wait for the end."""
        self.click(self.panel.run_button)
        self.wait(lambda: self.run.running)
        self.end()

    def end(self) -> None:
        """Wait for the end of the run, and until everything is shown."""
        self.wait(lambda: not self.run.running)
        self.settle()

    def settle(self) -> None:
        self.wait(lambda: not self.run.busy_with and not self.session.turns.busy)
        self.wait(lambda: self.run.looking is False)

    def states(self) -> dict[str, str]:
        """The mark of every section."""
        return {stage: section.mark.text() for stage, section in self.panel.sections.items()}

    def fill_in(self, box: Any, text: str) -> None:
        """Type a number."""
        box.setFocus()
        box.selectAll()
        QTest.keyClicks(box, text)
        QTest.keyClick(box, Qt.Key.Key_Return)
