"""Smoothing, background and thresholds."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from napari_unwrap3d.errors import EmptyMaskError, ParameterError
from napari_unwrap3d.imaging.threshold import background, corrected, foreground, threshold_of
from napari_unwrap3d.parameters import StackParameters
from napari_unwrap3d.progress import silent

UNIT = (1.0, 1.0, 1.0)


def three_levels() -> np.ndarray:
    image = np.random.default_rng(0).normal(10, 1, (24, 24, 24))
    image[4:20, 4:20, 4:20] += 40
    image[8:16, 8:16, 8:16] += 100
    return image.astype(np.float32)


def test_thresholds_separate_the_classes() -> None:
    image = three_levels()
    low = threshold_of(image, StackParameters(threshold="multi-otsu", threshold_class=1))
    high = threshold_of(image, StackParameters(threshold="multi-otsu", threshold_class=2))
    assert 12 < low < 48
    assert 52 < high < 148
    assert threshold_of(image, StackParameters(threshold="value", threshold_value=7.5)) == 7.5
    otsu = threshold_of(image, StackParameters())
    assert 12 < otsu < 148


def test_impossible_thresholds_are_refused() -> None:
    flat = np.full((4, 4, 4), 5.0, dtype=np.float32)
    with pytest.raises(EmptyMaskError, match="intensity = 5"):
        threshold_of(flat, StackParameters())
    classes = StackParameters(threshold="multi-otsu", threshold_classes=3, threshold_class=3)
    with pytest.raises(ParameterError, match="threshold_class = 3"):
        threshold_of(three_levels(), classes)
    two = (np.indices((4, 4, 4)).sum(axis=0) % 2).astype(np.float32)
    with pytest.raises(ParameterError, match="too few intensities"):
        threshold_of(two, StackParameters(threshold="multi-otsu", threshold_classes=4))


def test_background_equals_the_smoothing_it_stands_for() -> None:
    image = np.random.default_rng(0).random((40, 50, 60)).astype(np.float32)
    image += np.linspace(0, 3, 60, dtype=np.float32)
    sigma = np.array([6.0, 8.0, 10.0])
    exact = ndimage.gaussian_filter(image, sigma, mode="nearest")
    np.testing.assert_allclose(background(image, sigma), exact, atol=0.05)


def test_a_slope_of_the_background_does_not_decide() -> None:
    image = np.random.default_rng(0).normal(0, 1, (40, 40, 80))
    image += np.linspace(0, 200, 80)
    cell = ((np.indices(image.shape) - np.reshape([20, 20, 30], (3, 1, 1, 1))) ** 2).sum(
        axis=0
    ) < 64
    image[cell] += 60
    plain, _ = foreground(image.astype(np.float32), UNIT, 1.0, StackParameters(), silent())
    chosen = StackParameters(background_um=10.0)
    found, _ = foreground(image.astype(np.float32), UNIT, 1.0, chosen, silent())

    def agreement(mask: np.ndarray) -> float:
        return float((mask & cell).sum() / (mask | cell).sum())

    assert agreement(plain) < 0.1
    assert agreement(found) > 0.7


def test_smoothing_is_in_voxels_of_the_working_grid() -> None:
    image = np.zeros((21, 21, 21), dtype=np.float32)
    image[10, 10, 10] = 1
    chosen = StackParameters(smoothing_voxels=2.0)
    fine = corrected(image, UNIT, 1.0, chosen, silent())
    np.testing.assert_allclose(fine, ndimage.gaussian_filter(image, 2.0, mode="nearest"))
    coarse = corrected(image, (2.0, 2.0, 2.0), 1.0, chosen, silent())
    np.testing.assert_allclose(coarse, ndimage.gaussian_filter(image, 1.0, mode="nearest"))
    assert corrected(image, (9.0, 9.0, 9.0), 1.0, chosen, silent()) is image


def test_the_steepest_level_gives_a_blurred_bright_rim_its_size() -> None:
    radius, rng = 14.0, np.random.default_rng(0)
    away = np.linalg.norm(np.indices((48, 48, 48)) - 23.5, axis=0) - radius
    rim = 1 + 1.2 * np.exp(-0.5 * ((away + 1.5) / 1.5) ** 2)
    image = ndimage.gaussian_filter(np.where(away < 0, 100 * rim, 0.0), 2.5)
    image = (image + rng.normal(12, 3, image.shape)).astype(np.float32)
    values = corrected(image, UNIT, 1.0, StackParameters(), silent())

    def radius_at(threshold: float) -> float:
        return float(np.cbrt((values > threshold).sum() * 3 / (4 * np.pi)))

    edge = radius_at(threshold_of(values, StackParameters(threshold="edge")))
    otsu = radius_at(threshold_of(values, StackParameters(threshold="otsu")))
    assert abs(edge - radius) < 0.7
    assert abs(edge - radius) < 0.7 * abs(otsu - radius)


def test_a_level_that_would_lose_a_part_of_the_cell_is_not_taken() -> None:
    """A bright ball on a dim one: the steepest place of the outline is the bright one's."""
    z, y, x = np.indices((40, 40, 64)) - np.array([19.5, 19.5, 19.5])[:, None, None, None]
    image = np.where(z**2 + y**2 + x**2 < 12**2, 1000.0, 0.0)
    dim = (z**2 + y**2 + (x - 20) ** 2 < 12**2) & (image == 0)
    image[dim] = 620.0
    image = ndimage.gaussian_filter(image, 1.0)
    values = corrected(image.astype(np.float32), UNIT, 1.0, StackParameters(), silent())
    otsu = threshold_of(values, StackParameters(threshold="otsu"))
    edge = threshold_of(values, StackParameters(threshold="edge"))
    whole, kept = (values > otsu).sum(), (values > edge).sum()
    assert abs(kept / whole - 1) < 0.25
