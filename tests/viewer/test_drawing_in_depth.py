"""Drawing with the mouse in the topography and on slices of the stack, seen everywhere."""

from __future__ import annotations

import numpy as np
from qtpy.QtCore import Qt
from qtpy.QtTest import QTest
from scipy import ndimage

from napari_unwrap3d import shell
from napari_unwrap3d.annotations.charts import NEAR_VOXELS
from viewer.hand import Hand
from viewer.opened import SECONDS

STROKE = [(0.4 + 0.02 * k, 0.5) for k in range(6)]


def test_at_a_depth_of_the_topography_only_what_is_there_is_marked(hand: Hand) -> None:
    layer, topography = hand.show("topography"), hand.atlas.topography
    hand.choose("brush", label=2)
    assert not hand.widget.all_depths.isChecked()
    # Where the surface passes below the stroke.
    middle = np.linalg.norm(topography.surface[:, 1:] - [32, 57], axis=1).argmin()
    depth = float(topography.surface[middle, 0])
    hand.canvas.depth_bar.set_depth(depth)
    hand.drag(hand.second, STROKE)
    marked = hand.labels() == 2
    d, v, u = topography.surface[marked].T
    reach = shell.NEAR_VOXELS * hand.atlas.voxel_um + (topography.d_um[1] - topography.d_um[0])
    assert marked.sum() > 5
    assert np.abs(d - depth).max() <= reach
    assert np.abs(v - 32).max() < 16
    assert np.ptp(u) > 8
    assert layer.data.any()
    hand.show("uv")
    hand.assert_everywhere()
    assert (hand.uv.data == 2).any()
    assert (hand.annotations.image("drawn", "direct") == 2).any()
    hand.annotations.undo()
    assert not hand.labels().any()
    hand.assert_everywhere()


def test_through_all_depths_of_the_topography_every_sheet_is_marked(hand: Hand) -> None:
    hand.show("topography")
    hand.choose("brush", label=3)
    hand.widget.radius_box.setValue(0.8)
    hand.widget.all_depths.setChecked(True)
    hand.drag(hand.second, STROKE)
    layer = hand.annotating.layers.layer("drawn", "topography")
    # What is shown reaches a little beside what was drawn, as far as nodes show vertices.
    drawn = ndimage.binary_erosion((layer.data == 3).any(axis=0), iterations=3)
    topography = hand.atlas.topography
    d, v, u = topography.surface.T
    inside = np.isfinite(v) & (d > topography.d_um[0]) & (d < topography.d_um[-1])
    pixel = np.rint(np.where(inside, (v, u), 0.0)).astype(int) % [[64], [128]]
    inside &= drawn[tuple(pixel)]
    assert inside.sum() > 20
    assert (hand.labels()[inside] == 3).all()
    hand.show("uv")
    hand.assert_everywhere()
    assert (hand.uv.data == 3).any()


def test_what_is_drawn_on_a_slice_of_the_stack_is_everywhere(hand: Hand) -> None:
    hand.choose("brush", label=4)
    hand.widget.slices.setChecked(True)
    layers = hand.annotating.layers
    hand.qtbot.waitUntil(lambda: layers.layer("drawn", "volume") is not None, timeout=SECONDS)
    layer, mask, viewer = layers.layer("drawn", "volume"), hand.atlas.mask, hand.viewer
    assert viewer.dims.ndisplay == 2
    assert viewer.layers.selection.active is layer
    assert layer.mode == "paint"
    vertices = hand.atlas.surface.vertices
    slice_z = int(mask.to_index(vertices).mean(axis=0)[0])
    z = layer.data_to_world((slice_z, 0, 0))[0]
    viewer.dims.set_point(0, z)
    viewer.reset_view()
    # Along the outline of the cell in this slice, on its right side.
    near = np.abs(mask.to_index(vertices)[:, 0] - slice_z) < 0.5
    right = vertices[near & (vertices[:, 2] > vertices[:, 2].mean())]
    right = right[np.argsort(right[:, 1])]
    shift = layer.translate - np.asarray(mask.origin)
    way = [place[1:] + shift[1:] for place in right[len(right) // 4 : 3 * len(right) // 4 : 12]]
    hand.drag(hand.main, [hand.share(hand.main, *place) for place in way])
    marked = hand.labels() == 4
    assert marked.sum() > 10
    apart = np.abs(mask.to_index(vertices[marked])[:, 0] - slice_z)
    assert apart.max() <= NEAR_VOXELS + 0.5
    assert (layer.data == 4).any()
    hand.assert_everywhere()
    assert (hand.uv.data == 4).any()
    QTest.keyClick(hand.main, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    hand.assert_everywhere()
    assert not hand.labels().any()
