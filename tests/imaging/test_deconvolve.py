"""Deconvolution undoes the blur it knows, keeps intensities, and refuses what is no PSF."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import ndimage

from napari_unwrap3d.charts import Stack, Volume
from napari_unwrap3d.errors import (
    AxesError,
    Cancelled,
    FileFormatError,
    InputError,
    NotFiniteError,
    ParameterError,
    VoxelSizeMissingError,
)
from napari_unwrap3d.files.stacks import write_image
from napari_unwrap3d.imaging.deconvolve import (
    deconvolved,
    prepared_psf,
    read_deconvolved,
    read_psf,
    richardson_lucy,
    tapered,
)
from napari_unwrap3d.imaging.segment import segment
from napari_unwrap3d.parameters import StackParameters
from napari_unwrap3d.progress import Progress, silent

UNIT = (1.0, 1.0, 1.0)
SHAPE = (36, 40, 44)
SIGMA = (2.4, 1.2, 1.2)
METHODS = ("wiener", "richardson-lucy")


def gaussian(sigma: tuple[float, ...] = SIGMA, reach: int = 7, shift: float = 0.0) -> np.ndarray:
    place = np.indices((2 * reach + 1,) * 3) - reach - shift
    return np.exp(-0.5 * ((place / np.reshape(sigma, (3, 1, 1, 1))) ** 2).sum(axis=0))


def cell() -> np.ndarray:
    """A ball in a shell, and a bar that the border of the image cuts."""
    away = np.indices(SHAPE) - np.reshape((18, 20, 22), (3, 1, 1, 1))
    radius = np.sqrt((away**2).sum(axis=0))
    image = np.where(radius < 9, 200.0, 20.0)
    image[np.abs(radius - 13) < 1.5] = 150
    image[12:16, :8, 20:24] = 180
    return image


def blurred(image: np.ndarray) -> np.ndarray:
    """As a microscope sees it, which also sees what lies beyond the border."""
    wide = np.pad(image, 10, mode="edge")
    seen = ndimage.gaussian_filter(wide, SIGMA, truncate=5)
    return seen[10:-10, 10:-10, 10:-10].astype(np.float32)


def chosen(method: Any, **others: Any) -> StackParameters:
    return StackParameters(deconvolution=method, **others)


def error(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.sqrt(((one - other) ** 2).mean()))


def on_voxels(psf: np.ndarray, size: Any = UNIT, of_image: Any = UNIT) -> np.ndarray:
    return prepared_psf(Volume(psf, size), of_image, SHAPE)


# Images --------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("noisy", [False, True])
def test_the_truth_comes_nearer_and_the_intensity_is_kept(method: str, noisy: bool) -> None:
    truth = cell()
    image = blurred(truth)
    if noisy:
        image = np.random.default_rng(0).poisson(image).astype(np.float32)
    found = deconvolved(image, on_voxels(gaussian()), chosen(method), silent())
    assert error(found, truth) < 0.92 * error(image, truth)
    assert found.sum() == pytest.approx(image.sum(), rel=3e-3)
    assert found.dtype == np.float32


def test_richardson_lucy_keeps_the_sum_of_a_periodic_image_and_its_sign() -> None:
    image = np.random.default_rng(0).random((20, 24, 30)).astype(np.float32)
    found = richardson_lucy(image, on_voxels(gaussian()), 5, silent())
    assert found.sum(dtype=float) == pytest.approx(image.sum(dtype=float), rel=1e-4)
    assert found.min() >= 0


def test_a_point_changes_nothing() -> None:
    image = blurred(cell())
    point = np.zeros((5, 6, 7))
    point[1, 2, 4] = 3.0
    psf = on_voxels(point)
    for method in METHODS:
        found = deconvolved(image, psf, chosen(method, wiener_balance=1e-7), silent())
        np.testing.assert_allclose(found, image, atol=2e-3)


@pytest.mark.parametrize("method", METHODS)
def test_gain_and_offset_pass_through(method: str) -> None:
    image = blurred(cell())
    psf = on_voxels(gaussian())
    plain = deconvolved(image, psf, chosen(method), silent())
    louder = deconvolved(3 * image, psf, chosen(method), silent())
    np.testing.assert_allclose(louder, 3 * plain, rtol=2e-4, atol=2e-2)
    if method == "wiener":
        lower = deconvolved(image - 100, psf, chosen(method), silent())
        np.testing.assert_allclose(lower, plain - 100, atol=2e-2)


@pytest.mark.parametrize("method", METHODS)
def test_the_border_does_not_ring(method: str) -> None:
    """A slope stays a slope: without a taper its ends, which differ by 290, would ring."""
    slope = np.broadcast_to(np.linspace(10, 300, SHAPE[2]), SHAPE).astype(np.float32)
    psf = on_voxels(gaussian())
    found = deconvolved(slope, psf, chosen(method), silent())
    # The mirrored continuation has a kink, and nothing more, at the border.
    assert np.abs(found - slope).max() < 15
    inner = np.abs(found - slope)[:, :, 6:-6]
    assert inner.max() < 6
    flat = np.full(SHAPE, 70, dtype=np.float32)
    np.testing.assert_allclose(deconvolved(flat, psf, chosen(method), silent()), flat, rtol=1e-5)


def test_a_tapered_image_is_periodic_without_a_step() -> None:
    image = np.random.default_rng(0).random(SHAPE).astype(np.float32)
    image += 10 * np.arange(SHAPE[0])[:, None, None]
    continued, inner = tapered(image, (9, 5, 1))
    np.testing.assert_allclose(continued[inner], image, atol=1e-4)
    for axis in range(3):
        step = continued.take(0, axis) - continued.take(-1, axis)
        assert np.abs(step).max() < 0.02 * np.ptp(image)


def test_a_box_is_deconvolved_with_what_lies_around_it() -> None:
    image = blurred(cell())
    psf = on_voxels(gaussian())
    size = (0.5, 0.2, 0.2)
    box = (slice(8, 30), slice(5, 33), slice(10, 36))
    parameters = chosen("wiener")
    found = read_deconvolved(image, size, box, psf, parameters, silent())
    whole = deconvolved(image, psf, parameters, silent())
    assert found.origin == pytest.approx((4.0, 1.0, 2.0))
    assert error(found.data, whole[box]) < 1.5


def test_a_deconvolution_can_be_stopped_and_reports() -> None:
    event = threading.Event()
    seen: list[str] = []

    def watch(step: str, fraction: float, message: str) -> None:
        seen.append(message)
        if message.endswith("iteration 3"):
            event.set()

    with pytest.raises(Cancelled):
        richardson_lucy(blurred(cell()), on_voxels(gaussian()), 50, Progress(watch, "stack", event))
    assert len(seen) == 3


# The point-spread function -------------------------------------------------------


def test_a_psf_is_centred_and_has_the_sum_one() -> None:
    for shift in (0.0, 2.0, -1.5):
        psf = on_voxels(100 * gaussian(shift=shift))
        assert psf.sum() == pytest.approx(1, abs=1e-5)
        assert all(n % 2 == 1 for n in psf.shape)
        middle = (np.array(psf.shape) - 1) / 2
        np.testing.assert_allclose(ndimage.center_of_mass(psf), middle, atol=0.1)


def test_a_psf_on_other_voxels_is_resampled() -> None:
    fine = gaussian(tuple(2 * s for s in SIGMA), 15)
    psf = on_voxels(fine, (0.5, 0.5, 0.5))
    place = np.indices(psf.shape) - np.reshape((np.array(psf.shape) - 1) / 2, (3, 1, 1, 1))
    spread = [np.sqrt((psf * place[axis] ** 2).sum()) for axis in range(3)]
    np.testing.assert_allclose(spread, SIGMA, rtol=0.05)
    flat = prepared_psf(Volume(gaussian(), UNIT), (2.4, 0.5, 0.5), (36, 80, 88))
    assert flat.shape[0] < flat.shape[1] == flat.shape[2]


def test_what_is_no_psf_is_refused() -> None:
    broken = gaussian()
    broken[2, 3, 4] = np.nan
    with pytest.raises(NotFiniteError, match=r"voxels = 1, of = 3375.*Replace"):
        on_voxels(broken)
    with pytest.raises(InputError, match=r"positive sum.*sum = -.*background"):
        on_voxels(gaussian() - 1)
    with pytest.raises(InputError, match=r"positive sum.*sum = 0"):
        on_voxels(np.zeros((5, 5, 5)))
    with pytest.raises(InputError, match=r"larger than the image.*psf_um.*image_um.*Crop it"):
        on_voxels(gaussian(reach=20))
    with pytest.raises(InputError, match="larger than the image"):
        on_voxels(gaussian(), (3.0, 1.0, 1.0))


def test_a_background_is_warned_of(caplog: pytest.LogCaptureFixture) -> None:
    on_voxels(gaussian())
    assert not caplog.text
    on_voxels(gaussian() + 0.2)
    assert "17 % of its maximum at its border" in caplog.text


def test_a_psf_is_read_with_its_voxel_size(tmp_path: Path) -> None:
    psf = gaussian().astype(np.float32)
    sizes = {"z": 0.3, "y": 0.1, "x": 0.1}
    path = write_image(tmp_path / "psf.ome.tif", psf, "zyx", sizes=sizes)
    found = read_psf(path)
    assert found.voxel_size == pytest.approx((0.3, 0.1, 0.1))
    np.testing.assert_array_equal(found.data, psf)
    unknown = write_image(tmp_path / "unknown.ome.tif", psf, "zyx")
    with pytest.raises(VoxelSizeMissingError, match=r"unknown\.ome\.tif.*stack\.psf_voxel_um"):
        read_psf(unknown)
    assert read_psf(unknown, (0.2, 0.1, 0.1)).voxel_size == (0.2, 0.1, 0.1)
    two = write_image(tmp_path / "two.ome.tif", np.stack([psf, psf]), "czyx", sizes=sizes)
    with pytest.raises(AxesError, match=r"one volume.*czyx"):
        read_psf(two)
    with pytest.raises(FileFormatError, match="no file"):
        read_psf(tmp_path / "none.tif")


# In the segmentation ---------------------------------------------------------------


def test_two_parts_that_the_blur_joins_are_told_apart(tmp_path: Path) -> None:
    """Between a large and a small ball the blurred image is above the threshold."""
    truth = np.full((44, 44, 64), 20.0)
    place = np.indices(truth.shape)

    def ball(centre: tuple[int, int, int], radius: float) -> np.ndarray:
        away = place - np.reshape(centre, (3, 1, 1, 1))
        return (away**2).sum(axis=0) < radius**2

    truth[ball((22, 22, 20), 10)] = 200
    truth[ball((22, 22, 37), 5)] = 200
    image = ndimage.gaussian_filter(truth, SIGMA)
    stack = Stack(image.astype(np.float32), "zyx", UNIT)
    path = write_image(
        tmp_path / "psf.ome.tif",
        gaussian().astype(np.float32),
        "zyx",
        sizes=dict(zip("zyx", UNIT, strict=True)),
    )
    common: dict[str, Any] = {"threshold": "value", "threshold_value": 45, "smoothing_voxels": 0}
    _, plain = segment(stack, StackParameters(**common))
    assert plain["components"] == 1
    assert "deconvolution" not in plain
    for method in METHODS:
        _, report = segment(
            stack,
            chosen(
                method, psf=str(path), wiener_balance=1e-3, richardson_lucy_iterations=30
            ).model_copy(update=common),
        )
        assert report["components"] == 2, method
        assert report["deconvolution"] == method
        assert report["psf_voxels"] == [15, 15, 15]


def test_a_deconvolution_without_a_psf_is_refused() -> None:
    stack = Stack(blurred(cell()), "zyx", UNIT)
    with pytest.raises(ParameterError, match=r"needs a point-spread function.*stack\.psf"):
        segment(stack, chosen("wiener"))
