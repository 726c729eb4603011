"""The shape while a slider moves, and what takes its place."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import pytest

from napari_unwrap3d.unwrapping import preview
from napari_unwrap3d.viewer import session as module
from napari_unwrap3d.viewer.common.threads import THREAD_NAME
from napari_unwrap3d.viewer.session import Session, session_of
from napari_unwrap3d.viewer.steps.previews import NAME

UM = {"scale": (0.3, 0.2, 0.2), "units": ("µm",) * 3, "axis_labels": ("z", "y", "x")}
MS = 60_000


@pytest.fixture
def session(
    make_napari_viewer: Any,
    fake_pipeline: Any,
    stack: np.ndarray,
    monkeypatch: pytest.MonkeyPatch,
    qtbot: Any,
) -> Session:
    """A session after a run."""
    monkeypatch.setattr(module, "DEBOUNCE_MS", 20)
    monkeypatch.setattr(preview, "LEAST", 3)
    monkeypatch.setattr(preview, "BEYOND", 1)
    fake_pipeline.charts = ("mask", "surface", "sealed", "reference", "sphere")
    viewer = make_napari_viewer()
    layer = viewer.add_image(stack, name="stack", **UM)
    made = session_of(viewer)
    made.set_source(layer)
    with qtbot.waitSignal(made.finished, timeout=MS):
        made.run()
    qtbot.waitUntil(lambda: made.previews.flow is not None, timeout=MS)
    return made


def names(session: Session) -> list[str]:
    assert session.viewer is not None
    return [layer.name for layer in session.viewer.layers]


def move(session: Session, iteration: int) -> None:
    session.set_values("reference", {"stop": "fixed", "fixed_iteration": iteration})


def test_the_iteration_is_seen_at_once_and_the_exact_reference_replaces_it(
    session: Session, qtbot: Any
) -> None:
    viewer, flow = session.viewer, session.previews.flow.preview
    chosen = viewer.layers.selection.active
    move(session, 2)
    np.testing.assert_array_equal(viewer.layers[NAME].vertices, flow.frames[2])
    move(session, 1)
    np.testing.assert_array_equal(viewer.layers[NAME].vertices, flow.frames[1])
    assert not viewer.layers["surface"].visible, "it would hide what changes"
    assert viewer.layers.selection.active is chosen
    with qtbot.waitSignal(session.finished, timeout=MS):
        assert NAME in names(session)
    assert NAME not in names(session)
    assert viewer.layers["reference"].visible


def test_a_cancelled_change_shows_what_was_there(
    session: Session, qtbot: Any, fake_pipeline: Any
) -> None:
    fake_pipeline.behaviour["reference"] = 60.0
    move(session, 2)
    qtbot.waitUntil(lambda: session.steps["reference"].state == "running", timeout=MS)
    with qtbot.waitSignal(session.stopped, timeout=MS):
        session.cancel_by_user()
    assert NAME not in names(session)
    assert session.viewer.layers["surface"].visible


def test_the_blend_moves_the_sphere_and_comes_back(session: Session, qtbot: Any) -> None:
    layer = session.viewer.layers["sphere"]
    before = layer.vertices.copy()
    known = session.previews.blends
    rolled = np.roll(before, 1, axis=1)  # another state, so that there is a way to go
    known[0.0] = rolled
    session.set_values("sphere", {"blend": 0.5})
    expected = preview.between_blends({0.0: rolled, 1.0: known[1.0]}, 0.5)
    np.testing.assert_allclose(layer.vertices, expected, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(layer.vertices, axis=1), 1, atol=1e-5)
    with qtbot.waitSignal(session.settled, timeout=MS):
        session.set_values("sphere", {"blend": 1.0})
    np.testing.assert_array_equal(layer.vertices, before)


def test_a_flow_of_other_parameters_is_not_shown(session: Session) -> None:
    session.update_automatically = False
    session.set_values("reference", {"delta": 1e-3})
    move(session, 2)
    assert NAME not in names(session)


def test_closing_the_window_ends_the_thread(session: Session) -> None:
    session.previews.flow = None
    session.previews._keep_flow(session.atlas)
    session.viewer.close()
    assert not [t for t in threading.enumerate() if t.name.startswith(THREAD_NAME)]
