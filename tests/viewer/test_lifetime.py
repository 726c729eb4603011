"""What stays when docks and windows are closed, and what does not, in either Qt binding."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from qtpy.QtCore import QCoreApplication, QEvent
from qtpy.QtWidgets import QDockWidget, QWidget

from napari_unwrap3d.viewer.annotations.annotating import annotating_of
from napari_unwrap3d.viewer.annotations.widget import AnnotationWidget
from napari_unwrap3d.viewer.common.threads import THREAD_NAME
from napari_unwrap3d.viewer.session import session_of
from napari_unwrap3d.viewer.steps.panel import SphereDock
from napari_unwrap3d.viewer.views.canvas import open_canvas
from napari_unwrap3d.viewer.wizard import Wizard
from viewer.opened import SECONDS, open_atlas

UM = {"scale": (0.3, 0.2, 0.2), "units": ("µm",) * 3, "axis_labels": ("z", "y", "x")}


def thread_names() -> list[str]:
    return [each.name for each in threading.enumerate() if each.name.startswith(THREAD_NAME)]


def finish(session: Any, qtbot: Any) -> None:
    with qtbot.waitSignal(session.finished, timeout=SECONDS):
        session.run()
    qtbot.waitUntil(lambda: not session.running, timeout=SECONDS)


def close_dock(widget: QWidget) -> None:
    """Press the cross of a dock."""
    dock: Any = widget.parent()
    while not isinstance(dock, QDockWidget):
        dock = dock.parent()
    dock.destroyOnClose()


@pytest.fixture
def undrawn(small_atlas: Any) -> Callable[[], Any]:
    """Makes atlases of the small cell without annotations, and with no direct chart to wait for."""

    def make() -> Any:
        atlas = small_atlas.replaced()
        reason = {"direct": {"reason": "not wanted"}}
        object.__setattr__(atlas, "quality", {**atlas.quality, **reason})
        return atlas

    return make


def paint_in_uv(viewer: Any, qtbot: Any, name: str) -> Any:
    """Paint a spot in uv as a person would; returns the labels of the vertices."""
    annotating = annotating_of(viewer)
    annotating.annotations.add(name)
    annotating.current = name
    qtbot.waitUntil(lambda: annotating.layers.layer(name, "uv") is not None, timeout=SECONDS)
    layer = annotating.layers.layer(name, "uv")
    layer.brush_size = 6
    rows, columns = layer.data.shape
    layer.paint((rows // 2, columns // 2), 1)
    return annotating.annotations.labels(name)


@pytest.mark.usefixtures("every_chart")
def test_closed_docks_are_gone_and_the_cell_stays(
    make_napari_viewer: Any, qtbot: Any, stack: np.ndarray
) -> None:
    viewer = make_napari_viewer(strict_qt=True)
    viewer.add_image(stack, **UM)
    session = session_of(viewer)
    made = [Wizard(viewer), SphereDock(viewer), AnnotationWidget(viewer)]
    gone: list[int] = []
    for number, widget in enumerate(made):
        widget.destroyed.connect(partial(gone.append, number))
        viewer.window.add_dock_widget(widget)
    finish(session, qtbot)
    for widget in made:
        close_dock(widget)
    qtbot.waitUntil(lambda: sorted(gone) == [0, 1, 2], timeout=SECONDS)
    # What the docks listened to still happens.
    session.set_values("sphere", {"blend": 0.5})
    qtbot.waitUntil(lambda: session.running, timeout=SECONDS)
    qtbot.waitUntil(lambda: not session.running, timeout=SECONDS)
    assert session.atlas is not None
    viewer.theme = "light"
    viewer.layers.remove(viewer.layers[0])
    canvas = open_canvas(viewer)
    assert canvas is not None
    assert canvas.image("uv") is not None


def test_a_dock_that_is_moved_to_another_place_stays(make_napari_viewer: Any, qtbot: Any) -> None:
    viewer = make_napari_viewer()
    widget = Wizard(viewer)
    viewer.window.add_dock_widget(widget, name="here")
    viewer.window.remove_dock_widget(widget)
    viewer.window.add_dock_widget(widget, name="there", area="left")
    QCoreApplication.processEvents()
    QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
    assert widget.run_button.text() == "Run all"


def test_a_second_window_has_its_own_cell_canvas_and_annotations(
    make_napari_viewer: Any, qtbot: Any, undrawn: Callable[[], Any]
) -> None:
    first, second = (make_napari_viewer(strict_qt=True) for _ in range(2))
    atlases = {first: undrawn(), second: undrawn()}
    for viewer, atlas in atlases.items():
        open_atlas(viewer, atlas, qtbot, names=("surface", "uv"))
    drawn = paint_in_uv(first, qtbot, "lamella")
    assert (drawn == 1).any()
    assert atlases[second].annotations.names == ()
    assert (paint_in_uv(second, qtbot, "bleb") == 1).any()
    assert atlases[first].annotations.names == ("lamella",)
    first.close()
    annotating = annotating_of(second)
    annotating.undo()
    assert not atlases[second].annotations.labels("bleb").any()
    layer = annotating.layers.layer("bleb", "uv")
    qtbot.waitUntil(lambda: not layer.data.any(), timeout=SECONDS)
    assert (atlases[first].annotations.labels("lamella") == drawn).all()


def test_a_window_closed_while_everything_is_open_leaves_nothing(
    make_napari_viewer: Any, qtbot: Any, stack: np.ndarray, fake_pipeline: Any
) -> None:
    viewer = make_napari_viewer(strict_qt=True)
    viewer.add_image(stack, **UM)
    session = session_of(viewer)
    for widget in (Wizard(viewer), SphereDock(viewer), AnnotationWidget(viewer)):
        viewer.window.add_dock_widget(widget)
    fake_pipeline.behaviour["sphere"] = 60.0
    session.run()
    qtbot.waitUntil(lambda: session.steps["sphere"].state == "running", timeout=SECONDS)
    told: list[Any] = []
    session.finished.connect(told.append)
    session.stopped.connect(told.append)
    viewer.close()
    assert not thread_names()
    # Whatever the thread sent before it ended finds nobody.
    QCoreApplication.processEvents()
    assert told == []


def test_a_save_goes_on_without_the_dock_that_asked_for_it(
    make_napari_viewer: Any, qtbot: Any, undrawn: Callable[[], Any], tmp_path: Path
) -> None:
    viewer = make_napari_viewer()
    open_atlas(viewer, undrawn(), qtbot, names=("uv",))
    session, wizard = session_of(viewer), Wizard(viewer)
    viewer.window.add_dock_widget(wizard)
    path = tmp_path / "cell.unwrap3d"
    wizard.save(path)
    # The end of the save waits in the event loop, and the dock is gone before it comes.
    assert session.saving is not None
    assert session.saving.wait(SECONDS / 1000)
    close_dock(wizard)
    wizard.deleteLater()
    QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
    qtbot.waitUntil(lambda: session.project_path == path, timeout=SECONDS)
    assert path.is_file()
