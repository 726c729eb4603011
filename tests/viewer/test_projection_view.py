"""What is near the surface, at the timepoint that is shown."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from qtpy.QtTest import QTest

from napari_unwrap3d.motion.movie import load_movie
from napari_unwrap3d.motion.projections import Projections
from napari_unwrap3d.viewer.movies.projection_view import NO_STACK, ProjectionDock
from viewer.movie_window import MovieWindow
from viewer.opened import SECONDS


def test_the_projection_follows_time_and_choices(
    make_napari_viewer: Any, breathing: Any, qtbot: Any
) -> None:
    window = MovieWindow(make_napari_viewer(show=True), breathing, qtbot)
    dock = window.dock(ProjectionDock, "Surface projection")

    def shows(channel: int, reach_um: float, axis: str, statistic: str, timepoint: int) -> None:
        projections = Projections.of(breathing, channel, reach_um, axis, statistic=statistic)
        expected = projections.at(timepoint)
        qtbot.waitUntil(
            lambda: (
                dock.plot.found is not None
                and np.array_equal(dock.plot.found.image, expected.image, equal_nan=True)
            ),
            timeout=SECONDS,
        )

    shows(0, 1.0, "z", "max", 0)
    window.go_to(2)
    shows(0, 1.0, "z", "max", 2)
    dock.channel_box.setCurrentIndex(1)
    dock.axis_box.setCurrentText("x")
    dock.statistic_box.setCurrentText("mean")
    dock.reach_box.selectAll()
    QTest.keyClicks(dock.reach_box, "0.3\r")
    shows(1, 0.3, "x", "mean", 2)
    qtbot.waitUntil(lambda: not dock.busy, timeout=SECONDS)


def test_a_movie_without_its_stack_says_so(
    make_napari_viewer: Any, breathing: Any, qtbot: Any, tmp_path: Path
) -> None:
    window = MovieWindow(make_napari_viewer(show=True), load_movie(breathing.folder.path), qtbot)
    dock = window.dock(ProjectionDock, "Surface projection")
    assert dock.status.text() == NO_STACK
    assert not dock.plot.isVisible()
