"""From stacks, label images and masks to one cell, and what is refused on the way."""

from __future__ import annotations

import json
import threading
from pathlib import Path
from typing import Any

import dask.array as da
import numpy as np
import pytest

from napari_unwrap3d.charts import Mask, Stack, Volume
from napari_unwrap3d.errors import (
    Cancelled,
    EmptyMaskError,
    FullMaskError,
    InputError,
    NotFiniteError,
    ParameterError,
    SeveralCellsError,
    TouchesBorderError,
)
from napari_unwrap3d.files.stacks import read_stack
from napari_unwrap3d.imaging import scan
from napari_unwrap3d.imaging.segment import check_mask, segment
from napari_unwrap3d.imaging.solid import MARGIN_VOXELS
from napari_unwrap3d.parameters import StackParameters
from napari_unwrap3d.progress import Progress

VOXEL = (0.3, 0.1, 0.1)
CENTRE = (6.0, 3.0, 4.0)
RADIUS = 1.7


def places(shape: tuple[int, ...], voxel_size: tuple[float, float, float]) -> np.ndarray:
    return np.indices(shape) * np.reshape(voxel_size, (3, 1, 1, 1))


def ball(
    shape: tuple[int, int, int] = (36, 60, 80),
    voxel_size: tuple[float, float, float] = VOXEL,
    centre: tuple[float, float, float] = CENTRE,
    radius: float = RADIUS,
) -> np.ndarray:
    away = places(shape, voxel_size) - np.reshape(centre, (3, 1, 1, 1))
    return np.sqrt((away**2).sum(axis=0)) < radius


def recorded(cell: np.ndarray, seed: int = 0) -> np.ndarray:
    """A noisy recording of a cell."""
    rng = np.random.default_rng(seed)
    return rng.poisson(np.where(cell, 200, 50)).astype(np.uint16)


def stack(data: Any, voxel_size: tuple[float, float, float] = VOXEL, axes: str = "zyx") -> Stack:
    return Stack(data, axes, voxel_size)


def volume_and_place(mask: Mask) -> tuple[float, np.ndarray]:
    inside = mask.to_world(np.argwhere(mask.data))
    return len(inside) * float(np.prod(mask.voxel_size)), inside.mean(axis=0)


def assert_is_the_ball(mask: Mask, edge: float = 0.1) -> None:
    assert mask.voxel_size == pytest.approx((edge,) * 3)
    volume, place = volume_and_place(mask)
    assert volume == pytest.approx(4 / 3 * np.pi * RADIUS**3, rel=0.06)
    assert place == pytest.approx(CENTRE, abs=0.05)
    room = np.pad(
        np.zeros(np.array(mask.shape) - 2 * MARGIN_VOXELS, bool),
        MARGIN_VOXELS,
        constant_values=True,
    )
    assert not (mask.data & room).any()


# Images ------------------------------------------------------------------------


@pytest.mark.parametrize("threshold", ["otsu", "multi-otsu", "value"])
def test_an_anisotropic_stack(threshold: Any) -> None:
    image = recorded(ball())
    chosen = StackParameters(
        threshold=threshold, threshold_value=125, background_um=8.0 if threshold == "otsu" else 0
    )
    if threshold == "multi-otsu":
        image[ball(radius=0.8)] += 300
    mask, report = segment(stack(image), chosen)
    assert_is_the_ball(mask)
    assert report["source"] == "image"
    assert report["touches_border_voxels"] == 0
    assert report["volume_um3"] == pytest.approx(volume_and_place(mask)[0])
    assert json.loads(json.dumps(report)) == report


def test_lazy_and_loaded_stacks_give_the_same() -> None:
    image = recorded(ball())
    loaded, _ = segment(stack(image))
    lazy, _ = segment(stack(da.from_array(image, chunks=(5, 30, 40))))
    assert np.array_equal(loaded.data, lazy.data)
    assert loaded.origin == lazy.origin


def test_the_working_voxel_can_be_chosen() -> None:
    mask, report = segment(stack(recorded(ball())), StackParameters(working_voxel_um=0.2))
    assert report["working_voxel_um"] == 0.2
    assert_is_the_ball(mask, 0.2)


