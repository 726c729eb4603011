"""Optical flow on the sphere: patterns that turn rigidly, over seam and poles alike."""

from __future__ import annotations

from typing import get_args

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial.transform import Rotation

from napari_unwrap3d.errors import AxesError, InputError
from napari_unwrap3d.tracking.optical_flow import (
    Method,
    SphereFlow,
    directions_of_pixels,
    grey,
    grey_limits,
    in_pixels,
    tangents_at,
)
from napari_unwrap3d.unwrapping.uv import direction_to_uv, pixel_grid

ROWS = 128
PIXEL = np.pi / ROWS
DIRECTIONS = directions_of_pixels(ROWS)
Floats = npt.NDArray[np.float64]


def pattern(directions: Floats) -> Floats:
    """Waves of random directions on the sphere, some ten pixels long."""
    rng = np.random.default_rng(5)
    waves, phases = rng.normal(size=(40, 3)) * 9, rng.uniform(0, 2 * np.pi, 40)
    return np.asarray(np.cos(directions @ waves.T + phases).sum(axis=-1))


def turned(axis: tuple[float, float, float], pixels: float) -> Floats:
    direction = np.array(axis) / np.linalg.norm(axis)
    return Rotation.from_rotvec(direction * pixels * PIXEL).as_matrix()


@pytest.mark.parametrize("method", get_args(Method))
@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0.5, -0.3, 0.8)])
def test_a_turning_sphere(method: Method, axis: tuple[float, float, float]) -> None:
    turn = turned(axis, 2.0)
    images = [pattern(DIRECTIONS), pattern(DIRECTIONS @ turn)]
    limits = grey_limits(images, 0.0)
    found = SphereFlow(ROWS, method).between(*(grey(image, limits) for image in images))
    wrong = np.linalg.norm(found - (DIRECTIONS @ turn.T - DIRECTIONS), axis=-1) / PIXEL
    assert wrong.mean() < 0.15
    # At the poles and at the seam it is as good as elsewhere.
    for part in (wrong[:6], wrong[-6:], wrong[:, :6], wrong[:, -6:]):
        assert part.mean() < 0.4


@pytest.mark.parametrize("method", get_args(Method))
def test_what_stays_does_not_flow(method: Method) -> None:
    image = grey(pattern(DIRECTIONS), (-20.0, 20.0))
    found = SphereFlow(ROWS, method).between(image, image)
    assert np.abs(found).max() < 1e-3 * PIXEL


def test_images_of_another_size_are_refused() -> None:
    small = np.zeros((8, 16), np.uint8)
    with pytest.raises(AxesError):
        SphereFlow(ROWS).between(small, small)


def test_displacements_in_pixels_lead_to_the_place() -> None:
    turn = turned((0.2, 0.9, -0.4), 0.01)
    step = in_pixels(DIRECTIONS @ turn.T - DIRECTIONS, ROWS)
    expected = direction_to_uv((DIRECTIONS @ turn.T).reshape(-1, 3), ROWS).reshape(step.shape)
    moved = expected - pixel_grid(ROWS)
    moved[..., 1] = (moved[..., 1] + ROWS) % (2 * ROWS) - ROWS
    np.testing.assert_allclose(step[8:-8], moved[8:-8], atol=1e-3)


def test_tangents_are_orthonormal_and_point_along_v_and_u() -> None:
    places = np.random.default_rng(0).uniform((0, 0), (ROWS - 1, 2 * ROWS - 1), (50, 2))
    south, east = tangents_at(places, ROWS, (50,))
    start = directions_at(places)
    for axis, step in ((south, (1e-4, 0)), (east, (0, 1e-4))):
        along = directions_at(places + np.array(step)) - start
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        np.testing.assert_allclose(axis, along, atol=1e-4)
        np.testing.assert_allclose(np.einsum("ni,ni->n", axis, start), 0, atol=1e-12)


def directions_at(places: Floats) -> Floats:
    from napari_unwrap3d.unwrapping.uv import uv_to_direction

    return uv_to_direction(places, ROWS)


# 8 bits ---------------------------------------------------------------------------


def test_limits_are_extremes_or_percentiles_of_all_images() -> None:
    images = [np.linspace(0, 1, 1000), np.linspace(1, 2, 1000), np.array([np.nan])]
    assert grey_limits(images, 0.0) == (0.0, 2.0)
    assert grey_limits(images, 5.0) == pytest.approx((0.1, 1.9), abs=2e-3)
    with pytest.raises(InputError):
        grey_limits([np.array([np.nan])], 0.5)


def test_grey_is_linear_and_clipped() -> None:
    image = np.tile(np.linspace(-1, 3, 16), (8, 1))
    found = grey(image, (0.0, 2.0))
    assert found.dtype == np.uint8
    np.testing.assert_array_equal(found, np.rint(255 * np.clip(image / 2, 0, 1)))


def test_unknown_pixels_are_like_the_nearest_over_the_seam() -> None:
    image = np.zeros((16, 32))
    image[:, :2] = 1.0
    image[:, 28:] = np.nan
    found = grey(image, (0.0, 1.0))
    np.testing.assert_array_equal(found[2:-2, 30:], 255)
    np.testing.assert_array_equal(found[2:-2, 28:30], 0)
    np.testing.assert_array_equal(grey(np.full((16, 32), np.nan), (0.0, 1.0)), 0)
