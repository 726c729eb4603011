"""The switches above the 3D canvas."""

from __future__ import annotations

from typing import Any

import numpy as np
from qtpy.QtCore import Qt
from qtpy.QtTest import QTest

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.viewer.views.showing import ShownBar
from viewer.opened import open_atlas

LEFT = Qt.MouseButton.LeftButton


def test_switches_show_hide_and_single_out(
    make_napari_viewer: Any, qtbot: Any, small_atlas: Atlas
) -> None:
    viewer = make_napari_viewer()
    stack = viewer.add_image(
        np.zeros((9, 9, 9)), name="stack", units=("µm",) * 3, scale=(0.1, 0.1, 0.1)
    )
    names = ("surface", "reference", "sphere", "topographic surface", "uv")
    open_atlas(viewer, small_atlas, qtbot, names=names)
    bar = viewer.window._qt_window.findChild(ShownBar)
    on = {name for name, button in bar.buttons.items() if button.isChecked()}
    assert on == {"surface", "sphere"}
    assert not stack.visible, "it would lie over the charts"
    QTest.mouseClick(bar.buttons["stack"], LEFT)
    assert stack.visible
    QTest.mouseClick(bar.buttons["surface"], LEFT)
    assert not viewer.layers["surface"].visible
    viewer.layers["reference"].visible = True
    assert bar.buttons["reference"].isChecked()

    angles = (10, 20, 30)
    viewer.scene.camera.angles = angles
    QTest.mouseDClick(bar.buttons["topographic surface"], LEFT)
    assert {layer.name for layer in viewer.layers if layer.visible} == {"topographic surface"}
    np.testing.assert_allclose(viewer.scene.camera.angles, angles, atol=1e-6)
    low, high = viewer.layers["topographic surface"].extent.world
    np.testing.assert_allclose(viewer.scene.camera.center, (low + high) / 2, rtol=0.05, atol=0.5)
    del viewer.layers["sphere"]
    assert not bar.buttons["sphere"].isEnabled()
