"""What draws a layer is deleted in the OpenGL context of its own canvas."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from qtpy.QtGui import QOpenGLContext
from vispy.gloo import glir

from napari_unwrap3d.atlas import Atlas
from viewer.opened import open_atlas


@pytest.mark.parametrize("second", [False, True])
def test_what_is_left_of_a_layer_goes_with_its_own_canvas_current(
    second: bool,
    make_napari_viewer: Any,
    qtbot: Any,
    small_atlas: Atlas,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    viewer = make_napari_viewer(show=True)
    canvas = open_atlas(viewer, small_atlas, qtbot, names=("surface", "uv"))
    views = [(viewer, viewer.window._qt_viewer), (canvas.model, canvas.qt_viewer)]
    (model, own), (_, other) = views[::-1] if second else views
    layer = model.add_image(np.random.default_rng(0).random((8, 8)))
    for qt_viewer in (own, other):
        qt_viewer.canvas.screenshot()
    gone: list[Any] = []
    delete = glir.GlirBuffer.delete

    def noted(buffer: Any) -> None:
        gone.append(QOpenGLContext.currentContext())
        delete(buffer)

    monkeypatch.setattr(glir.GlirBuffer, "delete", noted)
    other.canvas.native.makeCurrent()
    model.layers.remove(layer)
    assert gone
    assert set(gone) == {own.canvas.native.context()}
