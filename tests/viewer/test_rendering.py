"""What the canvases draw, against stored thumbnails."""

from __future__ import annotations

from typing import Any

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.viewer.showing import ShownBar
from viewer.opened import open_atlas
from viewer.rendering import alike, assert_looks_like, picture


def test_the_canvases_look_as_before(
    make_napari_viewer: Any, qtbot: Any, small_atlas: Atlas
) -> None:
    viewer = make_napari_viewer(show=True)
    canvas = open_atlas(viewer, small_atlas, qtbot)
    viewer.scene.camera.angles = (60, -70, 60)
    viewer.window._qt_window.findChild(ShownBar).show_alone("surface")
    surface = picture(viewer.window._qt_viewer, (64, 64))
    assert_looks_like(surface, "surface_by_curvature")
    assert not alike(surface, surface[:, ::-1]), "the comparison tells a mirror image"
    uv = picture(canvas.qt_viewer)
    assert_looks_like(uv, "uv_by_curvature")
    assert not alike(uv, uv[:, ::-1])
    canvas.show_chart("topography")
    canvas.depth_bar.set_depth(0.25)
    slice_above = picture(canvas.qt_viewer)
    assert_looks_like(slice_above, "topography_slice")
    canvas.depth_bar.set_depth(-0.25)
    assert not alike(slice_above, picture(canvas.qt_viewer))
