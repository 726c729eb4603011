"""Distance transforms against scipy's."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis.extra.numpy import array_shapes, arrays
from scipy import ndimage

from napari_unwrap3d.geometry.distance import FAR, distance_to, power_distance, signed_distance
from shapes import ball, grid

masks = arrays(bool, array_shapes(min_dims=3, max_dims=3, max_side=9))


@given(mask=masks)
def test_distances_are_scipys(mask: np.ndarray) -> None:
    if mask.any():
        expected = ndimage.distance_transform_edt(~mask)
        np.testing.assert_allclose(distance_to(mask), expected, rtol=1e-6)
    else:
        assert (distance_to(mask) == 1e6).all()


@pytest.mark.parametrize("density", [0.5, 0.01, 0.0005])
def test_distances_in_a_larger_volume_are_scipys(density: float) -> None:
    mask = np.random.default_rng(0).random((30, 41, 52)) < density
    mask[0, 0, 0] = True
    np.testing.assert_allclose(
        distance_to(mask), ndimage.distance_transform_edt(~mask), rtol=1e-6, atol=0
    )


def test_the_mask_is_not_changed_and_any_layout_will_do() -> None:
    mask = np.random.default_rng(1).random((9, 10, 11)) < 0.1
    before = mask.copy()
    plain = distance_to(mask)
    np.testing.assert_array_equal(mask, before)
    np.testing.assert_array_equal(distance_to(mask.transpose(2, 0, 1)), plain.transpose(2, 0, 1))
    np.testing.assert_array_equal(
        distance_to(mask[::-1, :, ::2]), distance_to(mask[::-1, :, ::2].copy())
    )


@given(mask=masks)
def test_signed_distance_is_odd_under_complement(mask: np.ndarray) -> None:
    signed = signed_distance(mask)
    np.testing.assert_array_equal(signed < 0, mask)
    np.testing.assert_array_equal(signed_distance(~mask), -signed)
    assert np.abs(signed).min() >= 0.5


def test_signed_distance_of_a_ball() -> None:
    radius = np.linalg.norm(grid(41), axis=-1)
    signed = signed_distance(ball(13.2, 41))
    assert np.abs(signed - (radius - 13.2)).max() < 1.0


def test_a_full_mask_is_far_from_any_border() -> None:
    full = np.ones((3, 4, 5), bool)
    assert (distance_to(full) == 0).all()
    assert (signed_distance(full) < -1e5).all()


@given(mask=masks)
def test_a_power_distance_is_the_smallest_over_all_voxels(mask: np.ndarray) -> None:
    radius = np.random.default_rng(0).uniform(0, 4, mask.shape)
    weight = np.where(mask, -(radius**2), FAR).astype(np.float32)
    found = power_distance(weight)
    if not mask.any():
        assert (found >= FAR).all()
        return
    place, centre = np.indices(mask.shape).reshape(3, -1).T, np.argwhere(mask)
    squared = ((place[:, None] - centre) ** 2).sum(axis=2) - radius[mask] ** 2
    np.testing.assert_allclose(found.ravel(), squared.min(axis=1), rtol=1e-5, atol=1e-4)
