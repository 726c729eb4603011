"""The dock of tracks, and its page of the wizard: follow, keep those in a region, write, read."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from qtpy.QtCore import Qt
from qtpy.QtTest import QTest
from qtpy.QtWidgets import QFileDialog

from napari_unwrap3d import Movie, load_movie, read_tracks
from napari_unwrap3d.errors import InputError
from napari_unwrap3d.tracking import objects
from napari_unwrap3d.viewer.tracks import panel as track_panel
from napari_unwrap3d.viewer.tracks.files import ImportDialog
from napari_unwrap3d.viewer.tracks.flow_layers import NAMES
from napari_unwrap3d.viewer.tracks.layers import TrackLayers
from napari_unwrap3d.viewer.tracks.panel import TracksDock, TracksPanel
from napari_unwrap3d.viewer.tracks.run import CANCELLED, NO_MOVIE
from napari_unwrap3d.viewer.tracks.session import tracks_session_of
from napari_unwrap3d.viewer.wizard import Wizard
from viewer.playing import Projector
from viewer.tracked import Tracked, wandering

LEFT = Qt.MouseButton.LeftButton
DONE, STALE, READY, FAILED = "●", "◐", "○", "✕"


@pytest.fixture
def movie(movie_copy: Path) -> Movie:
    """A movie with tracks from elsewhere."""
    movie = load_movie(movie_copy)
    movie.keep_tracks("wandering", wandering(movie))
    return movie


@pytest.fixture
def window(make_napari_viewer: Any, movie: Movie, qtbot: Any) -> Tracked:
    return Tracked(make_napari_viewer(show=True), movie, qtbot)


@pytest.fixture
def panel(window: Tracked) -> TracksPanel:
    found: TracksPanel = window.dock(TracksDock, "Tracks").panel
    return found


class Tracker:
    """Stands in for the tracking of protrusions: quick, or waiting until it is cancelled."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.waits, self.fails = False, False
        self.threads: list[threading.Thread] = []
        self.methods: list[str] = []
        monkeypatch.setattr(objects, "track_protrusions", self)

    def __call__(self, movie: Any, parameters: Any, progress: Any) -> Any:
        self.threads.append(threading.current_thread())
        self.methods.append(parameters.tracking.method)
        progress(0.25, "timepoint 1")
        if self.fails:
            raise InputError("There is no protrusion at all.")
        while self.waits:
            progress(0.5, "timepoint 2")
        tracks = replace(wandering(movie, 9, seed=1), method="surface")
        movie.keep_tracks("protrusions", tracks)
        return tracks


def settle(window: Tracked, panel: TracksPanel) -> None:
    def rests() -> bool:
        return not panel.run.busy_with and window.tracking._reading is None

    window.wait(rests)
    window.wait(lambda: not panel.gate.gate.busy and not panel.numbers._rest.isActive())
    window.drawn()


def press(button: Any) -> None:
    assert button.isEnabled()
    QTest.mouseClick(button, LEFT)


def choose(box: Any, data: Any) -> None:
    """Choose from a list, as the mouse does."""
    index = box.findData(data)
    assert index >= 0
    box.setCurrentIndex(index)
    box.activated.emit(index)


