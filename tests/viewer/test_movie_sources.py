"""Which layers are a timelapse, and what is read from them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from napari.layers import Image, Labels, Layer, Surface

from napari_unwrap3d import Mask, Stack
from napari_unwrap3d.charts import Surface as Mesh
from napari_unwrap3d.errors import InputError
from napari_unwrap3d.viewer.movies.sources import candidates, natural, set_time_step, timelapse_of
from synthetic import icosphere

UM = ("µm",) * 3
SIZE = (0.3, 0.2, 0.2)


def image(shape: tuple[int, ...], step: float = 2.0, unit: str = "second", **more: Any) -> Layer:
    extra = len(shape) - 3
    scale = (step, *(1.0,) * (extra - 1), *SIZE) if extra else SIZE
    units = (unit, *("pixel",) * (extra - 1), *UM) if extra else UM
    return Image(np.zeros(shape, np.uint8), scale=scale, units=units, **more)


def test_a_stack_with_a_t_axis_is_one_and_others_are_not() -> None:
    movie, single = image((3, 4, 5, 6), name="movie"), image((4, 5, 6), name="single")
    channels = image((2, 4, 5, 6), axis_labels=tuple("czyx"))
    (found,) = candidates([movie, single, channels])
    assert (found.layers, found.timepoints) == ((movie,), 3)
    assert found.voxel_size == SIZE
    assert found.time_step == 2.0


def test_milliseconds_are_seconds_and_pixels_are_asked_about() -> None:
    (quick,) = candidates([image((3, 4, 5, 6), 500.0, "millisecond")])
    assert quick.time_step == pytest.approx(0.5)
    layer = image((3, 4, 5, 6), 1.0, "pixel")
    (unknown,) = candidates([layer])
    assert unknown.time_step is None
    with pytest.raises(InputError, match="time between two timepoints"):
        timelapse_of(unknown, None, None)
    lapse, _ = timelapse_of(unknown, None, 4.0)
    assert lapse.time_step_s == 4.0
    set_time_step(layer, 4.0)
    assert candidates([layer])[0].time_step == 4.0


def test_layers_of_one_kind_are_sorted_as_people_count() -> None:
    masks = [Image(np.zeros((4, 4, 4), bool), name=f"cell {n}", scale=SIZE, units=UM)
             for n in (10, 9, 1)]  # fmt: skip
    (found,) = candidates([*masks, Labels(np.zeros((4, 4, 4), int), name="other")])
    assert [layer.name for layer in found.layers] == ["cell 1", "cell 9", "cell 10"]
    lapse, origin = timelapse_of(found, None, 1.0)
    assert origin == (0.0, 0.0, 0.0)
    assert all(isinstance(lapse.at(t), Mask) for t in range(3))
    assert lapse.name == "cell"
    assert natural("a10") > natural("a9")


def test_masks_at_different_places_stay_there() -> None:
    masks = [Image(np.ones((2, 2, 2), bool), name=f"m{n}", scale=SIZE, units=UM,
                   translate=(n, 0, 0)) for n in range(2)]  # fmt: skip
    lapse, _ = timelapse_of(candidates(masks)[0], None, 1.0)
    second = lapse.at(1)
    assert isinstance(second, Mask)
    assert second.origin == (1.0, 0.0, 0.0)
    stacks = [image((2, 2, 2), name=f"s{n}", translate=(n, 0, 0)) for n in range(2)]
    with pytest.raises(InputError, match="different places"):
        timelapse_of(candidates(stacks)[0], None, 1.0)


def test_a_mesh_whose_vertices_have_a_time_is_one_mesh_for_each() -> None:
    vertices, faces = icosphere(1)
    count = len(vertices)
    times = np.repeat([[0.0], [5.0]], count, axis=0)
    both = np.hstack([times, np.vstack([vertices, vertices + 1])])
    layer = Surface(
        (both, np.vstack([faces, faces + count])), units=("second", *UM), scale=(1.5, *(0.5,) * 3)
    )
    (found,) = candidates([layer])
    assert (found.timepoints, found.time_step) == (2, 1.5)
    lapse, _ = timelapse_of(found, None, None)
    second = lapse.at(1)
    assert isinstance(second, Mesh)
    np.testing.assert_allclose(second.vertices, 0.5 * (vertices + 1))
    np.testing.assert_array_equal(second.faces, faces)


def test_a_stack_with_channels_keeps_them_and_its_place() -> None:
    layer = image((3, 2, 4, 5, 6), axis_labels=tuple("tczyx"), translate=(0, 0, 3, 0, 1))
    (found,) = candidates([layer])
    lapse, origin = timelapse_of(found, None, None)
    assert isinstance(lapse.sources, Stack)
    assert lapse.sources.axes == "tczyx"
    assert len(lapse.channels) == 2
    assert origin == (3.0, 0.0, 1.0)
    assert found.has_channels
