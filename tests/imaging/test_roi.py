"""A crop is a cut by hand that keeps the world; channels are numbers or names."""

from __future__ import annotations

from typing import Any

import dask.array as da
import numpy as np
import pytest

from napari_unwrap3d.charts import Mask, Stack
from napari_unwrap3d.errors import ParameterError
from napari_unwrap3d.imaging.roi import channel_index, chosen_volume, crop_box
from napari_unwrap3d.imaging.segment import check_mask, segment
from napari_unwrap3d.parameters import Parameters, StackParameters, SurfaceParameters
from napari_unwrap3d.progress import silent
from napari_unwrap3d.unwrapping.surface import surface

VOXEL = (0.25, 0.1, 0.1)
SHAPE = (40, 70, 90)
CROP = (3, 37, 15, 65, 30, 88)
BOX = (slice(3, 37), slice(15, 65), slice(30, 88))
START = np.array((3, 15, 30)) * VOXEL


def two_cells() -> np.ndarray:
    """One cell in the crop, another outside of it."""
    place = np.indices(SHAPE) * np.reshape(VOXEL, (3, 1, 1, 1))
    light = np.full(SHAPE, 50)
    for centre, radius in (((5.0, 4.0, 5.9), 1.8), ((5.0, 3.5, 1.4), 1.1)):
        away = place - np.reshape(centre, (3, 1, 1, 1))
        light[(away**2).sum(axis=0) < radius**2] = 200
    return np.random.default_rng(0).poisson(light).astype(np.uint16)


@pytest.mark.parametrize("lazy", [False, True])
def test_a_crop_gives_the_surface_of_a_cut_by_hand_in_its_place(lazy: bool) -> None:
    image = two_cells()
    data = da.from_array(image, chunks=(8, 70, 90)) if lazy else image
    mask, report = segment(Stack(data, "zyx", VOXEL), StackParameters(crop_voxels=CROP))
    cut, by_hand = segment(Stack(image[BOX], "zyx", VOXEL))
    assert np.array_equal(mask.data, cut.data)
    np.testing.assert_allclose(mask.origin, np.array(cut.origin) + START, atol=1e-9)
    one = surface(mask, SurfaceParameters(), None, silent())
    two = surface(cut, SurfaceParameters(), None, silent())
    np.testing.assert_allclose(one.vertices, two.vertices + START, atol=1e-9)
    assert np.array_equal(one.faces, two.faces)
    assert report["crop"] == [[3, 37], [15, 65], [30, 88]]
    shifted = np.array(by_hand["box"]) + np.array([[3], [15], [30]])
    assert np.array_equal(report["box"], shifted)
    np.testing.assert_allclose(one.vertices.mean(axis=0), (5.0, 4.0, 5.9), atol=0.05)


def test_a_crop_in_micrometres_takes_the_voxels_whose_centres_are_inside() -> None:
    lengths = tuple(
        float(end)
        for start, stop, size in zip(CROP[::2], CROP[1::2], VOXEL, strict=True)
        for end in (start * size, (stop - 1) * size)
    )
    assert crop_box(SHAPE, VOXEL, StackParameters(crop_um=lengths)) == BOX
    smaller = StackParameters(crop_um=tuple(np.array(lengths) + [0.01, -0.01] * 3))
    inner = crop_box(SHAPE, VOXEL, smaller)
    assert inner == tuple(slice(side.start + 1, side.stop - 1) for side in BOX)
    wide = crop_box(SHAPE, VOXEL, StackParameters(crop_um=(-9, 99, -9, 99, -9, 99)))
    assert wide == tuple(slice(0, n) for n in SHAPE)
    moved = crop_box(SHAPE, VOXEL, StackParameters(crop_um=lengths), (0.25, 0.1, 0.1))
    assert moved == tuple(slice(side.start - 1, side.stop - 1) for side in BOX)


