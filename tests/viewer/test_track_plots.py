"""The dock of the plots: measure, look, click on a curve, write it into a file."""

from __future__ import annotations

import itertools
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from qtpy.QtCore import QPoint, QPointF, Qt
from qtpy.QtTest import QTest
from qtpy.QtWidgets import QApplication

from napari_unwrap3d import load_movie
from napari_unwrap3d.measuring import analysis
from napari_unwrap3d.viewer.tracks.plots import NOT_MEASURED, NOTICE_PAGE, PLOT_PAGE, TrackPlotsDock
from napari_unwrap3d.viewer.tracks.run import NO_TRACKS
from viewer.measured import measured
from viewer.tracked import Tracked, wandering

LEFT, NONE = Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier
CONTROL = Qt.KeyboardModifier.ControlModifier


@pytest.fixture
def threads(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Measuring is made quick; the threads in which tracks were measured."""
    found: list[Any] = []

    def measure(movie: Any, tracks: Any, parameters: Any, progress: Any) -> Any:
        progress(0.5, "halfway")
        found.append(threading.current_thread())
        return measured(tracks, parameters)

    monkeypatch.setattr(analysis, "measure_tracks", measure)
    return found


@pytest.fixture
def window(make_napari_viewer: Any, movie_copy: Path, qtbot: Any) -> Tracked:
    movie = load_movie(movie_copy)
    movie.keep_tracks("wandering", wandering(movie))
    return Tracked(make_napari_viewer(show=True), movie, qtbot)


@pytest.fixture
def dock(window: Tracked, threads: list[Any]) -> TrackPlotsDock:
    return window.dock(TrackPlotsDock, "Track plots")


def shown(window: Tracked, dock: TrackPlotsDock) -> Any:
    """Wait until what is wanted is drawn."""
    window.wait(lambda: not (dock.run.busy_with or dock._rest.isActive() or dock.plot.busy))
    return dock.plot._shown


def measure(window: Tracked, dock: TrackPlotsDock) -> Any:
    QTest.mouseClick(dock.measure_button, LEFT)
    window.wait(lambda: window.tracking.measurements is not None)
    return shown(window, dock)


def choose(dock: TrackPlotsDock, kind: str) -> None:
    dock.kind_box.setCurrentIndex(dock.kind_box.findData(kind))


def pixel(dock: TrackPlotsDock, x: float, y: float) -> QPoint:
    """Where data coordinates of the first axes are in the plot."""
    drawn = dock.plot._shown
    assert drawn is not None
    right, up = drawn.figure.axes[0].transData.transform((x, y))
    width, height = dock.plot._scales()
    return QPoint(round(right / width), round((drawn.picture.shape[0] - up) / height))


def on_curve(dock: TrackPlotsDock, track: int) -> QPoint:
    """A place on the curve of a track that is far from all others."""
    drawn = dock.plot._shown
    assert drawn is not None
    (line,) = [artist for number, artist in drawn.curves if number == track]
    ends = line.get_xydata()
    ways = np.linspace(0.0, 1.0, 30)[:, None]
    parts = [ends, *(a + ways * (b - a) for a, b in itertools.pairwise(ends))]
    places = [pixel(dock, x, y) for x, y in np.concatenate(parts)]
    return next(place for place in places if dock.plot.track_at(QPointF(place)) == track)


def test_tracks_are_measured_in_a_thread_and_drawn(
    window: Tracked, dock: TrackPlotsDock, threads: list[Any]
) -> None:
    assert dock.pages.currentIndex() == NOTICE_PAGE
    assert dock.notice.text.text() == NOT_MEASURED
    assert not dock.export_button.isEnabled()
    QTest.mouseClick(dock.notice.button, LEFT)
    window.wait(lambda: window.tracking.measurements is not None)
    drawn = shown(window, dock)
    assert dock.pages.currentIndex() == PLOT_PAGE
    assert threads[0] is not threading.main_thread()
    assert drawn.wanted.name == "series"
    assert {track for track, _ in drawn.curves} == set(window.tracks.ids.tolist())
    # Another series, and another kind of plot.
    assert dock.choice_box.isVisible()
    dock.choice_box.setCurrentIndex(1)
    dock.choice_box.activated.emit(1)
    assert shown(window, dock).wanted.choice == "height_um"
    choose(dock, "aligned")
    assert shown(window, dock).wanted.choice == "", "all of them above each other"
    choose(dock, "lifetimes")
    assert shown(window, dock).wanted.name == "lifetimes"
    assert not dock.choice_box.isVisible()
    choose(dock, "series")
    assert shown(window, dock).wanted.choice == "height_um", "as it was left"
    choose(dock, "speeds")
    shown(window, dock)
    assert dock.pages.currentIndex() == NOTICE_PAGE
    assert not dock.export_button.isEnabled()
    # Nothing is left to measure.
    window.tracking.set_tracks("", None)
    shown(window, dock)
    assert dock.notice.text.text() == NO_TRACKS
    assert not dock.measure_button.isEnabled()


def test_a_click_selects_a_track_and_what_was_measured_ages_and_is_renewed(
    window: Tracked, dock: TrackPlotsDock, threads: list[Any], tmp_path: Path
) -> None:
    before = measure(window, dock)
    QTest.mouseClick(dock.plot, LEFT, NONE, on_curve(dock, 5))
    assert window.tracking.selection == {5}
    after = shown(window, dock)
    assert after.wanted.selection == {5}
    assert "track 5" in dock.status.text()
    assert not np.array_equal(after.picture, before.picture)
    QTest.mouseClick(dock.plot, LEFT, CONTROL, on_curve(dock, 2))
    assert window.tracking.selection == {2, 5}
    shown(window, dock)
    # Selected elsewhere.
    window.tracking.select([7])
    drawn = shown(window, dock)
    assert drawn.wanted.selection == {7}
    # A double click goes to its time, and leaves the selection.
    axes = drawn.figure.axes[0]
    low, high = axes.get_ylim()
    place = pixel(dock, 3 * window.movie.time_step_s, low + 0.04 * (high - low))
    assert dock.plot.track_at(QPointF(place)) is None
    QTest.mouseClick(dock.plot, LEFT, NONE, place)
    QTest.mouseDClick(dock.plot, LEFT, NONE, place)
    window.wait(lambda: window.session.timepoint == 3)
    line = dock.plot._time_line()
    assert line is not None
    assert abs(line[0].x() - place.x()) < 2
    assert window.tracking.selection == {7}
    # One click beside all curves does not.
    QTest.mouseClick(dock.plot, LEFT, NONE, QPoint(3, 3))
    window.wait(lambda: not window.tracking.selection)
    # The theme and the size.
    dark = shown(window, dock)
    window.viewer.theme = "light"
    light = shown(window, dock)
    assert light.picture[0, 0, 0] > 200 > dark.picture[0, 0, 0]
    dock.window().resize(dock.window().width(), dock.window().height() - 150)
    for _ in range(5):
        QApplication.processEvents()
    drawn = shown(window, dock)
    assert drawn.picture.shape[1] == round(dock.plot.width() * dock.plot.devicePixelRatioF())
    # What was measured ages, is renewed and written.
    assert not dock.stale.isVisible()
    window.tracking.set_gate([1, 2, 3, 4])
    assert dock.stale.isVisible()
    dock.automatic.setChecked(True)
    window.wait(lambda: len(threads) == 2 and not dock.stale.isVisible())
    assert {track for track, _ in shown(window, dock).curves} == {1, 2, 3, 4}
    dock.run.session.set_values("measurement", {"prominence": 0.25})
    window.wait(lambda: len(threads) == 3 and not dock.stale.isVisible())
    # Edited: what was measured is no longer of these tracks.
    assert window.tracking.edits is not None
    window.tracking.edits.delete(2)
    window.wait(lambda: len(threads) == 4 and not dock.run.busy_with)
    assert 2 not in {track for track, _ in shown(window, dock).curves}

    window.tracking.select([3, 4])
    shown(window, dock)
    for suffix, begin in ((".svg", b"<?xml"), (".csv", b"track_id,")):
        dock.export(tmp_path / f"series{suffix}")
        window.wait(lambda suffix=suffix: dock.message.text().endswith(suffix))
        assert (tmp_path / f"series{suffix}").read_bytes().startswith(begin)
    table = pd.read_csv(tmp_path / "series.csv")
    assert set(table.track_id) == {3, 4}
    rows = window.tracks.rows_of(3)
    own = table[table.track_id == 3]
    np.testing.assert_array_equal(own.area_um2, window.tracks.columns["area_um2"][rows])
