"""The step Protrusions in the wizard: its parameters, numbers, and heights with the threshold."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from qtpy.QtCore import QPoint
from qtpy.QtTest import QTest

from napari_unwrap3d.viewer import session as module
from napari_unwrap3d.viewer.steps.panel import ProtrusionsDock
from napari_unwrap3d.viewer.steps.states import DONE, StepState
from napari_unwrap3d.viewer.steps.texts import status_of
from viewer.protruding import LEFT

UM = {"scale": (0.3, 0.2, 0.2), "units": ("µm",) * 3, "axis_labels": ("z", "y", "x")}
MS = 60_000


@pytest.fixture
def dock(
    make_napari_viewer: Any, fake_pipeline: Any, stack: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> ProtrusionsDock:
    monkeypatch.setattr(module, "DEBOUNCE_MS", 20)
    viewer = make_napari_viewer()
    viewer.add_image(stack, name="stack", **UM)
    made = ProtrusionsDock(viewer)
    viewer.window.add_dock_widget(made)
    return made


def visible(dock: ProtrusionsDock) -> set[str]:
    entries = dock.panel.form.entries
    return {path for path, entry in entries.items() if not entry.widget.native.isHidden()}


def test_the_group_of_the_method_is_shown(dock: ProtrusionsDock) -> None:
    assert {path.split(".")[0] for path in visible(dock)} == {"protrusions"}
    assert "protrusions.threshold_um" in visible(dock)
    dock.panel.form.entries["protrusions.method"].widget.value = "topography"
    assert dock.session.parameters.protrusions.method == "topography"
    shown = visible(dock)
    assert "protrusions.method" in shown
    assert "protrusions.threshold_um" not in shown
    assert "topographic.threshold" in shown
    dock.panel.more.click()
    more = visible(dock)
    assert more > shown
    assert not any(path.startswith("protrusions.") for path in more - {"protrusions.method"})


def test_a_wrong_number_of_a_group_is_the_steps_problem(dock: ProtrusionsDock) -> None:
    dock.panel.form.entries["protrusions.method"].widget.value = "topography"
    dock.panel.more.click()
    entry = dock.panel.form.entries["topographic.asymmetry"]
    entry.widget.value = 0.5
    dock.session.set_values("topographic", {"asymmetry": 7.0})
    assert "asymmetry" in dock.panel.status.text()
    dock.panel.reset_button.click()
    assert not dock.panel.status.text()
    assert dock.session.parameters == type(dock.session.parameters)()


def test_the_threshold_is_dragged_in_the_histogram(dock: ProtrusionsDock, qtbot: Any) -> None:
    plot, session = dock.panel.plot, dock.session
    heights = np.concatenate([np.zeros(90), np.linspace(0.5, 3.0, 30)])
    found = SimpleNamespace(height_um=heights, numbers={"threshold_um": 0.4})
    vertices = np.random.default_rng(0).normal(size=(120, 3))
    faces = np.arange(120).reshape(40, 3)
    plot.show_heights(found, SimpleNamespace(vertices=vertices, faces=faces))
    qtbot.waitUntil(lambda: plot.canvas is not None, timeout=MS)
    plot.canvas.draw()
    assert plot.histogram.shares.sum() == pytest.approx(1)

    def place(height: float) -> QPoint:
        x, _ = plot._axes.transData.transform((height, 0.1))
        return QPoint(round(x / plot.canvas.device_pixel_ratio), plot.canvas.height() // 2)

    def drag(to: float) -> None:
        QTest.mousePress(plot.canvas, LEFT, pos=place(0.4))
        QTest.mouseMove(plot.canvas, place(to))
        qtbot.waitUntil(lambda: abs(plot.threshold_um - to) < 0.1, timeout=MS)
        assert session.parameters.protrusions.threshold_um is None, "not before it is let go"
        QTest.mouseRelease(plot.canvas, LEFT, pos=place(to))

    drag(1.5)
    assert session.parameters.protrusions.threshold_um == pytest.approx(1.5, abs=0.1)
    session.set_values("protrusions", {"threshold_um": None, "method": "topography"})
    drag(2.0)
    chosen = session.parameters.topographic
    assert chosen.threshold == "value"
    assert chosen.threshold_um == pytest.approx(2.0, abs=0.1)


def test_the_numbers_say_how_many_of_what_kind_and_why() -> None:
    numbers = {
        "protrusions": 12,
        "kind": "blebs",
        "kind_reason": "most of them are round",
        "parts_difference": 0.0,
    }
    text = status_of("protrusions", StepState(DONE, 1.0, numbers))
    assert text == "12 found, kind: blebs, most of them are round, parts and whole differ by 0.00%"
