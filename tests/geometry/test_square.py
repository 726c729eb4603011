"""The elliptical grid mapping between the disk and the square."""

from __future__ import annotations

import numpy as np
import pytest

from napari_unwrap3d.geometry.square import (
    disk_from_square,
    pixel_centres,
    pixels_of,
    square_from_disk,
)


@pytest.fixture
def disk_points():
    rng = np.random.default_rng(3)
    radius, angle = np.sqrt(rng.uniform(0, 1, 500)), rng.uniform(0, 2 * np.pi, 500)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def test_there_and_back_again(disk_points):
    np.testing.assert_allclose(
        disk_from_square(square_from_disk(disk_points)), disk_points, atol=1e-9
    )
    square = np.random.default_rng(1).uniform(-1, 1, (500, 2))
    np.testing.assert_allclose(square_from_disk(disk_from_square(square)), square, atol=1e-9)


def test_the_circle_becomes_the_border_of_the_square():
    angle = np.linspace(0, 2 * np.pi, 100)
    square = square_from_disk(np.stack([np.cos(angle), np.sin(angle)], axis=1))
    np.testing.assert_allclose(np.abs(square).max(axis=1), 1.0, atol=1e-7)


def test_a_quarter_turn_and_a_mirror_commute_with_the_mapping(disk_points):
    turned = np.stack([-disk_points[:, 1], disk_points[:, 0]], axis=1)
    square = square_from_disk(disk_points)
    expected = np.stack([-square[:, 1], square[:, 0]], axis=1)
    np.testing.assert_allclose(square_from_disk(turned), expected, atol=1e-12)
    np.testing.assert_allclose(square_from_disk(disk_points * [1, -1]), square * [1, -1])


def test_pixel_centres_are_whole_numbers_row_by_row():
    rows, columns = np.divmod(np.arange(25), 5)
    np.testing.assert_allclose(
        pixels_of(pixel_centres(5), 5), np.stack([rows, columns], axis=1), atol=1e-12
    )
