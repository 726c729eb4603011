"""The uv image continues over the seam and the poles as the sphere does."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from napari_unwrap3d.geometry.padding import (
    pad_sphere,
    sample_uv_label,
    sample_uv_linear,
    sample_uv_nearest,
    wrap_uv,
)
from napari_unwrap3d.unwrapping.uv import direction_to_uv, pixel_grid, uv_to_direction
from shapes import directions


def smooth(where: np.ndarray) -> np.ndarray:
    """A smooth function of direction without any symmetry."""
    z, y, x = np.moveaxis(where, -1, 0)
    return z + 0.7 * y - 0.4 * x + 0.8 * x * y - 0.5 * z * x + y**3


def image(rows: int) -> np.ndarray:
    return smooth(uv_to_direction(pixel_grid(rows).reshape(-1, 2), rows)).reshape(rows, -1)


def extended(rows: int, width: int) -> np.ndarray:
    """The function where the padded image has its pixels; the angles run on over the poles."""
    v, u = np.mgrid[-width : rows + width, -width : 2 * rows + width].astype(float)
    where = uv_to_direction(np.stack([v, u], axis=-1).reshape(-1, 2), rows)
    return smooth(where).reshape(v.shape)


@pytest.mark.parametrize("rows", [8, 15, 32])
@pytest.mark.parametrize("width", [1, 3, 8])
def test_a_function_of_direction_is_continued_exactly(rows: int, width: int) -> None:
    padded = pad_sphere(image(rows), width)
    assert padded.shape == (rows + 2 * width, 2 * rows + 2 * width)
    np.testing.assert_allclose(padded, extended(rows, width), atol=1e-12)


def test_padding_keeps_the_image_and_other_axes() -> None:
    stack = np.random.default_rng(0).integers(0, 9, (4, 8, 16, 3))
    padded = pad_sphere(stack, 2, axis=1)
    np.testing.assert_array_equal(padded[:, 2:-2, 2:-2], stack)
    for layer in range(4):
        np.testing.assert_array_equal(padded[layer], pad_sphere(stack[layer], 2))
    assert padded.dtype == stack.dtype
    assert pad_sphere(stack, 0, axis=1) is stack


@settings(max_examples=50)
@given(v=st.floats(-200, 200), u=st.floats(-500, 500), rows=st.sampled_from([8, 33, 64]))
def test_wrapping_keeps_the_direction(v: float, u: float, rows: int) -> None:
    point = np.array([[v, u]])
    wrapped = wrap_uv(point, rows)
    np.testing.assert_allclose(
        uv_to_direction(wrapped, rows), uv_to_direction(point, rows), atol=1e-9
    )
    assert -0.5 <= wrapped[0, 0] <= rows - 0.5
    assert -0.5 <= wrapped[0, 1] <= 2 * rows - 0.5
    np.testing.assert_allclose(wrap_uv(wrapped, rows), wrapped, atol=1e-9)


def test_wrapping_by_hand() -> None:
    given_points = np.array([[0.0, -1], [0, 16], [-1, 3], [8, 3], [3, 15.5], [2, 5], [-0.5, 2]])
    expected = np.array([[0.0, 15], [0, 0], [0, 11], [7, 11], [3, -0.5], [2, 5], [-0.5, 2]])
    np.testing.assert_allclose(wrap_uv(given_points, 8), expected, atol=1e-12)


@settings(max_examples=20)
@given(seed=st.integers(0, 1000))
def test_directions_and_pixels_are_inverse(seed: int) -> None:
    where = directions(200, seed)
    np.testing.assert_allclose(uv_to_direction(direction_to_uv(where, 48), 48), where, atol=1e-12)


def test_bilinear_values_follow_a_smooth_function_over_seam_and_poles() -> None:
    points = np.random.default_rng(0).uniform([-20, -40], [52, 104], (4000, 2))
    errors = []
    for rows in (32, 64):
        scaled = (points + 0.5) * rows / 32 - 0.5
        found = sample_uv_linear(image(rows), scaled)
        errors.append(np.abs(found - smooth(uv_to_direction(scaled, rows))).max())
    assert errors[0] < 0.02
    assert errors[1] < errors[0] / 3.5  # of second order
    at_poles = sample_uv_linear(image(64), np.array([[-0.5, 3.0], [63.5, 90.0]]))
    np.testing.assert_allclose(at_poles, smooth(np.array([[1.0, 0, 0], [-1, 0, 0]])), atol=5e-3)


def test_bilinear_values_at_pixels_are_the_pixels_also_of_vectors() -> None:
    values = np.random.default_rng(0).normal(size=(8, 16, 3))
    points = pixel_grid(8).reshape(-1, 2)
    np.testing.assert_allclose(sample_uv_linear(values, points), values.reshape(-1, 3))
    np.testing.assert_array_equal(sample_uv_nearest(values, points), values.reshape(-1, 3))
    constant = sample_uv_linear(np.full((8, 16), 7, np.uint8), np.array([[-0.4, 15.3]]))
    np.testing.assert_allclose(constant, 7.0)


def test_nearest_takes_the_pixel_that_holds_the_point() -> None:
    labels = np.arange(8 * 16).reshape(8, 16)
    points = np.array([[2.4, 5.4], [2.6, 5.6], [0, -0.6], [0, 15.6], [-0.7, 3], [7.6, 3]])
    rows, columns = [2, 3, 0, 0, 0, 7], [5, 6, 15, 0, 11, 11]
    np.testing.assert_array_equal(sample_uv_nearest(labels, points), labels[rows, columns])


def test_labels_are_chosen_by_bilinear_votes() -> None:
    labels = np.zeros((8, 16), int)
    labels[:, 5] = 1
    labels[4:, 6] = 2
    points = np.array([[2, 5], [2, 5.4], [2, 5.6], [4.4, 5.45], [3.5, 5.5], [7.4, 5.2]])
    np.testing.assert_array_equal(sample_uv_label(labels, points), [1, 1, 0, 1, 1, 1])
    # Three pixels of one label outvote the nearest one of another.
    corner = np.ones((8, 16), int)
    corner[3, 3] = 2
    np.testing.assert_array_equal(sample_uv_label(corner, np.array([[3.4, 3.4]])), [1])


def test_a_pixels_centre_has_its_own_label_also_at_the_seam_and_the_poles() -> None:
    labels = np.random.default_rng(0).integers(0, 5, (8, 16))
    points = pixel_grid(8).reshape(-1, 2)
    np.testing.assert_array_equal(sample_uv_label(labels, points), labels.ravel())
    turned = np.add(points, (0.0, 16.0))
    np.testing.assert_array_equal(sample_uv_label(labels, turned), labels.ravel())
    over = np.array([[-1.0, 3.0], [8.0, 3.0]])
    np.testing.assert_array_equal(sample_uv_label(labels, over), [labels[0, 11], labels[7, 11]])