def test_no_crop_is_the_default_and_the_whole_image_is_the_same() -> None:
    assert crop_box(SHAPE, VOXEL, StackParameters()) is None
    image = two_cells()[:, :, 26:]
    plain, report = segment(Stack(image, "zyx", VOXEL))
    assert "crop" not in report
    all_of_it = StackParameters(crop_voxels=(0, 40, 0, 70, 0, 64))
    whole, _ = segment(Stack(image, "zyx", VOXEL), all_of_it)
    assert np.array_equal(plain.data, whole.data)
    assert plain.origin == whole.origin


def test_labels_and_masks_are_cropped_too() -> None:
    image = two_cells() > 125
    labels = Stack(image.astype(np.uint8) * 3, "zyx", VOXEL)
    place = (0.5, -1.0, 2.0)
    of_label, _ = segment(labels, StackParameters(label=3, crop_voxels=CROP))
    of_mask, report = check_mask(Mask(image, VOXEL, place), StackParameters(crop_voxels=CROP))
    one = of_label.to_world(np.argwhere(of_label.data)) + place
    two = of_mask.to_world(np.argwhere(of_mask.data))
    np.testing.assert_allclose(one.mean(axis=0), two.mean(axis=0), atol=0.02)
    assert len(one) == pytest.approx(len(two), rel=0.01)
    assert (report["crop"][0], report["dropped_components"]) == ([3, 37], 0)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"crop_voxels": (0, 41, 0, 70, 0, 90)}, r"does not hold.*0, 41.*shape = \(40, 70, 90\)"),
        ({"crop_voxels": (-1, 40, 0, 70, 0, 90)}, "does not hold"),
        ({"crop_voxels": (8, 8, 0, 70, 0, 90)}, "does not hold"),
        ({"crop_voxels": (8, 9, 0, 70, 0, 90)}, "does not hold"),
        ({"crop_um": (50, 60, 0, 7, 0, 9)}, "does not hold"),
        ({"crop_um": (5, 1, 0, 7, 0, 9)}, "does not hold"),
        ({"crop_um": (0, 1, 0, 1, 0, 1), "crop_voxels": CROP}, "given twice"),
    ],
)
def test_crops_outside_of_the_image_are_refused(given: dict[str, Any], words: str) -> None:
    with pytest.raises(ParameterError, match=words):
        crop_box(SHAPE, VOXEL, StackParameters(**given))


def test_crops_are_read_from_text_and_from_files() -> None:
    text = Parameters.from_dict({"stack": {"crop_voxels": "3, 37, 15, 65, 30, 88"}})
    assert text.stack.crop_voxels == CROP
    assert Parameters.from_toml(text.to_toml()) == text
    for wrong in ("1, 2, 3", "all", (1, 2, 3, 4, 5), (0.5, 1, 2, 3, 4, 5)):
        with pytest.raises(ParameterError, match=r"stack\.crop_voxels"):
            Parameters.from_dict({"stack": {"crop_voxels": wrong}})
    with pytest.raises(ParameterError, match=r"stack\.psf_voxel_um"):
        Parameters.from_dict({"stack": {"psf_voxel_um": (0.1, 0.1, 0)}})


def test_channels_have_numbers_and_names() -> None:
    data = np.arange(2 * 3 * 8).reshape(2, 3, 2, 2, 2)
    movie = Stack(data, "tczyx", (1, 1, 1), channels=("actin", "488", "2"))
    assert [channel_index(movie, name) for name in (0, "1", "actin", "488", 2)] == [0, 1, 0, 1, 2]
    assert np.array_equal(chosen_volume(movie, 1, "488"), data[1, 1])
    for wrong in (3, -1, "septin", ""):
        with pytest.raises(ParameterError, match=r"no channel.*channels = 3.*actin, 488, 2"):
            channel_index(movie, wrong)
    with pytest.raises(ParameterError, match=r"no timepoint 2.*timepoints = 2"):
        chosen_volume(movie, 2, 0)