def test_protrusions_are_followed_with_the_parameters_of_the_form(
    window: Tracked, panel: TracksPanel, errors: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    tracker, section = Tracker(monkeypatch), panel.sections["protrusions"]
    before = window.tracking.tracks
    assert section.mark.text() == READY
    section.title.click()
    entries = section.form.entries
    assert entries["tracking.area_weight"].widget.native.isVisible() is False
    section.more.click()
    assert entries["tracking.area_weight"].widget.native.isVisible()
    assert not entries["boxes.least_iou"].widget.native.isVisible()
    entries["tracking.method"].widget.value = "boxes"
    assert entries["boxes.least_iou"].widget.native.isVisible()
    assert not entries["tracking.area_weight"].widget.native.isVisible()

    # It is cancelled: the tracks stay.
    tracker.waits = True
    press(section.run_button)
    window.wait(lambda: section.status.text() == "timepoint 2")
    assert section.cancel_button.isVisible()
    assert not panel.sections["flow"].run_button.isEnabled()
    press(section.cancel_button)
    settle(window, panel)
    assert panel.message.text() == CANCELLED
    assert window.tracking.tracks is before
    # It fails: that is said, and marked.
    tracker.waits, tracker.fails = False, True
    press(section.run_button)
    settle(window, panel)
    assert "no protrusion" in errors[-1]
    assert section.mark.text() not in (DONE, READY)
    # It ends.
    tracker.fails = False
    press(section.run_button)
    settle(window, panel)
    assert section.mark.text() == DONE
    assert window.tracking.name == "protrusions"
    assert panel.names_box.currentData() == "protrusions"
    assert panel.message.text() == "Found 9 tracks."
    assert "9, " in panel.numbers.text()
    assert "at a time" in panel.numbers.text()
    # What a person edited is not lost when it is made anew.
    assert window.tracking.edits is not None
    window.tracking.edits.delete(4)
    press(section.run_button)
    settle(window, panel)
    window.wait(
        lambda: set(window.tracking.names) == {"protrusions", "protrusions edited", "wandering"}
    )
    assert 4 in window.tracking.tracks.ids
    assert 4 not in window.movie.tracks("protrusions edited").ids
    # Other parameters: it belongs to those before.
    entries["tracking.longest_step_um"].widget.value = 2.5
    assert section.mark.text() == STALE
    assert tracker.methods == ["boxes"] * 4
    assert threading.main_thread() not in tracker.threads
    press(section.reset_button)
    assert panel.run.parameters.tracking.method == "surface"


def test_tracks_are_gated_by_what_is_drawn_written_and_read_and_their_flow_is_shown(
    window: Tracked,
    panel: TracksPanel,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    errors: list[str],
) -> None:
    tracks, annotations = window.tracks, window.movie.common.annotations
    rows = window.movie.common.uv.shape[0]
    annotations.add("front")
    gate = panel.gate
    assert gate.inside_box.findData("front") > 0
    choose(gate.inside_box, "front")
    settle(window, panel)
    assert window.tracking.shown is not None
    assert len(window.tracking.shown.ids) == 0, "nothing is drawn yet"
    every = np.ones((rows, 2 * rows), bool)
    annotations.draw("front", "uv", np.nonzero(every), 1)
    settle(window, panel)
    assert window.tracking.shown.ids.tolist() == tracks.ids.tolist()
    # Half of it is erased.
    half = every.copy()
    half[:, :rows] = False
    annotations.draw("front", "uv", np.nonzero(half), 0)
    settle(window, panel)
    inside = window.tracking.shown.ids
    u = tracks.place_px[:, 1]
    clear = [
        track
        for track in tracks.ids.tolist()
        if (abs(u[tracks.rows_of(track)] - rows / 2) < rows / 2 - 2).all()
    ]
    assert 0 < len(inside) < len(tracks.ids)
    assert set(clear) <= set(inside.tolist())
    assert f"{len(inside)} of {len(tracks.ids)} tracks" in gate.status.text()
    assert f"{len(inside)}, " in panel.numbers.text()
    # Those that stay outside are others; for a part of the life, more of them.
    choose(gate.inside_box, "")
    choose(gate.outside_box, "front")
    settle(window, panel)
    outside = set(window.tracking.shown.ids.tolist())
    assert not outside & set(inside.tolist())
    gate.share_box.setValue(10)
    settle(window, panel)
    assert set(window.tracking.shown.ids.tolist()) > outside
    assert panel.run.parameters.measurement.outside == "front", "measured as it is seen"
    # It is renamed away: that is said.
    annotations.rename("front", "bottom")
    settle(window, panel)
    assert "front" in gate.status.text()
    assert gate.outside_box.currentData() == "front"
    choose(gate.outside_box, "")
    settle(window, panel)
    assert window.tracking.shown is window.tracking.tracks
    # Those that are let through are written, and read again.
    window.tracking.set_gate([2, 3, 5])
    path = tmp_path / "some"
    chosen = (str(path), "Table (*.csv)")
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *_: chosen)
    press(panel.export_button)
    settle(window, panel)
    path = path.with_suffix(".csv")
    assert panel.message.text() == f"Written to {path}"
    assert read_tracks(path).ids.tolist() == [2, 3, 5]

    # From elsewhere: without a place on the image, it gets one.
    table = read_tracks(path).table
    table[["track_id", "time_s", "timepoint", "z_um", "y_um", "x_um"]].to_csv(
        tmp_path / "theirs.csv", index=False
    )
    monkeypatch.setattr(QFileDialog, "getOpenFileName", lambda *_: (tmp_path / "theirs.csv", ""))
    monkeypatch.setattr(ImportDialog, "exec", lambda _: True)
    panel._on_import(track_panel.ask_file)
    settle(window, panel)
    window.wait(lambda: "theirs" in window.tracking.names)
    assert panel.names_box.currentData() == "theirs"
    found = window.tracking.tracks
    assert found is not None
    assert np.isfinite(found.place_px).all()
    np.testing.assert_allclose(found.position_um, window.tracks.kept([2, 3, 5]).position_um)
    assert "µm from the surface" in panel.message.text()
    # A file that holds no tracks is told.
    (tmp_path / "theirs.csv").write_text("a,b\n1,2\n")
    panel._on_import(track_panel.ask_file)
    settle(window, panel)
    assert errors
    assert window.tracking.tracks is found
    # The flow is shown on the surface.
    viewer = window.viewer
    before = viewer.scene.camera.zoom
    QTest.mouseClick(panel.sections["flow"].fields_button, LEFT)
    settle(window, panel)
    layers = [viewer.layers[name] for name in NAMES.values()]
    assert [layer.visible for layer in layers] == [True, False, False]
    surface = window.movie.common.surface
    for layer in layers:
        np.testing.assert_array_equal(layer.faces, surface.faces)
        assert np.isfinite(layer.vertex_values).all()
    assert layers[0].vertex_values.min() >= 0
    assert viewer.scene.camera.zoom == before
    QTest.mouseClick(panel.sections["flow"].fields_button, LEFT)
    settle(window, panel)
    assert sum(layer.name.startswith("flow") for layer in viewer.layers) == len(NAMES)