def test_a_timepoint_and_a_channel_are_picked() -> None:
    movie = np.random.default_rng(0).poisson(50, (3, 2, 36, 60, 80)).astype(np.uint16)
    movie[2, 1] = recorded(ball())
    chosen = StackParameters(timepoint=2, channel=1)
    assert_is_the_ball(segment(stack(movie, axes="tczyx"), chosen)[0])
    with pytest.raises(ParameterError, match=r"no timepoint 3.*timepoints = 3"):
        segment(stack(movie, axes="tczyx"), StackParameters(timepoint=3))
    with pytest.raises(ParameterError, match=r"no channel 1.*channels = 1"):
        segment(stack(movie[:, 0], axes="tzyx"), StackParameters(channel=1))


def test_only_the_box_of_the_cell_is_kept_in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    shape = (60, 150, 200)
    data = recorded(ball(shape, (1.0, 1.0, 1.0), (20.0, 60.0, 70.0), 9.0))
    monkeypatch.setattr(scan, "COARSE_VOXELS", 40_000)
    monkeypatch.setattr("napari_unwrap3d.imaging.segment.SAMPLE_EDGE", 40)
    slices: list[int] = []

    class Watched:
        shape, dtype, ndim = data.shape, data.dtype, 3

        def __getitem__(self, key: Any) -> np.ndarray:
            part = data[key]
            slices.append(part.size)
            return part

    monkeypatch.setattr(scan, "SLAB_BYTES", 4 * 150 * 200 * 2)
    mask, report = segment(stack(Watched(), (1.0, 1.0, 1.0)))
    volume, place = volume_and_place(mask)
    assert volume == pytest.approx(4 / 3 * np.pi * 9.0**3, rel=0.05)
    assert place == pytest.approx((20.0, 60.0, 70.0), abs=0.2)
    assert max(slices) < data.size / 8
    low, high = np.array(report["box"]).T
    assert (low <= (11, 51, 61)).all()
    assert (high > (29, 69, 79)).all()


def test_the_box_grows_until_a_thin_part_is_inside(monkeypatch: pytest.MonkeyPatch) -> None:
    """A filopodium is too thin for the coarse copy, and it is not cut off."""
    monkeypatch.setattr(scan, "COARSE_VOXELS", 8_000)
    cell = ball((100, 100, 160), (1.0, 1.0, 1.0), (50.0, 50.0, 50.0), 18.0)
    cell[49:51, 49:51, 50:150] = True
    mask, report = segment(
        stack(np.where(cell, 200, 50) + (np.indices(cell.shape).sum(axis=0) % 3), (1.0,) * 3),
        StackParameters(smoothing_voxels=0),
    )
    assert mask.to_world(np.argwhere(mask.data))[:, 2].max() == pytest.approx(149, abs=1)
    assert report["box"][2][1] > 149


def test_cavities_are_filled_and_debris_is_dropped_and_both_are_counted() -> None:
    cell = ball()
    image = recorded(cell & ~ball(radius=0.6))
    image[2:5, 5:12, 5:12] = 250
    mask, report = segment(stack(image))
    assert_is_the_ball(mask)
    assert report["filled_cavities"] >= 1
    assert report["filled_voxels"] * 1e-3 == pytest.approx(4 / 3 * np.pi * 0.6**3, rel=0.3)
    assert report["dropped_components"] >= 1
    assert report["dropped_voxels"] > 50
    hollow, report = segment(stack(image), StackParameters(fill=False))
    assert "filled_voxels" not in report
    assert hollow.data.sum() < mask.data.sum()


# What is refused ---------------------------------------------------------------


def test_two_cells_are_refused() -> None:
    image = recorded(ball() | ball(centre=(6.0, 3.0, 1.7), radius=0.5))
    assert segment(stack(image))[1]["dropped_components"] >= 1
    image = recorded(ball(centre=(6.0, 3.0, 2.0)) | ball(centre=(6.0, 3.0, 6.0), radius=1.5))
    with pytest.raises(SeveralCellsError, match=r"2 objects.*largest_um3 = 2.*label image"):
        segment(stack(image))
    chosen = StackParameters(second_cell_fraction=0.9)
    assert segment(stack(image), chosen)[1]["components"] >= 2


def test_a_cell_at_the_border_is_closed_flat_and_reported(
    caplog: pytest.LogCaptureFixture,
) -> None:
    image = recorded(ball(centre=(6.0, 1.5, 4.0)))
    mask, report = segment(stack(image))
    assert report["touches_border_voxels"] > 50
    assert 0 < report["border_fraction"] < 0.1
    assert "closed flat" in caplog.text
    assert not mask.data[:, :MARGIN_VOXELS].any()
    assert mask.to_world(np.argwhere(mask.data))[:, 1].min() == pytest.approx(0.0, abs=1e-6)
    with pytest.raises(TouchesBorderError, match="fraction_of_surface"):
        segment(stack(recorded(ball(centre=(6.0, -0.3, 4.0)))))


