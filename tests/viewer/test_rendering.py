"""What the canvases draw, against stored thumbnails."""

from __future__ import annotations

from typing import Any

import numpy as np

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.viewer.views.showing import ShownBar
from viewer.hand import Hand
from viewer.opened import SECONDS, open_atlas
from viewer.rendering import BACKGROUND, alike, assert_looks_like, picture

# Of the same colours at the same places, when one is a mean over the shell's few layers.
CLOSE = 12


def all_depths(canvas: Any) -> tuple[float, float]:
    """All depths."""
    depths = canvas.depth_bar.d_um
    return float(depths[0]), float(depths[-1])


def test_the_canvases_look_as_before(
    make_napari_viewer: Any, qtbot: Any, upright_atlas: Atlas
) -> None:
    viewer = make_napari_viewer(show=True)
    canvas = open_atlas(viewer, upright_atlas, qtbot)
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
    qtbot.waitUntil(lambda: not canvas.depth_bar.busy, timeout=SECONDS)
    coloured = picture(canvas.qt_viewer)
    assert_looks_like(coloured, "topography_by_curvature")
    canvas.depth_bar.show_content("Mask")
    slice_above = picture(canvas.qt_viewer)
    assert_looks_like(slice_above, "topography_slice")
    canvas.depth_bar.set_depth(-0.25)
    assert not alike(slice_above, picture(canvas.qt_viewer))
    # Over all depths the surface is everywhere, in the colours that uv has where nothing overhangs.
    canvas.depth_bar.show_content("Field")
    canvas.depth_bar.set_range("Mean", *all_depths(canvas))
    whole = picture(canvas.qt_viewer)
    assert not alike(coloured, whole)
    assert np.median(np.abs(whole.astype(int) - uv)) < CLOSE


def test_meshes_are_lit_from_the_front(
    make_napari_viewer: Any, qtbot: Any, small_atlas: Atlas
) -> None:
    viewer = make_napari_viewer(show=True)
    names = ("surface", "topographic surface", "uv")
    open_atlas(viewer, small_atlas, qtbot, names=names)
    bar = viewer.window._qt_window.findChild(ShownBar)
    for name in ("surface", "topographic surface"):
        viewer.layers[name].colormap = "gray"
        viewer.layers[name].contrast_limits = (-1e6, -1e5)
        for angles in ((0, 0, 0), (30, 20, 10), (-30, 20, -40)):
            viewer.scene.camera.angles = angles
            bar.show_alone(name)
            drawn = picture(viewer.window._qt_viewer, (40, 40)).astype(int)
            mesh = np.abs(drawn - BACKGROUND).max(axis=2) > 100
            # White all over: what is dark is in the shade.
            assert drawn[mesh].mean() > 80, (name, angles)


def test_an_annotation_is_seen_in_three_views(
    make_napari_viewer: Any, qtbot: Any, upright_atlas: Atlas
) -> None:
    hand = Hand(make_napari_viewer(show=True), upright_atlas.replaced(), qtbot, ("uv", "direct"))
    away = hand.atlas.surface.vertices - hand.atlas.surface.vertices.mean(axis=0)
    plain = {chart: _seen(hand, chart) for chart in ("surface", "uv", "direct")}
    # The upper half of a cap has another label: a mirror image is another picture.
    cap = away @ np.array([-0.3, 0.5, -0.8]) > 0.75 * np.linalg.norm(away, axis=1)
    for label, chosen in ((1, cap & (away[:, 0] < 0)), (2, cap & (away[:, 0] >= 0))):
        hand.annotations.draw_vertices("drawn", np.flatnonzero(chosen), label)
    for chart, before in plain.items():
        drawn = _seen(hand, chart)
        assert not alike(drawn, before), chart
        assert_looks_like(drawn, f"annotation_{chart}")
        assert not alike(drawn, drawn[:, ::-1])
    hand.annotations.undo()
    hand.annotations.undo()
    for chart, before in plain.items():
        assert alike(_seen(hand, chart), before), chart


def _seen(hand: Hand, chart: str) -> Any:
    if chart == "surface":
        hand.viewer.scene.camera.angles = (60, -70, 60)
        hand.viewer.window._qt_window.findChild(ShownBar).show_alone("surface")
        hand.settle()
        return picture(hand.viewer.window._qt_viewer, (64, 64))
    hand.show(chart)
    hand.settle()
    return picture(hand.canvas.qt_viewer)
