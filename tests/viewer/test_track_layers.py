"""Tracks in both canvases: lines and heads that follow the timeline, the gate and the colours."""

from __future__ import annotations

from typing import Any

import numpy as np
from qtpy.QtCore import Qt
from qtpy.QtTest import QTest
from qtpy.QtWidgets import QApplication

from napari_unwrap3d.tracking.laying import position_of
from napari_unwrap3d.viewer.tracks.colours import DIMMED
from viewer.playing import TIMEPOINTS
from viewer.tracked import CONTROL, OTHER, SHOWN, Tracked

SPACE, UV = "surface", "uv"


def test_gate_colours_and_timeline_are_the_same_in_every_view(
    tracked: Tracked,
) -> None:
    window, tracking = tracked, tracked.tracking
    tracking.select([1, 4])
    tracking.set_gate([2, 4, 5])
    window.drawn()
    assert tracking.selection == {4}
    for chart in (SPACE, UV):
        assert set(window.lines.layer(chart).features["track"]) == {2, 4, 5}
    tracking.set_gate([])
    window.drawn()
    for chart in (SPACE, UV):
        assert not window.lines.layer(chart).visible
        assert not window.heads(chart)
    # Tracks that begin late leave the timeline where it is, whatever napari's slider can show.
    firsts = {
        t: int(window.tracks.timepoint[window.tracks.rows_of(t)][0]) for t in tracking.tracks.ids
    }
    tracking.set_gate([track for track, first in firsts.items() if first > 1])
    window.drawn()
    QApplication.processEvents()
    assert window.session.wanted == window.session.timepoint == 0
    assert not window.heads(UV)
    window.go_to(3)
    assert window.lines.layer(SPACE).current_time == 3
    tracking.set_gate(None)
    window.drawn()
    assert tracking.shown is window.tracks
    assert all(window.lines.layer(chart).visible for chart in (SPACE, UV))

    tracking.colour_by("area_um2")
    window.drawn()
    assert window.lines.layer(SPACE).color_by == window.lines.layer(UV).color_by == "area_um2"
    _same_colours(window)
    # napari's own controls.
    window.lines.layer(UV).color_by = "lifetime_s"
    window.drawn()
    assert tracking.column == window.lines.layer(SPACE).color_by == "lifetime_s"
    window.lines.layer(SPACE).colormap = "magma"
    window.drawn()
    assert tracking.colormap == "magma"
    tracking.select([4])
    window.drawn()
    _same_colours(window)
    layer = window.lines.layer(UV)
    others = np.asarray(layer.features["track"]) != 4
    assert np.allclose(layer.track_colors[others, 3], DIMMED)
    assert np.allclose(layer.track_colors[~others, 3], 1.0)
    tracking.colour_by("no such column")
    assert tracking.column == ""

    # They lie in both canvases, and follow the timeline both ways.
    tracks = window.tracks
    assert window.tracking.name == SHOWN
    assert window.tracking.names == (OTHER, SHOWN)
    lines, on_uv = window.viewer.layers["tracks"], window.canvas.model.layers["tracks"]
    assert (lines, on_uv) == (window.lines.layer(SPACE), window.lines.layer(UV))
    own = lines.data[np.asarray(lines.features["track_id"]) <= tracks.ids.max()]
    assert np.allclose(own[:, 2:], tracks.position_um)
    assert lines.units[1:] == window.cell.units
    steps = np.linalg.norm(np.diff(on_uv.data[:, 3:], axis=0), axis=1)
    assert steps[np.diff(on_uv.data[:, 0]) == 0].max() < tracks.rows
    for track in (1, 2):
        pieces = np.asarray(on_uv.features["track_id"])[
            np.asarray(on_uv.features["track"]) == track
        ]
        assert len(set(pieces)) == 2, "it goes over the seam, or over a pole"
    for timepoint in (2, TIMEPOINTS - 1, 0):
        window.go_to(timepoint)
        assert lines.current_time == on_uv.current_time == timepoint
        for chart, places in ((SPACE, tracks.position_um), (UV, tracks.place_px)):
            shown = window.heads(chart)
            assert set(shown) == window.there(timepoint)
            for track, place in shown.items():
                assert np.allclose(place, places[window.row(track, timepoint)])
    # napari's own slider is the same timeline.
    window.viewer.dims.set_current_step(0, 3)
    window.wait(lambda: window.session.timepoint == 3)
    assert set(window.heads(UV)) == window.there(3)
    # Other tracks that were kept.
    window.tracking.open(OTHER)
    window.wait(lambda: window.tracking.name == OTHER)
    window.drawn()
    assert set(lines.features["track"]) == {1}


