"""Sampling of volumes against scipy and functions it reproduces."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from napari_unwrap3d.geometry.interpolate import sample_linear, sample_nearest

RNG = np.random.default_rng(0)


def test_linear_functions_are_reproduced() -> None:
    z, y, x = np.indices((7, 8, 9)).astype(np.float32)
    points = RNG.uniform([0, 0, 0], [6, 7, 8], (500, 3))
    found = sample_linear(2 * z - 3 * y + 0.5 * x + 4, points)
    np.testing.assert_allclose(found, points @ [2, -3, 0.5] + 4, atol=1e-5)
    assert found.dtype == np.float32


@settings(max_examples=20)
@given(seed=st.integers(0, 1000))
def test_interpolation_is_scipys_also_beyond_the_border(seed: int) -> None:
    rng = np.random.default_rng(seed)
    volume = rng.normal(size=rng.integers(2, 7, 3))
    points = rng.uniform(-3, 9, (200, 3))
    expected = ndimage.map_coordinates(volume, points.T, order=1, mode="nearest")
    np.testing.assert_allclose(sample_linear(volume, points), expected, atol=1e-5)


def test_grid_points_and_corners_are_exact() -> None:
    volume = RNG.normal(size=(4, 5, 6)).astype(np.float32)
    index = np.stack(np.indices(volume.shape), axis=-1).astype(float)
    np.testing.assert_array_equal(sample_linear(volume, index), volume)
    np.testing.assert_array_equal(sample_nearest(volume, index), volume)


@pytest.mark.parametrize("shape", [(1, 5, 6), (4, 1, 1), (1, 1, 1)])
def test_a_single_slice_is_constant_across(shape: tuple[int, int, int]) -> None:
    volume = RNG.normal(size=shape).astype(np.float32)
    points = np.array([[0.0, 0, 0], [0.4, 0, 0], [-1, 0, 0]])
    found = sample_linear(volume, points)
    assert found[0] == found[2] == volume[0, 0, 0]


def test_any_dtype_and_layout_will_do() -> None:
    volume = np.arange(60, dtype=np.uint16).reshape(3, 4, 5)
    points = RNG.uniform(0, 2, (2, 3, 3))
    plain = sample_linear(volume, points)
    assert plain.shape == (2, 3)
    np.testing.assert_array_equal(sample_linear(np.asfortranarray(volume), points), plain)
    np.testing.assert_allclose(sample_linear(volume, points.astype(np.float32)), plain, atol=1e-4)


@settings(max_examples=20)
@given(seed=st.integers(0, 1000))
def test_nearest_takes_the_voxel_that_holds_the_point(seed: int) -> None:
    rng = np.random.default_rng(seed)
    volume = rng.integers(0, 100, (4, 5, 6)).astype(np.uint8)
    index = np.stack([rng.integers(0, n, 300) for n in volume.shape], axis=1)
    points = index + rng.uniform(-0.499, 0.499, index.shape)
    found = sample_nearest(volume, points)
    np.testing.assert_array_equal(found, volume[tuple(index.T)])
    assert found.dtype == np.uint8


def test_nearest_is_clamped_to_the_border() -> None:
    volume = np.arange(24).reshape(2, 3, 4)
    far = np.array([[-5.0, -5, -5], [9, 9, 9], [0, 9, -9]])
    assert sample_nearest(volume, far).tolist() == [0, 23, 8]