def test_values_that_are_not_finite_are_counted() -> None:
    image = recorded(ball()).astype(np.float32)
    image[3, 4, 5:9] = np.nan
    with pytest.raises(NotFiniteError, match="voxels = 4"):
        segment(stack(image))


def test_empty_and_full_images_are_refused() -> None:
    with pytest.raises(EmptyMaskError, match="one intensity"):
        segment(stack(np.full((8, 9, 10), 7.0)))
    image = recorded(ball())
    with pytest.raises(EmptyMaskError, match="Choose another threshold"):
        segment(stack(image), StackParameters(threshold="value", threshold_value=1e6))
    with pytest.raises(FullMaskError):
        segment(stack(image), StackParameters(threshold="value", threshold_value=1.0))


def test_a_cancelled_segmentation_stops() -> None:
    event = threading.Event()
    seen: list[str] = []

    def watch(step: str, fraction: float, message: str) -> None:
        seen.append(message)
        if message == "working grid":
            event.set()

    with pytest.raises(Cancelled):
        segment(stack(recorded(ball())), None, Progress(watch, "stack", event))
    assert seen[-1] == "working grid"


def test_progress_never_goes_back() -> None:
    fractions: list[float] = []
    segment(stack(recorded(ball())), None, Progress(lambda s, f, m: fractions.append(f)))
    assert fractions == sorted(fractions)
    assert 0 <= fractions[0] <= fractions[-1] <= 1


# Labels and masks --------------------------------------------------------------


def label_image() -> np.ndarray:
    labels = np.zeros((36, 60, 80), dtype=np.uint16)
    labels[ball(centre=(6.0, 3.0, 1.8))] = 4
    labels[ball()] = 9
    labels[30:34, 10:30, 10:70] = 12
    return labels


def test_one_label_is_taken_as_it_is() -> None:
    mask, report = segment(stack(label_image()), StackParameters(label=9))
    assert_is_the_ball(mask)
    assert report["source"] == "label"
    assert report["label"] == 9
    lazy = da.from_array(label_image(), chunks=(7, 20, 80))
    assert np.array_equal(segment(stack(lazy), StackParameters(label=9))[0].data, mask.data)


def test_labels_that_are_missing_or_forgotten_are_explained() -> None:
    with pytest.raises(InputError, match=r"no label 5.*labels = 3.*Labels: 4, 9, 12\."):
        segment(stack(label_image()), StackParameters(label=5))
    with pytest.raises(InputError, match=r"looks like a label image.*--label"):
        segment(stack(label_image()))
    with pytest.raises(InputError, match="whole numbers"):
        segment(stack(label_image().astype(float)), StackParameters(label=9))


def test_smooth_images_without_noise_are_no_label_images() -> None:
    distance = np.sqrt(
        ((places((36, 60, 80), VOXEL) - np.reshape(CENTRE, (3, 1, 1, 1))) ** 2).sum(axis=0)
    )
    image = np.clip(200 * (RADIUS + 0.2 - distance) / 0.4, 0, 200).astype(np.uint8)
    assert_is_the_ball(segment(stack(image))[0])


def test_a_label_in_two_parts_keeps_the_larger_or_is_refused() -> None:
    labels = np.where(ball(), 3, 0).astype(np.uint8)
    labels[30:32, 10:14, 10:14] = 3
    _, report = segment(stack(labels), StackParameters(label=3))
    assert (report["dropped_components"], report["dropped_voxels"]) == (1, 32)
    labels[ball(centre=(6.0, 3.0, 1.7))] = 3
    with pytest.raises(SeveralCellsError):
        segment(stack(ball(centre=(6.0, 3.0, 1.7)) | ball(centre=(6.0, 3.0, 6.0))))


def test_a_stack_of_two_values_is_a_mask() -> None:
    for data in (ball(), np.where(ball(), 255, 0).astype(np.uint8)):
        mask, report = segment(stack(data))
        assert report["source"] == "mask"
        assert_is_the_ball(mask)


