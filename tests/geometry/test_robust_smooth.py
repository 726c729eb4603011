"""Smoothing that goes on over the seam and the poles, and that outliers do not pull."""

from __future__ import annotations

import numpy as np
import pytest

from napari_unwrap3d.geometry.robust_smooth import box_smooth, continued, robust_smooth
from napari_unwrap3d.unwrapping.uv import pixel_grid, uv_to_direction

ROWS = 32


def directions() -> np.ndarray:
    """A smooth image (N, 2N, 3) on the sphere."""
    return uv_to_direction(pixel_grid(ROWS).reshape(-1, 2), ROWS).reshape(ROWS, 2 * ROWS, 3)


def noisy(level: float = 0.05) -> np.ndarray:
    return directions() + np.random.default_rng(0).normal(0, level, (ROWS, 2 * ROWS, 3))


def error(image: np.ndarray) -> float:
    return float(np.sqrt(((image - directions()) ** 2).sum(axis=2).mean()))


def test_a_constant_stays_what_it_is() -> None:
    image = np.ones((ROWS, 2 * ROWS, 3)) * [1.0, -2.0, 0.5]
    np.testing.assert_allclose(robust_smooth(image)[0], image, atol=1e-12)
    np.testing.assert_allclose(box_smooth(image, 5), image, atol=1e-12)


def test_noise_is_taken_out_and_s_grows_with_it() -> None:
    smooth, s = robust_smooth(noisy())
    assert error(smooth) < 0.35 * error(noisy())
    assert robust_smooth(noisy(0.5))[1] > s > robust_smooth(noisy(0.005))[1]


def test_outliers_do_not_pull() -> None:
    image = noisy(0.02)
    bad = np.random.default_rng(1).random((ROWS, 2 * ROWS)) < 0.05
    image[bad] += [3.0, -4.0, 2.0]
    smooth, _ = robust_smooth(image, s=5.0)
    assert error(smooth) < 0.05
    assert error(box_smooth(image, 5)) > 0.2


def test_a_given_s_is_kept() -> None:
    rough, s = robust_smooth(noisy(), s=0.01)
    assert s == 0.01
    smoother, _ = robust_smooth(noisy(), s=100.0)
    assert np.abs(np.diff(smoother, axis=1)).mean() < np.abs(np.diff(rough, axis=1)).mean()


@pytest.mark.parametrize("smooth", [lambda i: robust_smooth(i, 5.0)[0], lambda i: box_smooth(i, 5)])
def test_seam_and_poles_are_like_any_other_place(smooth) -> None:
    """Turning the image around the axis, or over a pole, turns the result."""
    image = noisy()
    plain = smooth(image)
    np.testing.assert_allclose(np.roll(plain, 7, axis=1), smooth(np.roll(image, 7, axis=1)))
    np.testing.assert_allclose(plain[::-1], smooth(image[::-1].copy()), atol=1e-12)
    single = np.zeros((ROWS, 2 * ROWS, 1))
    single[0, 5] = 1.0
    over = smooth(single)[..., 0]
    assert over[0, 5 + ROWS] > 0.3 * over[1, 5]


def test_the_continued_image_is_periodic() -> None:
    image = directions()
    whole = continued(image)
    assert whole.shape == (2 * ROWS, 2 * ROWS, 3)
    step = np.linalg.norm(np.diff(np.concatenate([whole, whole[:1]]), axis=0), axis=2)
    np.testing.assert_allclose(step, step[0, 0], rtol=1e-9)
