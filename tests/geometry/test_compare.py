"""Differences between surfaces that are known."""

import numpy as np
import pytest

from napari_unwrap3d.geometry.compare import (
    area_difference,
    chamfer_distance,
    volume_difference,
)
from shapes import icosphere, lumpy, rotation


def test_a_mesh_differs_from_itself_by_nothing() -> None:
    vertices, faces = lumpy(3)
    assert chamfer_distance(vertices, vertices) == 0.0
    assert area_difference(vertices, faces, vertices, faces) == 0.0
    assert volume_difference(vertices, faces, vertices, faces) == 0.0


def test_chamfer_is_the_sum_of_both_mean_distances() -> None:
    first = np.array([[0.0, 0, 0], [10, 0, 0]])
    second = np.array([[0.0, 3, 0], [10, 0, 0], [10, 0, 1], [10, 1, 0]])
    expected = (3 + 0) / 2 + (3 + 0 + 1 + 1) / 4
    assert chamfer_distance(first, second) == pytest.approx(expected)
    assert chamfer_distance(second, first) == pytest.approx(expected)


def test_chamfer_grows_with_the_distance_and_ignores_common_motion() -> None:
    vertices, _ = icosphere(4)
    shells = [chamfer_distance(vertices, scale * vertices) for scale in (1.0, 1.05, 1.2)]
    assert shells[0] < shells[1] < shells[2]
    assert shells[2] == pytest.approx(0.4, rel=0.05)
    turn = rotation(0)
    moved = chamfer_distance(vertices @ turn.T + 3, 1.2 * vertices @ turn.T + 3)
    assert moved == pytest.approx(shells[2], rel=1e-9)


@pytest.mark.parametrize("scale", [0.5, 1.02, 3.0])
def test_areas_and_volumes_of_scaled_bodies(scale: float) -> None:
    vertices, faces = lumpy(2)
    area = area_difference(scale * vertices, faces, vertices, faces)
    volume = volume_difference(scale * vertices, faces, vertices, faces)
    assert area == pytest.approx(scale**2 - 1)
    assert volume == pytest.approx(scale**3 - 1)