def _same_colours(window: Tracked) -> None:
    rows = window.tracking.colours.rows(window.tracking.selection)
    for chart in (SPACE, UV):
        layer, lines = window.lines.layer(chart), window.lines.lines[chart]
        assert np.allclose(layer.track_colors, rows[lines.row])
        points = window.lines.heads.layer(chart)
        assert np.allclose(points.face_color, rows[window.lines.heads.rows(chart)], atol=1e-6)


def test_a_click_selects_what_is_seen_and_a_head_that_is_dragged_stays_on_the_surface(
    tracked: Tracked,
) -> None:
    window, tracking = tracked, tracked.tracking
    window.go_to(2)
    shown = window.heads(UV)
    window.click(window.second, window.on_image(shown[1]))
    assert tracking.selection == {1}
    window.click(window.second, window.on_image(shown[5]), CONTROL)
    assert tracking.selection == {1, 5}
    # Half-way back on its line.
    line = window.tracks.place_px[window.tracks.rows_of(2)]
    window.click(window.second, window.on_image((line[0] + line[1]) / 2))
    assert tracking.selection == {2}
    window.click(window.second, window.on_image(_empty(window)))
    assert tracking.selection == frozenset()
    front, back = _sides(window)
    window.click(window.main, window.in_space(window.heads(SPACE)[front]))
    assert tracking.selection == {front}
    QTest.keyClick(window.main, Qt.Key.Key_Escape)
    assert tracking.selection == frozenset()
    window.click(window.main, window.in_space(window.heads(SPACE)[back]))
    assert back not in tracking.selection, "it is on the far side"

    layer = window.lines.heads.layer(UV)
    window.canvas.model.layers.selection.active = layer
    layer.mode = "select"
    start = shown[5].copy()
    _drag(window, start, start + np.array([3.0, 4.0]))
    window.wait(lambda: tracking.edits.is_edited)
    window.drawn()
    assert tracking.selection == {5}
    tracks, row = tracking.tracks, window.row(5, 2)
    assert np.allclose(tracks.place_px[row], start + np.array([3.0, 4.0]), atol=3 / _zoom(window))
    there = position_of(window.movie, 2, tracks.place_px[row][None])[0]
    assert np.allclose(tracks.position_um[row], there)
    assert np.allclose(window.heads(SPACE)[5], there)
    QTest.keyClick(window.second, Qt.Key.Key_Delete)
    window.drawn()
    assert 5 not in window.there(2), "its point at this timepoint was deleted"
    assert 5 in tracking.tracks.ids
    # napari's tool "add points": to the track that is selected, and else to a new one.
    layer.mode = "add"
    tracking.select([5])
    window.drawn()
    empty = _empty(window)
    for there in (lambda: 5 in window.there(2), lambda: len(tracking.tracks.ids) == 13):
        window.click(window.second, window.on_image(empty))
        window.wait(there)
        window.drawn()
    assert len(window.tracks.ids) == 12
    assert np.allclose(window.heads(UV)[5], empty, atol=2 / _zoom(window))
    row = window.row(5, 2)
    laid = position_of(window.movie, 2, tracking.tracks.place_px[row][None])[0]
    assert np.allclose(tracking.tracks.position_um[row], laid)
    for _ in range(4):
        tracking.editing.do("undo")
    window.drawn()
    assert np.allclose(window.heads(UV)[5], start)


def _empty(window: Tracked) -> Any:
    """A place of the image far from all tracks."""
    rows = window.tracks.rows
    grid = np.stack(np.meshgrid(np.arange(rows), np.arange(2 * rows), indexing="ij"), -1)
    grid = grid.reshape(-1, 2)
    away = np.linalg.norm(grid[:, None] - window.lines.lines[UV].place[None], axis=2).min(axis=1)
    return grid[np.argmax(away)]


