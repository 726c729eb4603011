"""Distances from segments, and looking along a line."""

import numpy as np
import pytest

from napari_unwrap3d.geometry.segments import across, distance_to_segments


@pytest.mark.parametrize("direction", [(1, 0, 0), (0, -2, 0), (0.3, 0.4, -5), (1, 1, 1)])
def test_what_lies_along_a_direction_falls_onto_one_point(direction):
    direction = np.array(direction, float)
    axes = across(direction)
    assert np.allclose(axes @ axes.T, np.eye(2))
    assert np.allclose(axes @ direction, 0)


def test_distances_are_those_of_the_nearest_of_many_points_between_the_ends():
    rng = np.random.default_rng(0)
    starts, ends = rng.normal(size=(2, 20, 3))
    ends[0] = starts[0]
    point = rng.normal(size=3)
    shares = np.linspace(0, 1, 2001)[:, None, None]
    between = starts + shares * (ends - starts)
    expected = np.linalg.norm(between - point, axis=2).min(axis=0)
    assert np.allclose(distance_to_segments(point, starts, ends), expected, atol=1e-3)
