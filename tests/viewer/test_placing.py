"""Charts are replaced in place; what the user set on a layer stays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from napari.components import ViewerModel

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.charts import Reference, Surface
from napari_unwrap3d.viewer.views.layers import CURVATURE, Layout, atlas_charts, chart_layers
from napari_unwrap3d.viewer.views.placing import place_layers, placing, remove_charts


@pytest.fixture
def viewer() -> ViewerModel:
    model = ViewerModel()
    model.add_image(np.zeros((4, 5, 6)), name="stack")
    return model


def show(viewer: ViewerModel, atlas: Atlas, name: str, chart: object = None) -> None:
    charts = atlas_charts(atlas)
    if chart is not None:
        charts[name] = chart
    place_layers(viewer, chart_layers(name, charts, Layout.of(charts)))


def test_later_charts_go_below_earlier_ones_and_above_the_stack(
    viewer: ViewerModel, round_cell: Atlas
) -> None:
    for name in ("surface", "sealed", "sphere"):
        show(viewer, round_cell, name)
    names = [layer.name for layer in viewer.layers]
    assert names[0] == "stack"
    assert names[-4:] == ["sphere", "sealed surface", "sealed places", "surface"]
    assert viewer.layers.selection.active.name == "stack"


def test_a_mesh_that_is_seen_is_prepared_once(viewer: ViewerModel, round_cell: Atlas) -> None:
    viewer.dims.ndisplay = 3
    charts = atlas_charts(round_cell)
    layout = Layout.of(charts)
    prepared: list[str] = []
    viewer.layers.events.inserted.connect(
        lambda event: event.value.events.set_data.connect(
            lambda event: prepared.append(event.source.name)
        )
    )
    viewer.layers["stack"].events.set_data.connect(lambda _: prepared.append("stack"))
    visible: list[bool] = []
    for _ in placing(viewer, chart_layers("surface", charts, layout)):
        visible += [viewer.layers["surface"].visible] if "surface" in viewer.layers else []
    assert visible == [False, True]
    assert prepared.count("surface") == 1
    # A slider that gets another range may move.
    viewer.layers.events.inserted.connect(lambda _: viewer.dims.set_point(0, 1.7))
    place_layers(viewer, chart_layers("topography", charts, layout)[1:])
    assert viewer.dims.point[0] == 1.7
    assert "stack" in prepared
    # No slider changes what is seen of it in 3D.
    assert prepared.count("surface") == 1


def test_charts_that_stay_where_they_are_are_left_alone(
    viewer: ViewerModel, round_cell: Atlas
) -> None:
    show(viewer, round_cell, "surface")
    moved: list[str] = []
    for event in (viewer.layers[1].events.scale, viewer.layers[1].events.translate):
        event.connect(lambda event: moved.append(event.type))
    show(viewer, round_cell, "surface")
    assert not moved


def test_a_chart_is_replaced_in_place(viewer: ViewerModel, round_cell: Atlas) -> None:
    show(viewer, round_cell, "surface")
    layer = viewer.layers["surface"]
    layer.name = "my cell"
    layer.visible = False
    layer.colormap = "turbo"
    half = len(round_cell.surface.vertices) // 2
    old = round_cell.surface
    faces = old.faces[(old.faces < half).all(axis=1)]
    fields = {CURVATURE: 7 + np.arange(half, dtype=float)}
    show(viewer, round_cell, "surface", Surface(old.vertices[:half], faces, fields))
    assert viewer.layers["my cell"] is layer
    assert len(viewer.layers) == 2
    assert len(layer.data[0]) == half
    assert len(layer.features) == half
    assert not layer.visible
    assert layer.colormap.name == "turbo"
    assert layer.contrast_limits[1] > 7


def test_contrast_limits_of_the_user_stay(viewer: ViewerModel, round_cell: Atlas) -> None:
    show(viewer, round_cell, "reference")
    layer = viewer.layers["reference"]
    layer.contrast_limits = (0.0, 0.125)
    old = round_cell.reference
    curvature = np.full(len(old.vertices), 3.0)
    show(
        viewer, round_cell, "reference", Reference(old.vertices, old.faces, {CURVATURE: curvature})
    )
    assert layer.contrast_limits == [0.0, 0.125]


def test_what_a_chart_no_longer_has_is_removed(viewer: ViewerModel, round_cell: Atlas) -> None:
    show(viewer, round_cell, "sealed")
    assert "sealed places" in viewer.layers
    show(viewer, round_cell, "sealed", replace(round_cell.sealed, sealed=()))
    assert "sealed places" not in viewer.layers
    assert "sealed surface" in viewer.layers
    show(viewer, round_cell, "sealed")
    assert "sealed places" in viewer.layers


def test_remove_charts_leaves_the_rest(viewer: ViewerModel, round_cell: Atlas) -> None:
    show(viewer, round_cell, "uv")
    remove_charts(viewer)
    assert [layer.name for layer in viewer.layers] == ["stack"]