def _sides(window: Tracked) -> tuple[int, int]:
    """The heads nearest to and farthest from the camera."""
    view = np.asarray(window.viewer.scene.camera.view_direction)
    depth = {track: float(place @ view) for track, place in window.heads(SPACE).items()}
    return min(depth, key=depth.__getitem__), max(depth, key=depth.__getitem__)


def _drag(window: Tracked, start: Any, end: Any) -> None:
    left, native = Qt.MouseButton.LeftButton, window.second
    first, last = window.on_image(start), window.on_image(end)
    QTest.mouseMove(native, first)
    QTest.mousePress(native, left, pos=first)
    for share in (0.25, 0.5, 0.75, 1.0):
        point = first + (last - first) * share
        QTest.mouseMove(native, point)
        QApplication.processEvents()
    QTest.mouseRelease(native, left, pos=last)
    QApplication.processEvents()


def test_other_charts_layers_that_were_removed_and_a_stack_with_channels(
    tracked: Tracked, capsys: Any
) -> None:
    window = tracked
    window.canvas.show_chart("topography")
    QApplication.processEvents()
    assert not window.lines.layer(UV).visible
    bar = window.canvas.depth_bar
    bar.slider.setValue(3)
    assert window.canvas.model.dims.point[-3] == 3
    window.go_to(2)
    assert window.canvas.model.dims.point[-3] == bar.slider.value() == 3
    window.canvas.show_chart("uv")
    assert window.lines.layer(UV).visible

    window.viewer.layers.remove(window.lines.layer(SPACE))
    window.go_to(1)
    assert "tracks" not in window.viewer.layers
    window.tracking.set_tracks("some", window.tracks.kept([1, 2]))
    window.drawn()
    assert set(window.viewer.layers["tracks"].features["track"]) == {1, 2}
    window.tracking.set_tracks("", None)
    window.drawn()
    for model in (window.viewer, window.canvas.model):
        names = {layer.name for layer in model.layers if layer.visible}
        assert not {"tracks", "track heads"} & names
    # They come again: the canvases never lost their axis over t.
    window.tracking.set_tracks("all", window.tracks)
    window.drawn()
    for chart in (SPACE, UV):
        assert window.lines.layer(chart).visible
        assert set(window.lines.layer(chart).features["track"]) == set(window.tracks.ids.tolist())

    # Beside a stack with channels, lines follow its time and not the channel.
    viewer = window.viewer
    lines = window.lines.layer(SPACE)
    stack = viewer.add_image(
        np.zeros((TIMEPOINTS, 2, 4, 4, 4), np.uint8),
        scale=(2.0, 1.0, 0.5, 0.5, 0.5),
        axis_labels=("t", "c", "z", "y", "x"),
        units=("second", "pixel", *(["µm"] * 3)),
        visible=False,
    )
    QApplication.processEvents()
    window.drawn()
    assert viewer.layers.extent.units is not None, "napari draws in units"
    assert tuple(viewer.dims.range[1]) == (0, 1, 1), "the slider of the channels is as it was"
    window.go_to(2)
    assert viewer.dims.point[0] == 4.0
    assert lines.current_time == 2
    viewer.dims.set_current_step(0, 3)
    window.wait(lambda: window.session.timepoint == 3)
    assert lines.current_time == 3
    viewer.dims.set_current_step(1, 1)
    QApplication.processEvents()
    assert (lines.current_time, window.session.timepoint) == (3, 3)
    # Lines that come when the stack is there.
    capsys.readouterr()
    viewer.layers.remove(lines)
    window.tracking.set_gate([1, 2])
    window.drawn()
    lines = window.lines.layer(SPACE)
    assert lines in viewer.layers
    assert lines.current_time == 3
    assert "Inconsistent units" not in capsys.readouterr().out
    viewer.layers.remove(stack)
    QApplication.processEvents()
    window.drawn()
    window.go_to(1)
    assert lines.current_time == 1
    assert viewer.layers.extent.units is not None
    viewer.dims.set_current_step(0, 4)
    window.wait(lambda: window.session.timepoint == 4)


def _zoom(window: Tracked) -> float:
    """Pixels of the screen for one of the image."""
    return float(window.canvas.model.scene.camera.zoom)
