"""The cell beside its uv image must not be its mirror image."""

from __future__ import annotations

import numpy as np
from napari.components import ViewerModel

from napari_unwrap3d.viewer.views.layers import atlas_layers
from napari_unwrap3d.viewer.views.placing import place_layers
from synthetic import make_atlas


def test_the_view_is_right_handed_in_xyz_once_charts_are_shown() -> None:
    viewer = ViewerModel(ndisplay=3)
    place_layers(viewer, atlas_layers(make_atlas(1, 16)))
    camera = viewer.scene.camera
    away, up = np.array(camera.view_direction), np.array(camera.up_direction)
    x, y, z = np.array([0, 0, 1.0]), np.array([0, 1.0, 0]), np.array([1.0, 0, 0])
    np.testing.assert_allclose(away @ z, 1.0)
    np.testing.assert_allclose(up @ y, -1.0)
    assert camera.orientation[2] == "right"
    # On the screen x runs right, y down and z away, and right × down = away.
    np.testing.assert_allclose(np.cross(x[::-1], y[::-1]), z[::-1])
