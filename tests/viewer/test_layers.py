"""Every chart becomes layers in µm that lie where they should and cover nothing."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from napari.components import ViewerModel
from napari.layers import Layer

from napari_unwrap3d.atlas import Atlas
from napari_unwrap3d.viewer.views.layers import (
    CURVATURE,
    KEY,
    Layout,
    atlas_charts,
    atlas_layers,
    chart_layers,
    facing_outwards,
    flat_surface,
)
from synthetic import CENTRE, RADIUS

NAMES = {
    "mask",
    "surface",
    "sealed surface",
    "sealed places",
    "reference",
    "sphere",
    "sphere (conformal)",
    "topographic surface",
    "surface from topography",
}
UNWRAPPED = {"uv", "topography"}


@pytest.fixture(scope="module")
def layers(round_cell: Atlas) -> dict[str, Layer]:
    made = [
        Layer.create(*layer)
        for unwrapped in (False, True)
        for layer in atlas_layers(round_cell, unwrapped=unwrapped)
    ]
    return {layer.name: layer for layer in made}


def world(layer: Layer, points: Any) -> np.ndarray:
    """Straight layers only: scale, then translate."""
    return np.asarray(points, dtype=float) * layer.scale + layer.translate


def test_every_chart_has_its_layers(round_cell: Atlas, layers: dict[str, Layer]) -> None:
    assert set(layers) == NAMES | UNWRAPPED
    assert {a["name"] for _, a, _ in atlas_layers(round_cell)} == NAMES
    assert {a["name"] for _, a, _ in atlas_layers(round_cell, unwrapped=True)} == UNWRAPPED


def test_layers_say_their_units_axes_and_chart(layers: dict[str, Layer]) -> None:
    for layer in layers.values():
        unit = "pixel" if layer.name in UNWRAPPED else "micrometer"
        assert {str(each) for each in layer.units} == {unit}
        assert layer.axis_labels in [("z", "y", "x"), ("v", "u"), ("d", "v", "u")]
        assert layer.metadata[KEY]["layer"] == layer.name
        assert layer.metadata[KEY]["chart"] in atlas_charts_of(layers)


def atlas_charts_of(layers: dict[str, Layer]) -> set[str]:
    return {layer.metadata[KEY]["chart"] for layer in layers.values()}


def test_the_viewer_keeps_its_units_and_space_axes(round_cell: Atlas) -> None:
    viewer = ViewerModel()
    for data in atlas_layers(round_cell):
        viewer.add_layer(Layer.create(*data))
    assert [str(unit) for unit in viewer.layers.units] == ["micrometer"] * 3
    assert viewer.dims.axis_labels == ("z", "y", "x")


def test_the_surface_lies_where_the_cell_is(round_cell: Atlas) -> None:
    charts = atlas_charts(round_cell)
    origin = (3.0, -4.0, 5.0)
    (data,) = chart_layers("surface", charts, Layout.of(charts, origin))
    layer = Layer.create(*data)
    shown = world(layer, layer.data[0])
    np.testing.assert_allclose(shown, round_cell.surface.vertices + origin, atol=1e-5)
    (mask,) = chart_layers("mask", charts, Layout.of(charts, origin))
    inside = np.argwhere(mask[0]) * mask[1]["scale"] + mask[1]["translate"]
    np.testing.assert_allclose(inside.mean(axis=0), np.add(origin, CENTRE), atol=0.2)


def test_the_sphere_has_the_radius_of_the_reference(layers: dict[str, Layer]) -> None:
    sphere = layers["sphere"]
    points = world(sphere, sphere.data[0])
    radii = np.linalg.norm(points - sphere.translate, axis=1)
    np.testing.assert_allclose(radii, RADIUS, rtol=0.02)


def test_the_topographic_surface_is_as_wide_as_the_equator(
    round_cell: Atlas, layers: dict[str, Layer]
) -> None:
    flat = layers["topographic surface"]
    rows, columns = round_cell.uv.shape
    assert flat.scale[2] * columns == pytest.approx(2 * np.pi * RADIUS, rel=0.02)
    assert flat.scale[1] * rows == pytest.approx(np.pi * RADIUS, rel=0.02)
    assert flat.scale[0] == -1.0, "outwards is towards the viewer"


def test_unwrapped_charts_lie_at_zero_in_pixels(
    round_cell: Atlas, layers: dict[str, Layer]
) -> None:
    for name in UNWRAPPED:
        layer = layers[name]
        index = np.array([5, 20, 7])[-layer.ndim :]
        np.testing.assert_array_equal(world(layer, index), index)
    topography = layers["topography"]
    np.testing.assert_array_equal(topography.data != 0, round_cell.topography.mask)


def test_layers_say_where_their_values_are(round_cell: Atlas, layers: dict[str, Layer]) -> None:
    for name, chart in (("surface", "surface"), ("sphere", "sphere"), ("uv", "uv")):
        assert layers[name].metadata[KEY]["values_on"] == chart
    for name in ("mask", "topography", "surface from topography"):
        assert "values_on" not in layers[name].metadata[KEY]
    flat = layers["topographic surface"]
    vertices = flat.metadata[KEY]["vertices"]
    np.testing.assert_allclose(flat.data[0], round_cell.topography.surface[vertices], rtol=1e-6)


def test_fields_colour_the_layers(round_cell: Atlas, layers: dict[str, Layer]) -> None:
    curvature = round_cell.surface.fields[CURVATURE]
    np.testing.assert_allclose(layers["surface"].data[2], curvature, rtol=1e-6)
    low, high = layers["surface"].contrast_limits
    assert low == pytest.approx(-high)
    image = round_cell.uv.fields["surface_mean_curvature_per_um"]
    np.testing.assert_allclose(layers["uv"].data, image, rtol=1e-6)
    assert set(layers["surface"].features) == set(round_cell.surface.fields)
    assert list(layers["sealed places"].features["kind"]) == ["handle"]


def test_only_one_layer_per_place_is_visible(layers: dict[str, Layer]) -> None:
    visible = {name for name, layer in layers.items() if layer.visible}
    assert visible == {
        "surface",
        "sealed places",
        "sphere",
        "uv",
        "topography",
    }


def test_a_missing_chart_has_no_layers(round_cell: Atlas) -> None:
    charts = {"reference": round_cell.reference, "sphere": round_cell.sphere}
    made = chart_layers("sphere", charts, Layout.of(charts))
    assert [attributes["name"] for _, attributes, _ in made] == ["sphere (conformal)", "sphere"]


def test_the_flat_surface_stays_over_the_image(round_cell: Atlas) -> None:
    old = round_cell.topography
    far = old.cut_vertices.copy()
    far[old.cut_faces[0, 0], 2] = 3 * old.shape[2]
    cut, kept = flat_surface(replace(old, cut_vertices=far))
    assert cut.vertices[:, 2].max() < 1.1 * old.shape[2]
    assert len(cut.faces) > 0.98 * len(old.cut_faces)
    np.testing.assert_array_equal(cut.vertices, far[kept])


def test_the_flat_mesh_faces_the_viewer() -> None:
    square = np.array([[0, 0, 0], [0, 1, 0], [0, 0, 1], [0, 1, 1]], dtype=float)
    faces = np.array([[0, 1, 2], [1, 3, 2]])
    np.testing.assert_array_equal(facing_outwards(square, faces), faces)
    np.testing.assert_array_equal(facing_outwards(square, faces[:, ::-1]), faces)


lengths = st.floats(0.5, 100)


@given(
    low=st.tuples(*[st.floats(-50, 50)] * 3),
    size=st.tuples(lengths, lengths, lengths),
    radius=st.floats(0.2, 60),
)
def test_no_chart_covers_another(
    low: tuple[float, ...], size: tuple[float, ...], radius: float
) -> None:
    box = np.array([low, np.add(low, size)])
    layout = Layout.around(box, radius)
    extent = np.array([np.pi * radius, 2 * np.pi * radius])
    _, y, x = layout.sphere
    areas = [
        box[:, 1:],
        np.array([[y - radius, x - radius], [y + radius, x + radius]]),
        np.array([layout.topography[1:], layout.topography[1:] + extent]),
    ]
    for i, first in enumerate(areas):
        for second in areas[i + 1 :]:
            apart = (first[0] >= second[1]) | (second[0] >= first[1])
            assert apart.any()
