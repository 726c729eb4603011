"""The dock widget in a real window, with a pipeline that takes no time."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import napari
import numpy as np
import pytest
from qtpy.QtCore import Qt
from qtpy.QtWidgets import QDockWidget

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.errors import NotGenusZeroError
from napari_unwrap3d.files.project import read_summary
from napari_unwrap3d.pipeline import STEP_NAMES
from napari_unwrap3d.viewer.common.threads import THREAD_NAME
from napari_unwrap3d.viewer.session import ASK_VOXEL_SIZE, NO_LAYER, session_of
from napari_unwrap3d.viewer.views.canvas import canvas_of
from napari_unwrap3d.viewer.views.placing import chart_of
from napari_unwrap3d.viewer.wizard import Wizard
from synthetic import icosphere

UM = {"scale": (0.3, 0.2, 0.2), "units": ("µm",) * 3, "axis_labels": ("z", "y", "x")}
SECONDS = 60_000

Dock = Callable[..., tuple[napari.Viewer, Wizard]]


@pytest.fixture
def dock(make_napari_viewer: Any, fake_pipeline: Any, stack: np.ndarray) -> Dock:
    """A window with a stack and the dock widget."""

    def make(**layer: Any) -> tuple[napari.Viewer, Wizard]:
        viewer = make_napari_viewer()
        if layer:
            viewer.add_image(stack, name="stack", **layer)
        widget = Wizard(viewer)
        viewer.window.add_dock_widget(widget, name="Unwrap")
        return viewer, widget

    return make


def run(widget: Wizard, qtbot: Any) -> None:
    """Press Run and wait for the end."""
    with qtbot.waitSignal(widget.session.running_changed, timeout=SECONDS, check_params_cb=_ended):
        widget.run_button.click()
    qtbot.waitUntil(lambda: not widget.session.running, timeout=1000 * 5)


def _ended(running: bool) -> bool:
    return not running


def charts(viewer: napari.Viewer) -> dict[str, Any]:
    return {layer.name: layer for layer in viewer.layers if chart_of(layer)}


@pytest.mark.usefixtures("every_chart")
def test_run_adds_every_chart_and_save_writes_the_project(
    dock: Dock, qtbot: Any, fake_pipeline: Any, tmp_path: Path
) -> None:
    viewer, widget = dock(**UM)
    run(widget, qtbot)
    shown = charts(viewer)
    assert {"surface", "reference", "sphere", "topographic surface"} <= set(shown)
    assert {"uv", "topography"} == set(charts(canvas_of(viewer).model))
    assert [str(unit) for unit in viewer.layers.units] == ["micrometer"] * 3
    assert viewer.dims.ndisplay == 3
    assert {widget.session.steps[name].state for name in STEP_NAMES} == {"done"}
    assert "Done in" in widget.message.text()
    assert widget.panels["reference"].status.text()
    assert widget.save_button.isEnabled()
    (pipeline,) = fake_pipeline.made
    assert threading.main_thread().name not in pipeline.threads
    # Saving writes the project.
    widget.save(tmp_path / "cell.unwrap3d")
    qtbot.waitUntil(lambda: "Saved" in widget.message.text(), timeout=SECONDS)
    qtbot.waitUntil(widget.save_button.isEnabled, timeout=SECONDS)
    assert read_summary(tmp_path / "cell.unwrap3d")


def test_further_runs_compute_what_changed_and_bring_back_what_is_gone(
    dock: Dock, qtbot: Any, fake_pipeline: Any, tmp_path: Path, errors: list[str]
) -> None:
    viewer, widget = dock(**UM)
    run(widget, qtbot)
    before = charts(viewer)
    viewer.dims.ndisplay = 2
    widget.panels["sphere"].form.entries["sphere.blend"].widget.value = 0.5
    states = {name: step.state for name, step in widget.session.steps.items()}
    assert [name for name, state in states.items() if state == "stale"] == [
        "sphere",
        "uv",
        "topography",
    ]
    assert widget.panels["sphere"].mark.text() == "◐"
    run(widget, qtbot)
    (pipeline,) = fake_pipeline.made
    assert pipeline.computed == [list(STEP_NAMES), ["sphere", "uv", "topography"]]
    assert charts(viewer) == before
    assert viewer.dims.ndisplay == 2, "the view is the user's after the first run"
    # A removed chart comes back with the next run.
    for name in ("sphere", "sphere (conformal)"):
        viewer.layers.remove(viewer.layers[name])
    run(widget, qtbot)
    assert "sphere" in charts(viewer)
    # A failed save is told.
    (tmp_path / "not a folder").touch()
    widget.save(tmp_path / "not a folder" / "cell.unwrap3d")
    qtbot.waitUntil(lambda: bool(errors), timeout=SECONDS)
    assert "not a folder" in errors[0]
    qtbot.waitUntil(widget.save_button.isEnabled, timeout=SECONDS)


def test_paint_on_the_labels_starts_anew(dock: Dock, qtbot: Any, fake_pipeline: Any) -> None:
    viewer, widget = dock()
    labels = viewer.add_labels(np.ones((6, 6, 6), int), **UM)
    assert widget.panels["stack"].form.entries["stack.label"].widget.native.isVisibleTo(widget)
    run(widget, qtbot)
    assert widget.session.parameters.stack.label == 1
    labels.data[2, 2, 2] = 2
    run(widget, qtbot)
    assert len(fake_pipeline.made) == 2


def test_progress_is_seen_charts_appear_meanwhile_and_cancel_stops_the_step_at_once(
    dock: Dock, qtbot: Any, fake_pipeline: Any, errors: list[str]
) -> None:
    viewer, widget = dock(**UM)
    # Progress is seen as soon as Run is pressed, and names the first step before it ends.
    fake_pipeline.behaviour["stack"] = 60.0
    qtbot.mouseClick(widget.run_button, Qt.MouseButton.LeftButton)
    assert widget.progress_bar.isVisibleTo(widget), "without a turn of the event loop"
    qtbot.waitUntil(lambda: "Stack" in widget.progress_bar.format(), timeout=SECONDS)
    assert widget.progress_bar.isVisibleTo(widget)
    assert "stack" in widget.message.text()
    assert not fake_pipeline.made[0].kept, "no step has ended"
    widget.cancel_button.click()
    qtbot.waitUntil(lambda: not widget.session.running, timeout=SECONDS)
    # Charts appear while the run goes on.
    fake_pipeline.behaviour.clear()
    fake_pipeline.behaviour["sphere"] = 60.0
    widget.run_button.click()
    qtbot.waitUntil(lambda: "reference" in charts(viewer), timeout=SECONDS)
    assert widget.session.running
    assert "surface" in charts(viewer)
    assert "sphere" not in charts(viewer)
    assert widget.progress_bar.isVisibleTo(widget)
    assert "Sphere" in widget.progress_bar.format()
    assert widget.panels["sphere"].mark.text() == "▶"
    assert not widget.run_button.isEnabled()
    widget.cancel_button.click()
    qtbot.waitUntil(lambda: not widget.session.running, timeout=SECONDS)
    # Cancelled at a step, the next run goes on there.
    fake_pipeline.behaviour.clear()
    fake_pipeline.behaviour["uv"] = 60.0
    widget.run_button.click()
    qtbot.waitUntil(lambda: widget.session.steps["uv"].state == "running", timeout=SECONDS)
    widget.cancel_button.click()
    qtbot.waitUntil(lambda: not widget.session.running, timeout=SECONDS)
    assert "Cancelled" in widget.message.text()
    assert widget.run_button.isEnabled()
    assert widget.session.steps["sphere"].state == "done"
    assert widget.session.steps["uv"].state == "ready"
    assert not errors, "the user asked for it"
    fake_pipeline.behaviour.clear()
    run(widget, qtbot)
    assert fake_pipeline.made[-1].computed[-1] == ["uv", "topography"]


def test_an_unexpected_error_is_not_swallowed_and_one_of_ours_is_told_with_its_hint(
    dock: Dock, qtbot: Any, fake_pipeline: Any, errors: list[str]
) -> None:
    _, widget = dock(**UM)
    fake_pipeline.behaviour["reference"] = ZeroDivisionError("a bug")
    run(widget, qtbot)
    assert errors == ["a bug"]
    assert "ZeroDivisionError" in widget.message.text()
    assert widget.session.steps["reference"].state == "failed"
    assert widget.run_button.isEnabled()
    # One of ours is told with its hint.
    errors.clear()
    fake_pipeline.behaviour.clear()
    fake_pipeline.behaviour["sphere"] = NotGenusZeroError("Not a ball.", genus=3, hint="Seal it.")
    run(widget, qtbot)
    assert errors == ["Not a ball. Measured: genus = 3. Seal it."]
    assert widget.message.text() == errors[0]
    assert widget.session.steps["sphere"].state == "failed"
    assert widget.session.steps["reference"].state == "done"
    assert widget.run_button.isEnabled()


def test_a_parameter_out_of_range_is_told(dock: Dock, errors: list[str]) -> None:
    _, widget = dock(**UM)
    widget.panels["reference"].form.entries["reference.delta"].widget.value = "-1"
    assert "reference.delta" in widget.panels["reference"].status.text()
    widget.run_button.click()
    assert not widget.session.running
    assert "reference.delta" in errors[0]


def test_the_voxel_size_is_asked_for_and_never_guessed(
    dock: Dock, qtbot: Any, fake_pipeline: Any
) -> None:
    viewer, widget = dock(scale=(3, 1, 1))
    assert widget.chooser.note.text() == ASK_VOXEL_SIZE
    assert widget.chooser.voxel_size.value is None
    assert not widget.run_button.isEnabled()
    widget.chooser.voxel_size.value = (0.3, 0.1, 0.1)
    assert widget.run_button.isEnabled()
    assert not widget.chooser.note.text()
    run(widget, qtbot)
    np.testing.assert_allclose(viewer.layers["stack"].scale, (0.3, 0.1, 0.1))
    assert fake_pipeline.made[0].source.voxel_size == pytest.approx((0.3, 0.1, 0.1))
    assert viewer.layers.units is not None, "the stack has units now, like the charts"
    assert not widget.chooser.voxel_size.isEnabled()


def test_a_known_voxel_size_is_shown_and_followed(dock: Dock) -> None:
    viewer, widget = dock(**UM)
    assert widget.chooser.voxel_size.value == pytest.approx((0.3, 0.2, 0.2))
    assert not widget.chooser.voxel_size.isEnabled()
    viewer.layers["stack"].scale = (0.4, 0.2, 0.2)
    assert widget.chooser.voxel_size.value == pytest.approx((0.4, 0.2, 0.2))
    viewer.layers["stack"].units = ("pixel",) * 3
    assert widget.chooser.voxel_size.isEnabled()


def test_the_layers_to_choose_from_follow_the_viewer(dock: Dock, stack: np.ndarray) -> None:
    viewer, widget = dock()
    assert widget.chooser.note.text() == NO_LAYER
    assert not widget.run_button.isEnabled()
    viewer.add_image(np.zeros((5, 5)), name="flat")
    assert not widget.chooser.layer_box.choices
    viewer.add_image(stack, name="stack", **UM)
    viewer.add_points(np.zeros((1, 3)), name="points")
    assert [layer.name for layer in widget.chooser.layer_box.choices] == ["stack"]
    assert widget.run_button.isEnabled()
    del viewer.layers["stack"]
    assert widget.chooser.note.text() == NO_LAYER


def test_a_mesh_needs_no_threshold(dock: Dock) -> None:
    viewer, widget = dock()
    vertices, faces = icosphere(1)
    viewer.add_surface((vertices, faces), units=("µm",) * 3)
    assert widget.run_button.isEnabled()
    assert (
        not widget.panels["stack"].form.entries["stack.threshold"].widget.native.isVisibleTo(widget)
    )
    widget.panels["stack"].more.click()
    assert (
        widget.panels["stack"]
        .form.entries["stack.working_voxel_um"]
        .widget.native.isVisibleTo(widget)
    )


def test_presets_and_reset(dock: Dock) -> None:
    _, widget = dock(**UM)
    widget.preset_box.value = "ruffles"
    assert widget.session.parameters.uv.axis_weight == "positive_curvature"
    widget.panels["uv"].form.entries["uv.rows"].widget.value = 64
    widget.panels["uv"].reset_button.click()
    assert widget.session.parameters.uv.rows == 512
    widget.preset_box.value = "defaults"
    assert widget.session.parameters.uv.axis_weight == "mean_curvature"


def test_another_layer_takes_the_charts_of_the_first_away(
    dock: Dock, qtbot: Any, stack: np.ndarray, fake_pipeline: Any
) -> None:
    viewer, widget = dock(**UM)
    run(widget, qtbot)
    viewer.add_image(stack[::-1], name="other", **UM)
    widget.chooser.layer_box.value = viewer.layers["other"]
    fake_pipeline.behaviour["sphere"] = NotGenusZeroError("Not a ball.")
    run(widget, qtbot)
    assert "surface" in charts(viewer)
    assert "sphere" not in charts(viewer), "no chart of another cell stays"


def test_closing_the_window_during_a_run_ends_it(
    dock: Dock, qtbot: Any, fake_pipeline: Any
) -> None:
    viewer, widget = dock(**UM)
    fake_pipeline.behaviour["reference"] = 60.0
    widget.run_button.click()
    qtbot.waitUntil(lambda: widget.session.steps["reference"].state == "running", timeout=SECONDS)
    viewer.close()
    assert not [t for t in threading.enumerate() if t.name.startswith(THREAD_NAME)]


def test_closing_the_dock_keeps_the_run_and_opening_it_shows_the_state(
    dock: Dock, qtbot: Any, fake_pipeline: Any
) -> None:
    viewer, widget = dock(**UM)
    fake_pipeline.behaviour["sphere"] = 1.0
    session = widget.session
    widget.run_button.click()
    docked = widget.parent()
    while not isinstance(docked, QDockWidget):
        docked = docked.parent()
    viewer.window.remove_dock_widget(docked)
    widget.deleteLater()
    qtbot.waitUntil(lambda: not session.running, timeout=SECONDS)
    viewer.layers["stack"].scale = (0.3, 0.3, 0.3)
    viewer.add_image(np.zeros((3, 3, 3)))
    again = Wizard(viewer)
    viewer.window.add_dock_widget(again)
    assert again.session is session
    assert again.panels["topography"].mark.text() == "●"
    assert again.save_button.isEnabled()


def test_two_viewers_have_two_sessions(dock: Dock, qtbot: Any) -> None:
    (first, one), (second, two) = dock(**UM), dock(**UM)
    assert session_of(first) is one.session is not two.session
    one.panels["sphere"].form.entries["sphere.blend"].widget.value = 0.25
    assert two.session.parameters.sphere.blend == 1
    run(one, qtbot)
    assert charts(first)
    assert not charts(second)
    first.close()
    run(two, qtbot)
    assert charts(second)


def test_each_chart_is_there_before_the_next_but_one_step_ends(
    dock: Dock, qtbot: Any, fake_pipeline: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    viewer, widget = dock(**UM)
    there = {chart: threading.Event() for chart in fake_pipeline.charts}
    missed: list[str] = []
    compute = fake_pipeline._compute

    def look(_: Any = None) -> None:
        for chart in set(charts(viewer)) & set(there):
            there[chart].set()

    def compute_when_seen(pipeline: Any, step: str, progress: Any) -> None:
        progress(0.0, "starting")
        for earlier in STEP_NAMES[: max(STEP_NAMES.index(step) - 1, 0)]:
            chart = "mask" if earlier == "stack" else earlier
            if chart in there and not there[chart].wait(5.0):
                missed.append(f"{chart} at the end of {step}")
        compute(pipeline, step, progress)

    viewer.layers.events.inserted.connect(look)
    monkeypatch.setattr(fake_pipeline, "_compute", compute_when_seen)
    run(widget, qtbot)
    assert not missed
    assert all(each.is_set() for each in there.values())


@pytest.mark.usefixtures("every_chart")
def test_charts_are_drawn_on_the_canvas(
    make_napari_viewer: Any, qtbot: Any, stack: np.ndarray, fake_pipeline: Any, round_cell: Atlas
) -> None:
    viewer = make_napari_viewer(show=True)
    viewer.window.resize(900, 600)  # software draws slowly
    viewer.add_image(stack, name="stack", **UM)
    viewer.layers["stack"].visible = False
    widget = Wizard(viewer)
    viewer.window.add_dock_widget(widget, name="Unwrap")
    run(widget, qtbot)
    # In a slice a mesh is a line.
    for dimensions, least in ((3, 0.05), (2, 0.003)):
        viewer.dims.ndisplay = dimensions
        viewer.reset_view()
        picture = viewer.screenshot(canvas_only=True, flash=False)[..., :3].astype(int)
        coloured = np.ptp(picture, axis=2) > 20
        assert coloured.mean() > least, "charts in colour cover a part of the canvas"
        right = coloured[:, coloured.shape[1] // 2 :]
        assert right.any(), "the sphere is at the right"
