"""Annotations stay with the cell when its charts are computed anew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from napari_unwrap3d.annotations import Annotations, Shape
from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.charts import Surface
from synthetic import icosphere, make_atlas

SQUARE = np.array([[4.0, 0.0], [4.0, 8.0], [9.0, 8.0], [9.0, 0.0]])


@pytest.fixture
def atlas() -> Atlas:
    atlas = make_atlas(rows=16)
    atlas.annotations.add("one")
    atlas.annotations.draw("one", "uv", ([3, 4], [5, 5]), 2)
    atlas.annotations.add_shape("one", Shape("uv", "rectangle", SQUARE, 3))
    atlas.annotations.add_shape("one", Shape("volume", "box", [[2, 2, 2], [5, 9, 9]], 4))
    atlas.annotations.points.set("tip", atlas.surface.vertices[3])
    atlas.annotations.overhang = "outermost"
    atlas.annotations.axis = (0, 3, 4)
    return atlas


def test_on_the_same_charts_nothing_changes(atlas: Atlas) -> None:
    again = atlas.replaced(quality={})
    one, other = atlas.annotations, again.annotations
    assert other is not one
    assert other.atlas is again
    assert other.shapes("one") == one.shapes("one")
    assert (other.labels("one") == one.labels("one")).all()
    assert (other.image("one", "uv") == one.image("one", "uv")).all()
    assert other.overhang == "outermost"
    assert other.axis == (0.0, 0.6, 0.8)
    assert dict(other.points.positions) == dict(one.points.positions)
    other.draw_vertices("one", [0], 9)
    assert one.labels("one")[0] != 9


def test_on_another_uv_labels_stay_on_the_surface(atlas: Atlas) -> None:
    """Shapes drawn there become painted labels; regions in space stay what they are."""
    turned = np.roll(atlas.topography.surface[:, 2], 0) + 7.0
    topography = replace(
        atlas.topography,
        surface=np.column_stack([atlas.topography.surface[:, :2], np.mod(turned, 32)]),
    )
    moved = atlas.replaced(topography=topography).annotations
    assert (moved.labels("one") == atlas.annotations.labels("one")).all()
    assert [shape.kind for shape in moved.shapes("one")] == ["box"]
    assert (moved.image("one", "uv") == moved.owners("uv").display(moved.labels("one"))).all()


def test_on_another_mesh_every_vertex_takes_the_nearest_label(atlas: Atlas) -> None:
    directions, faces = icosphere(4)
    finer = atlas.replaced(surface=None, sealed=None, reference=None, uv=None, topography=None)
    surface = Surface(6.0 + 4.0 * directions, faces)
    target = finer.replaced(surface=surface)
    moved = atlas.annotations.on(target)
    labels = atlas.annotations.labels("one")
    face, weights, _ = atlas._surface_locator.closest(surface.vertices)
    nearest = atlas.surface.faces[face, weights.argmax(axis=1)]
    box = ((surface.vertices >= 2) & (surface.vertices <= [5, 9, 9])).all(axis=1)
    assert (moved.labels("one")[box] == 4).all()
    outside = ~box & (labels[nearest] != 4)
    assert (moved.labels("one")[outside] == labels[nearest][outside]).all()
    assert 3 in moved.labels("one")


def test_an_atlas_without_annotations_carries_none() -> None:
    atlas = make_atlas(rows=16)
    assert atlas.annotated is None
    assert atlas.replaced(quality={}).annotated is None
    assert isinstance(atlas.annotations, Annotations)
    assert atlas.annotated is atlas.annotations
