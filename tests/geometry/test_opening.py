"""The opened cell against balls and boxes, and the cortex under footprints."""

import numpy as np
import pytest

from napari_unwrap3d.geometry.opening import (
    continued,
    depth,
    largest_radius,
    opening,
    without_tunnels,
)
from shapes import ball, grid, torus

SIZE = 64


@pytest.mark.parametrize("radius", [14.0, 17.3, 20.6])
def test_a_ball_opened_by_a_smaller_one_is_itself(radius: float) -> None:
    solid = ball(radius, SIZE)
    away = np.linalg.norm(grid(SIZE), axis=-1) - radius
    for part in (0.3, 0.5, 0.8):
        opened = opening(depth(solid, part * radius), part * radius)
        near = np.abs(away) < 1
        error = (opened.height - away)[near]
        # Neither too high nor too low by a part of a voxel, wherever the surface lies.
        assert abs(error.mean()) < 0.2
        assert np.abs(error).max() < 0.8


def test_the_depth_is_the_distance_from_the_surface_of_a_slanted_half_space() -> None:
    normal = np.array([1.0, 2.0, 3.0]) / np.sqrt(14)
    level = grid(SIZE) @ normal
    depths = depth(level < 0.3, 10.0)
    inner = (np.linalg.norm(grid(SIZE), axis=-1) < 18) & (level < -9.7) & (level > -13.7)
    error = depths[inner] - (0.3 - level[inner])
    assert np.abs(error).max() < 0.2


def test_the_largest_ball_of_a_box_is_half_its_thickness() -> None:
    solid = np.zeros((40, 40, 40), bool)
    solid[10:31, 5:35, 5:35] = True
    assert largest_radius(solid) == pytest.approx(10.5)


def test_thin_parts_are_high_over_the_opened_cell() -> None:
    solid = ball(16.0, SIZE)
    spike = (np.hypot(*grid(SIZE)[..., 1:].transpose(3, 0, 1, 2)) < 3) & (grid(SIZE)[..., 0] > 0)
    spike &= grid(SIZE)[..., 0] < 28
    opened = opening(depth(solid | spike, 8.0), 8.0)
    tip = np.argwhere(spike)[-1]
    assert opened.height[tuple(tip)] == pytest.approx(27.5 - 16.0, abs=0.8)


def test_the_cortex_under_a_wide_footprint_is_the_body() -> None:
    """A ball of half the body's radius rises by voxels into a neck as wide; the cortex not."""
    points, radius = grid(SIZE), 20.0
    body = np.linalg.norm(points, axis=-1) < radius
    knob = np.linalg.norm(points - [21.0, 0, 0], axis=-1) < 9.0
    solid = body | knob
    opened = opening(depth(solid, 10.0), 10.0)
    # On the axis of the knob the body's surface is at `radius`.
    axis = tuple(np.round(np.array([radius, 0, 0]) + (SIZE - 1) / 2).astype(int))
    expected = np.linalg.norm(points[axis]) - radius
    height = continued(solid, opened, solid & (opened.height > 0.5), 0.5, 4.0)
    assert opened.height[axis] < expected - 1.0
    assert height[axis] == pytest.approx(expected, abs=0.4)


def test_no_protrusions_no_change() -> None:
    solid = ball(15.0, SIZE)
    opened = opening(depth(solid, 7.0), 7.0)
    none = np.zeros(solid.shape, bool)
    assert continued(solid, opened, none, 0.5, 2.0) is opened.height


def test_a_wide_hole_stays_and_a_narrow_one_is_filled() -> None:
    ring = torus(17, 8.0, (SIZE,) * 3)
    np.testing.assert_array_equal(without_tunnels(ring, 4.0), ring)
    solid, hole = ball(20.0, SIZE), np.hypot(*np.moveaxis(grid(SIZE)[..., 1:], -1, 0)) < 2.0
    filled = without_tunnels(solid & ~hole, 9.0)
    assert (solid & ~filled).sum() < 0.3 * (solid & hole).sum()
