"""Layers that are drawn on, without a window."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from napari_unwrap3d.annotations import Annotations
from napari_unwrap3d.viewer.annotations.drawing import DrawnLabels

pytestmark = pytest.mark.usefixtures("qapp")


@pytest.fixture
def annotations(small_atlas: Any) -> Annotations:
    annotations = Annotations(small_atlas)
    annotations.add("drawn")
    return annotations


@pytest.fixture
def drawn_on(annotations: Annotations) -> Iterator[Any]:
    """Makes the layer of a chart."""
    made = []

    def make(chart: str) -> DrawnLabels:
        annotations.watch(chart)
        made.append(DrawnLabels(annotations, "drawn", chart))
        return made[-1]

    yield make
    for layer in made:
        layer.close()


def test_every_way_to_paint_reaches_the_annotation(annotations: Any, drawn_on: Any) -> None:
    layer = drawn_on("uv")
    layer.brush_size = 9
    layer.paint((30, 40), 1)
    assert (annotations.image("drawn", "uv") == layer.data).all()
    layer.paint_polygon([(5, 90), (5, 110), (20, 100)], 2)
    assert (annotations.image("drawn", "uv") == layer.data).all()
    layer.data_setitem((np.array([60]), np.array([3])), 4)
    layer.fill((30, 40), 3)
    assert (annotations.image("drawn", "uv") == layer.data).all()
    assert set(np.unique(layer.data)) == {0, 2, 3, 4}
    assert set(np.unique(annotations.labels("drawn"))) >= {0, 2, 3}
    layer.paint((30, 40), 0)
    assert (annotations.image("drawn", "uv") == layer.data).all()


def test_what_others_draw_is_shown_in_the_next_turn(
    annotations: Any, drawn_on: Any, qtbot: Any
) -> None:
    layer = drawn_on("uv")
    annotations.draw_vertices("drawn", np.arange(500), 5)
    assert not layer.data.any()
    qtbot.waitUntil(lambda: bool(layer.data.any()))
    assert (annotations.image("drawn", "uv") == layer.data).all()
    # Showing is not drawing: the other pixels keep what they had.
    assert (annotations.labels("drawn") == 5).sum() == 500


def test_a_hidden_layer_shows_what_changed_when_it_is_seen_again(
    annotations: Any, drawn_on: Any
) -> None:
    layer = drawn_on("uv")
    layer.visible = False
    # As it is before napari has made any slice of it.
    object.__setattr__(layer._slice.image, "view", np.zeros((1, 1), np.uint8))
    annotations.draw_vertices("drawn", np.arange(500), 5)
    layer.show_changes()
    layer.visible = True
    assert layer.data.any()
    assert (annotations.image("drawn", "uv") == layer.data).all()


def test_a_block_is_one_step_and_undo_is_everybodys(
    annotations: Any, drawn_on: Any, qtbot: Any
) -> None:
    layer = drawn_on("uv")
    with layer.block_history():
        layer.paint((30, 40), 1)
        layer.paint((30, 60), 1)
    once = layer.data.copy()
    annotations.draw_vertices("drawn", np.arange(500), 2)
    layer.undo()
    layer.show_changes()
    assert (layer.data == once).all()
    layer.undo()
    layer.show_changes()
    assert not layer.data.any()
    layer.redo()
    layer.show_changes()
    assert (layer.data == once).all()


def test_a_stroke_of_napari_that_is_broken_off_leaves_nothing(
    annotations: Any, drawn_on: Any
) -> None:
    layer = drawn_on("uv")
    layer._begin_stroke()
    layer.paint((30, 40), 1)
    assert annotations.labels("drawn").any()
    layer._abort_stroke()
    assert not annotations.labels("drawn").any()
    assert not layer.data.any()


@pytest.mark.parametrize("chart", ["topography", "volume"])
def test_away_from_the_surface_nothing_stays(annotations: Any, drawn_on: Any, chart: str) -> None:
    layer = drawn_on(chart)
    layer.brush_size, layer.n_edit_dimensions = 5, 3
    layer.paint(tuple(0 for _ in layer.data.shape), 1)
    layer.show_changes()
    assert not annotations.labels("drawn").any()
    assert not layer.data.any()


@pytest.mark.parametrize("chart", ["topography", "volume"])
def test_on_the_surface_what_is_touched_is_marked(
    annotations: Any, drawn_on: Any, chart: str
) -> None:
    layer = drawn_on(chart)
    annotations.draw_vertices("drawn", np.arange(len(annotations.labels("drawn"))), 1)
    layer.show_changes()
    place = np.argwhere(layer.data == 1)[100]
    layer.undo()
    layer.show_changes()
    assert not layer.data.any()
    layer.brush_size = 3
    layer.paint(tuple(place), 2)
    layer.show_changes()
    assert layer.data[tuple(place)] == 2
    assert (layer.data == annotations.image("drawn", chart)).all()
    assert 0 < (annotations.labels("drawn") == 2).sum() < 200


def test_through_all_depths_marks_the_column(annotations: Any, drawn_on: Any) -> None:
    one, uv = drawn_on("topography"), drawn_on("uv")
    one.all_depths = True
    one.brush_size = 5
    one.paint((0, 32, 64), 1)
    column = annotations.labels("drawn").copy()
    assert column.any()
    annotations.undo()
    uv.brush_size = 5
    uv.paint((32, 64), 1)
    both = (column == 1) & (annotations.labels("drawn") == 1)
    assert both.sum() > 0.7 * max((column == 1).sum(), 1)
