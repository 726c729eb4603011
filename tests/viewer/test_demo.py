"""Samples, and the main job in a window on a small simulated cell with the real pipeline."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import napari
import numpy as np
import pytest
from napari.layers import Layer

from napari_unwrap3d import simulate
from napari_unwrap3d.parameters import Parameters
from napari_unwrap3d.pipeline import STEP_NAMES
from napari_unwrap3d.viewer import demo
from napari_unwrap3d.viewer.files import samples
from napari_unwrap3d.viewer.views.canvas import canvas_of
from napari_unwrap3d.viewer.views.placing import chart_of

SMALL = Parameters.from_dict({"uv": {"rows": 64}, "reference": {"vertices": 4000}})


def test_there_is_a_sample_for_every_kind() -> None:
    for kind in simulate.KINDS:
        assert callable(getattr(samples, kind))


def test_a_sample_is_a_stack_with_its_truth() -> None:
    stack, truth = (Layer.create(*layer) for layer in samples.sample("blebs", size=80))
    assert stack.name == "blebs"
    assert {str(unit) for unit in (*stack.units, *truth.units)} == {"micrometer"}
    assert stack.axis_labels == truth.axis_labels == ("z", "y", "x")
    assert tuple(stack.scale) == (0.3, 0.104, 0.104)
    # The protrusions of the truth lie inside what is bright in the stack.
    inside = np.argwhere(truth.data > 0) * truth.scale + truth.translate
    voxels = np.rint((inside - stack.translate) / stack.scale).astype(int)
    z, y, x = np.clip(voxels, 0, np.array(stack.data.shape) - 1).T
    assert np.median(stack.data[z, y, x]) > 2 * np.median(stack.data)


def test_the_main_job_in_a_window(make_napari_viewer: Any, qtbot: Any, tmp_path: Path) -> None:
    viewer: napari.Viewer = make_napari_viewer()
    done: list[napari.Viewer] = []
    output = tmp_path / "cell.unwrap3d"
    widget = demo.start_demo(viewer, "blebs", output, SMALL, done.append, size=80)
    qtbot.waitUntil(lambda: bool(done), timeout=160_000)
    assert widget.session.atlas is not None, widget.message.text()
    layers = [*viewer.layers, *canvas_of(viewer).model.layers]
    shown = {chart_of(layer) for layer in layers}
    assert {"surface", "reference", "sphere", "uv", "topography"} <= shown
    assert all(widget.session.steps[name].seconds is not None for name in STEP_NAMES)
    for name in STEP_NAMES:
        assert widget.panels[name].status.text(), name
    qtbot.waitUntil(output.exists, timeout=60_000)
    qtbot.waitUntil(lambda: "Saved" in widget.message.text(), timeout=60_000)


@pytest.fixture
def no_event_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(napari, "run", lambda: None)


def test_open_demo_opens_a_window_and_waits_in_it(
    make_napari_viewer: Any, monkeypatch: pytest.MonkeyPatch, no_event_loop: None
) -> None:
    started: list[Any] = []
    monkeypatch.setattr(napari, "Viewer", lambda **_: make_napari_viewer())
    monkeypatch.setattr(demo, "start_demo", lambda *a, **k: started.append((a, k)))
    demo.open_demo("mix", size=80)
    ((viewer, *rest), more), *_ = started
    assert isinstance(viewer, napari.components.ViewerModel)
    assert rest[0] == "mix"
    assert more == {"size": 80, "seed": 0}
