"""The timeline: its slider, buttons and keys, the playback, and napari's own slider over t."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from qtpy.QtCore import QPoint, Qt
from qtpy.QtTest import QTest

from napari_unwrap3d.viewer.movies.timeline import Timeline, runs, time_text
from viewer.playing import TIME_STEP_S, TIMEPOINTS, Projector

LEFT = Qt.MouseButton.LeftButton


@pytest.fixture
def timeline(projector: Projector) -> Timeline:
    found = projector.viewer.window._qt_window.findChild(Timeline)
    assert found is not None
    return found


def shows(projector: Projector, timepoint: int) -> None:
    projector.wait(lambda: projector.session.timepoint == timepoint)
    projector.wait(lambda: projector.layers.shown.frame.timepoint == timepoint)


def test_buttons_keys_and_both_sliders_go_through_the_movie(
    projector: Projector, timeline: Timeline
) -> None:
    for name, expected in (("next", 1), ("last", TIMEPOINTS - 1), ("previous", 3), ("first", 0)):
        QTest.mouseClick(timeline.buttons[name], LEFT)
        shows(projector, expected)
        assert timeline.slider.value() == expected
        assert f"t {expected} / {TIMEPOINTS - 1}" in timeline.label.text()
        assert time_text(expected * TIME_STEP_S) in timeline.label.text()
    for canvas in (projector.main, projector.second):
        QTest.keyClick(canvas, Qt.Key.Key_Period)
        shows(projector, 1)
        QTest.keyClick(canvas, Qt.Key.Key_Comma)
        shows(projector, 0)
    # There is nothing before the first.
    QTest.keyClick(projector.main, Qt.Key.Key_Comma)
    assert projector.session.wanted == 0
    # The slider shows the last timepoint that it was moved to.
    seen: list[int] = []
    projector.session.frame_changed.connect(lambda frame: seen.append(frame.timepoint))
    for value in (1, 2, 4):
        timeline.slider.setValue(value)
    shows(projector, 4)
    projector.settle()
    assert seen[-1] == 4
    assert timeline.slider.value() == 4
    QTest.keyClick(timeline.slider, Qt.Key.Key_Left)
    shows(projector, 3)
    # napari's own slider over t is kept in step.
    viewer = projector.viewer
    stack = np.zeros((TIMEPOINTS, 4, 5, 6), np.uint8)
    layer = viewer.add_image(stack, axis_labels=("t", "z", "y", "x"), units=("s", *["µm"] * 3))
    assert viewer.dims.current_step[0] == projector.session.timepoint
    projector.go_to(4)
    assert viewer.dims.current_step[0] == 4
    viewer.dims.set_current_step(0, 1)
    shows(projector, 1)
    viewer.layers.remove(layer)
    projector.go_to(2)


def test_it_plays_to_the_end_or_for_ever_and_passes_over_what_is_not_made(
    projector: Projector, timeline: Timeline
) -> None:
    session = projector.session
    seen: list[int] = []
    session.frame_changed.connect(lambda frame: seen.append(frame.timepoint))
    timeline.fps_box.setValue(30)
    QTest.mouseClick(timeline.loop_box, LEFT, pos=QPoint(8, timeline.loop_box.height() // 2))
    assert not session.loop
    QTest.mouseClick(timeline.buttons["play"], LEFT)
    assert session.playing
    projector.wait(lambda: not session.playing)
    shows(projector, TIMEPOINTS - 1)
    assert seen == [1, 2, 3, 4]
    session.loop = True
    assert timeline.loop_box.isChecked()
    seen.clear()
    QTest.keyClick(projector.main, Qt.Key.Key_K)
    projector.wait(lambda: seen.count(2) == 2)
    QTest.keyClick(projector.main, Qt.Key.Key_K)
    assert not session.playing
    # Frames that are not made are marked, and passed over.
    folder = projector.movie.folder.path
    projector.wait(lambda: len(session.made) == TIMEPOINTS)
    path = folder / "frames" / "00002.zip"
    kept = path.read_bytes()
    path.unlink()
    session.set_movie(projector.movie)
    projector.wait(lambda: session.made == {0, 1, 3, 4})
    projector.wait(lambda: projector.views.layers is not None)
    projector.wait(lambda: projector.views.layers.shown is not None)
    assert timeline.slider.made == {0, 1, 3, 4}
    timeline.slider.setValue(2)
    projector.wait(lambda: "not made yet" in timeline.label.text())
    assert session.timepoint == 0
    session.fps, session.loop = 30, False
    session.set_timepoint(1)
    shows(projector, 1)
    seen[:] = [1]
    session.play()
    projector.wait(lambda: not session.playing)
    shows(projector, 4)
    assert seen == [1, 3, 4]
    path.write_bytes(kept)
    session.look_for_frames()
    projector.wait(lambda: 2 in timeline.slider.made)
    projector.go_to(2)


def test_without_a_movie_there_is_nothing_to_move(make_napari_viewer: Any) -> None:
    timeline = Timeline(make_napari_viewer())
    assert not timeline.slider.isEnabled()
    assert "no movie" in timeline.label.text()


def test_runs_of_frames() -> None:
    assert runs(frozenset({0, 1, 4}), 6) == [
        (0, 2, True),
        (2, 4, False),
        (4, 5, True),
        (5, 6, False),
    ]
    assert runs(frozenset(), 3) == [(0, 3, False)]


def test_times_in_words() -> None:
    assert time_text(2.4) == "2.4 s"
    assert time_text(204.0) == "204 s = 3 min 24 s"
