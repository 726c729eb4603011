"""A movie of the window, or of drawn pictures, as files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from qtpy.QtWidgets import QFileDialog

from movies import TIMEPOINTS, read_mp4
from napari_unwrap3d.viewer.movies.export_dialog import MP4, PNG, MovieExportDock
from napari_unwrap3d.viewer.movies.recording import BOTH, MAIN, fitted, stamped
from viewer.movie_window import MovieWindow
from viewer.opened import SECONDS


@pytest.fixture
def window(make_napari_viewer: Any, breathing: Any, qtbot: Any) -> MovieWindow:
    return MovieWindow(make_napari_viewer(show=True), breathing, qtbot)


@pytest.fixture
def dock(window: MovieWindow) -> MovieExportDock:
    return window.dock(MovieExportDock, "Export movie")


def choose(dock: MovieExportDock, what: str, kind: str = MP4) -> None:
    dock.what_box.setCurrentIndex(dock.what_box.findData(what))
    dock.format_box.setCurrentText(kind)


def press(dock: MovieExportDock, path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Press the button and name a file, or a folder."""
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *_: (str(path), ""))
    monkeypatch.setattr(QFileDialog, "getExistingDirectory", lambda *_: str(path))
    dock.export_button.click()


def wait(dock: MovieExportDock, qtbot: Any) -> None:
    qtbot.waitUntil(lambda: dock.recording is None and dock._task is None, timeout=2 * SECONDS)


def test_what_is_shown_is_recorded_and_pictures_are_drawn(
    window: MovieWindow,
    dock: MovieExportDock,
    qtbot: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    window.go_to(1)
    shown: list[int] = []
    window.session.frame_changed.connect(lambda frame: shown.append(frame.timepoint))
    choose(dock, BOTH)
    press(dock, tmp_path / "movie", monkeypatch)
    assert not dock.export_button.isEnabled()
    wait(dock, qtbot)
    frames = read_mp4(tmp_path / "movie.mp4")
    assert len(frames) == TIMEPOINTS
    assert shown[:TIMEPOINTS] == list(range(TIMEPOINTS))
    window.at(1)
    rows, columns = frames[0].shape[:2]
    native = window.viewer.window._qt_viewer.canvas.native
    assert columns >= native.width() + window.second.width() - 2
    # The time is in the corner, and changes.
    corner = [frame[: rows // 8, : columns // 8].astype(int) for frame in frames]
    assert np.abs(corner[1] - corner[0]).max() > 60
    assert "movie.mp4" in dock.status.text()
    assert dock.export_button.isEnabled()
    # Drawn pictures, as PNG.
    choose(dock, "drawn: uv", PNG)
    assert not dock.stamp_box.isEnabled()
    press(dock, tmp_path / "frames", monkeypatch)
    wait(dock, qtbot)
    assert len(list((tmp_path / "frames").iterdir())) == TIMEPOINTS


def test_a_cancelled_export_leaves_nothing_and_what_goes_wrong_is_told(
    dock: MovieExportDock,
    qtbot: Any,
    tmp_path: Path,
    errors: list[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    choose(dock, MAIN)
    press(dock, tmp_path / "movie.mp4", monkeypatch)
    qtbot.waitUntil(lambda: dock.bar.value() >= 1, timeout=SECONDS)
    dock.cancel_button.click()
    wait(dock, qtbot)
    assert "Stopped" in dock.status.text()
    assert not list(tmp_path.iterdir())
    choose(dock, "drawn: all")
    press(dock, tmp_path / "movie.mp4", monkeypatch)
    qtbot.waitUntil(lambda: dock.recording is not None, timeout=SECONDS)
    dock.cancel_button.click()
    wait(dock, qtbot)
    assert not list(tmp_path.iterdir())
    # What goes wrong is told.
    (tmp_path / "thesis.txt").write_text("years of work")
    choose(dock, MAIN, PNG)
    press(dock, tmp_path, monkeypatch)
    wait(dock, qtbot)
    assert "thesis.txt" in errors[-1]
    # Without a line there is no kymograph.
    choose(dock, "drawn: kymograph")
    press(dock, tmp_path / "movie.mp4", monkeypatch)
    wait(dock, qtbot)
    assert "line" in errors[-1]
    assert [entry.name for entry in tmp_path.iterdir()] == ["thesis.txt"]


def test_pictures_keep_their_size() -> None:
    image = np.full((20, 30, 3), 7, np.uint8)
    assert fitted(image, (20, 30, 3)) is image
    assert (fitted(image, (25, 20, 3)) == 7).all()
    assert fitted(image, (25, 20, 3)).shape == (25, 20, 3)


@pytest.mark.parametrize("shade", [0, 255])
def test_the_time_can_be_read_on_any_ground(qapp: Any, shade: int) -> None:
    image = np.full((201, 301, 3), shade, np.uint8)
    found = stamped(image, "12.5 s").astype(int)
    assert found.shape == image.shape
    changed = np.abs(found - shade).max(axis=2) > 128
    assert changed.any()
    assert not changed[40:].any()
    assert not changed[:, 150:].any()