def test_an_isotropic_mask_is_not_changed_at_all() -> None:
    data = ball((50, 60, 80), (0.1, 0.1, 0.1), (2.5, 3.0, 4.0))
    data[25, 30, 40] = False
    given = Mask(data, (0.1, 0.1, 0.1), (1.0, 2.0, 3.0))
    mask, report = check_mask(given)
    before = given.to_world(np.argwhere(given.data))
    np.testing.assert_allclose(mask.to_world(np.argwhere(mask.data)), before, atol=1e-9)
    assert report["enclosed_cavities"] == 1
    assert report["dropped_voxels"] == 0
    again, _ = check_mask(mask)
    assert np.array_equal(again.data, mask.data)
    assert again.origin == pytest.approx(mask.origin)


def test_an_anisotropic_mask_is_resampled_in_its_place() -> None:
    data = ball(centre=(5.0, 3.0, 4.0))
    mask, _ = check_mask(Mask(data, VOXEL, (1.0, 0.0, 0.0)))
    assert_is_the_ball(mask)


def test_masks_that_hold_no_one_cell_are_refused() -> None:
    with pytest.raises(EmptyMaskError, match="check the label or the mask"):
        check_mask(Mask(np.zeros((5, 5, 5), bool), (1, 1, 1)))
    with pytest.raises(FullMaskError):
        check_mask(Mask(np.ones((5, 5, 5), bool), (1, 1, 1)))
    with pytest.raises(SeveralCellsError):
        check_mask(Mask(ball(centre=(6.0, 3.0, 1.7)) | ball(centre=(6.0, 3.0, 6.0)), VOXEL))
    with pytest.raises(TouchesBorderError, match="larger field of view"):
        check_mask(Mask(ball((3, 60, 80), centre=(0.3, 3.0, 4.0)), VOXEL))


# Real stacks -------------------------------------------------------------------


def test_frames_of_the_droplet(shared_data: Path) -> None:
    movie = read_stack(shared_data / "stacks" / "ExampleTifSequence.tif", (1, 1, 1), 1.0)
    volumes = []
    for t in range(0, movie.timepoints, 4):
        _, report = segment(movie, StackParameters(timepoint=t))
        assert report["components"] == 1
        volumes.append(report["volume_um3"])
    assert max(volumes) / min(volumes) < 1.5


def test_the_organoid_goes_through_with_its_debris_counted(shared_data: Path) -> None:
    name = "Neural_tube_organoid_DAPI_betaCat-small.tif"
    mask, report = segment(read_stack(shared_data / "stacks" / name))
    assert report["dropped_components"] > 5
    assert report["touched_sides"] == 2
    assert 0.1 < report["border_fraction"] < 0.25
    assert mask.data.sum() > 90_000


def test_the_fly_embryo_is_filled(shared_data: Path) -> None:
    path = shared_data / "stacks" / "Drosophila_CAAX-mCherry-tiny.tif"
    _, report = segment(read_stack(path, (1, 1, 1)))
    assert report["filled_cavities"] == 1
    assert report["filled_voxels"] > 20_000


def test_an_embryo_of_many_cells_is_refused(shared_data: Path) -> None:
    path = shared_data / "stacks" / "limeseg_Dub-WilliamMohler-Tp33-Half.zip"
    with pytest.raises(SeveralCellsError, match=r"walls around several chambers.*label image"):
        segment(read_stack(path, (1, 0.5, 0.5)))


def test_cells_of_the_ovule(shared_data: Path) -> None:
    path = shared_data / "stacks" / "plantseg_sample_ovule.h5"
    labels = read_stack(path, dataset="label")
    data = np.asarray(labels.data)
    for value, border in ((292, 0.0), (673, 0.0), (850, 0.1), (809, 0.1), (322, 0.43)):
        mask, report = segment(labels, StackParameters(label=value))
        assert report["border_fraction"] == pytest.approx(border, abs=0.02)
        expected = float((data == value).sum()) * 0.235 * 0.15 * 0.15
        assert volume_and_place(mask)[0] == pytest.approx(expected, rel=0.03)
    with pytest.raises((SeveralCellsError, TouchesBorderError), match="label image"):
        segment(read_stack(path))


def test_volume_keeps_its_place() -> None:
    """The fixtures above use the same world as the charts."""
    volume = Volume(ball(), VOXEL)
    inside = volume.to_world(np.argwhere(volume.data))
    assert inside.mean(axis=0) == pytest.approx(CENTRE, abs=0.02)
