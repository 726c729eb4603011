"""One panel per step, in the wizard and as docks of their own: the same session."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from qtpy.QtCore import QPoint, Qt
from qtpy.QtTest import QTest

from napari_unwrap3d.viewer import session as module
from napari_unwrap3d.viewer.session import session_of
from napari_unwrap3d.viewer.steps import panel as step_panel
from napari_unwrap3d.viewer.steps.states import STEPS, StepState, step_of
from napari_unwrap3d.viewer.steps.texts import MAIN, NUMBERS, mark_of
from napari_unwrap3d.viewer.wizard import Wizard

UM = {"scale": (0.3, 0.2, 0.2), "units": ("µm",) * 3, "axis_labels": ("z", "y", "x")}
MS = 60_000
DOCKS = {each.step: each for each in step_panel.StepDock.__subclasses__()}


@pytest.fixture
def viewer(
    make_napari_viewer: Any, fake_pipeline: Any, stack: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> Any:
    monkeypatch.setattr(module, "DEBOUNCE_MS", 20)
    made = make_napari_viewer()
    made.add_image(stack, name="stack", **UM)
    return made


def finish(session: Any, qtbot: Any, press: Any) -> None:
    with qtbot.waitSignal(session.finished, timeout=MS):
        QTest.mouseClick(press, Qt.MouseButton.LeftButton)
    qtbot.waitUntil(lambda: not session.running, timeout=MS)


def test_there_is_a_dock_for_every_step() -> None:
    shown_first = {step_of(path.split(".")[0]) for path in MAIN}
    assert set(DOCKS) == set(STEPS) == set(NUMBERS) == shown_first


@pytest.mark.parametrize("step", STEPS)
def test_a_dock_of_its_own_runs_its_step(viewer: Any, qtbot: Any, step: str) -> None:
    dock = DOCKS[step](viewer)
    viewer.window.add_dock_widget(dock)
    assert dock.panel.run_button.isEnabled()
    finish(dock.session, qtbot, dock.panel.run_button)
    assert dock.session.steps[step].state == "done"
    assert dock.panel.mark.text() == "●"


def test_a_dock_and_the_wizard_show_the_same(viewer: Any, qtbot: Any) -> None:
    wizard, dock = Wizard(viewer), step_panel.SphereDock(viewer)
    for widget in (wizard, dock):
        viewer.window.add_dock_widget(widget)
    dock.panel.form.entries["sphere.blend"].widget.value = 0.5
    assert wizard.panels["sphere"].form.entries["sphere.blend"].value == 0.5
    finish(dock.session, qtbot, dock.panel.run_button)
    assert wizard.panels["sphere"].mark.text() == "●"
    assert wizard.panels["uv"].mark.text() == "○"


def test_progress_is_in_the_panel_that_runs_and_the_next_step_stands_out(
    viewer: Any, qtbot: Any, fake_pipeline: Any
) -> None:
    wizard = Wizard(viewer)
    viewer.window.add_dock_widget(wizard)

    def standing_out() -> list[str]:
        return [step for step, panel in wizard.panels.items() if panel.property("next")]

    assert standing_out() == ["stack"]
    assert "Run all" in wizard.hint.text()
    finish(wizard.session, qtbot, wizard.panels["stack"].run_button)
    assert standing_out() == ["surface"]
    assert "Surface" in wizard.hint.text()
    # Progress is shown in the panel that runs.
    fake_pipeline.behaviour["surface"] = 60.0
    wizard.run_button.click()
    panel = wizard.panels["surface"]
    qtbot.waitUntil(lambda: panel.progress_bar.value() == 500, timeout=MS)
    assert "still computing" in panel.status.text()
    assert panel.run_button.isHidden()
    with qtbot.waitSignal(wizard.session.stopped, timeout=MS):
        QTest.mouseClick(panel.cancel_button, Qt.MouseButton.LeftButton)
    assert not panel.run_button.isHidden()
    fake_pipeline.behaviour.clear()
    # Run all does the rest.
    finish(wizard.session, qtbot, wizard.run_button)
    assert standing_out() == []
    assert "draw on it" in wizard.hint.text()
    # Nothing is wider than the dock.
    for panel in wizard.panels.values():
        panel.expand(True)
        panel.more.setChecked(True)
        assert panel.minimumSizeHint().width() <= step_panel.WIDTH


def test_parameters_are_opened_reset_and_the_iteration_is_where_to_stop(viewer: Any) -> None:
    wizard = Wizard(viewer)
    viewer.window.add_dock_widget(wizard)
    panel = wizard.panels["uv"]
    assert panel.body.isHidden()
    QTest.mouseClick(panel.title, Qt.MouseButton.LeftButton)
    assert not panel.body.isHidden()
    assert panel.form.entries["uv.axis_zyx"].widget.native.isHidden()
    panel.more.click()
    assert not panel.form.entries["uv.axis_zyx"].widget.native.isHidden()
    # Reset goes back to the preset.
    wizard.preset_box.value = "ruffles"
    panel = wizard.panels["reference"]
    panel.form.entries["reference.delta"].widget.value = "not a number"
    assert "reference.delta" in panel.status.text()
    panel.reset_button.click()
    assert not panel.status.text()
    assert float(panel.form.entries["reference.delta"].value) == 1e-5
    assert wizard.session.parameters.reference.delta == 1e-5
    # Who moves the iteration wants to stop there.
    panel = wizard.panels["reference"]
    panel.form.entries["reference.fixed_iteration"].widget.value = 7
    chosen = session_of(viewer).parameters.reference
    assert (chosen.stop, chosen.fixed_iteration) == ("fixed", 7)
    assert panel.form.entries["reference.stop"].value == "fixed"
    panel.form.entries["reference.stop"].widget.value = "paper"
    assert session_of(viewer).parameters.reference.stop == "paper"


def test_the_stop_is_dragged_in_the_plot(viewer: Any, qtbot: Any) -> None:
    dock = step_panel.ReferenceDock(viewer)
    viewer.window.add_dock_widget(dock)
    session = dock.session
    session.update_automatically = False
    finish(session, qtbot, dock.panel.run_button)
    plot = dock.panel.plot
    plot.show_flow([9.0, 4.0, 2.0, 1.5], 3)
    plot.canvas.draw()

    def place(iteration: float) -> QPoint:
        x, _ = plot._axes.transData.transform((iteration, 2.0))
        ratio = plot.canvas.device_pixel_ratio
        return QPoint(round(x / ratio), plot.canvas.height() // 2)

    QTest.mousePress(plot.canvas, Qt.MouseButton.LeftButton, pos=place(3))
    QTest.mouseMove(plot.canvas, place(6))
    qtbot.waitUntil(lambda: plot.stop == 6, timeout=MS)
    QTest.mouseRelease(plot.canvas, Qt.MouseButton.LeftButton, pos=place(6))
    chosen = session.parameters.reference
    assert (chosen.stop, chosen.fixed_iteration) == ("fixed", 6)
    assert dock.panel.form.entries["reference.fixed_iteration"].value == 6


@pytest.mark.usefixtures("every_chart")
def test_histograms_are_drawn_in_the_theme(viewer: Any, qtbot: Any) -> None:
    viewer.theme = "dark"
    wizard = Wizard(viewer)
    viewer.window.add_dock_widget(wizard)
    finish(wizard.session, qtbot, wizard.run_button)
    plot = wizard.panels["sphere"].plot
    assert plot.canvas is None, "nobody looks at it yet"
    wizard.panels["sphere"].expand(True)
    qtbot.waitUntil(lambda: plot.canvas is not None, timeout=MS)
    assert not plot.isHidden()
    assert plot.histograms["q"].shares.sum() == pytest.approx(1)
    dark = plot.figure.get_facecolor()
    viewer.theme = "light"
    assert sum(plot.figure.get_facecolor()) > sum(dark)


def test_marks_say_why() -> None:
    good = {"flipped_faces": 0, "conformal_mean_q": 1.0}
    sign, green, words = mark_of("sphere", StepState("done", 1.0, good))
    assert (sign, words) == ("●", "done; every number is good")
    _, red, words = mark_of("sphere", StepState("done", 1.0, good | {"flipped_faces": 3}))
    assert red != green
    assert "flipped faces: 3" in words
    assert "not one to one" in words
