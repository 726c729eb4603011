"""A layer becomes a source with the voxel size that it says, or that the user states."""

from __future__ import annotations

import numpy as np
import pytest
from napari.components import ViewerModel
from napari.layers import Image, Labels, Layer, Points, Surface

from napari_unwrap3d import charts
from napari_unwrap3d.errors import AxesError, InputError, VoxelSizeMissingError
from napari_unwrap3d.viewer.movies.sources import set_time_step
from napari_unwrap3d.viewer.steps.computing import fingerprint
from napari_unwrap3d.viewer.views.layers import KEY
from napari_unwrap3d.viewer.views.sources import (
    is_source,
    layer_axes,
    layer_box,
    layer_source,
    layer_voxel_size,
    set_voxel_size,
)

SIZES = (0.3, 0.1, 0.2)


def image(shape: tuple[int, ...] = (4, 5, 6), **more: object) -> Image:
    return Image(np.zeros(shape, np.uint8), **more)


def test_voxel_size_and_origin_come_from_scale_units_and_translate() -> None:
    layer = image(scale=(300, 100, 200), translate=(3000, 0, -200), units=("nm",) * 3)
    source = layer_source(layer)
    assert isinstance(source.data, charts.Stack)
    assert source.data.voxel_size == pytest.approx(SIZES)
    assert source.origin == pytest.approx((3.0, 0.0, -0.2))


@pytest.mark.parametrize("scale", [(1, 1, 1), SIZES])
def test_a_layer_in_pixels_has_no_voxel_size(scale: tuple[float, ...]) -> None:
    layer = image(scale=scale)
    assert layer_voxel_size(layer) is None
    with pytest.raises(VoxelSizeMissingError):
        layer_source(layer)
    assert layer_source(layer, SIZES).data.voxel_size == SIZES


def test_one_axis_in_pixels_is_not_enough() -> None:
    assert layer_voxel_size(image(units=("µm", "µm", "pixel"))) is None


def test_a_known_voxel_size_wins_over_the_stated_one() -> None:
    layer = image(scale=SIZES, units=("µm",) * 3)
    assert layer_source(layer, (1, 1, 1)).data.voxel_size == SIZES


def test_the_stated_voxel_size_moves_the_layer_into_micrometres() -> None:
    layer = image((2, 4, 5, 6), scale=(1, 2, 1, 1), translate=(0, 4, 0, 3))
    before = layer_source(layer, SIZES)
    set_voxel_size(layer, SIZES)
    after = layer_source(layer)
    assert layer_voxel_size(layer) == pytest.approx(SIZES)
    assert after.origin == pytest.approx(before.origin)
    assert after.origin == pytest.approx((0.6, 0, 0.6))
    assert [str(u) for u in layer.units] == ["pixel", *["micrometer"] * 3]
    assert layer.axis_labels[-3:] == ("z", "y", "x")


@pytest.mark.parametrize("size", [1.0, 0.5])
def test_a_timelapse_is_still_seen_once_its_sizes_are_stated(size: float) -> None:
    viewer = ViewerModel()
    layer = viewer.add_image(np.ones((3, 4, 5, 6), np.uint8))
    set_voxel_size(layer, (size,) * 3)
    set_time_step(layer, size)
    assert layer.axis_labels == ("t", "z", "y", "x")
    assert layer._slice.image.view.min() == 1


@pytest.mark.parametrize(
    ("shape", "labels", "axes"),
    [
        ((4, 5, 6), None, "zyx"),
        ((2, 4, 5, 6), None, "tzyx"),
        ((2, 4, 5, 6), ("c", "z", "y", "x"), "czyx"),
        ((2, 4, 5, 6), ("time", "z", "y", "x"), "tzyx"),
        ((2, 2, 4, 5, 6), None, "tczyx"),
    ],
)
def test_axes(shape: tuple[int, ...], labels: tuple[str, ...] | None, axes: str) -> None:
    layer = image(shape, axis_labels=labels)
    assert layer_axes(layer) == axes
    source = layer_source(layer, SIZES).data
    assert isinstance(source, charts.Stack)
    assert source.axes == axes
    assert len(source.channels) == (2 if "c" in axes else 0)


def test_the_time_step_is_read_in_seconds() -> None:
    layer = image((2, 4, 5, 6), scale=(2, 1, 1, 1), units=("minute", "µm", "µm", "µm"))
    source = layer_source(layer).data
    assert isinstance(source, charts.Stack)
    assert source.time_step == pytest.approx(120)


def test_labels_stay_labels_and_booleans_become_a_mask() -> None:
    labels = Labels(np.arange(120).reshape(4, 5, 6) % 3)
    assert isinstance(layer_source(labels, SIZES).data, charts.Stack)
    mask = layer_source(Image(np.ones((4, 5, 6), bool)), SIZES).data
    assert isinstance(mask, charts.Mask)


def test_a_mesh_is_brought_to_micrometres() -> None:
    vertices = np.array([[0, 0, 0], [1000, 0, 0], [0, 1000, 0], [0, 0, 1000.0]])
    faces = np.array([[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]])
    layer = Surface((vertices, faces), units=("nm",) * 3, scale=(2, 2, 2))
    source = layer_source(layer).data
    assert isinstance(source, charts.Surface)
    np.testing.assert_allclose(source.vertices, vertices * 2e-3)
    np.testing.assert_array_equal(source.faces, faces)


@pytest.mark.parametrize(
    ("layer", "error"),
    [
        (image((5, 6)), AxesError),
        (Image(np.zeros((4, 5, 6, 3), np.uint8), rgb=True), AxesError),
        (image(rotate=10), InputError),
        (image(scale=(1, -1, 1)), InputError),
        (Points(np.zeros((1, 3))), InputError),
    ],
    ids=["2D", "rgb", "rotated", "mirrored", "points"],
)
def test_what_cannot_be_unwrapped_is_refused(layer: Layer, error: type[Exception]) -> None:
    with pytest.raises(error):
        layer_source(layer, SIZES)


def test_charts_and_flat_layers_are_no_sources() -> None:
    assert is_source(image())
    assert not is_source(image((5, 6)))
    assert not is_source(image(metadata={KEY: {"chart": "mask"}}))
    assert not is_source(Points(np.zeros((1, 3))))


def test_the_box_is_in_micrometres() -> None:
    box = layer_box(image(scale=(300, 100, 200), units=("nm",) * 3))
    np.testing.assert_allclose(np.ptp(box, axis=0), np.array((3, 4, 5)) * SIZES)


def test_the_fingerprint_sees_paint() -> None:
    labels = Labels(np.zeros((4, 5, 6), int))
    before = fingerprint(layer_source(labels, SIZES))
    assert fingerprint(layer_source(labels, SIZES)) == before
    labels.data[1, 2, 3] = 1
    assert fingerprint(layer_source(labels, SIZES)) != before
    assert fingerprint(layer_source(labels, (1, 1, 1))) != before
