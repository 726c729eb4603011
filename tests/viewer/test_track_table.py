"""The table of tracks: linked with every view, and what a person does to tracks from there."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from qtpy.QtCore import QItemSelectionModel, Qt
from qtpy.QtTest import QTest
from qtpy.QtWidgets import QApplication

from napari_unwrap3d.motion.movie import load_movie
from napari_unwrap3d.viewer.tracks.table import TrackTable
from viewer.tracked import SHOWN, Tracked

ROWS = QItemSelectionModel.SelectionFlag.ClearAndSelect | QItemSelectionModel.SelectionFlag.Rows


def column(dock: TrackTable, name: str) -> list[Any]:
    place = dock.model.columns.index(name)
    source = (dock.rows.index(row, place) for row in range(dock.rows.rowCount()))
    return [index.data(Qt.ItemDataRole.UserRole) for index in source]


def chosen(dock: TrackTable) -> set[int]:
    rows = dock.table.selectionModel().selectedRows()
    return {row.data(Qt.ItemDataRole.UserRole) for row in rows}


def test_the_table_has_a_row_per_track_that_is_linked_with_every_view(tracked: Tracked) -> None:
    window, tracking = tracked, tracked.tracking
    dock = window.dock(TrackTable, "Tracks table")
    expected = window.tracks.track_table
    for name in expected:
        assert column(dock, name) == expected[name].tolist()
    dock.table.sortByColumn(dock.model.columns.index("mean_area_um2"), Qt.SortOrder.DescendingOrder)
    areas = column(dock, "mean_area_um2")
    assert areas == sorted(areas, reverse=True)
    tracking.select([3, 7])
    assert chosen(dock) == {3, 7}
    first = dock.rows.index(0, 0)
    dock.table.selectionModel().select(first, ROWS)
    assert tracking.selection == {first.data(Qt.ItemDataRole.UserRole)}
    dock.table.setFocus()
    QTest.keyClick(dock.table, Qt.Key.Key_Escape)
    assert tracking.selection == frozenset()

    box = dock.colour_box
    box.setCurrentIndex(box.findData("area_um2"))
    box.activated.emit(box.currentIndex())
    assert tracking.column == "area_um2"
    assert dock.limits.text()
    dock.ids.setChecked(True)
    window.drawn()
    layer = window.lines.heads.layer("uv")
    written = [text.strip() for text in layer.features["shown"]]
    assert written == [str(track) for track in window.heads("uv")]

    tracking.set_gate([1, 2, 5])
    assert sorted(column(dock, "track_id")) == [1, 2, 5]
    assert "3 shown" in dock.count.text()
    action = next(a for a in dock.columns_menu.actions() if a.data() == "parent")
    action.trigger()
    dock.copy_button.click()
    lines = QApplication.clipboard().text().splitlines()
    assert len(lines) == 1 + 3
    assert "Out of" not in lines[0]
    assert {line.split("\t")[0] for line in lines[1:]} == {"1", "2", "5"}


def test_tracks_are_cut_joined_linked_anew_and_deleted_and_all_of_it_undone_and_kept(
    tracked: Tracked,
) -> None:
    window, tracking = tracked, tracked.tracking
    dock = window.dock(TrackTable, "Tracks table")
    buttons = dock.edit_bar.buttons
    assert not any(buttons[name].isEnabled() for name in buttons)
    window.go_to(2)
    tracking.set_gate([1, 2, 4, 5])
    tracking.select([1])
    assert buttons["cut"].isEnabled()
    assert not buttons["join"].isEnabled()
    buttons["cut"].click()
    new = max(tracking.tracks.ids)
    assert new > max(window.tracks.ids)
    assert tracking.selection == {1, new}
    assert new in tracking.shown.ids, "what an edit made is shown whatever the gate"
    assert 8 not in tracking.shown.ids
    buttons["join"].click()
    assert tracking.selection == {1}
    _same(tracking.tracks, window.tracks)
    dock.activateWindow()
    dock.table.setFocus()
    tracking.select([1, 2])
    QTest.keyClick(dock.table, Qt.Key.Key_L)
    swapped = tracking.tracks
    assert swapped.column_of(1, "v_px")[3] == window.tracks.column_of(2, "v_px")[3]
    assert swapped.column_of(1, "v_px")[1] == window.tracks.column_of(1, "v_px")[1]
    QTest.keyClick(dock.table, Qt.Key.Key_Delete)
    assert not {1, 2} & set(tracking.tracks.ids)
    assert tracking.selection == frozenset()
    window.wait(lambda: not tracking._keep_timer.isActive() and tracking._keeping is None)
    kept = load_movie(window.movie.folder.path).tracks(SHOWN)
    _same(kept, tracking.tracks)
    assert [step["edit"] for step in kept.numbers["edits"]] == ["cut", "join", "relink", "delete"]
    while buttons["undo"].isEnabled():
        QTest.keyClick(dock.table, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    assert tracking.tracks is window.tracks
    buttons["redo"].click()
    assert new in tracking.tracks.ids

    # The double click goes to when a track is there, and turns the cell to it.
    tracking.set_gate(None)
    window.go_to(0)
    late = next(t for t in window.tracks.ids if t not in window.there(0))
    tracking.select([late])
    buttons["show"].click()
    window.wait(lambda: window.session.timepoint > 0)
    assert late in window.there(window.session.timepoint)
    view = np.asarray(window.viewer.scene.camera.view_direction)
    vertices = window.movie.common.surface.vertices
    centre = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    outwards = tracking.tracks.position_um[window.row(late, window.session.timepoint)] - centre
    assert outwards @ view < -0.99 * np.linalg.norm(outwards)


def _same(one: Any, other: Any) -> None:
    pd.testing.assert_frame_equal(one.table, other.table, check_dtype=False)