def test_an_import_says_what_it_needs(qtbot: Any) -> None:
    dialog = ImportDialog(Path("a/spots.xml"), ("spots",))
    qtbot.addWidget(dialog)
    assert dialog.name.text() == "spots 2"
    dialog.voxel_size.setText("0.3, 0.1")
    assert not dialog.ok.isEnabled()
    dialog.voxel_size.setText("0.3, 0.1 0.1")
    assert dialog.ok.isEnabled()
    assert dialog.chosen().voxel_size == (0.3, 0.1, 0.1)
    dialog.name.setText(" ")
    assert not dialog.ok.isEnabled()
    # A name that cannot be kept is made one that can.
    other = ImportDialog(Path("2024 größe/tracks.geff"), ())
    qtbot.addWidget(other)
    other.name.setText(other.name.text())
    assert other.ok.isEnabled()
    third = ImportDialog(Path("2024 größe (3).csv"), ())
    qtbot.addWidget(third)
    third._check("")
    assert third.ok.isEnabled()


def test_the_wizard_has_a_page_for_the_tracks_of_a_movie(
    make_napari_viewer: Any, movie_copy: Path, qtbot: Any
) -> None:
    viewer = make_napari_viewer(show=True)
    wizard = Wizard(viewer)
    viewer.window.add_dock_widget(wizard, name="Unwrap")
    index = wizard.pages.indexOf(wizard.tracks)
    assert not wizard.pages.isTabVisible(index)
    assert wizard.tracks.message.text() == NO_MOVIE
    assert not wizard.tracks.sections["protrusions"].run_button.isEnabled()
    window = Projector(viewer, load_movie(movie_copy), qtbot)
    wizard.movie.run._show(window.movie)
    assert wizard.pages.isTabVisible(index)
    assert wizard.show_tracks() is wizard.tracks
    assert wizard.tracks.isVisible()
    assert wizard.tracks.message.text() == ""
    assert wizard.tracks.sections["protrusions"].run_button.isEnabled()
    # The slider over t that comes with tracks does not turn back the time.
    window.go_to(3)
    tracking = tracks_session_of(viewer)
    tracking.set_tracks("wandering", wandering(window.movie))
    layers = tracking.findChild(TrackLayers)
    window.wait(lambda: not layers.busy)
    assert window.session.wanted == window.session.timepoint == 3
    assert viewer.dims.current_step[0] == 3
