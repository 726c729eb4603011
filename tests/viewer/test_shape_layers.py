"""Shapes that are drawn, edited and deleted with the mouse, in uv, direct and plane."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from qtpy.QtCore import QPoint, Qt
from qtpy.QtTest import QTest

from viewer.hand import LEFT, NONE, Hand
from viewer.opened import coarsely_direct

CONTROL, SHIFT = Qt.KeyboardModifier.ControlModifier, Qt.KeyboardModifier.ShiftModifier


@pytest.fixture
def hand(make_napari_viewer: Any, plane_atlas: Any, qtbot: Any) -> Hand:
    atlas = coarsely_direct(plane_atlas)
    return Hand(make_napari_viewer(show=True), atlas, qtbot, ("uv", "direct", "plane"))


def click(hand: Hand, v: float, u: float) -> None:
    x, y = hand.share(hand.second, v, u)
    place = QPoint(round(x * hand.second.width()), round(y * hand.second.height()))
    QTest.mouseClick(hand.second, LEFT, NONE, place)


def undo(hand: Hand, keys: Any = CONTROL) -> None:
    """With the keyboard, in the second canvas, where a Shapes layer is active."""
    QTest.keyClick(hand.second, Qt.Key.Key_Z, keys)
    hand.settle()


@pytest.mark.parametrize("chart", ["uv", "direct", "plane"])
def test_shapes_are_drawn_edited_and_deleted(hand: Hand, chart: str) -> None:
    annotations = hand.annotations
    rows = hand.show(chart).data.shape[0]
    hand.widget.label_box.setValue(3)
    hand.widget.regions.shapes_button.click()
    layer = hand.annotating.shapes.layer("drawn", chart)
    assert hand.canvas.model.layers.selection.active is layer
    hand.lay_out()
    hand.zoom_out()

    # A box is one step.
    layer.mode = "add_rectangle"
    corners = [(0.3, 0.5), (0.4, 0.6), (0.6, 0.8)]
    hand.drag(hand.second, [hand.share(hand.second, v * rows, u * rows) for v, u in corners])
    (shape,) = annotations.shapes("drawn", chart)
    assert shape.kind == "rectangle"
    assert np.ptp(shape.vertices, axis=0) == pytest.approx([0.3 * rows] * 2, abs=1)
    drawn = annotations.image("drawn", chart)
    assert (
        drawn[int(0.35 * rows) : int(0.55 * rows), int(0.55 * rows) : int(0.75 * rows)] == 3
    ).all()
    marked = hand.labels()
    assert set(np.flatnonzero(marked)) == set(annotations.marked_by(shape))
    hand.assert_everywhere()
    undo(hand)
    assert annotations.shapes("drawn", chart) == ()
    assert not layer.data
    assert not hand.labels().any()
    undo(hand, CONTROL | SHIFT)
    assert (hand.labels() == marked).all()
    assert len(layer.data) == 1

    # A corner of it moves, and the labels with it: one step again.
    layer.mode = "direct"
    layer.selected_data = {0}
    corner = layer.data[0][np.argmax(layer.data[0].sum(axis=1))]
    way = [corner + np.array([2.0, 4.0]) * k for k in range(4)]
    hand.drag(hand.second, [hand.share(hand.second, *place) for place in way])
    (moved,) = annotations.shapes("drawn", chart)
    assert np.count_nonzero((moved.vertices != shape.vertices).any(axis=1)) == 1
    assert set(np.flatnonzero(hand.labels())) == set(annotations.marked_by(moved))
    assert (hand.labels() != marked).any()
    hand.assert_everywhere()
    undo(hand)
    assert (hand.labels() == marked).all()
    np.testing.assert_array_equal(layer.data[0], shape.vertices)

    # A polygon over the seam is on both sides of it.
    layer.mode = "add_polygon"
    # The last corner is the one that follows the pointer, which napari takes away.
    for v, u in ((0.4, 1.8), (0.4, 2.2), (0.6, 2.2), (0.6, 1.8), (0.5, 1.8)):
        click(hand, v * rows, u * rows)
    QTest.keyClick(hand.second, Qt.Key.Key_Escape)
    hand.settle()
    assert len(annotations.shapes("drawn", chart)) == 2
    image = annotations.image("drawn", chart)
    assert (image[rows // 2, : int(0.15 * rows)] == 3).all()
    assert (image[rows // 2, int(1.85 * rows) :] == 3).all()
    hand.assert_everywhere()

    # Deleting it leaves no trace, and is a step, too.
    both = hand.labels()
    layer.mode = "select"
    layer.selected_data = {1}
    QTest.keyClick(hand.second, Qt.Key.Key_Delete)
    hand.settle()
    assert len(annotations.shapes("drawn", chart)) == 1
    assert (hand.labels() == marked).all()
    undo(hand)
    assert (hand.labels() == both).all()
    assert len(layer.data) == 2
